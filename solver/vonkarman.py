"""Owns the law of large deflection: von Kármán membrane energy of modal amplitudes, its force and its tangent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.mesh import Floats


def index_pairs(modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Mode indices (r, s), r <= s, of the n(n+1)/2 pairs in the order that the cubic law uses."""
    return np.triu_indices(modes)


def pair_products(q: Floats) -> Floats:
    """(…, pairs) products c_(rs) = (2 - δ_rs) q_r q_s of modal amplitudes (…, modes)."""
    r, s = index_pairs(q.shape[-1])
    return q[..., r] * q[..., s] * np.where(r == s, 1.0, 2.0)


@dataclass(frozen=True)
class LargeDeflection:
    """What the membrane adds to the energy of n modes: U = ½ cᵀ G c + cᵀ H q over pairs c = `pair_products(q)`."""

    quartic: Floats
    """(pairs, pairs) G, symmetric positive semidefinite [J per (kg·m²)² for mass-normalised modes]."""
    cubic: Floats
    """(pairs, n) H of a lay-up with B ≠ 0 [J per (kg·m²)^1.5]; (0, n) where B = 0."""


def membrane_force(law: LargeDeflection, q: Floats) -> Floats:
    """(n,) gradient of U at amplitudes q (n,): the plain form of the kernel's law.

    With stresses S = G c + H q a pair, f_r = 2 Σ_s S_(rs) q_s + (cᵀ H)_r.
    """
    pairs = pair_products(q)
    stress = law.quartic @ pairs
    if not len(law.cubic):
        return 2 * _square(stress, len(q)) @ q
    return 2 * _square(stress + law.cubic @ q, len(q)) @ q + pairs @ law.cubic


def membrane_tangent(law: LargeDeflection, q: Floats) -> Floats:
    """(n, n) derivative of `membrane_force` by q, the tangent stiffness of the membrane; symmetric."""
    n = len(q)
    r, s = index_pairs(n)
    # ∂c/∂q of pair (r, s): twice q_s in column r and twice q_r in column s, which on the diagonal fall together
    slope = np.zeros((len(r), n))
    np.add.at(slope, (np.arange(len(r)), r), np.where(r == s, 1.0, 2.0) * q[s])
    np.add.at(slope, (np.arange(len(r)), s), np.where(r == s, 1.0, 2.0) * q[r])
    stress = law.quartic @ pair_products(q)
    tangent = slope.T @ law.quartic @ slope
    if len(law.cubic):
        stress = stress + law.cubic @ q
        mixed = slope.T @ law.cubic
        tangent += mixed + mixed.T
    return tangent + 2 * _square(stress, n)


def _square(pairs: Floats, n: int) -> Floats:
    """The symmetric matrix (n, n) whose upper triangle is given as (pairs,)."""
    matrix = np.zeros((n, n))
    r, s = index_pairs(n)
    matrix[r, s] = matrix[s, r] = pairs
    return matrix
