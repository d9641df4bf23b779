"""Owns the solution of symmetric positive definite sparse systems, in LAPACK's banded storage where that is fastest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from solver.mesh import Floats

WIDEST = 0.4  # of the size: a straight edge along x ties the whole mesh together, and bands would be all of the matrix


def definite_solver(matrix: sp.csr_array) -> Callable[[Floats], Floats]:
    """Factorise a symmetric positive definite matrix (n, n); gives the function b (n, …) -> its solution.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    entries = matrix.tocoo()
    row, column = entries.coords
    width, size = int(np.max(column - row, initial=0)), matrix.shape[0]
    if width > WIDEST * size > 400:
        factor = spla.splu(matrix.tocsc())
        if not np.all(np.isfinite(factor.U.diagonal())):
            raise np.linalg.LinAlgError("singular")
        return lambda b: factor.solve(np.ascontiguousarray(b))
    bands = np.zeros((width + 1, size))
    upper = column >= row
    bands[width + row[upper] - column[upper], column[upper]] = entries.data[upper]
    cholesky = scipy.linalg.cholesky_banded(bands)
    return lambda b: scipy.linalg.cho_solve_banded((cholesky, False), b)
