"""Controllers of one's own: python-control's gains and systems in place of the design's, and what is refused."""

import control
import numpy as np
import pytest
from panels import balance, closed_with, plant, seed, small, system_of

from solver import Compensator, ControlError, Gain, Law, Loop, Lqg, Lqr, RateFeedback
from solver.law import closed_loop
from solver.mesh import Floats
from solver.simulate import seed_protocol


@pytest.mark.parametrize("wiring", ["connected", "element"])
def test_gain_of_python_control_runs_as_the_regulator(wiring: str) -> None:
    of = plant(seed("seed-840", modes=8, channels="element" if wiring == "element" else "connected"))
    weights, effort = of.design.control.state_weight, of.design.control.effort_weight
    gain, _, _ = control.lqr(of.state_space(), weights * np.diag(balance(of) ** 2), effort * np.eye(len(of.channels)))
    mine, own = (seed_protocol(Loop.of(of, law)) for law in (Gain(gain).law(of), None))
    assert mine.damping_time is not None
    assert mine.damping_time == pytest.approx(own.damping_time, abs=2 * own.times[1])
    # the gains are equal to 1e-11; through the run at its limit that is no more than 1e-6 of the motion
    np.testing.assert_allclose(mine.largest, own.largest, atol=1e-6 * own.largest.max())


@pytest.mark.parametrize("wiring", ["connected", "element"])
def test_compensator_of_python_control_is_the_lqg(wiring: str) -> None:
    """As long as nothing saturates: there, the one follows what the drive gives, and the other what it asked for."""
    design = seed("seed-840", modes=8, channels="element" if wiring == "element" else "connected", kind="lqg")
    of = plant(design)
    theirs, own = Loop.of(of, Compensator(Lqg.of(of).state_space(of)).law(of)), Loop.of(of)
    assert theirs.growth.real == pytest.approx(own.growth.real, abs=1e-3)  # roots of a non-normal matrix of 1e8
    start = small(of, 1e-6)
    runs = [loop.stretch(start, 5e-4, 100, engaged=True) for loop in (theirs, own)]
    assert 0 < np.abs(runs[1][1]).max() < own.law.limit
    scale = balance(of)
    # one system in two orders of summation; the steps may differ, and integrate the fast filter to 1e-4
    np.testing.assert_allclose(scale * runs[0][0], scale * runs[1][0], atol=1e-3 * np.abs(scale * runs[1][0]).max())
    np.testing.assert_allclose(runs[0][1], runs[1][1], atol=1e-3 * np.abs(runs[1][1]).max())
    large = [loop.stretch(1e6 * start, 5e-4, 100, engaged=True)[0] for loop in (theirs, own)]
    assert np.abs(scale * (large[0] - large[1])).max() > 0.01 * np.abs(scale * large[1]).max()  # then they differ


def test_a_static_compensator_is_a_gain_on_the_charges() -> None:
    of = plant(seed("seed-840", 400.0, modes=8))
    static = system_of(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[-3e4]]))
    law = Compensator(static).law(of)
    assert not law.memory
    np.testing.assert_allclose(law.direct(of.force)[:, : of.size], 3e4 * of.force.T)
    assert not law.direct(of.force)[:, of.size :].any()


def test_a_compensator_approximates_rate_feedback() -> None:
    """K(s) = -g s / (1 + s T): below 1/T what a current amplifier does, and so are the loop's slow roots."""
    of = plant(seed("seed-840", 400.0, modes=4))
    g, lag = 1e3, 1e-6
    system = system_of(*(np.array([[x]]) for x in (-1 / lag, 1 / lag, g / lag, -g / lag)))
    one = np.linalg.eigvals(closed_loop(of, Compensator(system).law(of)))
    other = np.linalg.eigvals(closed_loop(of, RateFeedback(g).law(of)))
    slow = np.sort_complex(one[np.abs(one) < 0.5 / lag])
    # ω T is 2e-3 for the highest of these modes, and feedback shifts roots by some 20 /s
    np.testing.assert_allclose(slow, np.sort_complex(other), atol=0.2)


