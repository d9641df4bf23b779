"""Owns runs of the full-order model in time, as a reference for the reduced one, and what is measured on them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solver.errors import ControlError
from solver.fullorder import FullModel
from solver.implicit import SPECTRAL_RADIUS, FullState, Stepper
from solver.limitcycle import LimitCycle, limit_cycle, measured_cycle, peak_of, resting
from solver.mesh import Floats
from solver.modes import ModalModel
from solver.simulate import MOST_SAMPLES, SAMPLES_A_PERIOD, Loop, first_mode_at_rest
from solver.trace import PROBE, Trace

STEPS_A_PERIOD = 128  # of the flat panel's leading root; the error goes with the square of the step
WINDOW_PERIODS = 4  # between two looks at the amplitude; a cycle that starts near rest needs no longer ones
PATIENCE = 40  # windows
QUIET = 0.1  # of `run.settled`: a controlled panel below this for QUIET_PERIODS has come to rest
QUIET_PERIODS = 8


@dataclass(frozen=True, kw_only=True)
class FullTrace(Trace):
    """A run of the full-order model; its states are Φᵀ M w and Φᵀ M ẇ, the motion as a regulator sees it."""

    deflections: Floats
    """(samples, N) w at the free bending dofs [m and its derivatives]."""
    rates: Floats
    """(samples, N) their rates [m/s and its derivatives]."""

    @property
    def end(self) -> FullState:
        """The last state, from which a run can go on."""
        return FullState(self.deflections[-1], self.rates[-1])

    @property
    def probe(self) -> Floats:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(samples,) w at the 0.75 a point over h [-], of the whole motion and not of its projection."""
        panel = self.plant.design.panel
        values = self._field(self.deflections).at(PROBE[0] * panel.length, PROBE[1] * panel.width)
        return values / panel.thickness

    @property
    def largest(self) -> Floats:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(samples,) largest |w| on the panel over h [-], on a grid of 2 by 4 points an element."""
        result = np.empty(len(self.times))
        for k in range(0, len(result), 512):  # a few MB at a time
            field = self._field(self.deflections[k : k + 512]).sampled(2, 4)
            result[k : k + 512] = np.abs(field).max(axis=(0, 1))
        return result / self.plant.design.panel.thickness

    def _field(self, deflections: Floats) -> ModalModel:
        """Deflections (samples, N) as if they were mode shapes, to be sampled like them."""
        nothing = np.zeros(len(deflections))
        return ModalModel(self.plant.model.plate, deflections.T, nothing, nothing.astype(int))


def refuse_memory(loop: Loop) -> None:
    """Refuse a law that is more than a gain on the present motion.

    Raises:
        ControlError: it is.
    """
    if not loop.law.instant:
        raise ControlError(
            "the full-order model takes controllers that act at once on the present motion: use control.kind = lqr or "
            "rate with control.delay = 0 and control.sensor_noise = 0, or do without the full-order model"
        )


def full_run(
    loop: Loop,
    start: Floats | FullState,
    sample: float,
    samples: int,
    engaged: bool,
    *,
    full: FullModel | None = None,
    steps: int | None = None,
    rho: float = SPECTRAL_RADIUS,
) -> FullTrace:
    """Integrate the full-order model of a loop's design, under the loop's control law.

    Args:
        loop: plant and law; the modes of the one are the filter through which the other sees the motion.
        start: (2n,) amplitudes and rates in the plant's modes, or a state of the full model.
        sample: time between samples [s].
        samples: how many.
        engaged: whether the law drives the patches.
        full: the model, if it is there already.
        steps: time steps a sample; by default as many as give `STEPS_A_PERIOD`.
        rho: ρ∞ of the generalized-α method, 0 to 1 [-].

    Returns:
        The run from its start, at which its time is 0, to its end: samples + 1 instants.

    Raises:
        ArithmeticError: Newton's method does not converge at some step.
        ControlError: the law remembers, delays or hears noise, which this model has no place for.
    """
    plant, model = loop.plant, loop.plant.model
    if engaged:
        refuse_memory(loop)
    full = full or FullModel.of(plant.design, model.plate)
    state = start if isinstance(start, FullState) else FullState.of(model, start)
    steps = steps or max(1, math.ceil(sample * STEPS_A_PERIOD / plant.period))
    stepper = Stepper(full, model, loop.law if engaged else None, state, sample / steps, rho)
    deflections, rates = (np.empty((samples + 1, full.bending_size)) for _ in range(2))
    volts = np.zeros((samples + 1, full.drive.shape[1]))
    for k in range(samples + 1):
        deflections[k], rates[k] = stepper.w, stepper.v
        if engaged:
            volts[k] = stepper.volts(stepper.w, stepper.v)
        if k < samples:
            for _ in range(steps):
                stepper.advance()
    seen = np.hstack([deflections @ stepper.filter.T, rates @ stepper.filter.T])
    times = sample * np.arange(samples + 1)
    return FullTrace(plant=plant, times=times, states=seen, volts=volts, deflections=deflections, rates=rates)


def full_limit_cycle(loop: Loop, steps: int = STEPS_A_PERIOD) -> LimitCycle | None:
    """The limit cycle of the full-order model, from that of the reduced one on.

    Args:
        loop: plant and law; the latter stays disengaged.
        steps: time steps a period of the flat panel's leading root.

    Returns:
        The cycle, measured as `limit_cycle` measures it; None where the reduced model has none.

    Raises:
        ArithmeticError: Newton's method does not converge at some step.
    """
    near, plant = limit_cycle(loop), loop.plant
    if near is None:
        return None
    full, state = FullModel.of(plant.design, plant.model.plate), FullState.of(plant.model, near.state)
    peaks: list[float] = []
    for window in range(PATIENCE):
        trace = full_run(loop, state, plant.period / steps, WINDOW_PERIODS * steps, False, full=full, steps=1)
        state = trace.end
        peaks.append(peak_of(trace.probe))
        rests = all(resting(peaks[: len(peaks) - k]) for k in range(3))
        if rests or window == PATIENCE - 1:
            return measured_cycle(trace, peaks[-1], trace.states[-1], rests)
    return None


def full_seed_protocol(loop: Loop, steps: int = STEPS_A_PERIOD) -> FullTrace:
    """The run of the design, as `seed_protocol`, until it ends or the controlled panel has come to rest.

    Args:
        loop: plant and law.
        steps: time steps a period of the flat panel's leading root, about.

    Raises:
        ArithmeticError: Newton's method does not converge at some step.
        ControlError: as `full_run`.
    """
    plant = loop.plant
    refuse_memory(loop)
    run, full = plant.design.run, FullModel.of(plant.design, plant.model.plate)
    # the samples are those of the reduced run, so that peaks between them are missed alike
    sample = max(plant.period / SAMPLES_A_PERIOD, run.duration / MOST_SAMPLES)
    span = run.control_on or run.duration
    sample = span / math.ceil(span / sample)
    a_sample = max(1, round(steps * sample / plant.period))
    free, rest = round(run.control_on / sample), round((run.duration - run.control_on) / sample)
    start = first_mode_at_rest(plant, run.initial_amplitude * plant.design.panel.thickness)
    traces = [full_run(loop, start, sample, free, False, full=full, steps=a_sample)]
    window = math.ceil(QUIET_PERIODS * plant.period / sample)
    while rest > 0:
        count = min(window, rest)
        traces.append(full_run(loop, traces[-1].end, sample, count, True, full=full, steps=a_sample))
        rest -= count
        if traces[-1].largest.max() < QUIET * run.settled:
            break
    # a stretch begins where the one before it ended; that instant's voltage is the earlier one's, as in the reduced run
    states, volts, deflections, rates = (
        np.concatenate([getattr(trace, name)[k > 0 :] for k, trace in enumerate(traces)])
        for name in ("states", "volts", "deflections", "rates")
    )
    times = sample * np.arange(len(states))
    return FullTrace(plant=plant, times=times, states=states, volts=volts, deflections=deflections, rates=rates)
