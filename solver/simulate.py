"""Owns runs in time: a stretch of motion from any state, and the seed protocol from rest to damped."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solver.kernel import integrate
from solver.mesh import Floats
from solver.plant import Plant
from solver.regulator import Regulator
from solver.trace import Trace

SAMPLES_A_PERIOD = 32  # of a run, in a period of the flat panel's leading root
MOST_SAMPLES = 400_000  # of a run; a tiny panel's is sampled more coarsely, not integrated so
STEP_HIGHEST = 0.5  # step times the highest natural frequency; Runge-Kutta is stable to 2.8
# Step times the lowest: a step loses (ωh)⁶/72 of a mode's energy, at 0.03 so 2e-7 of the first mode's in 100 periods
STEP_LOWEST = 0.03
COUPLED = 0.5  # of that step where B ≠ 0: there any deflection moves the high modes, which lose energy first


@dataclass(frozen=True)
class Loop:
    """A plant and its regulator laid out for the kernel."""

    plant: Plant
    """The panel in its stream."""
    regulator: Regulator
    """The regulator, which a stretch may leave disengaged."""
    linear: Floats
    """(n, 2n) K and C side by side."""

    @staticmethod
    def of(plant: Plant, regulator: Regulator | None = None) -> Loop:
        """Lay out a plant and a regulator; without one the loop stays open.

        Raises:
            ControlError: a regulator was left to be made and does not exist.
        """
        return Loop(plant, regulator or Regulator.of(plant), np.hstack([plant.stiffness, plant.damping]))

    def stretch(self, state: Floats, sample: float, samples: int, engaged: bool) -> tuple[Floats, Floats]:
        """Integrate from a state.

        Args:
            state: (2n,) amplitudes and rates.
            sample: time between samples [s].
            samples: how many.
            engaged: whether the regulator drives the patches.

        Returns:
            States (samples, 2n) and voltages (samples, channels) after each interval; shorter if the motion diverged.
        """
        gain = self.regulator.gain
        lowest, highest = self.plant.model.band
        step = min(STEP_HIGHEST / highest, STEP_LOWEST / lowest)
        step *= COUPLED if len(self.plant.model.membrane.cubic) else 1.0
        substeps = max(1, math.ceil(sample / step))
        states = np.empty((samples, len(state)))
        volts = np.empty((samples, len(gain)))
        finite = integrate(
            state,
            self.linear,
            self.plant.model.membrane.quartic,
            self.plant.model.membrane.cubic,
            self.plant.model.load,
            np.ascontiguousarray(self.plant.force),
            np.ascontiguousarray(gain) if engaged else np.zeros_like(gain),
            self.regulator.limit,
            sample / substeps,
            substeps,
            states,
            volts,
        )
        return states[:finite], volts[:finite]


def first_mode_at_rest(plant: Plant, amplitude: float) -> Floats:
    """(2n,) state at rest in the first mode with the given largest |w| [m]."""
    state = np.zeros(2 * plant.size)
    state[0] = amplitude / plant.model.peak[0]
    return state


def seed_protocol(loop: Loop) -> Trace:
    """The run of the design: from rest in the first mode, uncontrolled until t_on, then controlled to the end."""
    run = loop.plant.design.run
    start = first_mode_at_rest(loop.plant, run.initial_amplitude * loop.plant.design.panel.thickness)
    sample = max(loop.plant.period / SAMPLES_A_PERIOD, run.duration / MOST_SAMPLES)
    # samples are equally spaced and t_on is one of them (the end, where t_on is the start)
    span = run.control_on or run.duration
    sample = span / math.ceil(span / sample)
    free, rest = round(run.control_on / sample), round((run.duration - run.control_on) / sample)
    before, idle = loop.stretch(start, sample, free, engaged=False)
    states, volts = [start[None], before], [np.zeros((1, idle.shape[1])), idle]
    if len(before) == free:
        after, driven = loop.stretch(before[-1] if free else start, sample, rest, engaged=True)
        states.append(after)
        volts.append(driven)
    states = np.concatenate(states)
    return Trace(
        loop.plant, sample * np.arange(len(states)), states, np.concatenate(volts), len(states) == free + rest + 1
    )
