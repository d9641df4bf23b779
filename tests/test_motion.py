"""The kinds of motion a panel settles into, and the exponents that tell them apart."""

import numpy as np
import pytest

from solver import Loop, ModalModel, Plant, first_mode_at_rest, limit_cycle, load_design
from solver.design import Load
from solver.equilibrium import still_air_rest
from solver.flutter import buckled
from solver.motion import Motion, lyapunov, motion_of
from solver.shooting import free_loop, unit_of_time
from solver.vonkarman import membrane_force

SEED = load_design("seed-bare").with_reduction("family", 4)
MODEL = ModalModel.of(SEED)


def plant_of(pressure: float, preload: float = 0.0) -> Plant:
    """The four-mode panel compressed alike along both sides; R = 2 buckles it."""
    if preload == 0.0:
        return Plant.of(SEED.with_dynamic_pressure(pressure), MODEL)
    return Plant.of(SEED.with_load(Load(preload_x=preload, preload_y=preload)).with_dynamic_pressure(pressure))


def motion(pressure: float, preload: float = 0.0) -> Motion:
    found = motion_of(Loop.of(plant_of(pressure, preload)))
    assert found is not None
    assert found.settled
    return found


def test_flat_below_the_critical_pressure() -> None:
    found = motion(400.0)
    assert found.kind == "flat"
    assert not found.snap_through
    assert found.amplitude_over_h < 1e-6  # the flat state solves its equation exactly
    assert found.lyapunov_per_s == pytest.approx(plant_of(400.0).growth.real, rel=1e-6)


def test_limit_cycle_above_it() -> None:
    found, cycle = motion(800.0), limit_cycle(Loop.of(plant_of(800.0)))
    assert cycle is not None
    assert found.kind == "limit cycle"
    assert not found.snap_through  # not buckled: there are no sides
    assert found.amplitude_over_h == pytest.approx(cycle.amplitude, rel=1e-3)  # limit_cycle's own accuracy
    assert found.frequency_hz == pytest.approx(cycle.frequency, rel=1e-3)
    assert abs(found.mean_over_h) < 1e-6  # symmetric


def test_buckled_in_a_slow_stream() -> None:
    plant = plant_of(50.0, 6.0)
    found = motion(50.0, 6.0)
    assert found.kind == "buckled"
    assert not found.snap_through
    assert found.lyapunov_per_s < 0
    # it rests where time integration ends: after 400 periods, 6 s, nothing is left of a decay by 7.4 / s
    states, _ = free_loop(plant).stretch(first_mode_at_rest(plant, 1e-4), unit_of_time(plant), 400, engaged=False)
    w = plant.model.at(0.75 * SEED.panel.length, 0.5 * SEED.panel.width) @ states[-1, :4] / SEED.panel.thickness
    assert abs(found.mean_over_h) == pytest.approx(abs(w), rel=1e-6)


def test_chaos_goes_from_side_to_side() -> None:
    """R_x = R_y = 6 at λ = 250, the exponent beside how fast two motions part that begin together."""
    plant = plant_of(250.0, 6.0)
    found = motion(250.0, 6.0)
    assert found.kind == "chaotic"
    assert found.snap_through
    # 8 pairs for 0.14 s, some ten e-foldings each: the rate scatters by a third a pair, an eighth in the mean
    start, _ = free_loop(plant).stretch(first_mode_at_rest(plant, 1e-4), 0.5, 1, engaged=False)
    rates = []
    for _ in range(8):
        sample = 0.01
        one, _ = free_loop(plant).stretch(start[-1], sample, 15, engaged=False)
        two, _ = free_loop(plant).stretch(start[-1] * (1 + 1e-9), sample, 15, engaged=False)
        apart = np.linalg.norm((one - two) * np.concatenate([plant.model.omega, np.ones(4)]), axis=1)
        rates.append(np.log(apart[-1] / apart[0]) / (14 * sample))
        start = one
    assert np.mean(rates) == pytest.approx(found.lyapunov_per_s, rel=0.4)  # three times that


def test_snap_through_may_be_periodic() -> None:
    found = motion(300.0, 4.0)
    assert found.kind == "limit cycle"
    assert found.snap_through
    assert found.lyapunov_per_s == 0


def test_exponent_of_a_stable_flat_panel_is_its_growth_rate() -> None:
    plant = plant_of(400.0)
    exponent, error = lyapunov(plant, np.zeros(8), 100 * unit_of_time(plant))
    # all roots decay almost alike here, so that the deviation beats and does not turn into one of them
    assert exponent == pytest.approx(plant.growth.real, rel=0.01)
    assert error < 0.05 * abs(exponent)


def test_exponent_above_the_critical_pressure_at_rest_is_the_growth_rate() -> None:
    plant = plant_of(600.0)
    exponent, _ = lyapunov(plant, np.zeros(8), 100 * unit_of_time(plant))
    assert exponent == pytest.approx(plant.growth.real, rel=1e-3)  # one root leads by far: what is left are the steps


def test_exponent_of_a_limit_cycle_is_nothing() -> None:
    plant = plant_of(800.0)
    cycle = limit_cycle(Loop.of(plant))
    assert cycle is not None
    exponent, _ = lyapunov(plant, cycle.state, 100 * unit_of_time(plant))
    assert abs(exponent) < 0.01 * plant.growth.real  # the one rate at hand


def test_the_well_balances_in_still_air() -> None:
    plant = plant_of(0.0, 4.0)
    model = plant.model
    assert buckled(model)
    q = still_air_rest(plant)
    assert q is not None
    stiffness = np.diag(model.omega**2) + model.geometric
    pull = stiffness @ q + membrane_force(model.membrane, q)
    assert np.abs(pull / model.omega).max() < 1e-9 * np.abs(model.omega * q).max()  # what Newton's method stops at
    assert still_air_rest(plant_of(0.0)) is None


def test_heat_buckles_too() -> None:
    """By 20 K; in a stream so slow that it damps the panel and hardly moves it from the well its energy has."""
    plant = Plant.of(SEED.with_load(Load(temperature=20.0)).with_dynamic_pressure(20.0))
    assert buckled(plant.model)
    found, well = motion_of(free_loop(plant)), still_air_rest(plant)
    assert found is not None
    assert well is not None
    assert found.kind == "buckled"
    w = plant.model.at(0.75 * SEED.panel.length, 0.5 * SEED.panel.width) @ well / SEED.panel.thickness
    assert abs(found.mean_over_h) == pytest.approx(abs(w), rel=0.1)  # a slow stream moves it by some per cent
