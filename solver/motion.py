"""Owns the kinds of motion that a panel settles into: flat, buckled, limit cycle, periodic, quasi-periodic, chaotic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from solver.equilibrium import motion_about, rest, still_air_rest
from solver.flutter import buckled, leading_eigenvalue
from solver.mesh import Floats
from solver.plant import Plant
from solver.shooting import UNIT_SAMPLES, WINDOW, Orbit, orbit_near, orbit_states, unit_of_time
from solver.simulate import Loop, first_mode_at_rest
from solver.trace import probe_shapes
from solver.variational import FlowMap

Kind = Literal["flat", "buckled", "deflected", "limit cycle", "periodic", "quasi-periodic", "chaotic"]

LOOKS = (1, 2, 4, 8, 16)  # windows after which a motion is judged; what no cycle is by then is taken for none
REST = 0.02  # of h: a motion this near to a stable rest, and coming nearer, is attracted by it
FLAT = 1e-3  # of h: a rest below it is flat; heat and preload beyond buckling by 1e-6 of it bend a panel more
PURE = 0.9  # share of the power that one frequency carries in a limit cycle; below it overtones exceed a third of it
SPAN = 150  # periods of the first mode over which exponents are measured, some hundreds of cycles
PIECES = 4  # renormalisations in such a period: a deviation then grows by a few times at most
BATCHES = 10  # parts of the span whose scatter gives the uncertainty
ALIGNMENT = 0.1  # of the span, in which the deviation turns into the direction that grows most
# Growth over the span below which an exponent is nothing: deviations along a torus grow as time does, ten times from
# ALIGNMENT on, and their length varies by some ten times in a cycle; this is ten times more than both.
TOLD = float(np.log(1e3))
CERTAIN = 3.0  # standard errors by which an exponent must differ from 0
LYAPUNOV_STEP_OMEGA = 0.25  # an exponent has two digits, which do not ask for the steps that shooting takes
STEADY = 0.1  # relative change of the rms of w from one half of the window to the other, in a settled motion
INTO_WELL = 0.5  # of the deflection in still air: beyond it, the panel has gone over to that side


@dataclass(frozen=True)
class Motion:
    """What an uncontrolled panel does in the end."""

    kind: Kind
    """flat: at rest undeflected; buckled: at rest to one side, where preload or heat makes flat unstable; deflected: at
    rest under the static load of heat in an unsymmetric lay-up; limit cycle: repeats itself, with one frequency that
    carries most of it; periodic: repeats itself, with overtones or after several swings; quasi-periodic: does not
    repeat, nor grow apart; chaotic: nearby motions grow apart."""
    snap_through: bool
    """Whether the panel, buckled in still air, goes over again and again from one side to the other."""
    lyapunov_per_s: float
    """Largest Lyapunov exponent [1/s]: at rest the growth rate of the leading root, along an orbit 0."""
    amplitude_over_h: float
    """Peak of |w| at the 0.75 a point over h [-]."""
    mean_over_h: float
    """Mean of w there over h [-]."""
    frequency_hz: float
    """Frequency of repetition, or of upward passages through the mean where nothing repeats [Hz]; 0 at rest."""
    settled: bool
    """Whether the motion was seen to stay as it is: attracted by a rest or an orbit, or steady over the window."""


def motion_of(loop: Loop, start: Floats | None = None) -> Motion | None:
    """The motion that the design's uncontrolled panel settles into, as `settled_motion`."""
    return settled_motion(loop, start)[0]


def settled_motion(loop: Loop, start: Floats | None = None) -> tuple[Motion | None, Orbit | None]:
    """The motion that the design's uncontrolled panel settles into.

    It is integrated until it is near a stable rest or, by shooting, a stable orbit. What finds neither is told apart
    by its largest Lyapunov exponent: positive beyond its uncertainty is chaos, otherwise it is quasi-periodic.

    Args:
        loop: the panel; its control law is not used.
        start: (2n,) where to start; from the start of the seed protocol by default.

    Returns:
        The motion, None if it diverged or there is nothing to drive or to damp it; and the orbit, if it has one.
    """
    plant, sample = loop.plant, unit_of_time(loop.plant) / UNIT_SAMPLES
    if not plant.flutters and not plant.damping.any():
        return None, None  # it swings for ever as it began
    thickness = plant.design.panel.thickness
    state = first_mode_at_rest(plant, plant.design.run.initial_amplitude * thickness) if start is None else start
    for k in range(1, LOOKS[-1] + 1):
        states, _ = loop.stretch(state, sample, WINDOW * UNIT_SAMPLES, engaged=False)
        if len(states) < WINDOW * UNIT_SAMPLES:
            return None, None
        state = states[-1]
        still = _rest(plant, states)
        if still is not None:
            return _resting(plant, still), None
        orbit = orbit_near(plant, states, sample) if k in LOOKS else None
        if orbit:
            return _repeating(plant, orbit), orbit
    return _wandering(loop, state, sample), None


