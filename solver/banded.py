"""Owns the solution of symmetric positive definite sparse systems, in LAPACK's banded storage where that is fastest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.linalg import lapack

from solver.mesh import Floats
from solver.pattern import Pattern

WIDEST = 0.4  # of the size: a straight edge along x ties the whole mesh together, and bands would be all of the matrix


@dataclass(frozen=True)
class Cholesky:
    """K = UᵀU of order n, in bands."""

    upper: Floats
    """(width + 1, n) bands of U [square root of K's unit]."""

    @staticmethod
    def of(bands: Floats) -> Cholesky:
        """Factorise upper bands (width + 1, n).

        Raises:
            numpy.linalg.LinAlgError: the matrix is not positive definite.
        """
        upper, info = lapack.dpbtrf(bands)
        if info:
            raise np.linalg.LinAlgError("not positive definite")
        return Cholesky(upper)

    def solve(self, b: Floats) -> Floats:
        """K⁻¹b of b (n, …)."""
        return lapack.dpbtrs(self.upper, b)[0]

    def half(self, b: Floats) -> Floats:
        """U⁻ᵀb of b (n, k): of two such, the products are those with K⁻¹ between them."""
        return lapack.dtbtrs(self.upper, b, trans="T")[0]


def definite_solver(matrix: sp.csr_array) -> Callable[[Floats], Floats]:
    """Factorise a symmetric positive definite matrix (n, n); gives the function b (n, …) -> its solution.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    entries = matrix.tocoo()
    row, column = entries.coords
    width, size = int(np.max(column - row, initial=0)), matrix.shape[0]
    if _too_wide(width, size):
        try:  # without pivoting off the diagonal: the pivots of a definite matrix, and of no other, are all positive
            factor = spla.splu(
                matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None
        if not np.all(factor.U.diagonal() > 0):
            raise np.linalg.LinAlgError("not positive definite")
        return lambda b: factor.solve(np.ascontiguousarray(b))
    bands = np.zeros((width + 1, size))
    upper = column >= row
    bands[width + row[upper] - column[upper], column[upper]] = entries.data[upper]
    cholesky = scipy.linalg.cholesky_banded(bands)
    return lambda b: scipy.linalg.cho_solve_banded((cholesky, False), b)


def compliance_products(pattern: Pattern, blocks: Floats, forces: Floats, others: Floats) -> Floats:
    """(p, p + q) products FᵀK⁻¹(F, G) of forces F (n, p) and G (n, q) through what they displace.

    Args:
        pattern: where the elements' matrices land in K.
        blocks: (elements, k, k) those, symmetric, such that K is positive definite.
        forces: F.
        others: G.

    Raises:
        numpy.linalg.LinAlgError: K is not positive definite.
    """
    both = np.hstack([forces, others]) if others.shape[1] else forces
    if not pattern.size:
        return np.zeros((forces.shape[1], both.shape[1]))
    if _too_wide(pattern.width, pattern.size):
        return definite_solver(pattern.matrix(blocks))(forces).T @ both
    half = Cholesky.of(pattern.bands(blocks)).half(both)
    return half[:, : forces.shape[1]].T @ half


def _too_wide(width: int, size: int) -> bool:
    return width > WIDEST * size > 400
