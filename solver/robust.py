"""Owns the robust damping time: the controller switched on at many phases of one and the same limit cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solver.limitcycle import LimitCycle, limit_cycle
from solver.mesh import Floats
from solver.simulate import MOST_SAMPLES, SAMPLES_A_PERIOD, Loop, Memory
from solver.trace import quiet_from

PHASES = 8
LISTENING = 12  # periods for which an estimator has listened to the limit cycle when the controller is switched on
WINDOW = 16  # periods after which a run is looked at, and ended if the panel is quiet
QUIET = 0.1  # of the limit below which it counts as damped: a stable linear motion of so little stays below it


@dataclass(frozen=True)
class RobustDamping:
    """What comes of switching the controller on at phases of the limit cycle."""

    times: Floats
    """(phases,) damping time from each phase [s]; NaN where the panel was not damped within the run."""
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


def robust_damping(loop: Loop, cycle: LimitCycle | None = None, phases: int = PHASES) -> RobustDamping | None:
    """Switch the controller on at phases of the limit cycle, for as long each time as the design's run lets it.

    Args:
        loop: plant and law; for a layout symmetric about y = b/2 in its symmetric modes, as the seed protocol runs.
        cycle: its limit cycle, if it is known.
        phases: how many.

    Returns:
        The damping times; None where there is no flutter to damp: a stable or passive panel, or no limit cycle.
    """
    cycle = _cycle(loop, cycle)
    if cycle is None:
        return None
    runs = [_damped(loop, state, memory) for state, memory in on_the_cycle(loop, cycle, phases)]
    times = [math.nan if time is None else time for time, _ in runs]
    return RobustDamping(np.array(times), max((peak for _, peak in runs), default=0.0))


def suppresses(loop: Loop, cycle: LimitCycle | None = None, phases: int = PHASES) -> bool:
    """Whether the controller damps the limit cycle, if there is one, from every phase; stops at the first where not."""
    cycle = _cycle(loop, cycle)
    if cycle is None:
        return bool(loop.plant.channels)
    return all(_damped(loop, state, memory)[0] is not None for state, memory in on_the_cycle(loop, cycle, phases))


def on_the_cycle(loop: Loop, cycle: LimitCycle, phases: int) -> list[tuple[Floats, Memory]]:
    """States (2n,) at phases of a limit cycle, the controller having listened to it for a while.

    They are equally spaced in either half of the period, and the second half's lie between those of the first: where w
    half a period later is -w, as on most cycles, equal ones would come in pairs that do the same. Of a motion that is
    only nearly periodic, they are instants of what it does next.
    """
    state, memory = cycle.state, Memory.blank(loop.law)
    if loop.law.memory:
        states, _, memory = loop.advance(state, memory, 1 / cycle.frequency, LISTENING, engaged=False)
        state = states[-1] if len(states) == LISTENING else cycle.state
    found = []
    for k in range(phases):
        found.append((state, memory))
        ahead = 1.5 if 2 * (k + 1) == phases else 1.0
        states, _, memory = loop.advance(state, memory, ahead / (phases * cycle.frequency), 1, engaged=False)
        if not len(states):
            break
        state = states[-1]
    return found


def _cycle(loop: Loop, cycle: LimitCycle | None) -> LimitCycle | None:
    plant, run = loop.plant, loop.plant.design.run
    if plant.passive or not plant.flutters or not plant.channels or run.duration <= run.control_on:
        return None
    cycle = cycle or limit_cycle(loop)
    return cycle if cycle is not None and cycle.frequency > 0 else None


def _damped(loop: Loop, state: Floats, memory: Memory) -> tuple[float | None, float]:
    """Damping time from a state on [s], None if not within the run, and the peak voltage [V]."""
    plant, run = loop.plant, loop.plant.design.run
    span = run.duration - run.control_on
    samples = min(math.ceil(span * SAMPLES_A_PERIOD / plant.period), MOST_SAMPLES)
    sample = span / samples
    shapes = plant.model.coarse.T / plant.design.panel.thickness
    ends = loop.growth.real < 0 and not loop.law.hears_noise
    largest, peak = [np.abs(state[None, : plant.size] @ shapes).max(axis=1)], 0.0
    for first in range(0, samples, WINDOW * SAMPLES_A_PERIOD):
        count = min(WINDOW * SAMPLES_A_PERIOD, samples - first)
        states, volts, memory = loop.advance(state, memory, sample, count, engaged=True)
        peak = max(peak, float(np.abs(volts).max(initial=0.0)))
        if len(states) < count:
            return None, peak
        state = states[-1]
        largest.append(np.abs(states[:, : plant.size] @ shapes).max(axis=1))
        if ends and largest[-1].max() < QUIET * run.settled:
            break
    sizes = np.concatenate(largest)
    return quiet_from(sample * np.arange(len(sizes)), sizes, run.settled), peak
