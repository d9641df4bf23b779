"""The Kalman filter against independent solvers and its own optimality, and the separation of filter and regulator."""

import control
import msgspec
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from panels import Roots, Wiring, balance, closed_with, plant, roots_of, seed, small, whole

from solver import ControlError, Loop, Lqg, Lqr, Plant, first_mode_at_rest, limit_cycle, seed_protocol
from solver.law import closed_loop
from solver.mesh import Floats
from solver.observer import kalman_gain
from solver.robust import robust_damping
from solver.simulate import Memory


def charges(of: Plant) -> Floats:
    """(channels, 2n) C of y = C X."""
    return np.hstack([of.force.T, np.zeros_like(of.force.T)])


def assert_same_roots(one: Roots, other: Roots, tolerance: float) -> None:
    """Both sets of eigenvalues, each paired with the nearest of the other."""
    distance = np.abs(one[:, None] - other)
    assert len(one) == len(other)
    rows, columns = scipy.optimize.linear_sum_assignment(distance)
    assert distance[rows, columns].max() < tolerance


@pytest.mark.parametrize("name", ["seed-840", "seed-1200"])
@pytest.mark.parametrize("wiring", ["connected", "element"])
@pytest.mark.parametrize("ratio", [1e5, 1e9, 1e11])
def test_filter_is_that_of_python_control(name: str, wiring: Wiring, ratio: float) -> None:
    """White forces of intensity W² in every mode and sensor noise of V², of which only W/V counts."""
    of = plant(seed(name, channels=wiring, observer_weight=ratio))
    n, c = of.size, charges(of)
    into = np.vstack([np.zeros((n, n)), np.eye(n)])
    gain, _, _ = control.lqe(of.system_matrix, into, c, ratio**2 * np.eye(n), np.eye(len(c)))
    scale = balance(of)[:, None]
    ours = Lqg.of(of).filter_gain
    # without balancing it solves for numbers from 1e-8 to 1e22 here; 3e-7 is measured at 1e5, 1e-11 at 1e9
    np.testing.assert_allclose(scale * ours, scale * gain, atol=3e-6 * np.abs(scale * gain).max())


def test_filter_is_optimal() -> None:
    """No gain nearby leaves less error: of (A - LC) P + P (A - LC)ᵀ + W + L Lᵀ = 0, by Lyapunov's equation alone."""
    of = plant(seed("seed-840"))
    n, scale, ratio = of.size, balance(of), of.design.control.observer_weight
    a, c = of.system_matrix * scale[:, None] / scale, charges(of) / scale * ratio  # sensor noise 1, disturbance 1
    disturbance = np.diag(np.repeat([0.0, 1.0], n))
    best = kalman_gain(of, of.force) * scale[:, None] / ratio

    def error(gain: Floats) -> float:
        left = scipy.linalg.solve_continuous_lyapunov(a - gain @ c, -(disturbance + gain @ gain.T))
        return float(np.trace(left))

    least, rng = error(best), np.random.default_rng(0)
    for _ in range(10):
        way = rng.standard_normal(best.shape) * np.abs(best) * 0.01
        plus, minus = error(best + way), error(best - way)
        assert min(plus, minus) > least
        # at a minimum the slope is nothing beside the curvature; the next term is of the third order in 0.01
        assert abs(plus - minus) < 0.1 * (plus + minus - 2 * least)


def test_closed_filter_has_the_mirrored_roots_of_the_dual_hamiltonian() -> None:
    of = plant(seed("seed-1200"))
    n, scale, ratio = of.size, balance(of), of.design.control.observer_weight
    a, c = of.system_matrix * scale[:, None] / scale, charges(of) / scale
    sensed = ratio * c.T @ c  # √ of the ratio's square on either side, which changes no root
    roots = roots_of(np.block([[a.T, -sensed], [-ratio * np.diag(np.repeat([0.0, 1.0], n)), -a]]))
    closed = roots_of(of.system_matrix - kalman_gain(of, of.force) @ charges(of))
    assert_same_roots(closed, roots[roots.real < 0], 1e-4)  # of matrices with entries of 1e5


@settings(max_examples=20, deadline=None)
@given(st.floats(-2.0, 2.0), st.floats(5.0, 10.0))
def test_weight_scales_with_the_sensor(power: float, weight: float) -> None:
    """A sensor k times as sensitive with the same noise is one whose noise is a k-th: L(kC, r) = L(C, kr) / k."""
    k, ratio = 10.0**power, 10.0**weight
    of = plant(seed("seed-840", modes=8))
    one = kalman_gain(_with_weight(of, ratio), k * of.force)
    other = kalman_gain(_with_weight(of, k * ratio), of.force) / k
    # of two Riccati solutions; at small ratios the filter all but rests, and L is small beside its terms
    np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(other).max(axis=0).max(), rtol=1e-5)


def _with_weight(of: Plant, ratio: float) -> Plant:
    control = msgspec.structs.replace(of.design.control, observer_weight=ratio)
    return Plant.of(of.design.with_control(control), of.model)


def test_surer_sensors_make_a_faster_filter() -> None:
    speeds = []
    for ratio in (1e5, 1e7, 1e9):
        of = plant(seed("seed-840", observer_weight=ratio))
        speeds.append(roots_of(of.system_matrix - kalman_gain(of, of.force) @ charges(of)).real.sum())
    assert speeds[0] > speeds[1] > speeds[2]


