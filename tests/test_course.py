"""The course of a controlled run: its end as that of a plain run to the last sample, gone through sample by sample."""

import msgspec
import numpy as np
import pytest
from panels import COARSE

from solver import Load, Loop, Plant, Ply, Reduction, Run, first_mode_at_rest, limit_cycle
from solver.course import LOOK, MOST_KEPT, Course, End
from solver.ear import Ear
from solver.simulate import SAMPLES_A_PERIOD, Memory


def loop_with(limit: float, kind: str = "lqr") -> Loop:
    control = msgspec.structs.replace(COARSE.control, voltage_limit=limit, kind=kind)
    design = msgspec.structs.replace(COARSE.with_control(control), run=Run(control_on=0.05, duration=0.6))
    return Loop.of(Plant.of(design).symmetric())


def plain_end(course: Course, state: np.ndarray, memory: Memory) -> End:
    """The same figures from all samples of one long run."""
    loop, model = course.loop, course.loop.plant.model
    law, design = loop.law, loop.plant.design
    states, volts, _ = loop.run(state, memory, course.sample, course.samples, engaged=True)
    states = np.vstack([state, states])
    first = -(law.direct(loop.plant.force) @ state + law.reading @ memory.own)
    volts = np.vstack([np.clip(first, -law.limit, law.limit), volts])
    largest = np.abs(states[:, : loop.plant.size] @ model.coarse.T).max(axis=1) / design.panel.thickness
    quiet = int(np.flatnonzero(largest >= design.run.settled).max(initial=-1)) + 1
    energy = np.trapezoid((volts[: quiet + 1] ** 2).sum(axis=1), dx=course.sample)
    time = quiet * course.sample if quiet < len(states) else None
    return End(time, float(energy), float(np.abs(volts[: quiet + 1]).max()))


@pytest.mark.parametrize("kind", ["lqr", "lqg"])
@pytest.mark.parametrize("limit", [200.0, 60.0, 0.01])
def test_a_run_ends_as_one_gone_through_to_the_last_sample(limit: float, kind: str) -> None:
    """Damped soon, late, or never, which takes more stretches than are kept before they are searched."""
    loop = loop_with(limit, kind)
    cycle = limit_cycle(loop)
    assert cycle is not None
    course, memory = Course.of(loop), Memory.blank(loop.law)
    found, plain = course.end(cycle.state, memory), plain_end(course, cycle.state, memory)
    if plain.time is None:
        assert found.time is None
        assert course.samples > MOST_KEPT * LOOK * SAMPLES_A_PERIOD
    else:
        assert found.time == pytest.approx(plain.time, abs=1.5 * course.sample)  # the tail is linear to 1e-5
    assert found.energy == pytest.approx(plain.energy, rel=1e-3)
    assert found.peak == pytest.approx(plain.peak, rel=1e-6)


LAYERS = msgspec.structs.replace(
    COARSE,
    panel=msgspec.structs.replace(
        COARSE.panel, plies=tuple(Ply("graphite-epoxy", angle, 0.000635) for angle in (0.0, 90.0))
    ),
    reduction=Reduction("patched", 8),
).with_dynamic_pressure(200.0)


@pytest.mark.parametrize("heat", [0.1, 0.2])
def test_a_panel_that_heat_bends_is_quiet_only_if_its_rest_is(heat: float) -> None:
    """Heat bends layers that are not symmetric: at rest they are deflected, which no linear tail knows of."""
    for settled in (5e-4, 1e-4):
        run = Run(control_on=0.2, duration=0.5, settled=settled)
        design = msgspec.structs.replace(LAYERS, load=Load(temperature=heat), run=run)
        loop = Loop.of(Plant.of(design).symmetric())
        start = first_mode_at_rest(loop.plant, 0.1 * loop.plant.design.panel.thickness)
        course, memory = Course.of(loop), Memory.blank(loop.law)
        found, plain = course.end(start, memory), plain_end(course, start, memory)
        assert found.time == (None if plain.time is None else pytest.approx(plain.time))
        assert course.tail is None


def test_a_small_motion_beyond_the_reach_of_the_voltage_is_not_over() -> None:
    """Small and linear, but for a controller that is at its limit and does not hold it."""
    loop = loop_with(1e-4)
    start = first_mode_at_rest(loop.plant, 1e-6 * loop.plant.design.panel.thickness)
    course, memory = Course.of(loop), Memory.blank(loop.law)
    assert plain_end(course, start, memory).time is None
    assert course.end(start, memory).time is None


@pytest.mark.parametrize("kind", ["lqr", "lqg"])
def test_no_motion_gets_beyond_the_bound_of_the_tail(kind: str) -> None:
    """Of the deflection and of the voltage, in the units of their limits, over all of a tail from random states."""
    loop = loop_with(200.0, kind)
    tail, n = Course.of(loop).tail, loop.plant.size
    assert tail is not None
    assert tail.root is not None
    rng, most = np.random.default_rng(0), 0.0
    heights = loop.plant.model.coarse.T / (5e-4 * loop.plant.design.panel.thickness)
    for _ in range(40):
        state = rng.standard_normal(len(tail.scale)) / tail.scale
        x = np.vstack([state, tail.powers @ state])
        reached = max(np.abs(x[:, :n] @ heights).max(), np.abs(x @ tail.gain.T).max() / tail.limit)
        most = max(most, float(reached / (np.linalg.norm(tail.root @ (tail.scale * state)) * tail.most)))
    assert 0.01 < most <= 1.0  # and the bound is of some use


def test_within_breaks_a_run_off_as_soon_as_it_is_known_to_be_loud_later() -> None:
    loop = loop_with(200.0)
    cycle = limit_cycle(loop)
    assert cycle is not None
    course, memory = Course.of(loop), Memory.blank(loop.law)
    whole = course.end(cycle.state, memory).time
    assert whole is not None
    assert course.end(cycle.state, memory, within=whole * 1.01).time == whole
    assert course.end(cycle.state, memory, within=whole * 0.9).time is None
    assert course.end(cycle.state, memory, within=0.0).time is None


def test_a_quiet_start_is_over_at_once() -> None:
    loop = loop_with(200.0)
    start = first_mode_at_rest(loop.plant, 1e-3 * loop.plant.design.run.settled * loop.plant.design.panel.thickness)
    assert Course.of(loop).end(start, Memory.blank(loop.law), within=0.0).time == 0.0


def test_the_ear_hears_what_a_look_at_every_point_shows() -> None:
    loop = loop_with(200.0)
    plant, run = loop.plant, loop.plant.design.run
    rng = np.random.default_rng(0)
    scale = 10.0 ** rng.uniform(-3, 1, (400, 1)) * run.settled * plant.design.panel.thickness / plant.model.peak
    states = np.hstack([rng.standard_normal((400, plant.size)) * scale, np.zeros((400, plant.size))])
    largest = np.abs(states[:, : plant.size] @ plant.model.coarse.T).max(axis=1) / plant.design.panel.thickness
    loud = largest >= run.settled
    assert 50 < loud.sum() < 350
    np.testing.assert_array_equal(Ear.of(loop).loud(states), loud)
