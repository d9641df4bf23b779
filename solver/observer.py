"""Owns the Kalman filter on the patches' own charges, and the regulator that works on its estimate (LQG)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from solver.errors import ControlError
from solver.flutter import leading_eigenvalue
from solver.law import Law
from solver.mesh import Bools, Floats
from solver.plant import Plant
from solver.reach import reached
from solver.regulator import STABLE, Balanced, lqr_gain

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Lqg:
    """U = -G X̂, with X̂' = A X̂ + B V + L (y - C X̂) from the charges y of the patches that are driven.

    The estimate follows the voltage that the drive gives, not what was asked for, so that saturation does not mislead
    it. It covers the modes that the patches reach; what they cannot drive they cannot sense.
    """

    gain: Floats
    """(channels, 2n) G of the regulator [V per unit of q, V·s per unit of q̇]."""
    filter_gain: Floats
    """(2n, channels) L of the Kalman filter [units of X per C·s]."""
    modes: Bools
    """(n,) modes that are estimated."""

    @staticmethod
    def of(plant: Plant) -> Lqg:
        """Regulator and filter of the design's weights, on its channels.

        Raises:
            ControlError: a growing mode is out of reach of the patches, so that neither exists.
        """
        gain, filter_gain = lqr_gain(plant, plant.force), kalman_gain(plant, plant.force)
        return Lqg(gain, filter_gain, reached(plant, plant.force))

    def law(self, plant: Plant) -> Law:
        """The law with the design's drive and sensors."""
        states, c = np.tile(self.modes, 2), len(self.gain)
        charge = np.hstack([plant.force.T, np.zeros_like(plant.force.T)])
        observed = plant.system_matrix - self.filter_gain @ charge
        none, drive = np.zeros((c, c)), plant.design.control
        return Law(
            gain=np.zeros_like(self.gain),
            on_charge=none,
            on_current=none,
            reading=self.gain[:, states],
            own=observed[np.ix_(states, states)],
            sensed=self.filter_gain[states],
            driven=plant.input_matrix[states],
            limit=drive.voltage_limit,
            delay=drive.delay,
            noise=drive.sensor_noise,
            seed=drive.noise_seed,
        )

    def state_space(self, plant: Plant) -> control.StateSpace:
        """The compensator as a python-control object, from charges [C] to voltages [V], never saturated."""
        import control  # here, because it brings matplotlib with it

        law = self.law(plant)
        inner = law.own - law.driven @ law.reading
        system = control.ss(inner, law.sensed, -law.reading, 0)
        assert isinstance(system, control.StateSpace)  # ss makes other kinds from other arguments
        return system


def kalman_gain(plant: Plant, force: Floats) -> Floats:
    """Gain (2n, sensors) of the steady Kalman filter on the charges y = Fᵀq of patches with these modal forces.

    Disturbances are white modal forces of one intensity in every mode (a load as random along the panel as its mass
    is spread), sensor noise is white; only their ratio counts, the design's `observer_weight`. By duality the Riccati
    equation is the regulator's with Aᵀ, Cᵀ for A, B (Kwakernaak and Sivan, 1972, ch. 4), solved in the balanced state.

    Args:
        plant: the panel in its stream.
        force: (n, sensors) modal force a volt, and so charge a unit of amplitude [C·√kg/m].

    Raises:
        ControlError: a growing mode is not sensed.
    """
    gain = np.zeros((2 * plant.size, force.shape[1]))
    part = Balanced.of(plant, force)
    k = len(part.omega)
    if not k:
        return gain
    ratio = plant.design.control.observer_weight
    charge = np.hstack([(force[part.modes] / part.omega[:, None]).T, np.zeros((force.shape[1], k))])
    # in the time ω1 t the disturbance counts ω1^-1/2, the noise ω1^1/2 times; y is scaled so that its noise is 1
    scaled = charge * ratio / part.rate
    disturbance = np.diag(np.repeat([0.0, 1.0], k))
    try:
        spread = scipy.linalg.solve_continuous_are(part.system.T, scaled.T, disturbance, np.eye(force.shape[1]))
    except np.linalg.LinAlgError:
        raise ControlError(_unobserved(plant)) from None
    balanced = spread @ scaled.T
    if leading_eigenvalue(part.system - balanced @ scaled).real > STABLE:
        raise ControlError(_unobserved(plant))
    gain[part.states] = (balanced * ratio) / part.scale[:, None]
    return gain


def _unobserved(plant: Plant) -> str:
    return (
        f"the patches cannot sense the flutter: no Kalman filter exists at λ = {plant.stream.dynamic_pressure:g} with "
        f"control.observer_weight = {plant.design.control.observer_weight:g}; change that, patch other elements or "
        "lower λ"
    )
