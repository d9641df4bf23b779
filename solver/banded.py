"""Owns the bridge from sparse matrices to LAPACK's banded storage, in which plates on a grid factorise fastest."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from solver.mesh import Floats


def upper_bands(matrix: sp.csr_array) -> Floats:
    """The upper triangle of a symmetric matrix (n, n) in LAPACK's banded form (bandwidth + 1, n)."""
    entries = matrix.tocoo()
    row, column = entries.coords
    width = int(np.max(column - row, initial=0))
    bands = np.zeros((width + 1, matrix.shape[0]))
    upper = column >= row
    bands[width + row[upper] - column[upper], column[upper]] = entries.data[upper]
    return bands
