"""What a layout is measured by: every objective against figures that other parts compute, and what cuts runs short."""

from __future__ import annotations

import math
from functools import lru_cache

import msgspec
import numpy as np
import pytest
from fakescores import coarse

from solver import Design, Loop, Plant, control_facts, limit_cycle, load_design, run_facts, seed_protocol
from solver.controlfacts import ControlFacts
from solver.limitcycle import LimitCycle
from solver.robust import RobustDamping, on_the_cycle, robust_damping
from solver.score import Score
from solver.scoring import SHORTEST, hopeless, pressures_of, scored, screened
from solver.task import Task, task_for

DESIGN, LAYOUT = coarse(6, 4), (5, 6)
PATCHED = DESIGN.with_elements(LAYOUT)


def measured(design: Design, task: Task, elements: tuple[int, ...], bound: float | None = None) -> Score:
    screen = screened(design, task, elements)
    assert screen.state == "screened", screen
    return scored(design, task, screen, bound)


@lru_cache
def facts() -> ControlFacts:
    return control_facts(PATCHED)


@lru_cache
def cycle() -> tuple[Loop, LimitCycle, RobustDamping]:
    loop = Loop.of(Plant.of(PATCHED).symmetric())
    found = limit_cycle(loop)
    assert found is not None
    robust = robust_damping(loop, found)
    assert robust is not None
    return loop, found, robust


def test_the_seed_by_its_worst_phase() -> None:
    seed = load_design("seed-840")
    score = measured(seed, Task(), seed.patches.elements)
    assert score.state == "suppressed"
    # what `flutterviz control seed-840` prints, to the digits that it prints
    assert score.value == score.robust_damping_time_s == pytest.approx(0.1267, abs=5e-5)
    assert score.channels == 1
    assert score.peak_voltage_v == 228.6
    assert score.estimate is not None
    assert score.value is not None
    assert SHORTEST * score.estimate < score.value


def test_robust_and_seed_are_those_of_the_facts() -> None:
    robust, seed = (measured(DESIGN, task, LAYOUT) for task in (Task(), Task(objective="seed")))
    # the cycle's eight phases are counted from another instant of it: a sample, 1/32 of a period of 30 ms, more or less
    sample = Plant.of(PATCHED).period / 32
    assert robust.value == pytest.approx(facts().robust_damping_time_s, abs=1.01 * sample)
    assert robust.mean_damping_time_s == pytest.approx(facts().mean_damping_time_s, abs=1.01 * sample)
    run, _ = run_facts(PATCHED)
    assert seed.value == robust.damping_time_s
    assert run.damping_time_s == facts().damping_time_s
    assert seed.value == pytest.approx(run.damping_time_s, rel=1e-12)  # the same sample: multiples add up otherwise
    # every figure but the objective is the same, whatever it is
    assert msgspec.structs.replace(robust, value=seed.value) == seed
    assert robust.lambda_cr == facts().lambda_cr
    assert robust.open_loop_growth_per_s == facts().open_loop_growth_per_s
    # eigenvalues of one matrix, in blocks or as a whole
    assert robust.closed_loop_growth_per_s == pytest.approx(facts().closed_loop_growth_per_s, rel=1e-9)
    # the amplitude of the run's own cycle, by its last periods
    assert robust.lco_amplitude_over_h == pytest.approx(run.lco_amplitude_over_h, rel=5e-3)


def test_reach_is_that_of_the_facts() -> None:
    score = measured(DESIGN, Task(objective="reach"), LAYOUT)
    assert score.value == score.suppresses_up_to == facts().suppresses_up_to
    assert score.value is not None
    assert score.value > 840.0
    assert score.robust_damping_time_s == measured(DESIGN, Task(), LAYOUT).value


def test_a_reach_that_linear_theory_rules_out_is_not_run() -> None:
    beyond = measured(DESIGN, Task(objective="reach"), LAYOUT, bound=1e4)
    assert (beyond.state, beyond.value, beyond.bound) == ("beyond", None, 1e4)
    assert beyond.peak_voltage_v is None


