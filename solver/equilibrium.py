"""Owns static states: the deflections in which a heated or loaded panel can rest, in still air or in the stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from solver.flutter import GROWTH_NOISE, SCAN_END, leading_eigenvalue
from solver.mesh import Floats
from solver.plant import Plant
from solver.trace import probe_shapes
from solver.vonkarman import membrane_force, membrane_tangent

NEWTON = 60  # steps, more than a start inside a well needs
CLOSED = 1e-10  # of the largest force in the balance that counts as balanced
SAME = 1e-4  # of h; states nearer to each other than this are one
FLAT = 1e-6  # of h; less deflection than this is none
FOLLOW_STEP = 5.0  # λ between points at which a state is followed; far apart, Newton's method would lose it
RESOLUTION = 1e-6  # relative, of the λ at which it ends
STARTS = 6  # softest directions from which buckled states are looked for, either way


@dataclass(frozen=True)
class StaticState:
    """A deflection in which all forces balance, and whether the panel stays there."""

    amplitudes: Floats
    """(n,) modal amplitudes [m·√kg]."""
    deflection: float
    """w at the 0.75 a point over h [-]."""
    largest: float
    """Largest |w| on the panel over h [-]."""
    growth: complex
    """Leading eigenvalue about it: growth rate [1/s] + i·frequency [rad/s]."""
    stable: bool
    """Whether every small motion about it dies out or, without damping, does not grow."""


@dataclass(frozen=True)
class EndOfRest:
    """Where a buckled panel in a rising stream ceases to rest, and what it does then."""

    dynamic_pressure: float
    """λ [-]."""
    frequency: float
    """Frequency of the flutter about the buckled state there [rad/s]; 0 where it is not flutter."""
    kind: Literal["flutter", "flat", "motion"]
    """flutter about the buckled state; flat: the stream presses the buckle out; motion: no rest is left near it."""


def static_states(plant: Plant) -> list[StaticState]:
    """The static states of a plant that Newton's method finds from its softest directions, by largest deflection.

    K q + f(q) = p, K with the flow's and the prestress' share, is solved from the flat state and from either side along
    the softest directions of K. A panel without a static load has every state twice, up and down.
    """
    found: list[Floats] = []
    for start in _starts(plant):
        q = rest(plant, start)
        if q is not None and all(_distance(plant, q, other) > SAME for other in found):
            found.append(q)
    return sorted((_described(plant, q) for q in found), key=lambda state: (state.largest, state.deflection))


def rest(plant: Plant, start: Floats, force: Floats | None = None) -> Floats | None:
    """(n,) amplitudes of the static state that damped Newton steps reach from a start; None if they reach none.

    Args:
        plant: the panel in its stream.
        start: (n,) amplitudes to start from.
        force: (n,) static modal force beside that of heat, as of a pressure difference [N/√kg].
    """
    model = plant.model
    static = model.load if force is None else model.load + force
    scale = model.omega**2  # forces over it are amplitudes, of one size in all modes

    def imbalance(q: Floats) -> Floats:
        return plant.stiffness @ q + membrane_force(model.membrane, q) - static

    q = start.copy()
    residual = imbalance(q)
    for _ in range(NEWTON):
        tangent = plant.stiffness + membrane_tangent(model.membrane, q)
        try:
            step = np.linalg.solve(tangent, residual)
        except np.linalg.LinAlgError:
            return None
        size = np.linalg.norm(residual / scale)
        reaches = (0.5**k for k in range(10))
        reach = next((r for r in reaches if np.linalg.norm(imbalance(q - r * step) / scale) <= size), 0.5**10)
        q = q - reach * step
        residual = imbalance(q)
        if np.abs(residual).max() <= CLOSED * (np.abs(plant.stiffness * q).max() + np.abs(static).max()):
            return q
        if _height(plant, q) < FLAT and not static.any():
            return np.zeros_like(q)
    return None


def motion_about(plant: Plant, amplitudes: Floats) -> Floats:
    """(2n, 2n) state matrix of small motions about a deflection (n,)."""
    n = plant.size
    matrix = plant.system_matrix.copy()
    matrix[n:, :n] -= membrane_tangent(plant.model.membrane, amplitudes)
    return matrix


def critical_pressure_deflected(plant: Plant) -> EndOfRest | None:
    """The λ up to which a buckled panel rests in the deflection that it has in still air, followed as λ rises.

    Returns:
        What ends the rest; None where the panel is flat in still air, or rests up to λ = 20 000.
    """
    last, low = still_air_rest(plant), 0.0
    if last is None:
        return None
    while low < SCAN_END:
        high = low + FOLLOW_STEP
        found = _still_there(plant.at_pressure(high), last)
        if found is None:
            return _end_of_rest(plant, last, low, high)
        last, low = found, high
    return None


def still_air_rest(plant: Plant) -> Floats | None:
    """(n,) the deflection in which a buckled panel rests in still air, to one of its sides; None if it is flat then."""
    if plant.model.plate.prestress is None:
        return None
    states = static_states(plant.at_pressure(0.0))
    buckles = [state for state in states if state.stable and state.largest > FLAT]
    return buckles[-1].amplitudes if buckles else None


def _end_of_rest(plant: Plant, last: Floats, low: float, high: float) -> EndOfRest:
    """Narrow down where between two values of λ a static state is lost, and say to what."""
    while high - low > RESOLUTION * high:
        middle = (low + high) / 2
        found = _still_there(plant.at_pressure(middle), last)
        if found is None:
            high = middle
        else:
            last, low = found, middle
    there = plant.at_pressure(high)
    q = rest(there, last)
    noise = GROWTH_NOISE * plant.model.omega[0]
    if q is not None and _height(there, q) > FLAT:
        root = leading_eigenvalue(motion_about(there, q))
        if root.imag > noise:
            return EndOfRest(high, root.imag, "flutter")
    return EndOfRest(high, 0.0, "motion" if there.flutters else "flat")


def _still_there(plant: Plant, last: Floats) -> Floats | None:
    """The stable deflection near another; None if it is gone, flat or no longer stable."""
    q = rest(plant, last)
    if q is None or _height(plant, q) <= FLAT:
        return None
    stable = leading_eigenvalue(motion_about(plant, q)).real <= GROWTH_NOISE * plant.model.omega[0]
    return q if stable else None


def _starts(plant: Plant) -> list[Floats]:
    """The flat state, and deflections either way along the softest directions of the flat panel in the stream."""
    model, n = plant.model, plant.size
    stiffness = (plant.stiffness + plant.stiffness.T) / 2
    values, vectors = np.linalg.eigh(stiffness)
    starts: list[Floats] = [np.zeros(n)]
    for value, vector in list(zip(values, vectors.T, strict=True))[:STARTS]:
        hardening = float(vector @ membrane_force(model.membrane, vector))  # of the cube of the amplitude
        size = np.sqrt(max(-value, 0.0) / hardening) if hardening > 0 else 0.0
        size = max(size, 0.1 / _height(plant, vector))
        starts += [size * vector, -size * vector]
    if model.load.any():
        starts.append(np.linalg.solve(np.diag(model.omega**2), model.load))
    return starts


def _described(plant: Plant, q: Floats) -> StaticState:
    h = plant.design.panel.thickness
    growth = leading_eigenvalue(motion_about(plant, q))
    stable = bool(growth.real <= GROWTH_NOISE * plant.model.omega[0])
    return StaticState(q, float(probe_shapes(plant) @ q / h), _height(plant, q), growth, stable)


def _height(plant: Plant, q: Floats) -> float:
    """Largest |w| over h of a deflection."""
    return float(np.abs(plant.model.coarse @ q).max() / plant.design.panel.thickness)


def _distance(plant: Plant, one: Floats, other: Floats) -> float:
    return _height(plant, one - other)
