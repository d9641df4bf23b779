"""Sensor noise: repeatable, of the density that was asked for at any time step, and none for the regulator."""

import numpy as np
import pytest
import scipy.linalg
from panels import balance, plant, seed, small

from solver import Loop
from solver.law import closed_loop
from solver.mesh import Floats
from solver.simulate import Memory

NOISE = 1e-9  # C/√Hz and A/√Hz
CHARGE, CURRENT = 1e-13, 1e-10  # so small that no voltage is cut and no motion large
TIME = 40.0  # s


def noisy(kind: str, random: int = 0) -> Loop:
    """A stable loop of few modes that hears noise."""
    level = CURRENT if kind == "rate" else CHARGE
    design = seed(
        "seed-840", 200.0, 4, kind=kind, sensor_noise=level, noise_seed=random, rate_gain=1e4, observer_weight=1e8
    )
    return Loop.of(plant(design))


@pytest.mark.parametrize("kind", ["lqg", "rate"])
@pytest.mark.parametrize("delay", [0.0, 2e-4])
def test_the_seed_decides(kind: str, delay: float) -> None:
    runs = []
    for random in (3, 3, 4):
        design = seed("seed-840", modes=4, kind=kind, sensor_noise=NOISE, noise_seed=random, delay=delay)
        loop = Loop.of(plant(design))
        runs.append(loop.stretch(small(loop.plant, 0.01), 1e-3, 50, engaged=True)[0])
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.abs(runs[0] - runs[2]).max() > 1e-6 * np.abs(runs[0]).max()


def test_noise_does_not_come_again() -> None:
    """Drawn some thousand steps at a time: from one time to the next it is another."""
    loop = noisy("rate")
    state, memory, ends = np.zeros(2 * loop.plant.size), Memory.blank(loop.law), []
    for _ in range(3):
        states, _, memory = loop.advance(state, memory, 1e-3, 20, engaged=True)
        ends.append(states[-1])
    assert memory.drawn == 3
    assert np.abs(ends[1] - ends[0]).max() > 0.1 * np.abs(ends[0]).max()
    assert np.abs(ends[2] - ends[1]).max() > 0.1 * np.abs(ends[1]).max()


def test_the_regulator_has_none() -> None:
    with_noise, without = (Loop.of(plant(seed("seed-840", modes=8, sensor_noise=level))) for level in (1e-6, 0.0))
    runs = [loop.stretch(small(loop.plant, 0.01), 1e-3, 50, engaged=True) for loop in (with_noise, without)]
    np.testing.assert_array_equal(runs[0][0], runs[1][0])
    np.testing.assert_array_equal(runs[0][1], runs[1][1])


def test_disengaged_it_does_not_reach_the_panel() -> None:
    for kind in ("lqg", "rate"):
        loop = noisy(kind)
        states, volts, _ = loop.advance(np.zeros(2 * loop.plant.size), Memory.blank(loop.law), 1e-3, 50, engaged=False)
        assert not states.any()
        assert not volts.any()


def covariance(of: Loop) -> Floats:
    """Of (X, z) in the steady state: A P + P Aᵀ + N (S²/2) Nᵀ = 0.

    White noise of one-sided amplitude density S has the two-sided spectrum S²/2 at all frequencies, so that its
    correlation is S²/2 δ(t). N is what it does to d/dt (X, z): -B Γ through the voltage, L through the filter.
    """
    law, n = of.law, of.plant.size
    volts = -(law.on_charge + law.on_current)
    enters = np.vstack([np.zeros((n, len(volts))), of.plant.force @ volts, law.driven @ volts + law.sensed])
    return scipy.linalg.solve_continuous_lyapunov(closed_loop(of.plant, law), -(law.noise**2) / 2 * enters @ enters.T)


@pytest.mark.parametrize("kind", ["lqg", "rate"])
@pytest.mark.parametrize("finer", [1, 4])
def test_variance_is_that_of_lyapunovs_equation(kind: str, finer: int) -> None:
    """At any step. Were the variance of the held noise not as 1/h, steps of a quarter would make it four times off.

    The energy of a mode that decays at σ is correlated over 1/(2σ); its mean over T has the relative error √(1/(σT)).
    With σ = 14 /s that is 4 %; four of them are allowed, which one seed in ten thousand exceeds.
    """
    loop = noisy(kind)
    n, scale = loop.plant.size, balance(loop.plant)
    assert loop.growth.real < -13
    sample = loop._step / finer  # and so the step
    states, volts, _ = loop.advance(np.zeros(2 * n), Memory.blank(loop.law), sample, round(TIME / sample), engaged=True)
    assert np.abs(volts).max() < loop.law.limit
    kept = states[len(states) // 50 :] * scale
    wanted = np.diag(covariance(loop))[: 2 * n] * scale**2
    assert (kept**2).mean(axis=0).sum() == pytest.approx(wanted.sum(), rel=0.17)
