"""Lanczos' method against a dense eigensolver: close and equal eigenvalues, small orders, and the same bits twice."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.lanczos import ACCURACY, lowest_pairs
from solver.mesh import Floats


def pencil(squares: Floats, seed: int) -> tuple[Floats, Floats]:
    """K and M (n, n) whose eigenvalues ω² are the given ones, in vectors of no particular kind."""
    rng = np.random.default_rng(seed)
    turned, _ = np.linalg.qr(rng.standard_normal((len(squares), len(squares))))
    turned = turned * rng.uniform(0.5, 2, len(squares))
    return turned.T @ (squares[:, None] * turned), turned.T @ turned


def found(stiffness: Floats, mass: Floats, count: int) -> tuple[Floats, Floats]:
    factor = scipy.linalg.cho_factor(stiffness)
    return lowest_pairs(lambda x: scipy.linalg.cho_solve(factor, x), lambda x: mass @ x, len(mass), count)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(12, 90), st.floats(1.0, 4.0))
def test_it_finds_what_a_dense_solver_finds(seed: int, count: int, more: int, growth: float) -> None:
    size = count + more
    squares = np.sort(np.random.default_rng(seed).uniform(0.5, 1.5, size) * np.arange(1, size + 1) ** growth)
    stiffness, mass = pencil(squares, seed)
    values, vectors = found(stiffness, mass, count)
    np.testing.assert_allclose(values, squares[:count], rtol=1e-14 * squares[-1] / squares[0])  # K and M are rounded
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(count), atol=1e-12)
    # the residual that it goes by, measured; with room for the rounding of the solution itself
    rest = scipy.linalg.solve(stiffness, mass @ vectors, assume_a="pos") * values - vectors
    assert np.sqrt(np.einsum("ik,ij,jk->k", rest, mass, rest)).max() < ACCURACY * (10 + squares[-1] / squares[0])


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-6, 1e-3])
def test_a_pair_of_one_frequency_is_found_whole(gap: float) -> None:
    # (1,3) and (3,1) of a square: were one of them missed, what comes after would take its place
    squares = np.array([1.0, 4.0, 9.0, 9.0 * (1 + gap), 25.0, 25.0 * (1 + gap), *np.arange(6, 80) ** 2.0])
    stiffness, mass = pencil(squares, 4)
    values, vectors = found(stiffness, mass, 6)
    np.testing.assert_allclose(values, squares[:6], rtol=1e-10)  # rounding of K, whose largest is 6241 times the least
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(6), atol=1e-12)


def test_the_same_matrices_give_the_same_bits() -> None:
    stiffness, mass = pencil(np.arange(1, 100) ** 2.0, 7)
    other = pencil(np.arange(2, 60) ** 2.5, 8)
    one = found(stiffness, mass, 9)
    found(*other, 5)
    two = found(stiffness, mass, 9)
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])


def test_as_many_steps_as_there_are_dimensions() -> None:
    squares = np.arange(1.0, 11.0)
    values, _ = found(*pencil(squares, 1), 3)
    np.testing.assert_allclose(values, squares[:3], rtol=1e-10)  # rounding


def test_what_is_not_definite_is_refused() -> None:
    stiffness, mass = pencil(np.arange(1.0, 60.0), 2)
    with pytest.raises(np.linalg.LinAlgError):
        lowest_pairs(lambda x: np.linalg.solve(stiffness, x), lambda x: -mass @ x, len(mass), 4)