def test_energy_is_the_integral_of_the_squared_voltage() -> None:
    """By plain sums over runs of its own, from the same phases on, with a sample of a hundredth of a millisecond."""
    score = measured(DESIGN, Task(objective="energy"), LAYOUT)
    loop, found, robust = cycle()
    assert score.value == score.control_energy_v2s == robust.energies.max()
    sample, energies = 1e-5, []
    for (state, memory), time in zip(on_the_cycle(loop, found, 8), robust.times, strict=True):
        _, volts, _ = loop.advance(state, memory, sample, round(time / sample), engaged=True)
        energies.append(sample * float((volts**2).sum()))
    # trapezia of 0.15 ms, as the run is sampled, over a voltage that falls from its limit within a millisecond
    np.testing.assert_allclose(robust.energies, energies, rtol=0.02)


def test_the_seed_protocol_spends_about_as_much() -> None:
    """A trace integrates its own; on the cycle too, at a phase of its own."""
    loop, _, robust = cycle()
    spent = seed_protocol(loop).control_energy
    assert 0.7 * robust.energies.min() < spent < 1.3 * robust.energies.max()  # it is one phase more


def test_the_worst_over_pressures_is_the_worst_of_each_alone() -> None:
    pressures = (720.0, 840.0, 760.0)
    task = Task(objective="range", pressures=pressures)
    score = measured(DESIGN, task, LAYOUT)
    alone = [measured(DESIGN.with_dynamic_pressure(value), Task(), LAYOUT) for value in pressures]
    times = [one.value for one in alone if one.value is not None]
    assert len(times) == 3
    assert pressures_of(DESIGN, task) == (840.0, 760.0, 720.0)
    # λ reaches the plant by another way, and so with other rounding
    assert score.value == score.robust_damping_time_s == pytest.approx(max(times), rel=1e-6)
    worst = alone[times.index(max(times))]
    assert score.mean_damping_time_s == pytest.approx(worst.mean_damping_time_s, rel=1e-6)
    assert score.damping_time_s == pytest.approx(max(one.damping_time_s or 9.0 for one in alone), rel=1e-6)
    assert score.peak_voltage_v == pytest.approx(max(one.peak_voltage_v or 0.0 for one in alone), rel=1e-6)
    assert score.control_energy_v2s == pytest.approx(max(one.control_energy_v2s or 0.0 for one in alone), rel=1e-6)
    assert score.estimate == pytest.approx(max(one.estimate or 0.0 for one in alone), rel=1e-6)
    assert score.lambda_cr == pytest.approx(709.7, rel=1e-3)  # what `flutter` prints, and below all three


def test_pressures_at_which_a_layout_is_passive_do_not_count() -> None:
    task = Task(objective="range", pressures=(840.0, 600.0))
    both, one = (measured(DESIGN, each, LAYOUT) for each in (task, Task(objective="range", pressures=(840.0,))))
    assert both == one
    below = screened(DESIGN, Task(objective="range", pressures=(600.0, 700.0)), LAYOUT)
    assert below.state == "passive"  # at all of them


def test_a_voltage_limit_is_kept_and_costs_time() -> None:
    task = Task(voltage_limit=5.0)
    low, free = measured(DESIGN, task, LAYOUT), measured(DESIGN, Task(), LAYOUT)
    assert low.peak_voltage_v is not None
    assert free.peak_voltage_v is not None
    assert low.peak_voltage_v <= 5.0 < free.peak_voltage_v
    assert low.value is not None
    assert free.value is not None
    assert low.value > free.value


def test_what_is_unstable_where_all_motions_must_decay() -> None:
    """Two pairs of the middle: above some λ an antisymmetric motion grows that one channel cannot reach."""
    design, layout = coarse(6, 4, 1400.0), (5, 6)
    free, strict = (screened(design, Task(stable=stable), layout) for stable in (False, True))
    growth = free.closed_loop_growth_per_s
    assert growth is not None
    assert growth > 0
    assert free.state == "screened"
    assert strict.state == "unstable"
    run = scored(design, Task(), free, None)
    assert run.state in ("in part", "not suppressed")
    calm = screened(DESIGN, Task(stable=True), LAYOUT)
    assert calm.state == "screened"
    assert calm.closed_loop_growth_per_s is not None
    assert calm.closed_loop_growth_per_s < 0


