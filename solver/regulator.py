"""Owns the linear quadratic regulator and what its gain says about where patches belong (NFCG)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from solver.design import Design
from solver.errors import ControlError
from solver.flutter import leading_eigenvalue
from solver.mesh import Bools, Floats
from solver.piezo import element_forces
from solver.plant import Plant

STABLE = 1e-9  # of ω1: growth below it is rounding


@dataclass(frozen=True)
class Regulator:
    """V = -G X, saturated at ± the voltage limit."""

    gain: Floats
    """(channels, 2n) G [V per unit of q, V·s per unit of q̇]."""
    limit: float
    """Largest voltage [V]."""
    growth: complex
    """Leading eigenvalue of the closed loop about the flat panel: growth rate [1/s] + i·frequency [rad/s]."""

    @staticmethod
    def idle(plant: Plant) -> Regulator:
        """A regulator that does nothing."""
        gain = np.zeros((len(plant.channels), 2 * plant.size))
        return Regulator(gain, plant.design.control.voltage_limit, plant.growth)

    def filtered(self, own: Plant, richer: Plant) -> Regulator:
        """The same regulator at work on a richer plant on the same mesh, which it sees through its own modes alone.

        With q = Φᵀ M w of its own modes, G becomes G Φᵀ M Φ_richer for amplitudes and rates alike. What it does to
        motion outside of its modes without seeing it is spillover (Balas, IEEE Trans. Autom. Control 23, 1978).

        Args:
            own: the plant that it was made for.
            richer: the plant that it is to drive, with the same channels.
        """
        share = own.model.project(richer.model, np.eye(richer.size)).T
        gain = np.hstack([self.gain[:, : own.size] @ share, self.gain[:, own.size :] @ share])
        closed = leading_eigenvalue(richer.system_matrix - richer.input_matrix @ gain)
        return Regulator(gain, self.limit, closed)

    @staticmethod
    def of(plant: Plant) -> Regulator:
        """The design's regulator; without patches, or with control off, one that does nothing.

        Raises:
            ControlError: a growing mode is out of reach of the patches, so that no regulator exists.
        """
        control = plant.design.control
        if control.kind == "off" or not plant.channels:
            return Regulator.idle(plant)
        gain = lqr_gain(plant, plant.force)
        closed = leading_eigenvalue(plant.system_matrix - plant.input_matrix @ gain)
        return Regulator(gain, control.voltage_limit, closed)


def lqr_gain(plant: Plant, force: Floats) -> Floats:
    """Gain (inputs, 2n) that minimises ∫ XᵀQX + R VᵀV dt, Q = s·blockdiag(Ω², I) (the seed's 3.6-3.8).

    Solved in the balanced state (Ωq, q̇), in which Q = s·I and A has one scale, and scaled back.

    Args:
        plant: the panel in its stream.
        force: (n, inputs) modal force a volt.

    Raises:
        ControlError: a growing mode cannot be reached by these inputs.
    """
    n, control = plant.size, plant.design.control
    gain = np.zeros((force.shape[1], 2 * n))
    reached = _reached(plant, force)
    if not reached.any():
        return gain
    n, omega, force = int(reached.sum()), plant.model.omega[reached], force[reached]
    stiffness, damping = plant.stiffness[np.ix_(reached, reached)], plant.damping[np.ix_(reached, reached)]
    scale = omega[0]  # time unit, so that numbers near 1 go into the Riccati equation
    a = np.zeros((2 * n, 2 * n))
    a[:n, n:] = np.diag(omega) / scale
    a[n:, :n] = -stiffness / omega / scale
    a[n:, n:] = -damping / scale
    b = np.vstack([np.zeros_like(force), force]) / scale
    effort = control.effort_weight / control.state_weight
    try:
        cost = scipy.linalg.solve_continuous_are(a, b, np.eye(2 * n), effort * np.eye(force.shape[1]))
    except np.linalg.LinAlgError:
        raise _refusal(plant) from None
    balanced = b.T @ cost / effort
    # where a force is almost nothing the equation's solver may also return, without a word, what stabilises nothing
    if leading_eigenvalue(a - b @ balanced).real > STABLE:
        raise _refusal(plant)
    gain[:, np.tile(reached, 2)] = balanced * np.concatenate([omega, np.ones(n)])
    return gain


def _refusal(plant: Plant) -> ControlError:
    return ControlError(
        "the patches cannot hold the flutter: no regulator exists at "
        f"λ = {plant.stream.dynamic_pressure:g}; patch other elements (the leading third is best) or lower λ"
    )


def _reached(plant: Plant, force: Floats) -> Bools:
    """(n,) modes that the inputs move, themselves or through other modes; what is left keeps its own growth rate.

    A layout symmetric about y = b/2 on one channel cannot touch the antisymmetric modes, and must not be kept from
    controlling the symmetric ones because of them.
    """
    coupled = (plant.stiffness != 0) | (plant.damping != 0)
    _, label = connected_components(sp.csr_array(coupled), directed=False)
    return np.isin(label, label[np.any(force != 0, axis=1)])


def nfcg(design: Design) -> Floats:
    """(elements,) norm of each element's row of the feedback gain (the seed's 4.1).

    Every element is its own actuator on the bare panel: the patches' own mass and stiffness are left out. The state is
    X = (q, q̇) in mass-normalised modes as in the seed, so that the gains on q [V/(m·√kg)] outweigh those on q̇.
    """
    bare = Plant.of(design.with_elements(()))
    return np.linalg.norm(lqr_gain(bare, element_forces(bare.model, design)), axis=1)
