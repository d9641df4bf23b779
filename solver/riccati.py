"""Owns the solution of Riccati's equation, by structure-preserving doubling."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from solver.mesh import Floats

MOST_DOUBLINGS = 50  # of the step: in 2^50 of them even what decays by rounding alone has died out
CONVERGED = 1e-11  # last change over P: the next one is of the order of its square
RESIDUAL = 1e-12  # of the equation over the size of its terms: with more, scipy's solution is looked at as well
WEAKEST = 1e-12  # over the rates of the system, what inputs do at the least; below it rounding does as much


def stabilising_cost(system: Floats, inputs: Floats, weights: Floats, effort: float) -> Floats:
    """The stabilising solution P (n, n) of AᵀP + PA - P B Bᵀ P / r + Q = 0.

    By the structure-preserving doubling of Chu, Fan and Lin (Linear Algebra Appl. 396, 2005), which keeps to symmetric
    matrices of order n and converges quadratically. Where it leaves a residual, the better of this and scipy's solution
    is taken; where inputs act by no more than rounding would, scipy's solver has the word.

    Args:
        system: A (n, n).
        inputs: B (n, m).
        weights: Q (n, n), symmetric positive semidefinite.
        effort: r > 0.

    Raises:
        numpy.linalg.LinAlgError: there is none: what grows is out of reach of B.
    """
    spread = inputs @ inputs.T / effort
    cost = _doubled(system, spread, weights)
    left = np.inf if cost is None else _residual(cost, system, spread, weights)
    if cost is not None and left <= RESIDUAL:
        return cost
    other = scipy.linalg.solve_continuous_are(system, inputs, weights, effort * np.eye(inputs.shape[1]))
    return cost if cost is not None and left <= _residual(other, system, spread, weights) else other


def _doubled(a: Floats, g: Floats, q: Floats) -> Floats | None:
    """P of AᵀP + PA - PGP + Q = 0 by doubling; None where it does not converge, or inputs act by rounding alone."""
    rate, hold = np.linalg.norm(a), np.linalg.norm(g)
    if np.sqrt(hold * np.linalg.norm(q)) < WEAKEST * rate:
        return None
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # of what grows out of reach
            cost = _limit(a, g, q)
    except np.linalg.LinAlgError:
        return None
    # P of a growing motion is as one over the square of the hold on it
    return cost if cost is not None and np.linalg.norm(cost) * hold < rate / WEAKEST else None


def _limit(a: Floats, g: Floats, q: Floats) -> Floats | None:
    """The limit of the doublings, if there is one.

    Cayley's transform turns the motion in time into steps, and every doubling makes one step of two.

    Raises:
        numpy.linalg.LinAlgError: a matrix on the way is singular.
    """
    n = len(a)
    # of the Hamiltonian's roots, which are the closed loop's and their mirror images, the steps fit the mean modulus
    hamiltonian = np.block([[a, -g], [-q, -a.T]])
    shift = np.exp(np.linalg.slogdet(hamiltonian)[1] / (2 * n))
    inverse = np.linalg.inv(a - shift * np.eye(n))
    other = np.linalg.inv((a - shift * np.eye(n)).T + q @ inverse @ g)
    step = np.eye(n) + 2 * shift * other.T
    spread, cost = 2 * shift * inverse @ g @ other, 2 * shift * other @ q @ inverse
    for _ in range(MOST_DOUBLINGS):
        twice = np.linalg.solve(np.eye(n) + spread @ cost, np.hstack([step, spread]))
        more = step.T @ cost @ twice[:, :n]
        spread = spread + _symmetric(step @ twice[:, n:] @ step.T)
        step = step @ twice[:, :n]
        cost = cost + _symmetric(more)
        change, size = np.linalg.norm(more), np.linalg.norm(cost)
        if not np.isfinite(size):
            return None
        if change <= CONVERGED * size:
            return _symmetric(cost)
    return None


def _residual(p: Floats, a: Floats, g: Floats, q: Floats) -> float:
    """What the equation leaves over the sizes of its terms [-]."""
    linear, square = a.T @ p, p @ g @ p
    terms = 2 * np.linalg.norm(linear) + np.linalg.norm(square) + np.linalg.norm(q)
    return float(np.linalg.norm(linear + linear.T - square + q) / terms)


def _symmetric(matrix: Floats) -> Floats:
    return (matrix + matrix.T) / 2