def test_a_passive_layout_is_known_by_its_critical_pressure_alone() -> None:
    row = tuple(range(4, 20))
    score = screened(DESIGN, Task(), row)
    critical = Plant.of(DESIGN.with_elements(row)).critical
    assert score.state == "passive"
    assert critical is not None
    assert score.lambda_cr == critical[0]
    assert critical[0] > 840.0
    assert score.value is score.estimate is None
    assert score.open_loop_growth_per_s is not None
    assert score.open_loop_growth_per_s < 0


@pytest.mark.parametrize("objective", ["robust", "seed"])
def test_a_bound_cuts_what_is_worse_and_leaves_what_is_not(objective: str) -> None:
    task = msgspec.convert({"objective": objective}, Task)
    value = measured(DESIGN, task, LAYOUT).value
    assert value is not None
    cut = measured(DESIGN, task, LAYOUT, bound=0.9 * value)
    assert (cut.state, cut.value, cut.bound) == ("beyond", None, 0.9 * value)
    for bound in (value, 1.1 * value):  # what is as good as the bound has its place by other figures
        assert measured(DESIGN, task, LAYOUT, bound=bound) == measured(DESIGN, task, LAYOUT)


def test_within_ends_at_the_first_phase_that_takes_longer() -> None:
    loop, found, robust = cycle()
    times = robust.times
    assert robust.worst is not None
    first_late = np.flatnonzero(times > times[0])
    assert len(first_late)  # a time that lets the first phase pass, and not all
    for within in (1.01 * times.max(), times[0], 0.5 * (times.max() + times.min()), 0.9 * times.min()):
        short = robust_damping(loop, found, within=within)
        assert short is not None
        late = np.flatnonzero(times > within)
        kept = late[0] if len(late) else 8
        np.testing.assert_array_equal(short.times[:kept], times[:kept])
        np.testing.assert_array_equal(short.energies[:kept], robust.energies[:kept])
        assert np.isnan(short.times[kept:]).all()
        assert (short.worst is None) == (kept < 8)
        assert short.peak_voltage <= robust.peak_voltage
    same = robust_damping(loop, found, within=math.inf)
    assert same is not None
    np.testing.assert_array_equal(same.times, times)


def test_within_the_whole_run_stops_at_what_is_never_damped() -> None:
    weak = PATCHED.with_control(msgspec.structs.replace(PATCHED.control, voltage_limit=0.01))
    loop = Loop.of(Plant.of(weak).symmetric())
    robust = robust_damping(loop, cycle()[1], within=math.inf)
    assert robust is not None
    assert robust.worst is None
    assert np.isnan(robust.times).all()
    assert np.isfinite(robust.energies[0])  # what was spent until the end, of the one phase that was run
    assert np.isnan(robust.energies[1:]).all()


def test_hopeless_is_what_linear_theory_puts_far_beyond_the_bound() -> None:
    score = Score((1, 2), 1, 0.1, "screened", estimate=0.2)
    assert hopeless(Task(), score, 0.99 * SHORTEST * 0.2)
    assert not hopeless(Task(), score, 1.01 * SHORTEST * 0.2)
    assert not hopeless(Task(), score, None)
    assert not hopeless(Task(), msgspec.structs.replace(score, estimate=None), 0.01)
    # the estimate is of damping times after the cycle: it says nothing of the seed's start, of energies or of reach
    for task in (Task(objective="seed"), Task(objective="energy"), Task(objective="reach")):
        assert not hopeless(task, score, 0.01)
    assert hopeless(Task(objective="range", pressures=(840.0,)), score, 0.01)


def test_where_nothing_flutters_above_the_critical_pressure_there_is_nothing_to_damp() -> None:
    """On a coarse mesh a layout flutters from λ = 722 on and not at 900, in a window of stability above λ_cr."""
    elements = (9, 10, 13, 14)
    design = coarse(12, 4)
    alone = task_for(Task("nfcg", elements=4), design.with_dynamic_pressure(900.0))
    score = screened(design.with_dynamic_pressure(900.0), alone, elements)
    assert score.lambda_cr is not None
    assert score.lambda_cr < 900.0
    assert score.open_loop_growth_per_s is not None
    assert score.open_loop_growth_per_s < 0.0
    assert score.state == "passive"
    task = task_for(Task("nfcg", "range", (840.0, 900.0), elements=4), design)
    both = scored(design, task, screened(design, task, elements), None)
    here = task_for(Task("nfcg", elements=4), design)
    assert both.value == scored(design, here, screened(design, here, elements), None).value
