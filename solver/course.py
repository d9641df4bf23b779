"""Owns the course of runs under control: how they end, damped within the design's run or not, and what that takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from solver.law import closed_loop, extended
from solver.mesh import Bools, Floats
from solver.simulate import MOST_SAMPLES, SAMPLES_A_PERIOD, Loop, Memory, Stretch, seed_start, until_on

LOOK = 4  # periods after which runs are looked at, and ended if they have been loud for too long
SPARSE = 29  # every so many points of the grid show most loud motions to be loud, without a look at the others
LINEAR = 3e-3  # of h: the membrane's forces, which go with the square, are 1e-5 of the others there


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
    """The loop as the linear system that it is for small motions; None where it has a delay or noise."""

    @staticmethod
    def of(loop: Loop, sample: float | None = None) -> Course:
        """The course of a loop from switching on to the end of the run, by default at as many samples as a run has."""
        run = loop.plant.design.run
        span = run.duration - run.control_on
        samples = min(math.ceil(span * SAMPLES_A_PERIOD / loop.plant.period), MOST_SAMPLES)
        if sample is None:
            sample = span / samples
        plain = loop.law.delay or loop.law.hears_noise
        return Course(
            loop,
            sample,
            round(span / sample),
            Ear.of(loop),
            None if plain else Tail.of(loop, sample, LOOK * SAMPLES_A_PERIOD),
        )

    def ends(self, starts: Sequence[tuple[Floats, Memory]], within: float | None = None) -> list[End]:
        """Run from states on, the controller at work, until they are quiet for good or the design's run is over.

        What has become small enough goes on as the linear system that it then is, by powers of its exponential: exact,
        and a great deal faster. Should it grow again, or ask for more than the limit, it is integrated as before.

        Args:
            starts: states (2n,) with what the controller remembers, run side by side.
            within: time [s]; as soon as one run is loud after it, all end, and none counts as damped; None waits for
                all.
        """
        look = LOOK * SAMPLES_A_PERIOD
        runs = [_Run.of(self, state, memory) for state, memory in starts]
        for first in range(0, self.samples, look):
            count = min(look, self.samples - first)
            going = [one for one in runs if not one.over and not (one.calm and one.coast(self, count))]
            if going:
                stretches = self.loop.run([(one.state, one.memory) for one in going], self.sample, count, engaged=True)
                for one, stretch in zip(going, stretches, strict=True):
                    one.take(self, stretch, count)
            if within is not None and any(one.diverged or one.loud * self.sample > within for one in runs):
                return [End(None, math.nan, one.peak) for one in runs]
            if all(one.over for one in runs):
                break
        return [one.end(self.sample) for one in runs]


def seed_damping_time(loop: Loop) -> float | None:
    """`Trace.damping_time` of the seed protocol [s], for which its run need not be gone through to the end."""
    plant, (start, sample, free) = loop.plant, seed_start(loop)
    if plant.passive or not plant.channels or plant.design.run.duration <= plant.design.run.control_on:
        return None
    states, _, memory = until_on(loop)
    if len(states) < free:
        return None
    return Course.of(loop, sample).ends([(states[-1] if free else start, memory)])[0].time


@dataclass
class _Run:
    """What is kept of a run while it goes on."""

    state: Floats
    memory: Memory
    loud: int  # number of the last sample that was loud, the first being that of switching on; -1 if none was
    power: list[Floats]  # VᵀV of the samples
    peak: float = 0.0
    done: int = 0
    calm: bool = False  # small enough to be linear
    diverged: bool = False
    over: bool = False

    @staticmethod
    def of(course: Course, state: Floats, memory: Memory) -> _Run:
        """A run that begins now."""
        law = course.loop.law
        asked = extended(course.loop.plant, law)[2] @ np.concatenate([state, memory.own])
        first = np.zeros(1) if law.delay else (np.clip(asked, -law.limit, law.limit) ** 2).sum(keepdims=True)
        return _Run(state, memory, 0 if course.ear.loud(state[None])[0] else -1, [first])

    def take(self, course: Course, stretch: Stretch, count: int) -> None:
        """Go on by a stretch that was to have `count` samples."""
        states, volts, memory = stretch
        loud = np.flatnonzero(course.ear.loud(states))
        if len(loud):
            self.loud = self.done + 1 + int(loud[-1])
        self.power.append((volts**2).sum(axis=1))
        self.peak = max(self.peak, float(np.abs(volts).max(initial=0.0)))
        self.done += len(states)
        self.diverged = self.over = len(states) < count
        if self.diverged:
            return
        self.state, self.memory = states[-1], memory
        self.calm = course.tail is not None and course.ear.small(states)
        self.over = self.calm and course.tail is not None and course.tail.quiet_from(self.state, memory)

    def coast(self, course: Course, count: int) -> bool:
        """Go on as the linear system; False, and no step, where it would not stay one."""
        assert course.tail is not None
        stretch = course.tail.stretch(self.state, self.memory, count)
        self.calm = np.abs(stretch[1]).max(initial=0.0) < course.tail.limit and course.ear.small(stretch[0])
        if self.calm:
            self.take(course, stretch, count)
        return self.calm

    def end(self, sample: float) -> End:
        """How it ended, given the time between samples [s]."""
        power, quiet = np.concatenate(self.power), self.loud + 1
        if self.diverged:
            return End(None, math.nan, self.peak)
        time = quiet * sample if quiet < len(power) else None
        return End(time, float(np.trapezoid(power[: quiet + 1], dx=sample)), self.peak)


@dataclass(frozen=True)
class Tail:
    """The closed loop as a linear system: its states after each sample of a look, and a bound on all that follow.

    With AᵀP + PA = -1, XᵀPX only falls, and a figure cᵀX never exceeds √(XᵀPX · cᵀP⁻¹c) (Lyapunov).
    """

    powers: Floats
    """(samples, S, S) exp(A_cl t) after each [-]."""
    gain: Floats
    """(channels, S) of what is asked for [V per unit of state]."""
    limit: float
    """Largest voltage [V]."""
    root: Floats | None
    """(S, S) R with P = RᵀR, of the state in (Ωq, q̇, z) times `scale`; None where the loop is not stable [√s]."""
    scale: Floats
    """(S,) what the state is multiplied by for that [rad/s, -]."""
    most: float
    """Largest √(cᵀP⁻¹c) of |w| over the limit of what is quiet, at any point [1/√s]."""

    @staticmethod
    def of(loop: Loop, sample: float, samples: int) -> Tail:
        """The tail of a loop without delay and noise."""
        plant, a = loop.plant, closed_loop(loop.plant, loop.law)
        powers = scipy.linalg.expm(a * sample)[None]
        while len(powers) < samples:
            powers = np.concatenate([powers, powers @ powers[-1]])
        scale = np.concatenate([plant.model.omega, np.ones(plant.size + loop.law.memory)])
        root, most = None, math.inf
        if loop.growth.real < 0:
            form = scipy.linalg.solve_continuous_lyapunov((a * scale[:, None] / scale).T, -np.eye(len(a)))
            try:
                root = np.linalg.cholesky((form + form.T) / 2).T
            except np.linalg.LinAlgError:  # stable by less than rounding
                root = None
        if root is not None:
            shapes = plant.model.coarse / (plant.design.panel.thickness * plant.design.run.settled * plant.model.omega)
            whole = np.zeros((len(a), len(shapes)))
            whole[: plant.size] = shapes.T
            most = float(np.linalg.norm(scipy.linalg.solve_triangular(root, whole, trans="T"), axis=0).max())
        return Tail(powers[:samples], extended(plant, loop.law)[2], loop.law.limit, root, scale, most)

    def stretch(self, state: Floats, memory: Memory, count: int) -> Stretch:
        """As `Loop.run` of one state."""
        x = self.powers[:count] @ np.concatenate([state, memory.own])
        kept = Memory(x[-1, len(state) :].copy(), memory.when, memory.asked, memory.drawn)
        return x[:, : len(state)], -x @ self.gain.T, kept

    def quiet_from(self, state: Floats, memory: Memory) -> bool:
        """Whether a small motion stays quiet for ever from a state (2n,) on, by the bound."""
        if self.root is None:
            return False
        return bool(np.linalg.norm(self.root @ (self.scale * np.concatenate([state, memory.own]))) * self.most < 1.0)


@dataclass(frozen=True)
class Ear:
    """Tells loud states from quiet ones, with a look at the whole panel only where that is not plain."""

    shapes: Floats
    """(n, points) mode shapes over h times the limit of what is quiet [1/(m·√kg)]."""
    few: Floats
    """(n, some points) of them [1/(m·√kg)]."""
    peak: Floats
    """(n,) their largest absolute values [1/(m·√kg)]."""
    linear: float
    """`LINEAR` over that limit [-]."""

    @staticmethod
    def of(loop: Loop) -> Ear:
        """The ear for the limit of the design's run."""
        model, design = loop.plant.model, loop.plant.design
        shapes = np.ascontiguousarray(model.coarse.T) / (design.panel.thickness * design.run.settled)
        few = np.ascontiguousarray(shapes[:, ::SPARSE])
        return Ear(shapes, few, np.abs(shapes).max(axis=1), LINEAR / design.run.settled)

    def loud(self, states: Floats) -> Bools:
        """(samples,) whether the largest |w| of states (samples, 2n) is not below the limit."""
        q = states[:, : len(self.peak)]
        loud = np.zeros(len(q), dtype=bool)
        unsure = np.flatnonzero(~(np.abs(q) @ self.peak < 1.0))
        for shapes in (self.few, self.shapes):
            heard = ~(np.abs(q[unsure] @ shapes).max(axis=1) < 1.0)
            loud[unsure[heard]] = True
            unsure = unsure[~heard]
        return loud

    def small(self, states: Floats) -> bool:
        """Whether |w| of all states (samples, 2n) is so small that they are linear."""
        return bool((np.abs(states[:, : len(self.peak)]) @ self.peak).max() < self.linear)
