"""Owns the von Kármán forces of the elements and their tangents: compiled loops over elements and Gauss points."""

from __future__ import annotations

import numba
import numpy as np

from solver.mesh import Floats, Ints
from solver.products import FAST


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def membrane_forces(
    local: Floats,
    extension: Floats,
    coupling: Floats,
    slope_x: Floats,
    slope_y: Floats,
    strain: Floats,
    curvature: Floats,
    weights: Floats,
    forces: Floats,
    stresses: Floats,
) -> None:
    """Gradient of ∫ ½ εᵀ A ε + εᵀ B κ dA of every element, ε = B_m u + ½ (w,x², w,y², 2 w,x w,y).

    The part of the internal force that stretching has a share in; ∫ ½ κᵀ D κ is linear and assembled apart. With
    N = A ε + B κ the variation is ∫ (B_m δu + (w,x δw,x, w,y δw,y, w,x δw,y + w,y δw,x))ᵀ N + δκᵀ Bᵀ ε dA (Reddy,
    Mechanics of Laminated Composite Plates and Shells, 2004, section 10.4).

    Args:
        local: (elements, 24) bending dofs (16), then in-plane dofs (8) of each element.
        extension: (elements, 3, 3) A [N/m].
        coupling: (elements, 3, 3) B [N], or (0, 3, 3) where it is zero.
        slope_x: (points, 16) N,x at the Gauss points.
        slope_y: (points, 16) N,y.
        strain: (3, points, 8) B_m.
        curvature: (3, points, 16) κ.
        weights: (points,) weights times area [m²].
        forces: (elements, 24) filled with the forces, in the order of the dofs.
        stresses: (elements, points, 3) filled with N [N/m].
    """
    coupled = coupling.shape[0] > 0
    bent = np.zeros(3)
    extended = np.empty(3)
    for e in range(local.shape[0]):
        forces[e] = 0.0
        for g in range(weights.size):
            wx = wy = 0.0
            bent[:] = 0.0
            extended[:] = 0.0
            for i in range(16):
                wx += slope_x[g, i] * local[e, i]
                wy += slope_y[g, i] * local[e, i]
            for a in range(3):
                for i in range(8):
                    extended[a] += strain[a, g, i] * local[e, 16 + i]
                if coupled:
                    for i in range(16):
                        bent[a] += curvature[a, g, i] * local[e, i]
            extended[0] += 0.5 * wx * wx
            extended[1] += 0.5 * wy * wy
            extended[2] += wx * wy
            for a in range(3):
                total = 0.0
                for b in range(3):
                    total += extension[e, a, b] * extended[b]
                    if coupled:
                        total += coupling[e, a, b] * bent[b]
                stresses[e, g, a] = total
            nx, ny, nxy = stresses[e, g] * weights[g]
            along, across = nx * wx + nxy * wy, ny * wy + nxy * wx
            for i in range(16):
                forces[e, i] += slope_x[g, i] * along + slope_y[g, i] * across
            for i in range(8):
                forces[e, 16 + i] += strain[0, g, i] * nx + strain[1, g, i] * ny + strain[2, g, i] * nxy
            if coupled:
                for a in range(3):
                    moment = 0.0
                    for b in range(3):
                        moment += coupling[e, b, a] * extended[b]
                    for i in range(16):
                        forces[e, i] += curvature[a, g, i] * moment * weights[g]


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def membrane_tangents(
    local: Floats,
    stresses: Floats,
    extension: Floats,
    coupling: Floats,
    slope_x: Floats,
    slope_y: Floats,
    strain: Floats,
    curvature: Floats,
    weights: Floats,
    tangents: Floats,
) -> None:
    """Add the derivative of `membrane_forces` by the dofs: ∫ Eᵀ A E + Eᵀ B κ + κᵀ Bᵀ E + N : δ∇w δ∇w dA.

    Args:
        local: (elements, 24) as in `membrane_forces`.
        stresses: (elements, points, 3) N that it gave [N/m].
        extension: as there.
        coupling: as there.
        slope_x: as there.
        slope_y: as there.
        strain: as there.
        curvature: as there.
        weights: as there.
        tangents: (elements, 24, 24) to which the tangents are added; symmetric.
    """
    coupled = coupling.shape[0] > 0
    varied = np.zeros((3, 24))  # E: strain a unit of each dof
    resultant = np.zeros((3, 24))  # N a unit of each dof
    moment = np.zeros((3, 24))  # Bᵀ E
    along = np.zeros(16)
    across = np.zeros(16)
    for e in range(local.shape[0]):
        tangent = tangents[e]
        for g in range(weights.size):
            wx = wy = 0.0
            for i in range(16):
                wx += slope_x[g, i] * local[e, i]
                wy += slope_y[g, i] * local[e, i]
            nx, ny, nxy = stresses[e, g] * weights[g]
            for i in range(16):
                varied[0, i] = slope_x[g, i] * wx
                varied[1, i] = slope_y[g, i] * wy
                varied[2, i] = slope_x[g, i] * wy + slope_y[g, i] * wx
                along[i] = nx * slope_x[g, i] + nxy * slope_y[g, i]
                across[i] = ny * slope_y[g, i] + nxy * slope_x[g, i]
            for a in range(3):
                for i in range(8):
                    varied[a, 16 + i] = strain[a, g, i]
            for a in range(3):
                for i in range(24):
                    total = 0.0
                    for b in range(3):
                        total += extension[e, a, b] * varied[b, i]
                    resultant[a, i] = total * weights[g]
                if coupled:
                    for i in range(16):
                        for b in range(3):
                            resultant[a, i] += coupling[e, a, b] * curvature[b, g, i] * weights[g]
                    for i in range(24):
                        total = 0.0
                        for b in range(3):
                            total += coupling[e, b, a] * varied[b, i]
                        moment[a, i] = total * weights[g]
            for i in range(24):
                for j in range(24):
                    tangent[i, j] += (
                        varied[0, i] * resultant[0, j] + varied[1, i] * resultant[1, j] + varied[2, i] * resultant[2, j]
                    )
            for i in range(16):
                for j in range(16):
                    tangent[i, j] += slope_x[g, i] * along[j] + slope_y[g, i] * across[j]
                if coupled:
                    for a in range(3):
                        for j in range(24):
                            tangent[i, j] += curvature[a, g, i] * moment[a, j]


@numba.njit(cache=True, nogil=True)
def gather(values: Floats, number: Ints, local: Floats) -> None:
    """Fill local (elements, k) with values (unknowns,) by their numbers (elements, k); zero where that is -1."""
    for e in range(number.shape[0]):
        for i in range(number.shape[1]):
            local[e, i] = values[number[e, i]] if number[e, i] >= 0 else 0.0


@numba.njit(cache=True, nogil=True)
def scatter_add(local: Floats, number: Ints, total: Floats) -> None:
    """Add local (elements, k) into total (unknowns,) by their numbers (elements, k), leaving out those of -1."""
    for e in range(number.shape[0]):
        for i in range(number.shape[1]):
            if number[e, i] >= 0:
                total[number[e, i]] += local[e, i]
