"""Owns the flow's derivative: the uncontrolled motion integrated together with small deviations from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from solver.kernel import integrate_free
from solver.mesh import Floats, Ints
from solver.plant import Plant

# As in kernel.py: sums may be reordered so that they vectorise; NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "nsz", "arcp"}

# Step times the highest natural frequency. Runge-Kutta damps that mode by its fifth power over 144 a radian, 1e-7, and
# turns it too slowly by its fourth over 120, 1e-6, and the modes that carry a cycle a thousand times less: volumes in
# state space are right to 1e-5 after a cycle. The membrane makes all of them faster, some twice at 1.8 h, so that an
# orbit of that size closes to 2e-5 under an exact integrator, and one of 1 h to a tenth of that.
STEP_OMEGA = 0.1


@numba.njit(cache=True, fastmath=_FAST)
def _membrane(
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


@numba.njit(cache=True, fastmath=_FAST, nogil=True)
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
            _membrane(stage[:n], spread, cubic, index, slope, stress, force, tangent)
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


@dataclass(frozen=True)
class FlowMap:
    """The uncontrolled panel's motion as a map from states to states, with its derivative."""

    linear: Floats
    """(n, 2n) K and C side by side [1/s², 1/s]."""
    quartic: Floats
    """(pairs, pairs) G of the membrane's energy [J per (kg·m²)²]."""
    spread: Floats
    """(pairs, n, n) G, its second pair written as a square [J per (kg·m²)²]."""
    cubic: Floats
    """(pairs, n) H, or (0, n) [J per (kg·m²)^1.5]."""
    index: Ints
    """(n, n) number of the pair of each two modes [-]."""
    load: Floats
    """(n,) static force [N/√kg]."""
    weights: Floats
    """(2n,) what makes q and q̇ alike in size, (Ω, 1): the norm is then that of twice the linear energy [rad/s, -]."""
    step: float
    """Largest time step [s]."""

    @staticmethod
    def of(plant: Plant) -> FlowMap:
        """The flow of a plant."""
        n, law = plant.size, plant.model.membrane
        index = np.zeros((n, n), dtype=np.int64)
        r, s = np.triu_indices(n)
        index[r, s] = index[s, r] = np.arange(len(r))
        return FlowMap(
            linear=np.hstack([plant.stiffness, plant.damping]),
            quartic=law.quartic,
            spread=np.ascontiguousarray(law.quartic[:, index]),
            cubic=np.ascontiguousarray(law.cubic),
            index=index,
            load=plant.model.load,
            weights=np.concatenate([plant.model.omega, np.ones(n)]),
            step=STEP_OMEGA / plant.model.band[1],
        )

    def steps(self, time: float) -> int:
        """Number of steps that a time [s] is cut into."""
        return max(1, math.ceil(time / self.step * (1 - 1e-12)))

    def advance(
        self, state: Floats, deviations: Floats, time: float, steps: int | None = None
    ) -> tuple[Floats, Floats]:
        """State and deviations a time later.

        Args:
            state: (2n,) amplitudes [m·√kg] and rates [m·√kg/s].
            deviations: (2n, m) small deviations from it; the identity gives the state transition matrix.
            time: how long [s].
            steps: number of Runge-Kutta steps; as many as the highest mode needs by default.

        Returns:
            New arrays of the same shapes; not finite where the motion diverged.
        """
        steps = steps or self.steps(time)
        state, deviations = state.copy(), np.array(deviations, dtype=float, order="C")
        propagate(
            state,
            deviations,
            self.linear,
            self.spread,
            self.cubic,
            self.index,
            self.load,
            time / steps,
            steps,
        )
        return state, deviations

    def moved(self, state: Floats, time: float, steps: int | None = None) -> Floats:
        """State (2n,) a time [s] later, by the same steps as `advance`; not finite where the motion diverged."""
        steps = steps or self.steps(time)
        n = len(self.load)
        end = np.full((1, 2 * n), np.nan)
        integrate_free(state, self.linear, self.quartic, self.cubic, self.load, time / steps, steps, end)
        return end[0]

    def norm(self, state: Floats) -> float:
        """Length of a state (2n,), or of a difference of two, in the norm of the linear energy [m·√kg/s]."""
        return float(np.linalg.norm(self.weights * state))

    def transition(self, state: Floats, time: float, steps: int | None = None) -> tuple[Floats, Floats]:
        """State (2n,) a time [s] later, and its derivative (2n, 2n) by the state now."""
        return self.advance(state, np.eye(len(state)), time, steps)

    def rate(self, state: Floats) -> Floats:
        """(2n,) time derivative of a state [m·√kg/s, m·√kg/s²]."""
        return self._local(state)[0]

    def jacobian(self, state: Floats) -> Floats:
        """(2n, 2n) derivative of `rate` by the state [1/s and 1/s²]."""
        n, tangent = len(self.load), self._local(state)[1]
        matrix = np.zeros((2 * n, 2 * n))
        matrix[:n, n:] = np.eye(n)
        matrix[n:] = -self.linear
        matrix[n:, :n] -= tangent
        return matrix

    def _local(self, state: Floats) -> tuple[Floats, Floats]:
        """Time derivative (2n,) of a state and the membrane's tangent stiffness (n, n) there."""
        n, pairs = len(self.load), len(self.spread)
        force, tangent = np.empty(n), np.empty((n, n))
        _membrane(
            state[:n],
            self.spread,
            self.cubic,
            self.index,
            np.empty((pairs, n)),
            np.empty(pairs),
            force,
            tangent,
        )
        return np.concatenate([state[n:], self.load - self.linear @ state - force]), tangent
