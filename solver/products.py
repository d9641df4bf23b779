"""Owns the compiled products of integration: small vectors within long arrays, monomials, and products that add up.

Arguments named `at` and `to` say where in an array a vector begins: to cut out a view costs as much as a small product.
They are unsigned, and so is what they are added to: a signed index may count from the end, and the question whether it
does keeps loops from being vectorised. Callers are trusted with the sizes, as with all compiled code here.
"""

from __future__ import annotations

import numba
import numpy as np

from solver.mesh import Floats

# Sums may be reordered so that they vectorise; NaN and infinity keep their meaning, divergence is detected by them.
FAST = {"reassoc", "contract", "nsz", "arcp"}
U = np.uintp
Index = int | np.uintp


@numba.njit(cache=True, fastmath=FAST)
def fill_monomials(x: Floats, at: Index, n: Index, out: Floats, to: Index) -> None:
    """Monomials of n amplitudes into `out`, in the order of `polynomial.force_table`.

    Those of which q_t is the last are q_t times all pairs of the amplitudes up to it: the head of the list of pairs,
    which is kept where the squares go, or would.
    """
    at, n, to = U(at), U(n), U(to)
    pairs = to + n * (n + U(1)) * (n + U(2)) // U(6)
    place = pairs
    for s in range(n):
        v = x[at + s]
        for r in range(s + U(1)):
            out[place + r] = x[at + r] * v
        place += s + U(1)
    place, count = to, U(0)
    for t in range(n):
        v = x[at + t]
        count += t + U(1)
        for k in range(count):
            out[place + k] = out[pairs + k] * v
        place += count


@numba.njit(cache=True, fastmath=FAST)
def multiply(matrix: Floats, x: Floats, at: Index, start: Floats, out: Floats, to: Index) -> None:
    """`start` + matrix (rows, k) · x into `out`; four rows at a time share what is read of x."""
    at, to, rows, size = U(at), U(to), U(matrix.shape[0]), U(matrix.shape[1])
    r = U(0)
    while r + U(4) <= rows:
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for k in range(size):
            v = x[at + k]
            a += matrix[r, k] * v
            b += matrix[r + U(1), k] * v
            c += matrix[r + U(2), k] * v
            d += matrix[r + U(3), k] * v
        out[to + r] = start[r] + a
        out[to + r + U(1)] = start[r + U(1)] + b
        out[to + r + U(2)] = start[r + U(2)] + c
        out[to + r + U(3)] = start[r + U(3)] + d
        r += U(4)
    while r < rows:
        a = 0.0
        for k in range(size):
            a += matrix[r, k] * x[at + k]
        out[to + r] = start[r] + a
        r += U(1)


@numba.njit(cache=True, fastmath=FAST)
def multiply_two(matrix: Floats, x: Floats, also: Index, start: Floats, out: Floats, too: Index) -> None:
    """As `multiply` for two vectors at once, at 0 and `also`, to 0 and `too`: the matrix is read only once."""
    also, too, rows, size = U(also), U(too), U(matrix.shape[0]), U(matrix.shape[1])
    r = U(0)
    while r + U(4) <= rows:
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        e, f, g, h = 0.0, 0.0, 0.0, 0.0
        for k in range(size):
            v, w = x[k], x[also + k]
            m = matrix[r, k]
            a += m * v
            e += m * w
            m = matrix[r + U(1), k]
            b += m * v
            f += m * w
            m = matrix[r + U(2), k]
            c += m * v
            g += m * w
            m = matrix[r + U(3), k]
            d += m * v
            h += m * w
        out[r], out[too + r] = start[r] + a, start[r] + e
        out[r + U(1)], out[too + r + U(1)] = start[r + U(1)] + b, start[r + U(1)] + f
        out[r + U(2)], out[too + r + U(2)] = start[r + U(2)] + c, start[r + U(2)] + g
        out[r + U(3)], out[too + r + U(3)] = start[r + U(3)] + d, start[r + U(3)] + h
        r += U(4)
    while r < rows:
        a, e = 0.0, 0.0
        for k in range(size):
            a += matrix[r, k] * x[k]
            e += matrix[r, k] * x[also + k]
        out[r], out[too + r] = start[r] + a, start[r] + e
        r += U(1)


@numba.njit(cache=True, fastmath=FAST)
def add_product(columns: Floats, x: Floats, at: Index, out: Floats, to: Index) -> None:
    """Add matrix · x to `out`, of a matrix with many rows and few columns that is kept as columns (k, rows)."""
    at, to, size, rows = U(at), U(to), U(columns.shape[0]), U(columns.shape[1])
    k = U(0)
    while k + U(4) <= size:
        a, b, c, d = x[at + k], x[at + k + U(1)], x[at + k + U(2)], x[at + k + U(3)]
        for r in range(rows):
            out[to + r] += (
                columns[k, r] * a + columns[k + U(1), r] * b + columns[k + U(2), r] * c + columns[k + U(3), r] * d
            )
        k += U(4)
    while k < size:
        a = x[at + k]
        for r in range(rows):
            out[to + r] += columns[k, r] * a
        k += U(1)
