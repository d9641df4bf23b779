"""Owns the limit cycle: the periodic motion that flutter settles into, by time integration to convergence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.mesh import Floats
from solver.simulate import SAMPLE, Loop, first_mode_at_rest
from solver.trace import Trace

WINDOW = 0.1  # s of motion between two looks at the amplitude
AGREEMENT = 1e-4  # relative change of the amplitude from window to window that counts as converged
PATIENCE = 60  # windows; slow growth just above λ_cr needs many


@dataclass(frozen=True)
class LimitCycle:
    """A converged limit cycle, or the motion that took its place when none was reached."""

    converged: bool
    """Whether the amplitude came to rest; if not, the figures are those of the last window."""
    amplitude: float
    """Peak of w at the 0.75 a point over h [-]."""
    frequency: float
    """Frequency by upward crossings of zero [Hz]; 0 if there are fewer than two."""
    participation: Floats
    """(n,) share of each mode, max|q_r| / Σ max|q_s| [%] (the seed's 3.9), q_r scaled by the mode's peak."""
    state: Floats
    """(2n,) a state on the cycle, amplitudes [m·√kg] and rates [m·√kg/s]."""


def limit_cycle(loop: Loop) -> LimitCycle | None:
    """The limit cycle that the design's uncontrolled panel settles into from the start of the seed protocol.

    Returns:
        The cycle; None where the panel does not flutter, or the motion diverged.
    """
    plant = loop.plant
    if plant.growth.real <= 0:
        return None
    thickness = plant.design.panel.thickness
    state = first_mode_at_rest(plant, plant.design.run.initial_amplitude * thickness)
    samples = round(WINDOW / SAMPLE)
    peaks: list[float] = []
    trace = None
    for _ in range(PATIENCE):
        states, volts = loop.stretch(state, SAMPLE, samples, engaged=False)
        if len(states) < samples:
            return None
        state = states[-1]
        trace = Trace(plant, SAMPLE * np.arange(samples), states, volts)
        peaks.append(_peak(trace.probe))
        settled = len(peaks) > 2 and np.ptp(peaks[-3:]) <= AGREEMENT * peaks[-1]
        if settled and peaks[-1] > 10 * AGREEMENT:
            return _measured(trace, peaks[-1], state, converged=True)
    assert trace is not None
    return _measured(trace, peaks[-1], state, converged=False)


def _measured(trace: Trace, amplitude: float, state: Floats, converged: bool) -> LimitCycle:
    share = np.abs(trace.modal).max(axis=0)
    return LimitCycle(converged, amplitude, _frequency(trace.times, trace.probe), 100 * share / share.sum(), state)


def _peak(values: Floats) -> float:
    """Largest |value|, by a parabola through the highest sample and its neighbours."""
    size = np.abs(values)
    k = int(np.argmax(size[1:-1])) + 1
    left, top, right = size[k - 1 : k + 2]
    bend = left - 2 * top + right
    return float(top - (left - right) ** 2 / (8 * bend)) if bend < 0 else float(size.max())


def _frequency(times: Floats, values: Floats) -> float:
    """Mean frequency by upward zero crossings, interpolated linearly [Hz]."""
    k = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    if len(k) < 2:
        return 0.0
    crossing = times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k])
    return float((len(k) - 1) / (crossing[-1] - crossing[0]))
