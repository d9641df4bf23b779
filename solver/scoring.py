"""Owns the measuring of a layout for a search: cheap linear figures first, then the runs of the full protocol."""

from __future__ import annotations

import math
from functools import lru_cache

import msgspec
import numpy as np
import scipy.linalg

from solver.aerodynamics import Stream
from solver.authority import nfcg
from solver.course import seed_damping_time
from solver.design import Design
from solver.ear import Ear
from solver.flutter import GROWTH_NOISE, buckled
from solver.holding import stabilises_up_to, stable, suppresses_up_to
from solver.law import Law, closed_loop
from solver.layouts import Layout, patch_mass
from solver.limitcycle import limit_cycle
from solver.mesh import Floats
from solver.piezo import channels
from solver.plant import Plant
from solver.ranking import design_with
from solver.robust import robust_damping
from solver.score import Score, State, linear_part
from solver.simulate import Loop, loop_if_any
from solver.task import Task
from solver.trace import probe_shapes

MOST_LOOKS = 4000  # at a linear estimate, however long the run is
FAILURES = (ArithmeticError, ValueError, RuntimeError)  # of one layout, which must not end a search of thousands
COARSE, HALF_TURNS = 8, 4  # samples a period, and phases of half a turn, by which a linear estimate is made
# Least ratio of damping time to linear estimate, with room. Over all symmetric rectangles of the 24 x 6 mesh it is 0.69
# at λ = 840 and 0.66 at 1200; on a mesh of 12 x 4, whose eight modes say less of a mode's shape, 0.46.
SHORTEST = 0.3
ROBUST = Task(objective="robust")


def pressures_of(design: Design, task: Task) -> tuple[float, ...]:
    """Dynamic pressures λ that a task measures at, the highest first [-]."""
    return tuple(sorted(task.pressures, reverse=True)) or (Stream.of(design).dynamic_pressure,)


@lru_cache(maxsize=8)
def element_nfcg(design: Design) -> Floats:
    """(elements,) NFCG, kept from one call to the next."""
    return nfcg(design.with_elements(()))


@lru_cache(maxsize=64)
def bare_flutter(design: Design, pressure: float) -> tuple[float, float] | None:
    """λ_cr of the bare panel and the amplitude of its limit cycle at a λ [-]; None if it has none.

    Kept from one layout to the next.
    """
    plant = Plant.of(design.with_elements(())).at_pressure(pressure)
    if plant.critical is None or pressure <= plant.critical[0]:
        return None
    cycle = limit_cycle(Loop.of(plant.symmetric()))
    return (plant.critical[0], cycle.amplitude) if cycle else None


def screened(design: Design, task: Task, elements: Layout) -> Score:
    """The linear figures of a layout, which settle whether it is passive, and whether its controller is stable.

    A controller under which a motion of the runs grows is not run, even where it would grow too slowly to be seen.

    Args:
        design: what is searched on; its own patches are not used.
        task: as `task_for` gives it.
        elements: the layout.

    Returns:
        The score; of state screened, with an estimate of the damping time, where only runs can tell more.
    """
    own = design_with(design, task, elements)
    groups, mass = len(channels(own)), len(elements) * patch_mass(design)
    try:
        return _screened(own, task, Score(elements, groups, mass, "passive"))
    except FAILURES:
        return Score(elements, groups, mass, "failed")


def _screened(own: Design, task: Task, score: Score) -> Score:
    whole = Plant.of(own)
    score = msgspec.structs.replace(
        score,
        lambda_cr=whole.critical[0] if whole.critical else None,
        open_loop_growth_per_s=_there(whole, pressures_of(own, task)[0]).growth.real,
    )
    growths: list[float] = []
    estimates: list[float | None] = []
    for pressure in pressures_of(own, task):
        there = _there(whole, pressure)
        if _passive(whole, there):
            continue
        loop, all_modes = loop_if_any(there.symmetric()), loop_if_any(there)
        if loop is None or (all_modes is None and task.stable):
            return msgspec.structs.replace(score, state="no controller")
        all_modes = all_modes or Loop.of(there, Law.idle(there))  # what is out of reach keeps its growth
        growths.append(all_modes.growth.real)
        estimates.append(linear_damping_time(loop, whole.critical, bare_flutter(own.with_elements(()), pressure)))
        if not stable(all_modes if task.stable else loop):
            return msgspec.structs.replace(score, state="unstable", closed_loop_growth_per_s=max(growths))
    if not growths:
        return score
    worst = max((time for time in estimates if time is not None), default=None)
    return msgspec.structs.replace(score, state="screened", closed_loop_growth_per_s=max(growths), estimate=worst)