@pytest.mark.parametrize("wiring", ["connected", "element"])
@pytest.mark.parametrize("name", ["seed-840", "seed-1200"])
def test_separation(name: str, wiring: Wiring) -> None:
    """With e = X - X̂ the loop is [A - BG, BG; 0, A - LC]: the regulator's roots and the filter's."""
    of = plant(seed(name, channels=wiring, kind="lqg"))
    lqg = Lqg.of(of)
    both = np.concatenate(
        [
            roots_of(of.system_matrix - of.input_matrix @ Lqr.of(of).gain),
            roots_of(of.system_matrix - lqg.filter_gain @ charges(of)),
        ]
    )
    # entries of L are 1e8 and the roots of a non-normal matrix move by more than rounding
    assert_same_roots(roots_of(closed_loop(of, lqg.law(of))), both, 1e-2)
    assert_same_roots(closed_with(of, lqg.state_space(of)), both, 1e-2)


def test_in_all_modes_the_filter_leaves_alone_what_it_cannot_sense() -> None:
    of = whole(seed("seed-1200", kind="lqg"))
    lqg = Lqg.of(of)
    odd = of.model.parity == -1
    assert (lqg.modes == ~odd).all()
    assert not lqg.filter_gain[np.tile(odd, 2)].any()
    assert Loop.of(of).growth.real == pytest.approx(53.8, abs=0.1)  # the antisymmetric flutter goes on as it was


def test_estimate_closes_in_on_the_motion() -> None:
    """Disengaged, e = X - X̂ obeys ė = (A - LC) e, however the panel flutters: exactly, by the matrix exponential."""
    of = plant(seed("seed-840", kind="lqg", modes=8))
    loop, lqg, sample = Loop.of(of), Lqg.of(of), 5e-4
    start, scale = small(of, 1e-6), balance(of)
    state, memory = start, Memory.blank(loop.law)
    for k in range(1, 21):
        states, volts, memory = loop.advance(state, memory, sample, 1, engaged=False)
        state = states[-1]
        error = scipy.linalg.expm((of.system_matrix - lqg.filter_gain @ charges(of)) * k * sample) @ start
        # the filter's fastest pole, 1 in a step, is integrated to a percent, but is gone in two samples
        assert np.abs(scale * (state - memory.own - error)).max() < 2e-2 * np.abs(scale * start).max()
        assert not volts.any()
    states, _, memory = loop.advance(state, memory, sample, 80, engaged=False)
    assert np.abs(scale * (states[-1] - memory.own)).max() < 1e-2 * np.abs(scale * states[-1]).max()
    assert np.abs(scale * states[-1]).max() > 10 * np.abs(scale * start).max()


def test_saturation_does_not_mislead_the_estimate() -> None:
    """The filter is told what the drive gives, so that its error obeys the same equation at the limit."""
    of = plant(seed("seed-840", kind="lqg", modes=8, voltage_limit=1e-6))
    loop, lqg, sample = Loop.of(of), Lqg.of(of), 1e-3
    start, scale = small(of, 1e-5), balance(of)
    states, volts, memory = loop.advance(start, Memory.blank(loop.law), sample, 10, engaged=True)
    assert (np.abs(volts) == 1e-6).mean() > 0.5
    error = scipy.linalg.expm((of.system_matrix - lqg.filter_gain @ charges(of)) * 10 * sample) @ start
    assert np.abs(scale * (states[-1] - memory.own - error)).max() < 1e-2 * np.abs(scale * start).max()


def test_one_channel_does_not_suppress_840_and_six_do() -> None:
    """From its limit cycle: one charge tells too little of a motion that stretching makes stiffer than the model."""
    outcomes = {}
    cases: tuple[tuple[Wiring, float], ...] = (("connected", 840.0), ("element", 840.0), ("connected", 600.0))
    for wiring, pressure in cases:
        of = plant(seed("seed-840", pressure, channels=wiring, kind="lqg"))
        loop = Loop.of(of)
        assert loop.growth.real < 0
        outcomes[wiring, pressure] = seed_protocol(loop).damping_time
    assert outcomes["connected", 840.0] is None
    # 0.123 s and 0.099 s are measured: to a period, 6 ms
    assert outcomes["element", 840.0] == pytest.approx(0.123, abs=6e-3)
    assert outcomes["connected", 600.0] == pytest.approx(0.099, abs=6e-3)


def test_of_small_motions_one_channel_is_enough_at_840() -> None:
    """So it is the limit cycle's size that is too much for it, and its voltage limit."""
    of = plant(seed("seed-840", kind="lqg"))
    loop = Loop.of(of)
    states, volts = loop.stretch(first_mode_at_rest(of, 1e-3 * of.design.panel.thickness), 1e-3, 300, engaged=True)
    assert np.abs(volts).max() < loop.law.limit
    assert np.abs(states[-1] * balance(of)).max() < 1e-3 * np.abs(states[0] * balance(of)).max()
    cycle = limit_cycle(loop)
    assert cycle is not None
    robust = robust_damping(loop, cycle, phases=1)
    assert robust is not None
    assert robust.worst is None


def test_what_no_filter_exists_for_is_said_in_one_line() -> None:
    of = plant(seed("seed-840", kind="lqg", observer_weight=1e3))
    with pytest.raises(ControlError, match=r"no Kalman filter exists at λ = 840 .*observer_weight = 1000") as caught:
        kalman_gain(of, 1e-12 * of.force)
    assert "\n" not in str(caught.value)
