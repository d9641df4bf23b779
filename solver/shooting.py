"""Owns periodic motions: orbits found by shooting, and their Floquet multipliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.law import Law
from solver.mesh import Floats
from solver.plant import Plant
from solver.simulate import Loop
from solver.trace import probe_shapes
from solver.variational import FlowMap

Complexes = NDArray[np.complex128]

CLOSED = 1e-10  # relative gap at which Newton stops: what rounding over some hundred steps leaves, and to spare
ENOUGH = 1e-8  # relative gap that still counts as closed where rounding stops Newton earlier
ITERATIONS = 15  # Newton needs 3 to 6 from nearby, and rarely finds anything later
DAMPINGS = 5  # halvings of a Newton step that does not bring the ends nearer
REACH = 0.2  # largest relative change of state or period in a step: beyond it the linear picture means nothing
SAME = 1e-5  # relative distance below which two states are one; a closed orbit knows its states far better
MARGIN = 1e-5  # accuracy of the multipliers, as the one that must be 1 shows; nearer to the circle nothing is decided
SAMPLES = 256  # of an orbit, from which its peaks are read
SMALL = 1e-3  # of h; a motion below it is rest

UNIT_SAMPLES = 128  # in a period of the first mode in vacuo; flutter is two to four times as fast
RETURNS = 6  # such periods within which an orbit must close: some fifteen cycles
WINDOW = 20  # such periods between two looks at a motion: some fifty cycles
TELLING = 0.01  # of its size: a difference of two distances that sampling does not make
NEAR = 0.1  # of its size: a motion that returns so near to where it was is worth a try, and so far a cycle may lie


@dataclass(frozen=True)
class Orbit:
    """A periodic motion of the uncontrolled panel, stable or not."""

    dynamic_pressure: float
    """λ that it belongs to [-]."""
    state: Floats
    """(2n,) a state on it, amplitudes [m·√kg] and rates [m·√kg/s]."""
    period: float
    """The shortest time after which it repeats [s]."""
    multipliers: Complexes
    """(2n,) Floquet multipliers by decreasing modulus [-]: what small deviations are multiplied by in a period."""
    trivial: int
    """Which of them is the one that is 1 by nature, of a deviation along the orbit."""
    roots: Complexes | None
    """(2n,) of an orbit with w(t + T/2) = -w(t), square roots of the multipliers [-]: half a period, then the mirror.

    A root -1 breaks the mirror symmetry, a root +1 does not; the multipliers cannot tell the two. None for others.
    """
    residual: float
    """Distance of the ends of one period over the size of the state, both in the norm of the linear energy [-]."""
    amplitude: float
    """Peak of |w| at the 0.75 a point over h [-]."""
    half_range: float
    """Half of what w at that point ranges over, over h [-]: less than the amplitude if up and down are not alike."""

    @property
    def symmetric(self) -> bool:
        """Whether w(t + T/2) = -w(t); an orbit that is not has a twin, its mirror image -w."""
        return self.roots is not None

    @property
    def others(self) -> Complexes:
        """(2n - 1,) multipliers but for the trivial one, by decreasing modulus [-]."""
        return np.delete(self.multipliers, self.trivial)

    @property
    def stable(self) -> bool:
        """Whether all multipliers but the trivial one lie within the unit circle by more than their error."""
        return bool(np.abs(self.others[0]) < 1 - MARGIN)

    @property
    def unstable(self) -> int:
        """Number of multipliers but the trivial one that lie outside of the unit circle."""
        return int((np.abs(self.others) > 1).sum())

    @property
    def frequency(self) -> float:
        """Frequency [Hz]."""
        return 1 / self.period


def find_orbit(plant: Plant, state: Floats, period: float, mirrored: bool = False) -> Orbit | None:
    """The periodic motion near a guess, by shooting.

    Newton's method in X0 and T on X(T; X0) = X0, the step in X0 being orthogonal to the motion (the phase condition),
    in the balanced state (Ωq, q̇) and halved until it brings the ends nearer.

    Args:
        plant: the panel in its stream; no control acts.
        state: (2n,) a state near the orbit.
        period: about its period [s].
        mirrored: whether to look among motions with w(t + T/2) = -w(t) alone, by X(T/2; X0) = -X0; the equation then
            stays regular where the orbit loses this symmetry.

    Returns:
        The orbit, with its shortest period; None if Newton's method fails or ends in rest.
    """
    flow = FlowMap.of(plant)
    found = _closed(flow, np.asarray(state, dtype=float), float(period), mirrored)
    if found is None:
        return None
    state, period, gap = found
    track = _track(flow, state, period)
    swing = np.abs(track[:, : plant.size] - track[:, : plant.size].mean(axis=0)).max(axis=0)
    if np.all(swing * plant.model.peak < SMALL * plant.design.panel.thickness):
        return None
    for parts in (3, 5, 7, 11, 13) if mirrored else (2, 3, 5, 7, 11, 13, 17, 19, 23, 29):
        part = flow.moved(state, period / parts)
        if flow.norm(part - state) < SAME * flow.norm(state):  # several periods close as well as one
            return find_orbit(plant, state, period / parts, mirrored)
    return _measured(plant, flow, state, period, gap, track)


def _closed(flow: FlowMap, state: Floats, period: float, mirrored: bool) -> tuple[Floats, float, float] | None:
    """State and period of a closed orbit and the relative gap that is left, by damped Newton."""
    weights, size, sign = flow.weights, len(state), -1.0 if mirrored else 1.0
    time = period / 2 if mirrored else period
    # the same steps as `_measured` takes: the multiplier 1 is that of the closed orbit of the steps themselves
    steps = flow.steps(period / 2) * (1 if mirrored else 2)

    def gap(state: Floats, end: Floats) -> float:
        return flow.norm(sign * end - state) / (flow.norm(state) or np.inf)

    value = np.inf
    for _ in range(ITERATIONS):
        end, matrix = flow.transition(state, time, steps)
        value = gap(state, end)
        if not np.isfinite(matrix).all() or not np.isfinite(value):
            return None
        if value <= CLOSED:
            break
        along, leaving = weights * flow.rate(state), weights * flow.rate(end)
        system = np.zeros((size + 1, size + 1))
        system[:size, :size] = sign * matrix * weights[:, None] / weights - np.eye(size)
        system[:size, size] = sign * leaving * time
        system[size, :size] = along / (np.linalg.norm(along) or 1.0)
        right = np.append(weights * (state - sign * end), 0.0)
        change = np.linalg.lstsq(system, right, rcond=1e-14)[0]  # at a fold the matrix is singular
        longest = max(abs(change[-1]), np.linalg.norm(change[:-1]) / flow.norm(state))
        share = min(1.0, REACH / longest) if longest else 1.0
        for _ in range(DAMPINGS):
            trial, length = state + share * change[:-1] / weights, time * (1 + share * change[-1])
            reached = gap(trial, flow.moved(trial, length, steps))
            if reached < (1 - 0.1 * share) * value:
                break
            share /= 2
        else:
            break
        state, time = trial, length
    return (state, float(2 * time if mirrored else time), value) if value <= ENOUGH else None


def _track(flow: FlowMap, state: Floats, period: float) -> Floats:
    """(samples, 2n) states around an orbit, at equal intervals from the first."""
    track = np.empty((SAMPLES, len(state)))
    track[0] = state
    for k in range(1, SAMPLES):
        track[k] = flow.moved(track[k - 1], period / SAMPLES)
    return track


def _measured(plant: Plant, flow: FlowMap, state: Floats, period: float, gap: float, track: Floats) -> Orbit:
    steps = flow.steps(period / 2)
    middle, first = flow.transition(state, period / 2, steps)
    _, second = flow.transition(middle, period / 2, steps)
    balance = flow.weights[:, None] / flow.weights
    roots = None
    if flow.norm(middle + state) < SAME * flow.norm(state):
        roots = _by_modulus(-first * balance)
        multipliers = roots**2
    else:
        multipliers = _by_modulus((second @ first) * balance)
    trivial = int(np.argmin(np.abs((multipliers if roots is None else roots) - 1)))
    w = track[:, : plant.size] @ probe_shapes(plant) / plant.design.panel.thickness
    top, bottom = _highest(w), -_highest(-w)
    return Orbit(
        dynamic_pressure=plant.stream.dynamic_pressure,
        state=state,
        period=period,
        multipliers=multipliers,
        trivial=trivial,
        roots=roots,
        residual=gap,
        amplitude=max(top, -bottom),
        half_range=(top - bottom) / 2,
    )


def _by_modulus(matrix: Floats) -> Complexes:
    values: Complexes = np.linalg.eigvals(matrix).astype(np.complex128)
    return values[np.argsort(-np.abs(values), kind="stable")]


def _highest(values: Floats) -> float:
    """Highest of periodic values, by a parabola through the highest sample and its neighbours."""
    k = int(np.argmax(values))
    left, top, right = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = left - 2 * top + right
    return float(top - (left - right) ** 2 / (8 * bend)) if bend < 0 else float(top)


def unit_of_time(plant: Plant) -> float:
    """Period of the first mode in vacuo [s]: it means something also where the flat panel is buckled or stable."""
    return float(2 * np.pi / plant.model.omega[0])


def free_loop(plant: Plant) -> Loop:
    """The plant with a law that asks for nothing, also where no regulator exists."""
    return Loop.of(plant, Law.idle(plant))


def orbit_near(plant: Plant, states: Floats, sample: float) -> Orbit | None:
    """The stable orbit that a sampled motion runs along, if it does.

    Args:
        plant: the panel.
        states: (samples, 2n) the motion, over several of its periods.
        sample: time between samples [s].

    Returns:
        The orbit; None if the motion does not return to where it was, or lies near no stable orbit.
    """
    flow = FlowMap.of(plant)
    weighted = states * flow.weights
    size = np.linalg.norm(weighted - weighted.mean(axis=0), axis=1).max()
    apart = ((weighted - weighted[0]) ** 2).sum(axis=1) / (size**2 or np.inf)  # squared, a parabola at a return
    away = np.flatnonzero(apart > (2 * NEAR) ** 2)  # it first has to leave
    if not len(away):
        return None
    k = np.arange(max(1, away[0]), min(len(apart) - 1, RETURNS * UNIT_SAMPLES))
    k = k[(apart[k] <= apart[k - 1]) & (apart[k] < apart[k + 1])]
    bend = apart[k - 1] - 2 * apart[k] + apart[k + 1]
    shift = (apart[k - 1] - apart[k + 1]) / (2 * bend)
    gaps = np.sqrt(np.maximum(apart[k] - bend * shift**2 / 2, 0.0))
    if not len(k) or gaps.min() > NEAR:
        return None
    # the first of the nearest returns: after twice a period the motion is as near, and nearer by accident
    first = np.flatnonzero(gaps <= 2 * gaps.min() + TELLING)[0]
    nearest = k[first] + shift[first]
    orbit = find_orbit(plant, states[0], nearest * sample)
    if orbit is None or not orbit.stable:
        return None
    track = _track(flow, orbit.state, orbit.period) * flow.weights
    gap = np.linalg.norm(track - weighted[-1], axis=1).min()
    return orbit if gap < NEAR * size else None


def orbit_states(plant: Plant, orbit: Orbit) -> Floats:
    """(samples, 2n) states around an orbit, at equal intervals from its first to just before its return."""
    return _track(FlowMap.of(plant), orbit.state, orbit.period)
