"""Owns the flow's derivative: the uncontrolled motion integrated together with small deviations from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solver.mesh import Floats, Ints
from solver.plant import Plant
from solver.polynomial import force_table

# Step times the highest natural frequency. Runge-Kutta damps that mode by its fifth power over 144 a radian, 1e-7, and
# turns it too slowly by its fourth over 120, 1e-6, and the modes that carry a cycle a thousand times less: volumes in
# state space are right to 1e-5 after a cycle. The membrane makes all of them faster, some twice at 1.8 h, so that an
# orbit of that size closes to 2e-5 under an exact integrator, and one of 1 h to a tenth of that.
STEP_OMEGA = 0.1


@dataclass(frozen=True)
class FlowMap:
    """The uncontrolled panel's motion as a map from states to states, with its derivative."""

    linear: Floats
    """(n, 2n) K and C side by side [1/s², 1/s]."""
    table: Floats
    """(n, monomials) the cubic law as `polynomial.force_table` gives it [N/√kg per (m·√kg)³]."""
    spread: Floats
    """(pairs, n, n) G of the membrane's energy, its second pair written as a square [J per (kg·m²)²]."""
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
            table=force_table(law),
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
        from solver.deviations import propagate  # here, because numba is slow to import

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
        from solver.kernel import integrate_free  # here, because numba is slow to import

        steps = steps or self.steps(time)
        n = len(self.load)
        end = np.full((1, 2 * n), np.nan)
        integrate_free(state, self.linear, self.table, self.load, time / steps, steps, end)
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
        from solver.deviations import membrane  # here, because numba is slow to import

        n, pairs = len(self.load), len(self.spread)
        force, tangent = np.empty(n), np.empty((n, n))
        membrane(
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
