"""Owns the linear quadratic regulator of the full state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.errors import ControlError
from solver.flutter import leading_eigenvalue
from solver.law import Law
from solver.mesh import Bools, Floats
from solver.plant import Plant
from solver.reach import reached, refusal
from solver.riccati import stabilising_cost

STABLE = 1e-9  # of ω1: growth below it is rounding


@dataclass(frozen=True)
class Lqr:
    """U = -G X with the whole state known: the paper's regulator."""

    gain: Floats
    """(channels, 2n) G [V per unit of q, V·s per unit of q̇]."""

    @staticmethod
    def of(plant: Plant) -> Lqr:
        """The regulator of the design's weights, on its channels.

        Raises:
            ControlError: a growing mode is out of reach of the patches, so that no regulator exists.
        """
        return Lqr(lqr_gain(plant, plant.force))

    def law(self, plant: Plant) -> Law:
        """The law with the design's drive."""
        return Law.static(plant.design.control, self.gain)


@dataclass(frozen=True)
class Balanced:
    """The modes that some inputs reach, as a system in the state (Ωq, q̇) and the time ω1 t: numbers near 1."""

    modes: Bools
    """(n,) which of the plant's modes these are."""
    omega: Floats
    """(k,) their natural frequencies [rad/s]."""
    rate: float
    """ω1 [rad/s]."""
    system: Floats
    """(2k, 2k) system matrix [-]."""
    inputs: Floats
    """(2k, inputs) what the inputs do to the rates [units of force over ω1]."""

    @staticmethod
    def of(plant: Plant, force: Floats) -> Balanced:
        """Cut out and scale what inputs of modal forces (n, inputs) reach."""
        modes = reached(plant, force)
        omega, k = plant.model.omega[modes], int(modes.sum())
        rate = float(omega[0]) if k else 1.0
        a = np.zeros((2 * k, 2 * k))
        a[:k, k:] = np.diag(omega) / rate
        a[k:, :k] = -plant.stiffness[np.ix_(modes, modes)] / omega / rate
        a[k:, k:] = -plant.damping[np.ix_(modes, modes)] / rate
        b = np.vstack([np.zeros((k, force.shape[1])), force[modes]]) / rate
        return Balanced(modes, omega, rate, a, b)

    @property
    def states(self) -> Bools:
        """(2n,) which of the plant's states these are."""
        return np.tile(self.modes, 2)

    @property
    def scale(self) -> Floats:
        """(2k,) what the plant's states are multiplied by."""
        return np.concatenate([self.omega, np.ones(len(self.omega))])


def state_weights(plant: Plant) -> Floats:
    """(2n,) diagonal of Q/s for the state (Ωq, q̇), Q being the design's: all 1 where it weighs energy."""
    control, model = plant.design.control, plant.model
    match control.weighting:
        case "energy":
            return np.ones(2 * model.size)
        case "identity":
            return np.concatenate([model.omega**-2.0, np.ones(model.size)])
        case "diagonal":
            numbers = np.arange(model.size) if model.numbers is None else model.numbers
            by_hand = np.array(control.diagonal).reshape(2, -1)[:, numbers]
            return np.concatenate([by_hand[0] / model.omega**2, by_hand[1]])


def lqr_gain(plant: Plant, force: Floats) -> Floats:
    """Gain (inputs, 2n) that minimises ∫ XᵀQX + R UᵀU dt (the seed's 3.6-3.8), with Q by the design's weighting.

    Solved in the balanced state and scaled back.

    Args:
        plant: the panel in its stream.
        force: (n, inputs) modal force a volt.

    Raises:
        ControlError: a growing mode cannot be reached by these inputs.
    """
    gain = np.zeros((force.shape[1], 2 * plant.size))
    part = Balanced.of(plant, force)
    if part.modes.any():
        _, balanced = regulator_solution(plant, part)
        gain[:, part.states] = balanced * part.scale
    return gain


def regulator_solution(plant: Plant, part: Balanced) -> tuple[Floats, Floats]:
    """Riccati's P (2k, 2k) over s, and the gain (inputs, 2k), both for the balanced state (the seed's 3.7 and 3.8).

    Raises:
        ControlError: no regulator exists.
    """
    if not part.modes.any():
        raise ControlError("the patches move nothing: no regulator exists; give them a patches.d31 that is not 0")
    effort = plant.design.control.effort_weight / plant.design.control.state_weight
    weights = np.diag(state_weights(plant)[part.states])
    a, b = part.system, part.inputs
    try:
        cost = stabilising_cost(a, b, weights, effort)
    except np.linalg.LinAlgError:
        raise ControlError(refusal(plant)) from None
    gain = b.T @ cost / effort
    # where a force is almost nothing the equation's solver may also return, without a word, what stabilises nothing
    if leading_eigenvalue(a - b @ gain).real > STABLE:
        raise ControlError(refusal(plant))
    return cost, gain
