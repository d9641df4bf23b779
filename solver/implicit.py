"""Owns steps in time of the full-order model: the generalized-α method with Newton's."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solver.banded import definite_solver
from solver.fullorder import FullModel, lu_solver
from solver.law import Law
from solver.mesh import Floats
from solver.modes import ModalModel

SPECTRAL_RADIUS = 0.9  # ρ∞: what a step leaves of a motion too fast for it; the slow ones lose 1e-6 of themselves
# Of the largest deflection, what Newton's method may leave a step: a thousandth of the step's own error, which is
# (2π/128)³/12 = 1e-5. Deflections below SMALLEST h count as that: a fifth of where the panel counts as damped.
TOLERANCE = 1e-8
SMALLEST = 1e-4
ITERATIONS = 12  # quadratic convergence from the last motion carried on takes three
HALVINGS = 6  # of a step that does not converge: a channel that comes out of saturation is a kink
CONTRACTION = 0.2  # of the error an iteration: a tangent that gives less is made anew


@dataclass(frozen=True)
class FullState:
    """Deflection and rate of all free bending dofs; the in-plane displacements follow from them."""

    deflection: Floats
    """(N,) w and its derivatives at the nodes [m and its derivatives]."""
    rate: Floats
    """(N,) their rates [m/s and its derivatives]."""

    @staticmethod
    def of(model: ModalModel, state: Floats) -> FullState:
        """The motion (2n,) of a reduced model: w = Φ q, ẇ = Φ q̇."""
        return FullState(model.shapes @ state[: model.size], model.shapes @ state[model.size :])


class Stepper:
    """Steps of one length from a state on: M a + C v + λ S w + f(w, u) - F V(w, v) = 0 and g(w, u) = 0.

    The generalized-α method (Chung and Hulbert, J. Appl. Mech. 60, 1993, 371-375): inertia at the instant
    t + (1 - α_m) Δt, all other forces at t + (1 - α_f) Δt, there at the interpolated motion. It is second-order
    accurate; ρ∞ = 1 is the implicit mid-point rule. The displacements u have no inertia, and are sought at the second
    instant alone. Newton's unknown is x = (w, u) there. The control law closes the loop within the iteration: channels
    that are not saturated add +F G' to the tangent, of the channels' rank, taken in by the formula of Sherman, Morrison
    and Woodbury. A tangent is kept for as long as it serves.
    """

    def __init__(  # noqa: D107 - the class says it
        self, full: FullModel, model: ModalModel, law: Law | None, state: FullState, step: float, rho: float
    ) -> None:
        self.full, self.law = full, law
        self.inertia_at, self.force_at = (2 * rho - 1) / (rho + 1), rho / (rho + 1)  # α_m, α_f
        self.gamma = 0.5 - self.inertia_at + self.force_at
        self.beta = (1 - self.inertia_at + self.force_at) ** 2 / 4
        self.filter = (full.plate.mass @ model.shapes).T  # (n, N) Φᵀ M
        self.gain = np.zeros((full.drive.shape[1], 2 * self.filter.shape[1]))
        if law is not None:
            amplitudes, rates = law.gain[:, : model.size] @ self.filter, law.gain[:, model.size :] @ self.filter
            self.gain = np.hstack([amplitudes, rates]) + law.direct_on_sensors(full.drive)
        self.limit = math.inf if law is None else law.limit
        self.floor = SMALLEST * full.design.panel.thickness
        self.drive = np.zeros((full.size, full.drive.shape[1]))
        self.drive[full.bending] = full.drive
        self.driven = self.drive  # tangent's solution for the drive
        self._set_step(step)
        self.w, self.v = state.deflection, state.rate
        self.x = full.unknowns(self.w, full.condensed(self.w))
        self.drift = np.zeros(full.size)  # of x, in a unit of time
        self.a = definite_solver(full.plate.mass)(-self._force(self.x, self.w, self.v)[0][full.bending])

    def _set_step(self, step: float) -> None:
        self.step = step
        # what a unit of w at the instant of the forces adds to a at that of inertia, and to v
        self.mass_factor = (1 - self.inertia_at) / ((1 - self.force_at) * self.beta * step**2)
        self.rate_factor = self.gamma / (self.beta * step)
        self.blocks = self.full.inertial_blocks(self.mass_factor, self.rate_factor)
        self.solve: Callable[[Floats], Floats] | None = None

    def volts(self, w: Floats, v: Floats) -> Floats:
        """(channels,) saturated voltages at w (N,) and v (N,)."""
        return np.clip(-self.gain @ np.concatenate([w, v]), -self.limit, self.limit)

    def _force(self, x: Floats, w: Floats, v: Floats) -> tuple[Floats, Floats]:
        """All forces but inertia (size,), and the voltages among them."""
        full = self.full
        volts = self.volts(w, v)
        force = full.internal_force(x)
        force[full.bending] += full.damping @ v + full.flow @ w - full.drive @ volts
        return force, volts

    def advance(self, halvings: int = HALVINGS) -> None:
        """Go on by a step, in halves where Newton's method does not converge otherwise.

        Raises:
            ArithmeticError: it does not converge with the smallest step either.
        """
        try:
            return self._advance()
        except ArithmeticError:
            if not halvings:
                raise
        step = self.step
        self._set_step(step / 2)
        for _ in range(2):
            self.advance(halvings - 1)
        self._set_step(step)

    def _advance(self) -> None:
        full, dt, af, am = self.full, self.step, self.force_at, self.inertia_at
        w, v, a = self.w, self.v, self.a
        x = self.x + dt * self.drift
        x[full.bending] = w + (1 - af) * (dt * v + dt**2 / 2 * a)
        before, fresh = 0.0, False
        for _ in range(ITERATIONS):
            at = x[full.bending]
            new_w = (at - af * w) / (1 - af)
            new_a = (new_w - w - dt * v) / (self.beta * dt**2) - (1 / (2 * self.beta) - 1) * a
            new_v = v + dt * ((1 - self.gamma) * a + self.gamma * new_a)
            residual, volts = self._force(x, at, (1 - af) * new_v + af * v)
            residual[full.bending] += full.plate.mass @ ((1 - am) * new_a + am * a)
            change = self._correction(x, residual, volts)
            size = float(np.abs(change * full.scale).max())
            rate = size / before if before else 1.0  # not known yet at first
            if not fresh and before and rate > CONTRACTION:
                self._factorise(x)
                fresh = True
                change = self._correction(x, residual, volts)
                size = float(np.abs(change * full.scale).max())
                rate = 1.0
            x -= change
            before = size
            allowed = TOLERANCE * max(float(np.abs(x * full.scale).max()), self.floor)
            # what is left of a sequence of errors that shrink at this rate (Hairer and Wanner II, IV.8)
            if size <= allowed or (rate < 0.5 and rate / (1 - rate) * size <= allowed):
                break
        else:
            raise ArithmeticError(
                f"a step of {dt:.3g} s does not converge: the motion diverges, or changes too fast; use more steps"
            )
        at = x[full.bending]
        self.w = (at - af * w) / (1 - af)
        self.a = (self.w - w - dt * v) / (self.beta * dt**2) - (1 / (2 * self.beta) - 1) * a
        self.v = v + dt * ((1 - self.gamma) * a + self.gamma * self.a)
        self.drift, self.x = (x - self.x) / dt, x

    def _factorise(self, x: Floats) -> None:
        if not np.isfinite(x).all():
            raise ArithmeticError("the motion diverged; use more steps, or lower λ")
        self.solve = lu_solver(self.full.tangent(x, self.blocks))
        self.driven = self.solve(self.drive) if self.drive.shape[1] else self.drive

    def _correction(self, x: Floats, residual: Floats, volts: Floats) -> Floats:
        """(size,) what Newton's method takes off x; saturated channels do not answer to it."""
        if self.solve is None:
            self._factorise(x)
        assert self.solve is not None
        change = self.solve(residual)
        active = np.abs(volts) < self.limit
        if self.law is None or not active.any():
            return change
        n = self.full.bending_size
        answer = self.gain[active, :n] + self.rate_factor * self.gain[active, n:]  # -dV/dw
        driven = self.driven[:, active]
        small = np.eye(len(answer)) + answer @ driven[self.full.bending]
        return change - driven @ np.linalg.solve(small, answer @ change[self.full.bending])
