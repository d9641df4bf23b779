"""Owns the compiled integration of several runs of one closed loop at once, by exponential Runge-Kutta steps."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from solver.mesh import Floats
from solver.products import FAST, Index, U, add_product, fill_monomials, multiply, multiply_two
from solver.propagator import PARTS, Propagator


class Forces(NamedTuple):
    """What drives the linear system: load - f(q) + F V on the rates and E V on the controller's own state z."""

    table: Floats
    """(n, monomials) of -f as `polynomial.force_table` gives it, (n, 0) to leave it out [N/√kg per (m·√kg)³]."""
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
    """(S, 4S) [-]."""
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
def _drive(
    x: Floats, at: Index, forces: Forces, now: Floats, to: Index, side: Floats, mark: Index, begin: bool
) -> bool:
    """Add what the voltages at a state do to its forces; tell whether one is at another limit than when it began."""
    at, to, mark = U(at), U(to), U(mark)
    channels, size = U(forces.gain.shape[0]), U(forces.gain.shape[1])
    n, memory = U(forces.force.shape[0]), U(forces.driven.shape[0])
    kinked = False
    for k in range(memory):
        now[to + n + k] = 0.0
    for c in range(channels):
        volts = 0.0
        for k in range(size):
            volts -= forces.gain[c, k] * x[at + k]
        limited = 1.0 if volts > forces.limit else (-1.0 if volts < -forces.limit else 0.0)
        volts = min(max(volts, -forces.limit), forces.limit)
        if begin:
            side[mark + c] = limited
        elif side[mark + c] != limited:
            kinked = True
        for r in range(n):
            now[to + r] += forces.force[r, c] * volts
        for k in range(memory):
            now[to + n + k] += forces.driven[k, c] * volts
    return kinked


@numba.njit(inline="always", cache=True, fastmath=FAST)
def _step(
    x: Floats,
    runs: int,
    weights: Weights,
    forces: Forces,
    results: Floats,
    products: Floats,
    now: Floats,
    side: Floats,
    kinked: Floats,
) -> None:
    """One step of one run or of two from states x (runs·S,) to y in the results (runs·4S,), a run after the other.

    `kinked` (runs,) tells in which a voltage met its limit or left it; the other arrays are room.
    """
    n, monomials = len(forces.load), len(products) // 2
    size, count, channels = forces.gain.shape[1], len(now) // 2, len(side) // 2
    for k in range(runs * 4 * size):
        results[k] = 0.0
    for run in range(runs):
        kinked[run] = 0.0
        add_product(weights.coast, x, run * size, results, run * 4 * size)
    for stage in range(4):
        for run in range(runs):
            if stage == 0:
                fill_monomials(x, run * size, n, products, run * monomials)
            else:  # at a, b and c of the results' b, y, c, a
                at = 3 if stage == 1 else (0 if stage == 2 else 2)
                fill_monomials(results, (4 * run + at) * size, n, products, run * monomials)
        if runs == 2:
            multiply_two(forces.table, products, monomials, forces.load, now, count)
        else:
            multiply(forces.table, products, 0, forces.load, now, 0)
        for run in range(runs):
            own, to = run * 4 * size, run * count
            if stage == 0:
                _drive(x, run * size, forces, now, to, side, run * channels, True)
                add_product(weights.first, now, to, results, own + size)
            elif stage == 1:
                kinked[run] += _drive(results, own + 3 * size, forces, now, to, side, run * channels, False)
                add_product(weights.second, now, to, results, own)
            elif stage == 2:
                kinked[run] += _drive(results, own, forces, now, to, side, run * channels, False)
                add_product(weights.third, now, to, results, own + size)
            else:
                kinked[run] += _drive(results, own + 2 * size, forces, now, to, side, run * channels, False)
                add_product(weights.last, now, to, results, own + size)


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def integrate_runs(
    starts: Floats, weights: Weights, parted: Weights, forces: Forces, substeps: int, states: Floats, volts: Floats
) -> None:
    """Integrate runs from several states, two at a time.

    ẋ = A x + B p(x), the linear part exact, p as `Forces` has it, by ETD4RK. A step in which a voltage meets its limit
    or leaves it is taken in `PARTS`: there the force has a kink, which costs any method its order.

    Args:
        starts: (runs, S) states, not changed.
        weights: of a step.
        parted: of one in `PARTS`.
        forces: what is not linear.
        substeps: steps from one sample to the next.
        states: (runs, samples, S) filled with the states after each `substeps` steps; NaN after a run has diverged.
        volts: (runs, samples, channels) filled with the voltages then.
    """
    runs, size = starts.shape
    n, count, channels = len(forces.load), len(weights.first), volts.shape[2]
    results, now = np.empty(8 * size), np.empty(2 * count)
    products = np.empty(2 * (n * (n + 1) * (n + 2) // 6 + n * (n + 1) // 2))
    side, kinked, again, alone = np.empty(2 * channels), np.empty(2), np.empty(2), np.empty(size)
    states[:] = np.nan
    volts[:] = np.nan
    for first in range(0, runs, 2):
        pair = min(2, runs - first)
        x = starts[first : first + pair].copy().ravel()
        for sample in range(states.shape[1]):
            for _ in range(substeps):
                _step(x, pair, weights, forces, results, products, now, side, kinked)
                for run in range(pair):
                    again[run] = kinked[run]
                    if kinked[run] > 0.0:
                        continue
                    for k in range(size):
                        x[run * size + k] = results[(4 * run + 1) * size + k]
                for run in range(pair):
                    if again[run] > 0.0:
                        alone[:] = x[run * size : (run + 1) * size]
                        for _ in range(PARTS):
                            _step(alone, 1, parted, forces, results, products, now, side, kinked)
                            alone[:] = results[size : 2 * size]
                        x[run * size : (run + 1) * size] = alone
            moving = False
            for run in range(pair):
                state = x[run * size : (run + 1) * size]
                if np.isfinite(state).all():
                    moving = True
                    states[first + run, sample] = state
                    for c in range(channels):
                        asked = -np.dot(forces.gain[c], state)
                        volts[first + run, sample, c] = min(max(asked, -forces.limit), forces.limit)
            if not moving:
                break
