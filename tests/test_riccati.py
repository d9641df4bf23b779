"""Riccati's equation: doubling against scipy's solver, the refinement of both, and what has no solution."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import riccati
from solver.mesh import Floats
from solver.riccati import RESIDUAL, stabilising_cost

System = tuple[Floats, Floats, Floats, float]


def panel(seed: int, modes: int, inputs: int, damping: float, hold: float, growth: float = 0.05) -> System:
    """A, B, Q and r of an oscillator of many modes in its balanced state (Ωq, q̇) and ω1 t, as the regulator has it."""
    rng = np.random.default_rng(seed)
    omega = np.sort(np.append(rng.uniform(1, 25, modes - 1), 1.0))
    stiffness = np.diag(omega**2) + growth * rng.standard_normal((modes, modes)) * omega[:, None]
    a = np.zeros((2 * modes, 2 * modes))
    a[:modes, modes:], a[modes:, :modes] = np.diag(omega), -stiffness / omega
    a[modes:, modes:] = -damping * np.eye(modes)
    b = np.vstack([np.zeros((modes, inputs)), hold * rng.standard_normal((modes, inputs))])
    return a, b, np.eye(2 * modes), 1.0


def refined(system: System, cost: Floats) -> Floats:
    """After two steps of Newton's method (Kleinman, 1968): exact to the rounding of Lyapunov's equation."""
    a, b, q, r = system
    for _ in range(2):
        gain = b.T @ cost / r
        cost = scipy.linalg.solve_continuous_lyapunov((a - b @ gain).T, -(q + r * gain.T @ gain))
    return (cost + cost.T) / 2


def residual(system: System, cost: Floats) -> float:
    a, b, q, r = system
    rest = a.T @ cost + cost @ a - cost @ b @ b.T @ cost / r + q
    return float(np.linalg.norm(rest) / (np.linalg.norm(a.T @ cost) + np.linalg.norm(q)))


def error(system: System, cost: Floats) -> float:
    """Of the gain, relative."""
    b, exact = system[1], refined(system, cost)
    return float(np.linalg.norm(b.T @ (cost - exact)) / np.linalg.norm(b.T @ exact))


SYSTEMS = st.builds(
    panel,
    seed=st.integers(0, 10**6),
    modes=st.integers(1, 14),
    inputs=st.integers(1, 4),
    damping=st.sampled_from([0.0, 1e-6, 1e-3, 0.1, -0.05]),
    hold=st.floats(-4, 1).map(lambda power: 10**power),
    growth=st.sampled_from([0.0, 0.05, 1.0]),
)


@settings(max_examples=60, deadline=None)
@given(SYSTEMS)
def test_the_solution_is_at_least_as_good_as_scipys(system: System) -> None:
    a, b, q, r = system
    try:
        other = scipy.linalg.solve_continuous_are(a, b, q, r * np.eye(b.shape[1]))
    except np.linalg.LinAlgError:
        return
    cost = stabilising_cost(*system)
    np.testing.assert_array_equal(cost, cost.T)
    # where scipy's own is next to marginal and far off, Newton's method may not lead to a solution from it
    if residual(system, other) < 1e-8 and np.linalg.eigvals(a - b @ b.T @ other / r).real.max() < -1e-7:
        assert np.linalg.eigvals(a - b @ b.T @ cost / r).real.max() < 0
        assert residual(system, cost) < max(10 * RESIDUAL, 2 * residual(system, other))
        assert error(system, cost) < max(1e-11, 2 * error(system, other))


@pytest.mark.parametrize("damping", [0.0, 0.01])
@pytest.mark.parametrize("hold", [0.3, 1e-3])
def test_doubling_is_more_accurate(damping: float, hold: float, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> Floats:
        raise AssertionError

    system = panel(3, 12, 1, damping, hold)
    a, b, q, r = system
    other = scipy.linalg.solve_continuous_are(a, b, q, r * np.eye(1))
    monkeypatch.setattr(riccati.scipy.linalg, "solve_continuous_are", refuse)
    cost = stabilising_cost(*system)
    # roots of the loop from 1e-4 of ω1 off the axis on magnify rounding by as much; scipy's solver loses more digits
    assert error(system, cost) < 1e-11
    assert error(system, cost) < 0.1 * error(system, other)


def test_where_control_is_all_but_forbidden_scipys_solution_is_not_taken() -> None:
    # at 1e-6 of the default's hold scipy's gain is off by percents, and doubling leaves more than it likes to
    system = panel(3, 12, 1, 0.01, 3e-7)
    a, b, q, r = system
    cost = stabilising_cost(*system)
    assert residual(system, cost) <= residual(system, scipy.linalg.solve_continuous_are(a, b, q, r * np.eye(1)))
    assert error(system, cost) < 1e-8  # rounding times the distance of the roots from the axis


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3))
def test_one_oscillator_in_closed_form(seed: int, inputs: int) -> None:
    # q̈ + q = b u with Q = I: P11, P12, P22 by hand from the three equations of P
    b = np.vstack([np.zeros((1, inputs)), np.random.default_rng(seed).uniform(0.1, 3, (1, inputs))])
    cost = stabilising_cost(np.array([[0.0, 1.0], [-1.0, 0.0]]), b, np.eye(2), 1.0)
    g = float(b[1] @ b[1])
    p12 = (np.sqrt(1 + g) - 1) / g
    p22 = np.sqrt((1 + 2 * p12) / g)
    np.testing.assert_allclose(cost, [[p22 * (1 + g * p12), p12], [p12, p22]], rtol=1e-11, atol=1e-13)  # rounding


@pytest.mark.parametrize("hold", [0.0, 1e-16, 1e-12])
def test_a_growing_motion_out_of_reach_has_no_regulator(hold: float) -> None:
    a, b, q, r = panel(5, 6, 1, -0.01, 1.0, growth=0.0)
    b[6] = hold  # of rounding is none
    try:
        cost = stabilising_cost(a, b, q, r)
    except np.linalg.LinAlgError:
        return
    # scipy's solver may return without a word what does not stabilise; the regulator looks at the roots itself
    assert np.linalg.eigvals(a - b @ b.T @ cost / r).real.max() > 0
