"""Owns the law of large deflection as a polynomial in the modal amplitudes: its monomials and their coefficients."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from solver.mesh import Floats, Ints
from solver.vonkarman import LargeDeflection, index_pairs


def force_table(law: LargeDeflection) -> Floats:
    """Coefficients of -∂U/∂q on the monomials of the amplitudes.

    U = ½ cᵀ G c + cᵀ H q is a polynomial of the fourth degree, so that its gradient is one of the third. Of the
    products G (pairs × pairs) with pairs and those with amplitudes, many meet in one monomial: n(n+1)(n+2)/6 of those
    are left, a third less work, and a plain matrix-vector product.

    Returns:
        (n, monomials) on q_r q_s q_t, r <= s <= t, t running slowest and r fastest; then, where H is given, on
        q_r q_s, r <= s, s running slower [N/√kg per (m·√kg)³ and (m·√kg)²].
    """
    n = round((np.sqrt(8 * len(law.quartic) + 1) - 1) / 2)
    r, s = index_pairs(n)
    pair = _pair_numbers(n)
    twice = np.where(r == s, 1.0, 2.0)  # how often a pair stands in a sum over both of its modes
    cubes = n * (n + 1) * (n + 2) // 6
    # f_r = 2 Σ_s Σ_p G_(rs)p c_p q_s
    cubic = _gathered(2 * law.quartic[pair] * twice, _cube_places(n), cubes)
    if not len(law.cubic):
        return -cubic
    # f_r = 2 Σ_s Σ_k H_(rs)k q_k q_s + Σ_p c_p H_pr
    places = _square_places(n)
    square = _gathered(2 * law.cubic[pair], places, len(r))
    square[:, places[r, s]] += (law.cubic * twice[:, None]).T
    return -np.hstack([cubic, square])


def monomials(q: Floats, squares: bool) -> Floats:
    """(monomials,) of amplitudes q (n,) in the order of `force_table`, with the squares or without: the plain form."""
    upper = np.arange(len(q))
    triples = [q[i] * q[j] * q[k] for k in upper for j in range(k + 1) for i in range(j + 1)]
    pairs = [q[i] * q[j] for j in upper for i in range(j + 1)]
    return np.array(triples + pairs if squares else triples)


def _gathered(terms: Floats, places: Ints, size: int) -> Floats:
    """(n, size) sums of terms (n, …) by the monomials that they belong to (…)."""
    n = len(terms)
    rows = np.arange(n).reshape(-1, *[1] * places.ndim) * size
    return np.bincount((rows + places).ravel(), terms.ravel(), n * size).astype(float, copy=False).reshape(n, size)


@lru_cache(maxsize=8)
def _pair_numbers(n: int) -> Ints:
    """(n, n) number of each pair in the order of `index_pairs`."""
    numbers = np.zeros((n, n), dtype=np.intp)
    r, s = index_pairs(n)
    numbers[r, s] = numbers[s, r] = np.arange(len(r))
    return numbers


@lru_cache(maxsize=8)
def _square_places(n: int) -> Ints:
    """(n, n) place of q_r q_s among the squares."""
    low, high = np.sort(np.indices((n, n)), axis=0)
    return high * (high + 1) // 2 + low


@lru_cache(maxsize=8)
def _cube_places(n: int) -> Ints:
    """(n, pairs) place of q_s times a pair's product among the cubes."""
    r, s = index_pairs(n)
    three = np.stack(np.broadcast_arrays(np.arange(n)[:, None], r, s))
    low, middle, high = np.sort(three, axis=0)
    return high * (high + 1) * (high + 2) // 6 + middle * (middle + 1) // 2 + low