def test_compensator_closes_the_loop_that_python_control_closes() -> None:
    of = plant(seed("seed-840", 400.0, modes=8, channels="element"))
    rng, c = np.random.default_rng(0), 6
    a = -np.diag(rng.uniform(100, 1000, 4))
    system = system_of(a, rng.standard_normal((4, c)), 1e5 * rng.standard_normal((c, 4)), rng.standard_normal((c, c)))
    theirs = closed_with(of, system)
    ours = np.linalg.eigvals(closed_loop(of, Compensator(system).law(of)))
    # the same matrix in another order; pairs that lie close may change places
    np.testing.assert_allclose(np.poly(ours / 3e3), np.poly(theirs / 3e3), atol=1e-8)


@pytest.mark.parametrize("shape", [(1, 3), (2, 10), (10,), (10, 1), (0, 10)])
def test_a_gain_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    of = plant(seed("seed-840", modes=8, channels="element"))
    with pytest.raises(ControlError, match=r"this plant takes \(6, 10\), channels by states") as caught:
        Gain(np.zeros(shape)).law(of)
    assert "\n" not in str(caught.value)
    assert str(np.atleast_2d(np.zeros(shape)).shape) in str(caught.value)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_gain_without_numbers_is_refused(value: float) -> None:
    of = plant(seed("seed-840", modes=8))
    with pytest.raises(ControlError, match="finite"):
        Gain(np.full((1, 2 * of.size), value)).law(of)


def test_a_single_channel_takes_a_plain_list() -> None:
    of = plant(seed("seed-840", modes=8))
    row = Lqr.of(of).gain[0]
    np.testing.assert_array_equal(Gain(row).law(of).gain, Lqr.of(of).gain)


def _system(inputs: int, outputs: int, step: float | bool | None = None) -> control.StateSpace:
    parts: tuple[Floats, ...] = (-np.eye(2), np.ones((2, inputs)), np.ones((outputs, 2)), np.zeros((outputs, inputs)))
    system = control.ss(*parts) if step is None else control.ss(*parts, step)
    assert isinstance(system, control.StateSpace)
    return system


@pytest.mark.parametrize(
    "system", [_system(2, 1), _system(1, 2), _system(3, 3), _system(1, 1, 1e-3), _system(1, 1, True)]
)
def test_a_system_of_another_shape_or_in_discrete_time_is_refused(system: control.StateSpace) -> None:
    of = plant(seed("seed-840", modes=8))
    with pytest.raises(ControlError, match=r"takes one of 1 and 1, continuous in time$") as caught:
        Compensator(system).law(of)
    assert "\n" not in str(caught.value)


def test_a_system_without_numbers_is_refused() -> None:
    of = plant(seed("seed-840", modes=8))
    system = system_of(*(np.array([[x]]) for x in (np.nan, 1.0, 1.0, 0.0)))
    with pytest.raises(ControlError) as caught:
        Loop.of(of, Compensator(system).law(of))
    assert "\n" not in str(caught.value)


def test_your_own_law_takes_the_designs_drive() -> None:
    of = plant(seed("seed-840", modes=8, delay=1e-4, sensor_noise=1e-9, noise_seed=7, voltage_limit=50.0))
    laws: list[Law] = [
        Gain(np.zeros((1, 2 * of.size))).law(of),
        Compensator(_system(1, 1)).law(of),
        RateFeedback(1e3).law(of),
        Lqg.of(of).law(of),
    ]
    for law in laws:
        assert (law.limit, law.delay, law.noise, law.seed) == (50.0, 1e-4, 1e-9, 7)
    assert [law.hears_noise for law in laws] == [False, True, True, True]
    assert not any(law.instant for law in laws)


@pytest.mark.parametrize("gain", [1e7, 1e9, 1e12])
def test_what_is_too_fast_to_be_integrated_is_refused(gain: float) -> None:
    of = plant(seed("seed-840", kind="rate", rate_gain=gain))
    with pytest.raises(ControlError, match=r"brings a pole of .* /s, far beyond .*control\.rate_gain") as caught:
        Loop.of(of)
    assert "\n" not in str(caught.value)


def test_what_is_just_fast_is_integrated_in_shorter_steps() -> None:
    """At 1e6 V/A a pole of 3.4e5 /s: Runge-Kutta is stable only if the step follows it."""
    of = plant(seed("seed-840", 400.0, kind="rate", rate_gain=1e6))
    states, _ = Loop.of(of).stretch(small(of, 1e-6), 1e-3, 20, engaged=True)
    assert len(states) == 20
    assert np.abs(states[-1] * balance(of)).max() < np.abs(small(of, 1e-6) * balance(of)).max()
