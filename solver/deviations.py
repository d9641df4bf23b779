"""Owns the compiled integration of the uncontrolled motion together with small deviations from it."""

from __future__ import annotations

import numba
import numpy as np

from solver.mesh import Floats, Ints
from solver.products import FAST


@numba.njit(cache=True, fastmath=FAST)
def membrane(
    q: Floats, spread: Floats, cubic: Floats, index: Ints, slope: Floats, stress: Floats, force: Floats, tangent: Floats
) -> None:
    """The membrane's force into `force` (n,) and its tangent stiffness into `tangent` (n, n) at amplitudes q (n,).

    `slope` (pairs, n) is the work space for the derivative of the pairs' stresses by q, `stress` (pairs,) for these.
    """
    n = q.size
    coupled = cubic.shape[0] > 0
    for p in range(stress.size):
        total = 0.0
        for k in range(n):
            row = 0.0
            for s in range(n):
                row += spread[p, k, s] * q[s]
            slope[p, k] = 2.0 * row
            total += row * q[k]
        if coupled:
            for k in range(n):
                total += cubic[p, k] * q[k]
                slope[p, k] += cubic[p, k]
        stress[p] = total
    for k in range(n):
        total = 0.0
        for s in range(n):
            total += stress[index[k, s]] * q[s]
            tangent[k, s] = 2.0 * stress[index[k, s]]
        force[k] = 2.0 * total
    for k in range(n):
        for s in range(n):
            p = index[k, s]
            for j in range(n):
                tangent[k, j] += 2.0 * q[s] * slope[p, j]
            if coupled:
                for j in range(n):
                    tangent[j, k] += 2.0 * q[s] * cubic[p, j]
                    force[j] += q[k] * q[s] * cubic[p, j]


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def propagate(
    state: Floats,
    deviations: Floats,
    linear: Floats,
    spread: Floats,
    cubic: Floats,
    index: Ints,
    load: Floats,
    step: float,
    steps: int,
) -> None:
    """Integrate q̈ = load - linear·(q, q̇) - f(q) and its variational equation by classical Runge-Kutta, in place.

    Both take the same stages, so that the deviations are those of the computed motion, exactly.

    Args:
        state: (2n,) start, overwritten by the end.
        deviations: (2n, m) small deviations from it, overwritten likewise.
        linear: (n, 2n) stiffness and damping side by side.
        spread: (pairs, n, n) G of the membrane's energy, its second pair written as a square.
        cubic: (pairs, n) H of it, or (0, n).
        index: (n, n) number of the pair of each two modes.
        load: (n,) static force.
        step: time step [s].
        steps: how many.
    """
    n = state.size // 2
    m = deviations.shape[1]
    stage, rate, total = state.copy(), np.empty_like(state), np.empty_like(state)
    d_stage, d_rate, d_total = deviations.copy(), np.empty_like(deviations), np.empty_like(deviations)
    slope, stress = np.empty((spread.shape[0], n)), np.empty(spread.shape[0])
    force, tangent = np.empty(n), np.empty((n, n))
    for _ in range(steps):
        for k in range(2 * n):
            stage[k] = state[k]
            total[k] = 0.0
            for j in range(m):
                d_stage[k, j] = deviations[k, j]
                d_total[k, j] = 0.0
        for phase in range(4):
            membrane(stage[:n], spread, cubic, index, slope, stress, force, tangent)
            for r in range(n):
                rate[r] = stage[n + r]
                sum_r = 0.0
                for k in range(2 * n):
                    sum_r += linear[r, k] * stage[k]
                rate[n + r] = load[r] - sum_r - force[r]
                for j in range(m):
                    d_rate[r, j] = d_stage[n + r, j]
                    d_rate[n + r, j] = 0.0
                for k in range(2 * n):
                    factor = linear[r, k] + (tangent[r, k] if k < n else 0.0)
                    for j in range(m):
                        d_rate[n + r, j] -= factor * d_stage[k, j]
            weight = step / 6.0 if phase == 0 or phase == 3 else step / 3.0
            reach = step if phase == 2 else 0.5 * step
            for k in range(2 * n):
                total[k] += weight * rate[k]
                stage[k] = state[k] + reach * rate[k]
                for j in range(m):
                    d_total[k, j] += weight * d_rate[k, j]
                    d_stage[k, j] = deviations[k, j] + reach * d_rate[k, j]
        for k in range(2 * n):
            state[k] += total[k]
            for j in range(m):
                deviations[k, j] += d_total[k, j]
