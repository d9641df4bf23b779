"""Owns the choice of a design's controller."""

from __future__ import annotations

from typing import Protocol

from solver.law import Law
from solver.observer import Lqg
from solver.plant import Plant
from solver.ratefeedback import RateFeedback
from solver.regulator import Lqr


class Controller(Protocol):
    """What every controller offers: `Lqr`, `Lqg`, `RateFeedback`, `Gain`, `Compensator`, or one of your own."""

    def law(self, plant: Plant) -> Law:
        """The law it amounts to on a plant."""
        ...


def law_of(plant: Plant) -> Law:
    """The law of the design's controller; without patches, or with control off, one that asks for nothing.

    Raises:
        ControlError: a growing mode is out of reach of the patches, so that no such controller exists.
    """
    if not plant.channels:
        return Law.idle(plant)
    match plant.design.control.kind:
        case "off":
            return Law.idle(plant)
        case "lqr":
            return Lqr.of(plant).law(plant)
        case "lqg":
            return Lqg.of(plant).law(plant)
        case "rate":
            return RateFeedback.of(plant).law(plant)
