"""Owns the compiled loop over pairs of modes: their strains in large deflection, and the in-plane forces of these."""

from __future__ import annotations

import numba

from solver.mesh import Floats, Ints
from solver.products import FAST


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def pair_strains(
    slope_x: Floats,
    slope_y: Floats,
    root: Floats,
    weight: Floats,
    displaced: Floats,
    number: Ints,
    first: Ints,
    end: Ints,
    strains: Floats,
    forces: Floats,
) -> None:
    """Fill `strains` with Lᵀ e √weight of pairs of modes, e = ½ (w,x w,x, w,y w,y, w,x w,y + w,y w,x); add to `forces`.

    Args:
        slope_x: (n, elements, points) w,x of the modes.
        slope_y: (n, elements, points) w,y likewise.
        root: (elements, 3, 3) L of the elements' A = L Lᵀ.
        weight: (elements, points) √weight.
        displaced: (elements, 8, 3·points) Lᵀ ε √weight of unit in-plane dofs of the element.
        number: (elements, 8) where their forces belong; -1 of a dof that is held.
        first: (n,) the first mode that each pairs with.
        end: (n,) one past the last.
        strains: (pairs, elements·3·points or more) in the order of first and end.
        forces: (pairs, size) the work of the strains on those dofs.
    """
    elements, points = weight.shape
    pair = 0
    for r in range(len(first)):
        for s in range(first[r], end[r]):
            for e in range(elements):
                strain = strains[pair, 3 * points * e : 3 * points * (e + 1)]
                for i in range(3):
                    xx, yy, xy = root[e, 0, i] / 2, root[e, 1, i] / 2, root[e, 2, i] / 2
                    for g in range(points):
                        x, y, other_x, other_y = slope_x[r, e, g], slope_y[r, e, g], slope_x[s, e, g], slope_y[s, e, g]
                        square = xx * x * other_x + yy * y * other_y + xy * (x * other_y + y * other_x)
                        strain[points * i + g] = weight[e, g] * square
                for k in range(8):
                    if number[e, k] >= 0:
                        work = 0.0
                        for g in range(3 * points):
                            work += displaced[e, k, g] * strain[g]
                        forces[pair, number[e, k]] += work
            pair += 1
