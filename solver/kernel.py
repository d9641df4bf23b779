"""Owns classical Runge-Kutta steps of the closed loop, compiled, with delay and noise."""

from __future__ import annotations

import numba
import numpy as np

from solver.mesh import Floats
from solver.products import FAST, fill_monomials, multiply


@numba.njit(cache=True, fastmath=FAST)
def _ask(x: Floats, gain: Floats, jitter: Floats, out: Floats) -> None:
    """What the controller asks for, -gain·x and noise, into `out` (channels,)."""
    for c in range(out.size):
        total = jitter[c]
        for k in range(x.size):
            total -= gain[c, k] * x[k]
        out[c] = total


@numba.njit(cache=True)
def _recall(time: float, when: Floats, asked: Floats, known: int, place: int, out: Floats) -> int:
    """What was asked for at an instant, by the parabola through the records about it; gives where to look next."""
    while place + 1 < known and when[place + 1] <= time:
        place += 1
    if time < when[place]:  # before the controller was switched on
        out[:] = 0.0
    elif place + 1 == known:
        out[:] = asked[place]
    else:
        share = (time - when[place]) / (when[place + 1] - when[place])
        bend = 0.0
        if place > 0:  # the record before the two
            bend = (time - when[place]) * (time - when[place + 1]) / (when[place + 1] - when[place - 1])
        for c in range(out.size):
            rise = asked[place + 1, c] - asked[place, c]
            out[c] = asked[place, c] + share * rise
            if place > 0:
                before = (asked[place, c] - asked[place - 1, c]) / (when[place] - when[place - 1])
                out[c] += bend * (rise / (when[place + 1] - when[place]) - before)
    return place


@numba.njit(cache=True, fastmath=FAST, nogil=True)
def integrate(
    state: Floats,
    linear: Floats,
    table: Floats,
    load: Floats,
    force: Floats,
    gain: Floats,
    own: Floats,
    driven: Floats,
    limit: float,
    jitter: Floats,
    delay: float,
    when: Floats,
    asked: Floats,
    known: int,
    step: float,
    substeps: int,
    states: Floats,
    volts: Floats,
) -> int:
    """Integrate panel and controller by classical Runge-Kutta.

    q̈ = load - linear·(q, q̇) - f(q) + force·V and ż = own·(q, q̇, z) + driven·V, with V = U(t - delay) within ± limit
    and U = -gain·(q, q̇, z).

    Args:
        state: (2n + m,) start (q, q̇, z), not changed.
        linear: (n, 2n) stiffness and damping side by side.
        table: (n, monomials) of -f, as `polynomial.force_table` gives it.
        load: (n,) static force.
        force: (n, channels) modal force a volt.
        gain: (channels, 2n + m) what the controller asks for.
        own: (m, 2n + m) what its own state z does.
        driven: (m, channels) what the voltages do to that.
        limit: largest voltage [V].
        jitter: (steps, channels + m) noise of each step, added to U and to ż; (0, channels + m) if there is none.
        delay: from U to V [s]; 0, or no less than a step.
        when: (known + steps + 1,) instants at which U is known, 0 being now; filled from `known` on, where delayed.
        asked: (known + steps + 1, channels) U then; filled likewise.
        known: how many of those are past.
        step: time step [s].
        substeps: steps from one sample to the next.
        states: (samples, 2n + m) filled with the states after each `substeps` steps.
        volts: (samples, channels) filled with the voltages then.

    Returns:
        How many samples are finite; fewer than asked for if the motion diverged.
    """
    n = linear.shape[0]
    size, channels = state.size, force.shape[1]
    x = state.copy()
    stage = np.empty_like(x)
    rate = np.empty_like(x)
    total = np.empty_like(x)
    products = np.empty(n * (n + 1) * (n + 2) // 6 + n * (n + 1) // 2)
    drive = np.zeros(channels)
    noise = np.zeros(channels + size - 2 * n)
    delayed = delay > 0.0 and channels > 0
    place = 0
    done = 0
    for sample in range(states.shape[0]):
        for _ in range(substeps):
            if jitter.shape[0] > 0:
                noise[:] = jitter[done]
            if delayed:
                when[known] = done * step
                _ask(x, gain, noise, asked[known])
                known += 1
            for k in range(size):
                stage[k] = x[k]
                total[k] = 0.0
            for phase in range(4):
                if delayed:
                    ahead = 0.0 if phase == 0 else (1.0 if phase == 3 else 0.5)
                    place = _recall((done + ahead) * step - delay, when, asked, known, place, drive)
                else:
                    _ask(stage, gain, noise, drive)
                for c in range(channels):
                    drive[c] = min(max(drive[c], -limit), limit)
                for k in range(n):
                    rate[k] = stage[n + k]
                fill_monomials(stage, 0, n, 1.0, products, 0)
                multiply(table, products, 0, load, rate, n)
                for r in range(n):
                    change = 0.0
                    for k in range(2 * n):
                        change -= linear[r, k] * stage[k]
                    for c in range(channels):
                        change += force[r, c] * drive[c]
                    rate[n + r] += change
                for k in range(size - 2 * n):
                    change = noise[channels + k]
                    for c in range(channels):
                        change += driven[k, c] * drive[c]
                    for i in range(size):
                        change += own[k, i] * stage[i]
                    rate[2 * n + k] = change
                weight = step / 6.0 if phase == 0 or phase == 3 else step / 3.0
                reach = step if phase == 2 else 0.5 * step
                for k in range(size):
                    total[k] += weight * rate[k]
                    stage[k] = x[k] + reach * rate[k]
            for k in range(size):
                x[k] += total[k]
            done += 1
        if delayed:
            place = _recall(done * step - delay, when, asked, known, place, drive)
        else:
            _ask(x, gain, noise, drive)
        for k in range(size):
            if not np.isfinite(x[k]):
                return sample
            states[sample, k] = x[k]
        for c in range(channels):
            volts[sample, c] = min(max(drive[c], -limit), limit)
    return states.shape[0]


def integrate_free(
    state: Floats,
    linear: Floats,
    table: Floats,
    load: Floats,
    step: float,
    substeps: int,
    states: Floats,
) -> int:
    """As `integrate`, for a panel (2n,) without patches."""
    samples, size = states.shape
    no_channel, no_memory = np.zeros((0, size)), np.zeros((0, size))
    return integrate(
        state,
        linear,
        table,
        load,
        np.zeros((size // 2, 0)),
        no_channel,
        no_memory,
        np.zeros((0, 0)),
        0.0,
        np.zeros((0, 0)),
        0.0,
        np.zeros(0),
        np.zeros((0, 0)),
        0,
        step,
        substeps,
        states,
        np.zeros((samples, 0)),
    )