def _there(whole: Plant, pressure: float) -> Plant:
    """The plant at a λ."""
    return whole if pressure == whole.stream.dynamic_pressure else whole.at_pressure(pressure)


def _passive(whole: Plant, there: Plant) -> bool:
    """`Plant.passive` of a plant at another λ, whose λ_cr is that of the whole; or it does not flutter above it."""
    below = whole.critical is None or there.stream.dynamic_pressure < whole.critical[0]
    return not there.flutters or (below and not buckled(there.model))


def linear_damping_time(
    loop: Loop, critical: tuple[float, float] | None, bare: tuple[float, float] | None
) -> float | None:
    """How long the loop would take to calm its flutter mode, were the panel linear and the drive unlimited [s].

    The mode starts as large as the limit cycle is likely to be, whose amplitude grows as √(λ - λ_cr): by that of the
    bare panel. Over several phases the longest counts.

    Args:
        loop: a loop whose panel flutters.
        critical: its `Plant.critical`.
        bare: what `bare_flutter` gives.

    Returns:
        The time, that of the whole run if it is longer; None where the bare panel gives no amplitude, or a controller
        with a memory would have to have listened first.
    """
    plant, run = loop.plant, loop.plant.design.run
    if bare is None or critical is None or not loop.law.instant:
        return None
    above = max(plant.stream.dynamic_pressure - critical[0], 0.0)
    amplitude = bare[1] * math.sqrt(above / (plant.stream.dynamic_pressure - bare[0]))
    n, span = plant.size, run.duration - run.control_on
    sample = max(plant.period / COARSE, span / MOST_LOOKS)
    values, vectors = np.linalg.eig(plant.system_matrix)
    mode = vectors[:, int(np.argmax(np.real(values)))]
    thickness = plant.design.panel.thickness
    mode = mode * (amplitude * thickness / max(abs(probe_shapes(plant) @ mode[:n]), 1e-300))
    turns = np.exp(1j * np.pi * np.arange(HALF_TURNS) / HALF_TURNS)
    x = np.real(mode[:, None] * turns).T[None]  # (samples, turns, 2n)
    step, count = scipy.linalg.expm(closed_loop(plant, loop.law) * sample).T, int(span / sample) + 1
    while len(x) < count:  # as many again, by a power of the step that doubles with them
        x, step = np.concatenate([x, x @ step]), step @ step
    loud = Ear.of(loop).loud(x[:count].reshape(-1, 2 * n)).reshape(count, -1)
    above = np.flatnonzero(loud.any(axis=1))
    quiet = int(above[-1]) + 1 if len(above) else 0
    return span if quiet == count else sample * quiet


def hopeless(task: Task, score: Score, bound: float | None) -> bool:
    """Whether linear figures alone show that a layout's objective is worse than a bound.

    Of the damping time they do, as far as it is at least `SHORTEST` times the linear estimate: measured, not proved.
    """
    timed = task.objective in ("robust", "range")
    return timed and bound is not None and score.estimate is not None and SHORTEST * score.estimate > bound


def scored(design: Design, task: Task, screen: Score, bound: float | None) -> Score:
    """The full figures of a layout.

    Args:
        design: as for `screened`.
        task: as for `screened`.
        screen: what `screened` gave.
        bound: value of the objective that a layout worth ranking is better than [its unit]; None for any.

    Returns:
        The score, with the bound instead of a value where it was not better.
    """
    whole = Plant.of(design_with(design, task, screen.elements))
    try:
        match task.objective:
            case "range":
                found = _over_pressures(whole, task, screen, bound)
            case "reach":
                found = _by_reach(whole, screen, bound)
            case _:
                found = _at_own(whole, task, screen, bound)
    except FAILURES:
        return msgspec.structs.replace(screen, state="run failed")
    return known_within(task, found, bound)


