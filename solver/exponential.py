"""Owns the compiled integration of runs of a closed loop by exponential Runge-Kutta steps."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from solver.mesh import Floats
from solver.products import FAST, Index, U, add_product, fill_monomials, multiply
from solver.propagator import PARTS, Propagator


class Forces(NamedTuple):
    """What drives the linear system: load - f(q) + F V on the rates and E V on the controller's own state z."""

    table: Floats
    """(n, at least as many as monomials) of -f as `polynomial.force_table` gives it for amplitudes over `unit`, zeros
    after that; (n, 0) to leave it out [N/√kg]. Its precision is that in which the law is worked out."""
    unit: float
    """Unit of the amplitudes in that law [m·√kg]."""
    load: Floats
    """(n,) static force [N/√kg]."""
    force: Floats
    """(n, channels) F, modal force a volt [N/(V·√kg)]."""
    driven: Floats
    """(m, channels) E, what the voltages do to z [units of z per V·s]."""
    gain: Floats
    """(channels, 2n + m) what the controller asks for, V = -gain·x within ± the limit [V per unit of x]."""
    limit: float
    """Largest voltage [V]."""


class Weights(NamedTuple):
    """The coefficients of a step, as `Propagator` has them, of one length of step."""

    coast: Floats
    """(S, 2S) [-]."""
    first: Floats
    """(F, 3S) [s]."""
    second: Floats
    """(F, 2S) [s]."""
    third: Floats
    """(F, 2S) [s]."""
    last: Floats
    """(F, S) [s]."""


def weights_of(propagator: Propagator) -> tuple[Weights, Weights]:
    """The coefficients of a whole step and of one in `PARTS`."""
    own = (propagator.coast, propagator.first, propagator.second, propagator.third, propagator.last)
    return Weights(*(part[0] for part in own)), Weights(*(part[1] for part in own))


@numba.njit(cache=True, fastmath=FAST)
def _drive(x: Floats, at: Index, forces: Forces, now: Floats, side: Floats, begin: bool) -> bool:
    """Add what the voltages at a state do to its forces; tell whether one is at another limit than when it began."""
    at = U(at)
    channels, size = U(forces.gain.shape[0]), U(forces.gain.shape[1])
    n, memory = U(forces.force.shape[0]), U(forces.driven.shape[0])
    kinked = False
    for k in range(memory):
        now[n + k] = 0.0
    for c in range(channels):
        volts = 0.0
        for k in range(size):
            volts -= forces.gain[c, k] * x[at + k]
        limited = 1.0 if volts > forces.limit else (-1.0 if volts < -forces.limit else 0.0)
        volts = min(max(volts, -forces.limit), forces.limit)
        if begin:
            side[c] = limited
        elif side[c] != limited:
            kinked = True
        for r in range(n):
            now[r] += forces.force[r, c] * volts
        for k in range(memory):
            now[n + k] += forces.driven[k, c] * volts
    return kinked


@numba.njit(inline="always", cache=True, fastmath=FAST)
def _force(x: Floats, at: Index, forces: Forces, products: Floats, now: Floats, side: Floats, begin: bool) -> bool:
    """All forces at a state into `now` (F,); tells what `_drive` does."""
    n = len(forces.load)
    fill_monomials(x, at, n, forces.unit, products, 0)
    multiply(forces.table, products, 0, forces.load, now, 0)
    return _drive(x, at, forces, now, side, begin)


@numba.njit(inline="always", cache=True, fastmath=FAST)
def _step(
    x: Floats, weights: Weights, forces: Forces, results: Floats, products: Floats, now: Floats, side: Floats
) -> bool:
    """One step from a state x (S,) to y in the results (4S,), which are b, y, c and a; the other arrays are room.

    Tells whether a voltage met its limit or left it.
    """
    size = len(x)
    for k in range(2 * size):
        results[k] = 0.0
    add_product(weights.coast, x, 0, results, 0)
    for k in range(size):
        results[2 * size + k] = results[size + k]
        results[3 * size + k] = results[k]
    _force(x, 0, forces, products, now, side, True)
    add_product(weights.first, now, 0, results, size)
    kinked = _force(results, 3 * size, forces, products, now, side, False)
    add_product(weights.second, now, 0, results, 0)
    kinked |= _force(results, 0, forces, products, now, side, False)
    add_product(weights.third, now, 0, results, size)
    kinked |= _force(results, 2 * size, forces, products, now, side, False)
    add_product(weights.last, now, 0, results, size)
    return kinked


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def integrate(
    start: Floats, weights: Weights, parted: Weights, forces: Forces, substeps: int, states: Floats, volts: Floats
) -> int:
    """Integrate from a state.

    ẋ = A x + B p(x), the linear part exact, p as `Forces` has it, by ETD4RK. A step in which a voltage meets its limit
    or leaves it is taken in `PARTS`: there the force has a kink, which costs any method its order.

    Args:
        start: (S,) state, not changed.
        weights: of a step.
        parted: of one in `PARTS`.
        forces: what is not linear.
        substeps: steps from one sample to the next.
        states: (samples, S) filled with the states after each `substeps` steps.
        volts: (samples, channels) filled with the voltages then.

    Returns:
        How many samples are filled; fewer than asked for if the motion diverged.
    """
    x, size, n, channels = start.copy(), len(start), len(forces.load), volts.shape[1]
    results, now, side = np.empty(4 * size), np.empty(len(weights.first)), np.empty(channels)
    room = n * (n + 1) * (n + 2) // 6 + n * (n + 1) // 2
    products = np.zeros(max(room, forces.table.shape[1]), forces.table.dtype)
    for sample in range(len(states)):
        for _ in range(substeps):
            if not _step(x, weights, forces, results, products, now, side):
                x[:] = results[size : 2 * size]
            else:
                for _ in range(PARTS):
                    _step(x, parted, forces, results, products, now, side)
                    x[:] = results[size : 2 * size]
        if not np.isfinite(x).all():
            return sample
        states[sample] = x
        for c in range(channels):
            asked = -np.dot(forces.gain[c], x)
            volts[sample, c] = min(max(asked, -forces.limit), forces.limit)
    return len(states)