def _rest(plant: Plant, states: Floats) -> Floats | None:
    """(n,) the stable deflection that a motion (samples, 2n) is coming to rest at; None if it is not."""
    n, height = plant.size, REST * plant.design.panel.thickness
    half = len(states) // 2
    swings = np.ptp(states[:half, :n], axis=0), np.ptp(states[half:, :n], axis=0)
    if np.any(swings[1] * plant.model.peak > height) or swings[1].max() > swings[0].max():
        return None
    middle = (states[half:, :n].max(axis=0) + states[half:, :n].min(axis=0)) / 2
    found = rest(plant, middle)
    if found is None or np.abs(plant.model.peak * (found - middle)).max() > height:
        return None
    return found if leading_eigenvalue(motion_about(plant, found)).real < 0 else None


def _resting(plant: Plant, q: Floats) -> Motion:
    thickness = plant.design.panel.thickness
    flat = float(np.abs(plant.model.coarse @ q).max()) < FLAT * thickness
    w = float(probe_shapes(plant) @ q) / thickness
    return Motion(
        "flat" if flat else "buckled",
        False,
        leading_eigenvalue(motion_about(plant, q)).real,
        abs(w),
        w,
        0.0,
        settled=True,
    )


def _repeating(plant: Plant, orbit: Orbit) -> Motion:
    w = orbit_states(plant, orbit)[:, : plant.size] @ probe_shapes(plant) / plant.design.panel.thickness
    power = np.abs(np.fft.rfft(w)[1:]) ** 2
    kind = "limit cycle" if power[0] >= PURE * power.sum() else "periodic"
    return Motion(kind, _snaps(plant, w), 0.0, orbit.amplitude, float(w.mean()), orbit.frequency, settled=True)


def _wandering(loop: Loop, state: Floats, sample: float) -> Motion | None:
    """A motion that neither rests nor repeats, by its exponent and its figures over the same span."""
    plant = loop.plant
    span = SPAN * unit_of_time(plant)
    states, _ = loop.stretch(state, sample, SPAN * UNIT_SAMPLES, engaged=False)
    if len(states) < SPAN * UNIT_SAMPLES:
        return None
    w = states[:, : plant.size] @ probe_shapes(plant) / plant.design.panel.thickness
    first, second = np.array_split(w - w.mean(), 2)
    change = abs(np.sqrt((second**2).mean() / (first**2).mean()) - 1)
    exponent, error = lyapunov(plant, state, span)
    chaotic = exponent > CERTAIN * error and exponent * span > TOLD
    upward = int(((w[:-1] < w.mean()) & (w[1:] >= w.mean())).sum())
    return Motion(
        kind="chaotic" if chaotic else "quasi-periodic",
        snap_through=_snaps(plant, np.array_split(w, 2)[0]) and _snaps(plant, np.array_split(w, 2)[1]),
        lyapunov_per_s=exponent,
        amplitude_over_h=float(np.abs(w).max()),
        mean_over_h=float(w.mean()),
        frequency_hz=upward / span,
        settled=bool(change < STEADY),
    )


def lyapunov(plant: Plant, state: Floats, span: float) -> tuple[float, float]:
    """Largest Lyapunov exponent of the motion from a state, by Benettin's method.

    A small deviation is carried along by the variational equation and brought back to length 1, in the norm of the
    linear energy, some times a cycle; the exponent is the slope of the logarithm of its length over time.

    Args:
        plant: the panel in its stream; no control acts.
        state: (2n,) start, on the motion that is to be judged.
        span: how long to follow it [s].

    Returns:
        The exponent [1/s] and its standard error, from the scatter over parts of the span.
    """
    flow, n = FlowMap.of(plant), plant.size
    pieces = max(10 * BATCHES, round(span / unit_of_time(plant) * PIECES))
    time = span / pieces
    steps = max(1, int(np.ceil(time * plant.model.band[1] / LYAPUNOV_STEP_OMEGA)))
    deviation = np.ones((2 * n, 1)) / flow.weights[:, None]  # blind to no mode
    logs = np.zeros(pieces)
    for k in range(pieces):
        state, deviation = flow.advance(state, deviation, time, steps)
        length = float(np.linalg.norm(flow.weights * deviation[:, 0]))
        deviation /= length
        logs[k] = np.log(length)
    kept = logs[int(ALIGNMENT * pieces) :]
    batches = [_slope(np.cumsum(part), time) for part in np.array_split(kept, BATCHES)]
    return _slope(np.cumsum(kept), time), float(np.std(batches, ddof=1) / np.sqrt(BATCHES))


def _slope(values: Floats, time: float) -> float:
    """Slope of values at equal intervals of time, by least squares: what swings with a cycle averages out."""
    return float(np.polyfit(time * np.arange(len(values)), values, 1)[0])


def _snaps(plant: Plant, w: Floats) -> bool:
    """Whether w over h at the probe goes well into both of the sides that the panel buckles to in still air."""
    well = still_air_rest(plant) if buckled(plant.model) else None
    if well is None:
        return False
    depth = INTO_WELL * abs(float(probe_shapes(plant) @ well)) / plant.design.panel.thickness
    return bool(w.max() > depth and w.min() < -depth)
