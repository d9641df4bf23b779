"""Owns the shape functions: Bogner-Fox-Schmit (bicubic Hermite) for w, bilinear for u and v, and Gauss points."""

from __future__ import annotations

import numpy as np

from solver.mesh import Floats, Mesh


def gauss(points: int) -> tuple[Floats, Floats]:
    """Gauss-Legendre points and weights on [0, 1], each (points,)."""
    x, weight = np.polynomial.legendre.leggauss(points)
    return (x + 1) / 2, weight / 2


def hermite(s: Floats, size: float, derivative: int) -> Floats:
    """Cubic Hermite functions on an element of the given size.

    Args:
        s: (p,) positions on [0, 1].
        size: element size [m].
        derivative: order of the derivative with respect to x = s·size, 0 to 2.

    Returns:
        (p, 4) functions of (value, slope) at the left node, then at the right.
    """
    cubics = np.array([[1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]], dtype=float)
    scale = np.array([1, size, 1, size])
    coefficients = np.polynomial.polynomial.polyder(cubics.T, derivative)
    return np.polynomial.polynomial.polyval(s, coefficients).T * scale / size**derivative


def linear(s: Floats, size: float, derivative: int) -> Floats:
    """Linear functions of the left and right node and, with derivative = 1, their slopes: (p, 2)."""
    if derivative == 0:
        return np.column_stack([1 - s, s])
    return np.tile([-1 / size, 1 / size], (len(s), 1))


def bending_shape(mesh: Mesh, s: Floats, t: Floats, dx: int = 0, dy: int = 0) -> Floats:
    """BFS functions, or their (dx, dy) derivative, on the tensor grid of positions s × t in an element.

    The 16 functions are ordered (node in x, derivative in x, node in y, derivative in y), as `Mesh.bending_dofs`.

    Returns:
        (len(s)·len(t), 16), t running fastest.
    """
    return np.kron(hermite(s, mesh.hx, dx), hermite(t, mesh.hy, dy))


def inplane_shape(mesh: Mesh, s: Floats, t: Floats, dx: int = 0, dy: int = 0) -> Floats:
    """Bilinear functions, or their derivative, on the tensor grid of positions s × t: (len(s)·len(t), 4)."""
    return np.kron(linear(s, mesh.hx, dx), linear(t, mesh.hy, dy))


def membrane_strain(mesh: Mesh, s: Floats) -> Floats:
    """(3, len(s)², 8) strain ε = (u,x, v,y, u,y + v,x) of the in-plane dofs on the tensor grid of positions s × s."""
    strain = np.zeros((3, len(s) ** 2, 8))
    strain[0, :, :4] = strain[2, :, 4:] = inplane_shape(mesh, s, s, 1, 0)
    strain[1, :, 4:] = strain[2, :, :4] = inplane_shape(mesh, s, s, 0, 1)
    return strain
