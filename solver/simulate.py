"""Owns runs in time: a stretch of motion from any state, and the seed protocol from rest to damped."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.controllers import law_of
from solver.errors import ControlError
from solver.flutter import leading_of
from solver.law import Law, closed_loop, extended, line_nodes
from solver.mesh import Floats
from solver.plant import Plant
from solver.polynomial import force_table
from solver.propagator import Propagator
from solver.trace import Trace

if TYPE_CHECKING:
    from solver.exponential import Forces, Weights

SAMPLES_A_PERIOD = 40  # of a run, in a period of the flat panel's leading root
MOST_SAMPLES = 400_000  # of a run; a tiny panel's is sampled more coarsely, not integrated so
STEP_HIGHEST = 0.5  # classical step times the highest natural frequency; Runge-Kutta is stable to 2.8
# Step times the lowest: a step loses (ωh)⁶/72 of a mode's energy, at 0.03 so 2e-7 of the first mode's in 100 periods
STEP_LOWEST = 0.03
LONGER = 2.5  # times as long as the classical step is an exponential one, which has no such loss, and a smaller error
COUPLED = 0.5  # of the classical step, exponential ones too, where B ≠ 0: there any deflection moves the high modes
STEP_FASTEST = 1.0  # step times the fastest pole that the controller brings; those decay, and Runge-Kutta is stable
STIFFEST = 30.0  # times shorter than the panel's own a step may be made by that
MOST_NODES = 800  # of all delay lines together, in a dense eigenproblem
LANES = 32  # coefficients that the compiled force takes at a time: a rest takes as long, and is filled up
CHUNK = 4096  # steps at a time for which noise is drawn and what was asked for is kept


@dataclass(frozen=True)
class Memory:
    """What a controller carries from one stretch of motion to the next."""

    own: Floats
    """(m,) its own state z [its own units]."""
    when: Floats
    """(k,) instants at which it asked for something, back to a delay ago and one more, from now [s]; the last is the
    latest."""
    asked: Floats
    """(k, channels) what it asked for then [V]; before the first it asked for nothing."""
    drawn: int
    """How many times noise was drawn [-]."""

    @staticmethod
    def blank(law: Law) -> Memory:
        """That of a controller which is just being set up: estimating no motion, having asked for nothing."""
        return Memory(np.zeros(law.memory), np.zeros(0), np.zeros((0, len(law.gain))), 0)

    def fits(self, law: Law) -> bool:
        """Whether a law could go on from here: with as many states of its own and as many channels."""
        return len(self.own) == law.memory and self.asked.shape[1] == len(law.gain)


Stretch = tuple[Floats, Floats, Memory]
"""States (samples, 2n), voltages (samples, channels), and what the controller remembers at the end."""


@dataclass(frozen=True)
class Loop:
    """A plant and the law that drives it, laid out for the kernel."""

    plant: Plant
    """The panel in its stream."""
    law: Law
    """The control law, which a stretch may leave disengaged."""
    linear: Floats
    """(n, 2n) K and C side by side."""
    precision: type[np.floating] = np.float32
    """That in which exponential steps work out the law of large deflection; everything else is in double precision."""

    @staticmethod
    def of(plant: Plant, law: Law | None = None) -> Loop:
        """Lay out a plant and a law, by default that of the design's controller.

        Raises:
            ControlError: the design's controller does not exist, or is too fast to be integrated.
        """
        loop = Loop(plant, law or law_of(plant), np.hstack([plant.stiffness, plant.damping]))
        if STEP_FASTEST / max(loop._fastest, 1e-300) < loop._panel_step / STIFFEST:
            raise ControlError(
                f"the controller brings a pole of {loop._fastest:.2g} /s, far beyond the panel's highest mode: use a "
                "smaller control.rate_gain or control.observer_weight, or a smaller gain of your own"
            )
        lines = min(len(loop.law.gain), 2 * plant.size + loop.law.memory)
        if line_nodes(plant, loop.law) * lines > MOST_NODES:
            turned = loop.law.delay * plant.model.band[1]
            raise ControlError(
                f"control.delay = {loop.law.delay:g} s: the highest mode turns {turned:.0f} rad in that time, too "
                "often for its eigenvalues; use a shorter delay, fewer modes or fewer channels"
            )
        return loop

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Poles of the closed loop about the flat panel [1/s]; with a delay, those nearest to the imaginary axis."""
        return np.linalg.eigvals(closed_loop(self.plant, self.law)).astype(np.complex128)

    @cached_property
    def growth(self) -> complex:
        """Leading pole of the closed loop: growth rate [1/s] + i·frequency [rad/s]."""
        return leading_of(self.poles)

    @cached_property
    def table(self) -> Floats:
        """(n, monomials) the law of large deflection as a polynomial, as `polynomial.force_table` gives it."""
        return force_table(self.plant.model.membrane)

    @property
    def _panel_step(self) -> float:
        """Longest classical time step that the panel's motion allows [s]."""
        lowest, highest = self.plant.model.band
        return min(STEP_HIGHEST / highest, STEP_LOWEST / lowest)

    @cached_property
    def _fastest(self) -> float:
        """Size of the fastest pole, at work or saturated [1/s]; 0 for a controller that brings none of its own."""
        a, b, k = extended(self.plant, self.law)
        if not k.any() and not self.law.memory:
            return 0.0
        found = [np.linalg.eigvals(a - b @ k) if self.law.delay else self.poles]
        if self.law.memory:  # saturated, z moves by a alone
            found.append(np.linalg.eigvals(a))
        return max(float(np.abs(values).max()) for values in found)

    @cached_property
    def _step(self) -> float:
        """Longest classical time step [s] that all motions of panel and controller allow."""
        step = self._panel_step * (COUPLED if len(self.plant.model.membrane.cubic) else 1.0)
        step = min(step, STEP_FASTEST / max(self._fastest, 1e-300))
        return min(step, self.law.delay) if self.law.delay else step

    @cached_property
    def _long_step(self) -> float:
        """Longest exponential time step [s]: of a gain, what it feeds back is all that is not in the exponential."""
        if self.law.memory:  # an estimator may be fast, and what drives it is outside as well
            return self._step
        step = self._panel_step * (COUPLED if len(self.plant.model.membrane.cubic) else LONGER)
        _, b, k = extended(self.plant, self.law)
        n = self.plant.size
        feedback = -b @ k
        feedback[:n, n : 2 * n] += np.eye(n)  # it may drive what has no stiffness of its own as fast as this
        return min(step, STEP_FASTEST / max(float(np.abs(np.linalg.eigvals(feedback)).max()), 1e-300))

    def stretch(self, state: Floats, sample: float, samples: int, engaged: bool) -> tuple[Floats, Floats]:
        """Integrate from a state, with a controller that is just being set up.

        Args:
            state: (2n,) amplitudes and rates.
            sample: time between samples [s].
            samples: how many.
            engaged: whether the controller drives the patches.

        Returns:
            States (samples, 2n) and voltages (samples, channels) after each interval; shorter if the motion diverged.
        """
        law = self.law if engaged else self._idle
        return self._run(state, Memory.blank(law), law, sample, samples)[:2]

    def run(self, state: Floats, memory: Memory, sample: float, samples: int, engaged: bool) -> Stretch:
        """As `stretch`, with what the controller remembers, and will in the end; disengaged, it goes on listening."""
        return self._run(state, memory, self.law if engaged else self._listening, sample, samples)

    def advance(self, state: Floats, memory: Memory, sample: float, samples: int, engaged: bool) -> Stretch:
        """As `run` by classical steps: for stretches too short to make exponentials for."""
        return self._classical(state, memory, self.law if engaged else self._listening, sample, samples)

    @cached_property
    def _idle(self) -> Law:
        """A law that asks for nothing and listens to nothing."""
        return Law.idle(self.plant)

    @cached_property
    def _listening(self) -> Law:
        """The law disengaged."""
        return dataclasses.replace(self.law.scaled(0.0), delay=0.0)

    def _run(self, state: Floats, memory: Memory, law: Law, sample: float, samples: int) -> Stretch:
        way = self._classical if law.delay or law.hears_noise else self._exponential
        return way(state, memory, law, sample, samples)

    def _exponential(self, state: Floats, memory: Memory, law: Law, sample: float, samples: int) -> Stretch:
        """By exponential steps, for a law without delay and noise."""
        from solver.exponential import integrate  # here, because numba takes long to start

        n, substeps = self.plant.size, self.steps_of(sample)
        weights = self._weights(law, sample / substeps)
        states, volts = np.empty((samples, 2 * n + law.memory)), np.empty((samples, len(law.gain)))
        start = np.concatenate([state, memory.own])
        finite = integrate(start, *weights, self._forces(law), substeps, states, volts)
        own = states[finite - 1, 2 * n :].copy() if finite else memory.own
        kept = Memory(own, np.zeros(0), np.zeros((0, len(law.gain))), memory.drawn)
        return states[:finite, : 2 * n], volts[:finite], kept

    def _forces(self, law: Law) -> Forces:
        """What is not linear, laid out; kept."""
        from solver.exponential import Forces

        if law not in self._laid_out:
            force = self.plant.force
            self._laid_out[law] = Forces(
                *self._law_in_units,
                self.plant.model.load,
                np.ascontiguousarray(force),
                np.ascontiguousarray(law.driven),
                np.hstack([law.direct(force), law.reading]),
                law.limit,
            )
        return self._laid_out[law]

    @cached_property
    def _laid_out(self) -> dict[Law, Forces]:
        return {}

    @cached_property
    def _law_in_units(self) -> tuple[Floats, float]:
        """The law for amplitudes over a unit, by which the panel deflects about h, and that unit.

        In single precision a panel of micrometres would else be near the smallest numbers that there are.
        """
        n, table = self.plant.size, self.table
        unit = self.plant.design.panel.thickness / float(self.plant.model.peak.max())
        cubes = n * (n + 1) * (n + 2) // 6
        whole = np.zeros((n, -(-table.shape[1] // LANES) * LANES), self.precision)
        whole[:, : table.shape[1]] = table * np.where(np.arange(table.shape[1]) < cubes, unit**3, unit**2)
        return whole, unit

    def _weights(self, law: Law, step: float) -> tuple[Weights, Weights]:
        """Exponentials of a step of the panel and the controller's own states; kept, as stretches are alike."""
        from solver.exponential import weights_of

        n, m = self.plant.size, law.memory
        key = (m, step)
        if key not in self._known_weights:
            a = np.zeros((2 * n + m, 2 * n + m))
            a[:n, n : 2 * n] = np.eye(n)
            a[n : 2 * n, : 2 * n] = -self.linear
            a[2 * n :, :n] = law.sensed @ self.plant.force.T
            a[2 * n :, 2 * n :] = law.own
            b = np.eye(2 * n + m)[:, n:]
            self._known_weights[key] = weights_of(Propagator.of(a, b, step))
        return self._known_weights[key]

    def steps_of(self, sample: float) -> int:
        """Number of exponential steps from one sample to the next, a time [s] later."""
        return max(1, math.ceil(sample / self._long_step))

    @cached_property
    def _known_weights(self) -> dict[tuple[int, float], tuple[Weights, Weights]]:
        return {}

    def _classical(self, state: Floats, memory: Memory, law: Law, sample: float, samples: int) -> Stretch:
        """By classical Runge-Kutta steps, with delay and noise where the law has them."""
        from solver.kernel import integrate  # here, because numba takes long to start

        plant, n = self.plant, self.plant.size
        substeps = max(1, math.ceil(sample / self._step))
        step = sample / substeps
        gain = np.hstack([law.direct(plant.force), law.reading])
        own = np.hstack([law.sensed @ plant.force.T, np.zeros((law.memory, n)), law.own])
        states = np.empty((samples, 2 * n + law.memory))
        volts = np.empty((samples, len(gain)))
        chunk = max(1, CHUNK // substeps) if law.delay or law.hears_noise else max(1, samples)
        x = np.concatenate([state, memory.own])
        for first in range(0, samples, chunk):
            part = slice(first, min(first + chunk, samples))
            steps = (part.stop - first) * substeps
            known = len(memory.when)
            when, asked = memory.when, memory.asked
            if law.delay:
                when, asked = (
                    np.concatenate([when, np.empty(steps + 1)]),
                    np.vstack([asked, np.empty((steps + 1, len(gain)))]),
                )
            jitter = _jitter(law, memory.drawn, steps, step)
            finite = integrate(
                x,
                self.linear,
                self.table,
                plant.model.load,
                np.ascontiguousarray(plant.force),
                np.ascontiguousarray(gain),
                own,
                np.ascontiguousarray(law.driven),
                law.limit,
                jitter,
                law.delay,
                when,
                asked,
                known,
                step,
                substeps,
                states[part],
                volts[part],
            )
            if finite < part.stop - first:
                return states[: first + finite, : 2 * n], volts[: first + finite], memory
            x = states[part.stop - 1]
            memory = _remembered(
                law, x[2 * n :], when, asked, known + steps, steps * step, memory.drawn + bool(len(jitter))
            )
        return states[:, : 2 * n], volts, memory


def _jitter(law: Law, drawn: int, steps: int, step: float) -> Floats:
    """(steps, channels + m) noise on U and ż, held for a step each; (0, channels + m) where there is none.

    Held for a step h, white noise of one-sided density S has the variance S²/(2h): its band ends at 1/(2h).
    """
    c = len(law.gain)
    if not law.hears_noise:
        return np.zeros((0, c + law.memory))
    noise = np.random.default_rng((law.seed, drawn)).normal(0.0, law.noise / math.sqrt(2 * step), (steps, c))
    return np.hstack([-noise @ (law.on_charge + law.on_current).T, noise @ law.sensed.T])


def _remembered(law: Law, own: Floats, when: Floats, asked: Floats, known: int, elapsed: float, drawn: int) -> Memory:
    """The memory after a time, with what was asked for in the last delay, and the record before that."""
    if not law.delay:
        return Memory(own.copy(), np.zeros(0), np.zeros((0, len(law.gain))), drawn)
    times = when[:known] - elapsed
    first = max(0, int(np.searchsorted(times, -law.delay, side="right")) - 2)  # and the one before, for the parabola
    return Memory(own.copy(), times[first:], asked[first:known], drawn)


def loop_if_any(plant: Plant, law: Law | None = None) -> Loop | None:
    """As `Loop.of`, or None where the controller does not exist or is too fast."""
    try:
        return Loop.of(plant, law)
    except ControlError:
        return None


def first_mode_at_rest(plant: Plant, amplitude: float) -> Floats:
    """(2n,) state at rest in the first mode with the given largest |w| [m]."""
    state = np.zeros(2 * plant.size)
    state[0] = amplitude / plant.model.peak[0]
    return state


def seed_protocol(loop: Loop) -> Trace:
    """The run of the design: from rest in the first mode, uncontrolled until t_on, then controlled to the end.

    A controller that estimates the motion listens from the start.
    """
    run = loop.plant.design.run
    start, sample, free = seed_start(loop)
    rest = round((run.duration - run.control_on) / sample)
    before, idle, memory = until_on(loop)
    states, volts = [start[None], before], [np.zeros((1, idle.shape[1])), idle]
    if len(before) == free:
        after, driven, _ = loop.run(before[-1] if free else start, memory, sample, rest, engaged=True)
        states.append(after)
        volts.append(driven)
    states = np.concatenate(states)
    return Trace(
        loop.plant, sample * np.arange(len(states)), states, np.concatenate(volts), len(states) == free + rest + 1
    )


def until_on(loop: Loop) -> Stretch:
    """The seed protocol up to t_on, without its start; shorter if the motion diverged."""
    start, sample, free = seed_start(loop)
    return loop.run(start, Memory.blank(loop.law), sample, free, engaged=False)


def seed_start(loop: Loop) -> tuple[Floats, float, int]:
    """State (2n,) at the start of the seed protocol, time between samples [s] and their number up to t_on."""
    run = loop.plant.design.run
    start = first_mode_at_rest(loop.plant, run.initial_amplitude * loop.plant.design.panel.thickness)
    sample = max(loop.plant.period / SAMPLES_A_PERIOD, run.duration / MOST_SAMPLES)
    # samples are equally spaced and t_on is one of them (the end, where t_on is the start)
    span = run.control_on or run.duration
    sample = span / math.ceil(span / sample)
    return start, sample, round(run.control_on / sample)
