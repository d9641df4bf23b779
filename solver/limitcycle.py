"""Owns the limit cycle: the periodic motion that flutter settles into, by time integration to convergence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.mesh import Floats
from solver.simulate import Loop, first_mode_at_rest
from solver.trace import Trace

SAMPLES_A_PERIOD = 128  # fewer, and a peak that falls between samples moves by more than NOISE
WINDOW_PERIODS = 16  # of the flat panel's leading root, between two looks at the amplitude
NOISE = 1e-4  # relative change of the amplitude that sampling alone can make
AGREEMENT = 1e-3  # relative change still to come, were it to go on as it does, that counts as converged
SMALL = 1e-3  # of h; a motion below it has not begun to be a cycle
PATIENCE = 150  # windows; slow growth just above λ_cr, or a slow return to symmetry, needs many


@dataclass(frozen=True)
class LimitCycle:
    """A converged limit cycle, or the motion that took its place when none was reached."""

    converged: bool
    """Whether the amplitude came to rest; if not, the figures are those of the last window."""
    amplitude: float
    """Peak of |w| at the 0.75 a point over h [-]."""
    frequency: float
    """Frequency by upward crossings of the middle of its range [Hz]; 0 if there are fewer than two."""
    participation: Floats
    """(n,) share of each mode, max|q_r| / Σ max|q_s| [%] (the seed's 3.9), q_r scaled by the mode's peak."""
    state: Floats
    """(2n,) a state on the cycle, amplitudes [m·√kg] and rates [m·√kg/s]."""


def limit_cycle(loop: Loop, start: Floats | None = None) -> LimitCycle | None:
    """The limit cycle that the design's uncontrolled panel settles into.

    Args:
        loop: the panel; its control law is not used.
        start: (2n,) state to start from; that of the seed protocol if none is given.

    Returns:
        The cycle; None where the panel does not flutter, comes to rest in a deflection, or the motion diverged.
    """
    plant = loop.plant
    if start is None and not plant.flutters:
        return None
    thickness = plant.design.panel.thickness
    state = first_mode_at_rest(plant, plant.design.run.initial_amplitude * thickness) if start is None else start
    sample, samples = plant.period / SAMPLES_A_PERIOD, WINDOW_PERIODS * SAMPLES_A_PERIOD
    peaks: list[float] = []
    trace = None
    for _ in range(PATIENCE):
        states, volts = loop.stretch(state, sample, samples, engaged=False)
        if len(states) < samples:
            return None
        state = states[-1]
        trace = Trace(plant, sample * np.arange(samples), states, volts)
        peaks.append(peak_of(trace.probe))
        if len(peaks) > 2 and peaks[-1] < min(SMALL, peaks[-2]) and not plant.flutters:
            return None  # on its way to rest
        if len(peaks) > 2 and np.ptp(trace.probe) <= NOISE * peaks[-1]:
            return None  # a deflection in which nothing moves any more
        if all(resting(peaks[: len(peaks) - k]) for k in range(3)):
            return measured_cycle(trace, peaks[-1], state, converged=True)
    assert trace is not None
    return measured_cycle(trace, peaks[-1], state, converged=False)


def resting(peaks: list[float]) -> bool:
    """Whether the amplitude looks at rest after the last of these windows.

    A small change from window to window is not enough: an amplitude that creeps may have a long way to go. The change
    still to come is taken as that of a geometric series through the last three of every second window. It is asked of
    three windows in turn, because just where a fast decay gives way to a slow one the series looks short.
    """
    if len(peaks) < 5 or peaks[-1] < SMALL:
        return False
    first, second = abs(peaks[-3] - peaks[-5]), abs(peaks[-1] - peaks[-3])
    if max(first, second) <= NOISE * peaks[-1]:
        return True
    return second < first and second * second / (first - second) <= AGREEMENT * peaks[-1]


def measured_cycle(trace: Trace, amplitude: float, state: Floats, converged: bool) -> LimitCycle:
    """The figures of a motion's last window.

    Args:
        trace: the window.
        amplitude: peak of |w| in it at the 0.75 a point, over h [-].
        state: (2n,) where it ended.
        converged: whether its amplitude is at rest.
    """
    share = np.abs(trace.modal).max(axis=0)
    return LimitCycle(converged, amplitude, _frequency(trace.times, trace.probe), 100 * share / share.sum(), state)


def peak_of(values: Floats) -> float:
    """Largest |value|: some cycles are not alike in up and down."""
    return max(_highest(values), _highest(-values))


def _highest(values: Floats) -> float:
    """Highest value, by a parabola through the highest sample and its neighbours."""
    k = int(np.argmax(values[1:-1])) + 1
    left, top, right = values[k - 1 : k + 2]
    bend = left - 2 * top + right
    return float(top - (left - right) ** 2 / (8 * bend)) if bend < 0 else float(values.max())


def _frequency(times: Floats, values: Floats) -> float:
    """Mean frequency by upward crossings of the middle, interpolated linearly [Hz]."""
    values = values - (values.max() + values.min()) / 2
    k = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    if len(k) < 2:
        return 0.0
    crossing = times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k])
    return float((len(k) - 1) / (crossing[-1] - crossing[0]))
