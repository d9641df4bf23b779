"""Owns collocated rate feedback: each channel's voltage against the current of its own patches."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from solver.law import Law
from solver.plant import Plant


@dataclass(frozen=True)
class RateFeedback:
    """U = -g ẏ: what a damper does, with no model and no estimate; the baseline that others have to beat."""

    gain: float
    """g, voltage a unit current [V/A]."""

    @staticmethod
    def of(plant: Plant) -> RateFeedback:
        """The one of the design's gain."""
        return RateFeedback(plant.design.control.rate_gain)

    def law(self, plant: Plant) -> Law:
        """The law with the design's drive and sensors."""
        c = len(plant.channels)
        nothing = Law.static(plant.design.control, np.zeros((c, 2 * plant.size)))
        return dataclasses.replace(nothing, on_current=self.gain * np.eye(c))
