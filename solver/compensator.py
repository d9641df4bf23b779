"""Owns controllers of anyone's own design: a gain on the state, or a python-control system from charges to volts."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from solver.errors import ControlError
from solver.law import Law
from solver.mesh import Floats
from solver.plant import Plant

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Gain:
    """U = -K X, as `control.lqr(plant.state_space(), Q, R)` gives K."""

    matrix: Floats
    """(channels, 2n) K [V per unit of q, V·s per unit of q̇]."""

    def law(self, plant: Plant) -> Law:
        """The law with the design's drive.

        Raises:
            ControlError: the gain is not one for this plant.
        """
        try:
            gain = np.atleast_2d(np.asarray(self.matrix, dtype=float))
        except (TypeError, ValueError):
            raise ControlError("a gain: this takes a matrix of numbers, channels by states") from None
        wanted = (len(plant.channels), 2 * plant.size)
        if gain.shape != wanted or not np.isfinite(gain).all():
            raise ControlError(f"a gain of shape {gain.shape}: this plant takes {wanted}, channels by states, finite")
        return Law.static(plant.design.control, gain)


@dataclass(frozen=True)
class Compensator:
    """U = K(s) y, with K a python-control system from the charges y of the channels [C] to their voltages [V].

    It acts as it stands: a K that is to damp brings its own minus sign, as `Lqg.state_space` does. It does not know
    what the drive gives of what it asks for: an estimator within it is misled by saturation, as that of `Lqg` is not.
    """

    system: control.StateSpace
    """(channels by channels) K, continuous in time."""

    def law(self, plant: Plant) -> Law:
        """The law with the design's drive and sensors.

        Raises:
            ControlError: the system is not one for this plant.
        """
        import control  # here, because it brings matplotlib with it

        c, system = len(plant.channels), self.system
        if not isinstance(system, control.StateSpace):
            raise ControlError(
                f"a compensator of type {type(system).__name__}: use a control.StateSpace, as control.ss"
            )
        if (system.noutputs, system.ninputs) != (c, c) or not system.isctime():
            raise ControlError(
                f"a compensator of {system.ninputs} inputs and {system.noutputs} outputs: this plant takes one of {c} "
                f"and {c}, continuous in time"
            )
        nothing = Law.static(plant.design.control, np.zeros((c, 2 * plant.size)))
        own, sensed, reading, direct = (np.asarray(m, dtype=float) for m in (system.A, system.B, system.C, system.D))
        if not all(np.isfinite(m).all() for m in (own, sensed, reading, direct)):
            raise ControlError("a compensator with matrices that are not finite: give it numbers")
        return dataclasses.replace(
            nothing,
            on_charge=-direct,
            reading=-reading,
            own=own,
            sensed=sensed,
            driven=np.zeros_like(sensed),
        )
