"""Definite systems: solved as by a dense method, on a narrow band and on a wide one, and refused if not definite."""

import numpy as np
import pytest
import scipy.sparse as sp

from solver.banded import _too_wide, definite_solver
from solver.mesh import Floats

SIZE = 1200


def definite(width: int, seed: int) -> sp.csr_array:
    """A symmetric positive definite matrix with entries up to so far off the diagonal."""
    rng = np.random.default_rng(seed)
    upper = np.zeros((SIZE, SIZE))
    for k in (1, width):
        upper += np.diag(rng.standard_normal(SIZE - k), k)
    whole = upper + upper.T
    return sp.csr_array(whole + np.diag(np.abs(whole).sum(axis=1) + 0.1))  # the diagonal outweighs its row


@pytest.mark.parametrize("width", [3, 900])
def test_it_solves(width: int) -> None:
    assert _too_wide(width, SIZE) == (width == 900)
    matrix, forces = definite(width, 1), np.random.default_rng(2).standard_normal((SIZE, 3))
    found: Floats = definite_solver(matrix)(forces)
    np.testing.assert_allclose(found, np.linalg.solve(matrix.toarray(), forces), rtol=0, atol=1e-11)


@pytest.mark.parametrize("width", [3, 900])
@pytest.mark.parametrize("what", ["indefinite", "singular"])
def test_it_refuses_what_is_not_definite(width: int, what: str) -> None:
    matrix = definite(width, 3).toarray()
    if what == "indefinite":
        matrix -= 2 * np.diag(np.diag(matrix)) * (np.arange(SIZE) == 700)
    else:
        matrix[700] = matrix[:, 700] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        definite_solver(sp.csr_array(matrix))
