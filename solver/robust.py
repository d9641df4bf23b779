"""Owns the robust damping time: the controller switched on at many phases of one and the same limit cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solver.course import Course
from solver.limitcycle import DivergedError, LimitCycle, limit_cycle, settled_motion
from solver.mesh import Floats
from solver.simulate import Loop, Memory

PHASES = 8
LISTENING = 12  # periods for which an estimator has listened to the limit cycle when the controller is switched on


@dataclass(frozen=True)
class RobustDamping:
    """What comes of switching the controller on at phases of the limit cycle."""

    times: Floats
    """(phases,) damping time from each phase [s]; NaN where the panel was not damped within the run."""
    energies: Floats
    """(phases,) ∫ VᵀV dt over all channels until damped, or the end [V²·s]; NaN where the motion diverged, or the phase
    was not gone through to its end."""
    peak_voltage: float
    """Largest |V| on any channel [V]."""

    @property
    def worst(self) -> float | None:
        """The longest of them [s]; None unless every phase is damped."""
        return float(self.times.max()) if len(self.times) and np.isfinite(self.times).all() else None

    @property
    def mean(self) -> float | None:
        """Their mean [s]; None unless every phase is damped."""
        return float(self.times.mean()) if self.worst is not None else None


def robust_damping(
    loop: Loop, cycle: LimitCycle | None = None, phases: int = PHASES, within: float | None = None
) -> RobustDamping | None:
    """Switch the controller on at phases of the limit cycle, for as long each time as the design's run lets it.

    Args:
        loop: plant and law; for a layout symmetric about y = b/2 in its symmetric modes, as the seed protocol runs.
        cycle: its limit cycle, if it is known.
        phases: how many.
        within: time [s] after which the rest is of no interest: once a phase is found from which the panel is still
            loud then, or by the end of the run, no others are looked at, and NaN stands for it and for them.

    Returns:
        The damping times; None where there is no flutter to damp: a stable or passive panel, or no limit cycle.
    """
    cycle = _cycle(loop, cycle)
    if cycle is None:
        return None
    times, energies, peak = np.full(phases, np.nan), np.full(phases, np.nan), 0.0
    course = Course.of(loop)
    starts = on_the_cycle(loop, cycle, phases)
    for k, (state, memory) in enumerate(starts):
        end = course.end(state, memory, within)
        times[k] = math.nan if end.time is None else end.time
        energies[k], peak = end.energy, max(peak, end.peak)
        if within is not None and end.time is None:
            break
    return RobustDamping(times, energies, peak)


def suppresses(loop: Loop, cycle: LimitCycle | None = None, phases: int = PHASES) -> bool:
    """Whether the controller damps the limit cycle, if there is one, from every phase; stops at the first where not.

    What comes to rest by itself needs no damping; what diverges, or a run without time for it, is not damped.
    """
    plant, run = loop.plant, loop.plant.design.run
    if not plant.channels or run.duration <= run.control_on:
        return False
    if plant.passive or not plant.flutters:
        return True
    try:
        cycle = cycle or settled_motion(loop)
    except DivergedError:
        return False
    if cycle is None:
        return True
    robust = robust_damping(loop, cycle, phases, within=math.inf)
    return robust is not None and robust.worst is not None


def on_the_cycle(loop: Loop, cycle: LimitCycle, phases: int) -> list[tuple[Floats, Memory]]:
    """States (2n,) at phases of a limit cycle, the controller having listened to it for a while.

    They are equally spaced in either half of the period, and the second half's lie between those of the first: where w
    half a period later is -w, as on most cycles, equal ones would come in pairs that do the same. Of a motion that is
    only nearly periodic, they are instants of what it does next.
    """
    state, memory = cycle.state, Memory.blank(loop.law)
    half = 1 / (2 * phases * cycle.frequency)  # from one phase to the next twice this or, between the halves, thrice
    if loop.law.memory:
        count = LISTENING * 2 * phases
        states, _, memory = loop.run(state, memory, half, count, engaged=False)
        state = states[-1] if len(states) == count else cycle.state
    found = []
    for k in range(phases):
        found.append((state, memory))
        count = 3 if 2 * (k + 1) == phases else 2
        states, _, memory = loop.run(state, memory, half, count, engaged=False)
        if len(states) < count:
            break
        state = states[-1]
    return found


def _cycle(loop: Loop, cycle: LimitCycle | None) -> LimitCycle | None:
    plant, run = loop.plant, loop.plant.design.run
    if plant.passive or not plant.flutters or not plant.channels or run.duration <= run.control_on:
        return None
    cycle = cycle or limit_cycle(loop)
    return cycle if cycle is not None and cycle.frequency > 0 else None