def known_within(task: Task, score: Score, bound: float | None) -> Score:
    """What is known of a run layout once it is asked no more than whether it is better than a bound.

    So that a layout measured under a looser bound, or none, is told of as one that was cut short.
    """
    told = score.state in ("no limit cycle", "run failed") or bound is None
    if told or (score.value is not None and task.cost(score.value) <= task.cost(bound or 0.0)):
        return score
    return msgspec.structs.replace(linear_part(score), state="beyond", bound=bound)


def _at_own(whole: Plant, task: Task, score: Score, bound: float | None) -> Score:
    """By damping time or energy, at the design's λ."""
    loop = Loop.of(whole.symmetric())
    by_seed = task.objective == "seed"
    seed = seed_damping_time(loop) if by_seed else None
    if by_seed and (seed is None or (bound is not None and seed > bound)):
        return msgspec.structs.replace(score, state="not suppressed")
    cycle = limit_cycle(loop)
    within = bound if bound is not None and task.objective == "robust" else math.inf
    robust = robust_damping(loop, cycle, within=within) if cycle else None
    if (cycle is None or robust is None) and not by_seed:
        return msgspec.structs.replace(score, state="no limit cycle")
    worst = robust.worst if robust else None
    if worst is None and not by_seed:
        return msgspec.structs.replace(score, state="not suppressed")
    seed = seed if by_seed else seed_damping_time(loop)
    energy = float(robust.energies.max()) if robust and worst is not None else None
    return msgspec.structs.replace(
        score,
        state=_kind(whole, score) if worst is not None else "in part",
        value={"seed": seed, "energy": energy}.get(task.objective, worst),
        robust_damping_time_s=worst,
        mean_damping_time_s=robust.mean if robust else None,
        damping_time_s=seed,
        control_energy_v2s=energy,
        peak_voltage_v=robust.peak_voltage if robust else None,
        lco_amplitude_over_h=cycle.amplitude if cycle else None,
    )


def _over_pressures(whole: Plant, task: Task, score: Score, bound: float | None) -> Score:
    """By the worst damping time over λ, the highest first; where the layout is passive there is nothing to damp."""
    found: list[Score] = []
    for pressure in sorted(task.pressures, reverse=True):
        there = _there(whole, pressure)
        if _passive(whole, there):
            continue
        here = _at_own(there, ROBUST, score, bound)
        if here.value is None:
            return here
        found.append(here)
    worst = max(found, key=lambda here: here.value or 0.0)
    return msgspec.structs.replace(
        worst,
        damping_time_s=_most([here.damping_time_s for here in found]),
        control_energy_v2s=_most([here.control_energy_v2s for here in found]),
        peak_voltage_v=_most([here.peak_voltage_v for here in found]),
    )


def _most(values: list[float | None]) -> float | None:
    """The largest; None if one is missing."""
    known = [value for value in values if value is not None]
    return max(known) if len(known) == len(values) else None


def _by_reach(whole: Plant, score: Score, bound: float | None) -> Score:
    """By the largest λ at which the limit cycle is ended; no larger than that up to which small motions are stable."""
    linear = stabilises_up_to(whole)
    if linear is None or (bound is not None and linear.dynamic_pressure < bound):
        return msgspec.structs.replace(score, state="not suppressed")
    hold = suppresses_up_to(whole, linear)
    # the figures at the design's own λ as well; a layout that does not hold so far has none of them
    here = _at_own(whole, ROBUST, score, None)
    holds = hold is not None and whole.critical is not None and hold.dynamic_pressure > whole.critical[0]
    reach = hold.dynamic_pressure if hold is not None and holds else None
    return msgspec.structs.replace(here, value=reach, suppresses_up_to=reach)


def _kind(whole: Plant, score: Score) -> State:
    """suppressed; in part where a motion grows under control that the runs do not excite."""
    growth = score.closed_loop_growth_per_s
    calm = growth is not None and growth <= GROWTH_NOISE * float(whole.model.omega[0])
    return "suppressed" if calm else "in part"
