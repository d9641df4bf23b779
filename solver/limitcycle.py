"""Owns the limit cycle: the periodic motion that flutter settles into, by time integration to convergence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from solver.bfs import hermite
from solver.mesh import Floats
from solver.simulate import SAMPLES_A_PERIOD, Loop, first_mode_at_rest
from solver.trace import Trace, probe_shapes

FINER = 4  # times, by the rates, as finely as it is sampled a motion is measured; a peak is then right to 1e-5
WINDOW_PERIODS = 8  # of the flat panel's leading root, between two looks at the amplitude
NOISE = 3e-5  # relative change of the amplitude that is none
AGREEMENT = 1e-3  # relative change still to come, were it to go on as it does, that counts as converged
SMALL = 1e-3  # of h; a motion below it has not begun to be a cycle
STEADY = 24  # windows, by the last of which a motion that never comes to rest is known
STILL = 0.9  # of the scatter of the amplitude is still there after half of those
PATIENCE = 300  # windows; slow growth just above λ_cr, or a slow return to symmetry, needs many


class DivergedError(ArithmeticError):
    """A motion that grows beyond all numbers."""


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
    try:
        return settled_motion(loop, start)
    except DivergedError:
        return None


def settled_motion(loop: Loop, start: Floats | None = None) -> LimitCycle | None:
    """As `limit_cycle`, None telling of a panel at rest.

    Raises:
        DivergedError: the motion did.
    """
    plant = loop.plant
    if start is None and not plant.flutters:
        return None
    thickness = plant.design.panel.thickness
    state = first_mode_at_rest(plant, plant.design.run.initial_amplitude * thickness) if start is None else start
    sample, samples = plant.period / SAMPLES_A_PERIOD, WINDOW_PERIODS * SAMPLES_A_PERIOD
    shapes = probe_shapes(plant) / thickness
    peaks: list[float] = []
    trace = None
    for _ in range(PATIENCE):
        states, volts = loop.stretch(state, sample, samples, engaged=False)
        if len(states) < samples:
            raise DivergedError
        state = states[-1]
        trace = Trace(plant, sample * np.arange(samples), states, volts)
        probe = finer(states[:, : plant.size] @ shapes, states[:, plant.size :] @ shapes, sample)
        peaks.append(peak_of(probe))
        if len(peaks) > 2 and peaks[-1] < min(SMALL, peaks[-2]) and not plant.flutters:
            return None  # on its way to rest
        if len(peaks) > 2 and np.ptp(probe) <= NOISE * peaks[-1]:
            return None  # a deflection in which nothing moves any more
        if all(resting(peaks[: len(peaks) - k]) for k in range(3)):
            return measured_cycle(_finer_trace(trace), peaks[-1], state, converged=True)
        if wandering(peaks):
            break
    assert trace is not None
    return measured_cycle(_finer_trace(trace), peaks[-1], state, converged=False)


def resting(peaks: list[float]) -> bool:
    """Whether the amplitude looks at rest after the last of these windows.

    A small change from window to window is not enough: an amplitude that creeps may have a long way to go. The change
    still to come is taken as that of a geometric series through the last three windows, and through the last three of
    every second one: by the latter alone a fast decay that gives way to a slow one looks like a short series, by the
    former a beat does. For the same reason it is asked of three windows in turn.
    """
    if len(peaks) < 5 or peaks[-1] < SMALL:
        return False
    return all(_to_come(*peaks[-1 - 2 * lag :: lag]) <= AGREEMENT * peaks[-1] for lag in (1, 2))


def wandering(peaks: list[float]) -> bool:
    """Whether the amplitude goes up and down for good after the last of these windows: no cycle, and none to come.

    Then it differs from window to window, by as much in the latter half of the last ones as in the former, and with no
    trend: the means of the halves lie nearer to each other than what chance would make of that difference.
    """
    former, latter = np.array_split(np.array(peaks[-STEADY:]), 2)
    scatter = float(np.std(peaks[-STEADY:]))
    return bool(
        len(peaks) >= STEADY
        and scatter > AGREEMENT * peaks[-1]
        and latter.std() > STILL * former.std()
        and abs(latter.mean() - former.mean()) < scatter / math.sqrt(STEADY / 4)
    )


def _to_come(one: float, two: float, three: float) -> float:
    """What a geometric series through three values still has to go."""
    first, second = abs(two - one), abs(three - two)
    if max(first, second) <= NOISE * three:
        return 0.0
    return second * second / (first - second) if second < first else math.inf


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


def finer(values: Floats, rates: Floats, interval: float, derivative: int = 0) -> Floats:
    """Samples `FINER` times as fine, by Hermite's cubic from values and rates; or its slopes.

    The cubic's error is the fourth power of the interval: 2e-6 of a sine at 40 samples a period.

    Args:
        values: (samples, …) at equal intervals.
        rates: (samples, …) their derivatives [1/s].
        interval: between samples [s].
        derivative: 1 for the slopes, 0 for the values.

    Returns:
        (FINER·(samples - 1) + 1, …), the last being the last sample.
    """
    slopes = rates * interval
    ends = np.stack([values[:-1], slopes[:-1], values[1:], slopes[1:]])
    between = np.tensordot(_cubics()[derivative], ends, axes=1) / interval**derivative  # (FINER, samples - 1, …)
    last = rates[-1:] if derivative else values[-1:]
    return np.concatenate([between.swapaxes(0, 1).reshape(-1, *values.shape[1:]), last])


@lru_cache(maxsize=1)
def _cubics() -> tuple[Floats, Floats]:
    """(FINER, 4) each: Hermite's functions and their slopes at the finer samples of an interval of 1."""
    places = np.arange(FINER) / FINER
    return hermite(places, 1.0, 0), hermite(places, 1.0, 1)


def _finer_trace(trace: Trace) -> Trace:
    """A trace `FINER` times as fine; voltages are those of the sample before."""
    n, interval = trace.plant.size, float(trace.times[1] - trace.times[0])
    q, rates = trace.amplitudes, trace.states[:, n:]
    states = np.hstack([finer(q, rates, interval, derivative) for derivative in (0, 1)])
    volts = np.repeat(trace.volts, FINER, axis=0)[: len(states)]
    return Trace(trace.plant, np.linspace(trace.times[0], trace.times[-1], len(states)), states, volts)


def peak_of(values: Floats) -> float:
    """Largest |value|: some cycles are not alike in up and down."""
    return max(_highest(values), _highest(-values))


def _highest(values: Floats) -> float:
    """Highest value, by a parabola through the highest sample and its neighbours."""
    k = int(np.argmax(values[1:-1])) + 1
    left, top, right = values[k - 1 : k + 2]
    bend = left - 2 * top + right
    if not (left <= top >= right and bend < 0):  # highest at an end
        return float(values.max())
    return float(top - (left - right) ** 2 / (8 * bend))


def _frequency(times: Floats, values: Floats) -> float:
    """Mean frequency by upward crossings of the middle, interpolated linearly [Hz]."""
    values = values - (values.max() + values.min()) / 2
    k = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    if len(k) < 2:
        return 0.0
    crossing = times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k])
    return float((len(k) - 1) / (crossing[-1] - crossing[0]))
