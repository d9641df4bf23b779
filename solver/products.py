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
def fill_monomials(x: Floats, at: Index, n: Index, unit: float, out: Floats, to: Index) -> None:
    """Monomials of n amplitudes over a unit into `out`, in its precision and the order of `polynomial.force_table`.

    Those of which q_t is the last are q_t times all pairs of the amplitudes up to it: the head of the list of pairs,
    which is kept where the squares go, or would.
    """
    convert, scale = out.dtype.type, 1.0 / unit
    at, n, to = U(at), U(n), U(to)
    pairs = to + n * (n + U(1)) * (n + U(2)) // U(6)
    place = pairs
    for s in range(n):
        v = convert(x[at + s] * scale)
        for r in range(s + U(1)):
            out[place + r] = convert(x[at + r] * scale) * v
        place += s + U(1)
    place, count = to, U(0)
    for t in range(n):
        v = convert(x[at + t] * scale)
        count += t + U(1)
        for k in range(count):
            out[place + k] = out[pairs + k] * v
        place += count


@numba.njit(cache=True, fastmath=FAST)
def multiply(matrix: Floats, x: Floats, at: Index, start: Floats, out: Floats, to: Index) -> None:
    """`start` + matrix (rows, k) · x into `out`; four rows at a time share what is read of x.

    Summed up in the precision of the matrix, which should be that of x.
    """
    at, to, rows, size = U(at), U(to), U(matrix.shape[0]), U(matrix.shape[1])
    r, zero = U(0), matrix.dtype.type(0.0)
    while r + U(4) <= rows:
        a, b, c, d = zero, zero, zero, zero
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
        a = zero
        for k in range(size):
            a += matrix[r, k] * x[at + k]
        out[to + r] = start[r] + a
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
