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
LOOK = 4  # periods after which a run is looked at, and ended if it has been quiet for long or loud for too long
QUIET, LONG = 0.1, 4  # of the limit, and looks: a stable linear motion of so little for so long stays below the limit


@dataclass(frozen=True)
class RobustDamping:
    """What comes of switching the controller on at phases of the limit cycle."""

    times: Floats
    """(phases,) damping time from each phase [s]; NaN where the panel was not damped within the run."""
    energies: Floats
    """(phases,) ∫ VᵀV dt over all channels until damped, or the end [V²·s]."""
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
        within: time [s] after which the rest is of no interest: the first phase from which the panel is still loud
            then, or by the end of the run, is the last one looked at, and NaN stands for it and the others.

    Returns:
        The damping times; None where there is no flutter to damp: a stable or passive panel, or no limit cycle.
    """
    cycle = _cycle(loop, cycle)
    if cycle is None:
        return None
    times, energies, peak = np.full(phases, np.nan), np.full(phases, np.nan), 0.0
    for k, (state, memory) in enumerate(on_the_cycle(loop, cycle, phases)):
        end = _end_of(loop, state, memory, math.inf if within is None else within)
        times[k] = math.nan if end.time is None else end.time
        energies[k], peak = end.energy, max(peak, end.peak)
        if within is not None and end.time is None:
            break
    return RobustDamping(times, energies, peak)


def suppresses(loop: Loop, cycle: LimitCycle | None = None, phases: int = PHASES) -> bool:
    """Whether the controller damps the limit cycle, if there is one, from every phase; stops at the first where not."""
    cycle = _cycle(loop, cycle)
    if cycle is None:
        return bool(loop.plant.channels)
    robust = robust_damping(loop, cycle, phases, within=math.inf)
    return robust is not None and robust.worst is not None


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


@dataclass(frozen=True)
class _End:
    """How a run under control ended."""

    time: float | None
    """Damping time [s]; None if it was not damped, or not in time."""
    energy: float
    """∫ VᵀV dt until then [V²·s]."""
    peak: float
    """Largest |V| [V]."""


def _end_of(loop: Loop, state: Floats, memory: Memory, within: float) -> _End:
    """Run from a state on, the controller at work, until quiet, or loud for longer than `within` [s]."""
    plant, run = loop.plant, loop.plant.design.run
    span = run.duration - run.control_on
    samples = min(math.ceil(span * SAMPLES_A_PERIOD / plant.period), MOST_SAMPLES)
    sample = span / samples
    shapes = plant.model.coarse.T / plant.design.panel.thickness
    ends = loop.growth.real < 0 and not loop.law.hears_noise
    largest, power = [np.abs(state[None, : plant.size] @ shapes).max(axis=1)], [np.zeros(1)]
    peak, calm = 0.0, 0
    for first in range(0, samples, LOOK * SAMPLES_A_PERIOD):
        count = min(LOOK * SAMPLES_A_PERIOD, samples - first)
        states, volts, memory = loop.advance(state, memory, sample, count, engaged=True)
        peak = max(peak, float(np.abs(volts).max(initial=0.0)))
        power.append((volts**2).sum(axis=1))
        if len(states) < count:
            return _End(None, math.nan, peak)
        state = states[-1]
        largest.append(np.abs(states[:, : plant.size] @ shapes).max(axis=1))
        loud = np.flatnonzero(~(largest[-1] < run.settled))
        if len(loud) and (first + 1 + loud[-1]) * sample > within:
            return _End(None, math.nan, peak)
        calm = calm + 1 if largest[-1].max() < QUIET * run.settled else 0
        if ends and calm == LONG:
            break
    time = quiet_from(sample * np.arange(sum(len(part) for part in largest)), np.concatenate(largest), run.settled)
    spent = np.concatenate(power)
    spent[0] = spent[1]  # at the instant of switching on, where nothing has been sampled yet
    if time is not None:
        spent = spent[: round(time / sample) + 1]
    return _End(time, float(np.trapezoid(spent, dx=sample)), peak)
