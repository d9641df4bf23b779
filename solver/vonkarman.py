"""Owns the law of large deflection: von Kármán membrane energy with the in-plane field condensed out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.assembly import STIFFNESS_POINTS, PlateMatrices, scatter
from solver.banded import definite_solver
from solver.bfs import bending_shape, gauss, membrane_strain
from solver.mesh import Floats

# A side. 7 points would be exact (degree 12). 4 are within 1e-5 of that for the modes (m,1) that carry flutter, and
# within 0.3 % for the highest of 24, which a limit cycle does not notice (tests/test_vonkarman.py measures both).
CUBIC_POINTS = STIFFNESS_POINTS


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


def condensed_energy(plate: PlateMatrices, modes: Floats, points: int = CUBIC_POINTS) -> LargeDeflection:
    """Membrane energy of large deflection with the in-plane field condensed out.

    With w = Σ q_r φ_r the von Kármán strain is ε = B u + Σ c_p e_p and the curvature κ = Σ q_r κ_r. In-plane inertia is
    neglected, so that u minimises the energy ½ ∫ εᵀ A ε + 2 εᵀ B κ, which leaves G = EᵀAE - gᵀ K_m⁻¹ g and
    H = EᵀBκ - gᵀ K_m⁻¹ K_mb Φ with g = ∫ Bᵀ A e. This is the seed's (2.21) written as an energy.

    Args:
        plate: the plate of the design.
        modes: (free dofs, modes) bending shapes.
        points: Gauss points a side of an element.
    """
    space, mesh = plate.space, plate.space.mesh
    s, weight = gauss(points)
    weights = np.kron(weight, weight) * mesh.hx * mesh.hy
    local = space.expand(modes)[mesh.bending_dofs]  # (elements, 16, modes)
    slope_x = bending_shape(mesh, s, s, 1, 0) @ local  # (elements, points², modes)
    slope_y = bending_shape(mesh, s, s, 0, 1) @ local
    r, t = index_pairs(modes.shape[1])
    strain = np.empty((mesh.elements, 3, len(weights), len(r)))
    np.multiply(slope_x[..., r], slope_x[..., t], out=strain[:, 0])
    np.multiply(slope_y[..., r], slope_y[..., t], out=strain[:, 1])
    np.add(slope_x[..., r] * slope_y[..., t], slope_y[..., r] * slope_x[..., t], out=strain[:, 2])

    # A = LᵀL an element turns both products below into one symmetric one each
    root = np.linalg.cholesky(plate.laminate.extension).transpose(0, 2, 1)
    scaled = np.matmul(root, strain.reshape(mesh.elements, 3, -1)).reshape(strain.shape)
    scaled *= 0.5 * np.sqrt(weights)[:, None]
    rows = scaled.reshape(-1, len(r))

    displacement = membrane_strain(mesh, s) * np.sqrt(weights)[:, None]
    rooted = np.einsum("eab,bgi->eiag", root, displacement).reshape(mesh.elements, 8, -1)
    pull = np.matmul(rooted, scaled.reshape(mesh.elements, -1, len(r)))
    force = scatter(mesh.inplane_unknowns[mesh.inplane_dofs], pull, space.inplane.size)

    displaced = definite_solver(plate.membrane)(force)
    energy = rows.T @ rows - force.T @ displaced
    cubic = np.zeros((0, modes.shape[1]))
    if plate.coupling is not None:
        curvature = -np.stack([bending_shape(mesh, s, s, *d) for d in ((2, 0), (0, 2))])
        curvature = np.concatenate([curvature, -2 * bending_shape(mesh, s, s, 1, 1)[None]]) @ local[:, None]
        stress = np.linalg.solve(
            root.transpose(0, 2, 1), plate.laminate.coupling @ curvature.reshape(mesh.elements, 3, -1)
        ).reshape(curvature.shape)
        stress *= np.sqrt(weights)[:, None]
        cubic = rows.T @ stress.reshape(len(rows), -1) - displaced.T @ (plate.coupling @ modes)
    return LargeDeflection((energy + energy.T) / 2, cubic)


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
