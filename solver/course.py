"""Owns the course of runs under control: how they end, damped within the design's run or not, and what that takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solver.ear import Ear
from solver.law import extended
from solver.mesh import Floats
from solver.simulate import MOST_SAMPLES, SAMPLES_A_PERIOD, Loop, Memory, Stretch, seed_start, until_on
from solver.tail import Tail

LOOK = 4  # periods after which runs are looked at, and ended if they have been loud for too long
MOST_KEPT = 16  # stretches whose states are kept


@dataclass(frozen=True)
class End:
    """How a run under control ended."""

    time: float | None
    """Damping time [s]; None if it was not damped, or not in time."""
    energy: float
    """∫ VᵀV dt until then, or the end [V²·s]."""
    peak: float
    """Largest |V| [V]."""


@dataclass(frozen=True)
class Course:
    """What the controlled phase of a design's run is looked at by, laid out once for all runs of a loop."""

    loop: Loop
    """Plant and law."""
    sample: float
    """Time between samples [s]."""
    samples: int
    """How many [-]."""
    ear: Ear
    """Tells loud states from quiet ones."""
    tail: Tail | None
    """The loop as the linear system that it is for small motions; None where it has a delay or noise, where static
    forces bend the panel, or where bending pulls at its membrane (B ≠ 0), which small motions feel as well."""

    @staticmethod
    def of(loop: Loop, sample: float | None = None) -> Course:
        """The course of a loop from switching on to the end of the run, by default at as many samples as a run has."""
        run = loop.plant.design.run
        span = run.duration - run.control_on
        samples = min(math.ceil(span * SAMPLES_A_PERIOD / loop.plant.period), MOST_SAMPLES)
        if sample is None:
            sample = span / samples
        model = loop.plant.model
        linear = not (loop.law.delay or loop.law.hears_noise or model.load.any() or len(model.membrane.cubic))
        return Course(
            loop,
            sample,
            round(span / sample),
            Ear.of(loop),
            Tail.of(loop, sample, LOOK * SAMPLES_A_PERIOD) if linear else None,
        )

    def end(self, state: Floats, memory: Memory, within: float | None = None) -> End:
        """Run from a state on, the controller at work, until it is quiet for good or the design's run is over.

        What has become small enough goes on as the linear system that it then is, by powers of its exponential: exact,
        and a great deal faster. Should it grow again, or ask for more than the limit, it is integrated as before.

        Args:
            state: (2n,) state.
            memory: what the controller remembers.
            within: time [s]; as soon as the run is found to be damped later, it ends and does not count as damped.
        """
        look = LOOK * SAMPLES_A_PERIOD
        run = _Run.of(self, state, memory)
        for first in range(0, self.samples, look):
            count = min(look, self.samples - first)
            if not (run.calm and run.coast(count)):
                run.take(self.loop.run(run.state, run.memory, self.sample, count, engaged=True), count)
            if within is not None and run.later_than(within):
                return End(None, math.nan, run.peak)
            if run.over:
                break
        return run.end()


def seed_damping_time(loop: Loop) -> float | None:
    """`Trace.damping_time` of the seed protocol [s], for which its run need not be gone through to the end."""
    plant, (start, sample, free) = loop.plant, seed_start(loop)
    if plant.passive or not plant.channels or plant.design.run.duration <= plant.design.run.control_on:
        return None
    states, _, memory = until_on(loop)
    if len(states) < free:
        return None
    return Course.of(loop, sample).end(states[-1] if free else start, memory).time


@dataclass
class _Run:
    """What is kept of a run while it goes on."""

    course: Course
    state: Floats
    memory: Memory
    states: list[Floats]  # of the stretches that were not searched for loud ones yet, since most need not be
    heard: int  # number of the last sample known to be loud, the first being that of switching on; -1 if none is
    power: list[Floats]  # VᵀV of the samples
    peak: float  # largest |V|
    done: int = 0
    calm: bool = False  # small enough to be linear
    diverged: bool = False
    over: bool = False

    @staticmethod
    def of(course: Course, state: Floats, memory: Memory) -> _Run:
        """A run that begins now."""
        law = course.loop.law
        asked = extended(course.loop.plant, law)[2] @ np.concatenate([state, memory.own])
        first = np.zeros_like(asked) if law.delay else np.clip(asked, -law.limit, law.limit)
        power, peak = (first**2).sum(keepdims=True), float(np.abs(first).max(initial=0.0))
        return _Run(course, state, memory, [], 0 if course.ear.loud(state[None])[0] else -1, [power], peak)

    def take(self, stretch: Stretch, count: int) -> None:
        """Go on by a stretch that was to have `count` samples."""
        (states, volts, memory), tail = stretch, self.course.tail
        self.states.append(states)
        self.done += len(states)
        if len(self.states) > MOST_KEPT:
            self._listen()
        self.power.append((volts**2).sum(axis=1))
        self.peak = max(self.peak, float(np.abs(volts).max(initial=0.0)))
        self.diverged = self.over = len(states) < count
        if self.diverged:
            return
        self.state, self.memory = states[-1], memory
        self.calm = tail is not None and self.course.ear.small(states)
        self.over = self.calm and tail is not None and tail.quiet_from(self.state, memory)

    def coast(self, count: int) -> bool:
        """Go on as the linear system; False, and no step, where it would not stay one."""
        tail = self.course.tail
        assert tail is not None
        stretch = tail.stretch(self.state, self.memory, count)
        self.calm = np.abs(stretch[1]).max(initial=0.0) < tail.limit and self.course.ear.small(stretch[0])
        if self.calm:
            self.take(stretch, count)
        return self.calm

    def later_than(self, time: float) -> bool:
        """Whether it is known to become quiet later than a time [s] from switching on, or has diverged."""
        if not self.diverged and self.done * self.course.sample > time:
            self._listen()
        return self.diverged or (self.heard + 1) * self.course.sample > time

    def _listen(self) -> None:
        """Search for the last loud sample from the end back, which is soon found in all but the quiet ones."""
        after = self.done + 1
        for states in reversed(self.states):
            after -= len(states)
            loud = np.flatnonzero(self.course.ear.loud(states))
            if len(loud):
                self.heard = after + int(loud[-1])
                break
        self.states.clear()

    def end(self) -> End:
        """How it ended."""
        sample = self.course.sample
        self._listen()
        power, quiet = np.concatenate(self.power), self.heard + 1
        if self.diverged:
            return End(None, math.nan, self.peak)
        time = quiet * sample if quiet < len(power) else None
        return End(time, float(np.trapezoid(power[: quiet + 1], dx=sample)), self.peak)
