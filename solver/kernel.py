"""Owns the compiled inner loop: fourth-order Runge-Kutta of the saturated closed loop in modal coordinates."""

from __future__ import annotations

import numba
import numpy as np

from solver.mesh import Floats

# Sums may be reordered so that they vectorise; NaN and infinity keep their meaning, divergence is detected by them.
_FAST = {"reassoc", "contract", "nsz", "arcp"}


@numba.njit(cache=True, fastmath=_FAST)
def _acceleration(
    x: Floats,
    linear: Floats,
    quartic: Floats,
    cubic: Floats,
    load: Floats,
    force: Floats,
    gain: Floats,
    limit: float,
    pairs: Floats,
    stress: Floats,
    volts: Floats,
    out: Floats,
) -> None:
    """q̈ into `out` (n,) and the saturated voltages into `volts`, at the state x = (q, q̇); the rest is work space."""
    n = out.size
    coupled = cubic.shape[0] > 0
    p = 0
    for r in range(n):
        pairs[p] = x[r] * x[r]
        p += 1
        for s in range(r + 1, n):
            pairs[p] = 2.0 * x[r] * x[s]
            p += 1
    p = 0
    for r in range(n):
        for s in range(r, n):
            row = quartic[p]
            total = 0.0
            for k in range(row.size):
                total += row[k] * pairs[k]
            if coupled:
                for k in range(n):
                    total += cubic[p, k] * x[k]
            stress[r, s] = total
            stress[s, r] = total
            p += 1
    for c in range(volts.size):
        total = 0.0
        for k in range(2 * n):
            total -= gain[c, k] * x[k]
        volts[c] = min(max(total, -limit), limit)
    for r in range(n):
        total = 0.0
        for k in range(2 * n):
            total -= linear[r, k] * x[k]
        nonlinear = 0.0
        for s in range(n):
            nonlinear += stress[r, s] * x[s]
        for c in range(volts.size):
            total += force[r, c] * volts[c]
        out[r] = load[r] + total - 2.0 * nonlinear
    if coupled:
        for p in range(pairs.size):
            for r in range(n):
                out[r] -= pairs[p] * cubic[p, r]


@numba.njit(cache=True, fastmath=_FAST, nogil=True)
def integrate(
    state: Floats,
    linear: Floats,
    quartic: Floats,
    cubic: Floats,
    load: Floats,
    force: Floats,
    gain: Floats,
    limit: float,
    step: float,
    substeps: int,
    states: Floats,
    volts: Floats,
) -> int:
    """Integrate q̈ = load - linear·(q, q̇) - f(q) + force·V, V = clip(-gain·(q, q̇), ± limit), by classical Runge-Kutta.

    Args:
        state: (2n,) start, not changed.
        linear: (n, 2n) stiffness and damping side by side.
        quartic: (pairs, pairs) G of the membrane's energy.
        cubic: (pairs, n) H of it, or (0, n).
        load: (n,) static force.
        force: (n, channels) modal force a volt.
        gain: (channels, 2n) feedback gain.
        limit: largest voltage [V].
        step: time step [s].
        substeps: steps from one sample to the next.
        states: (samples, 2n) filled with the states after each `substeps` steps.
        volts: (samples, channels) filled with the voltages then.

    Returns:
        How many samples are finite; fewer than asked for if the motion diverged.
    """
    n = state.size // 2
    x = state.copy()
    stage = np.empty_like(x)
    rate = np.empty_like(x)
    total = np.empty_like(x)
    pairs = np.empty(quartic.shape[0])
    stress = np.empty((n, n))
    drive = np.zeros(force.shape[1])
    for sample in range(states.shape[0]):
        for _ in range(substeps):
            for k in range(2 * n):
                stage[k] = x[k]
                total[k] = 0.0
            for phase in range(4):
                for k in range(n):
                    rate[k] = stage[n + k]
                _acceleration(stage, linear, quartic, cubic, load, force, gain, limit, pairs, stress, drive, rate[n:])
                weight = step / 6.0 if phase == 0 or phase == 3 else step / 3.0
                reach = step if phase == 2 else 0.5 * step
                for k in range(2 * n):
                    total[k] += weight * rate[k]
                    stage[k] = x[k] + reach * rate[k]
            for k in range(2 * n):
                x[k] += total[k]
        _acceleration(x, linear, quartic, cubic, load, force, gain, limit, pairs, stress, drive, rate[n:])
        for k in range(2 * n):
            if not np.isfinite(x[k]):
                return sample
            states[sample, k] = x[k]
        for c in range(drive.size):
            volts[sample, c] = drive[c]
    return states.shape[0]
