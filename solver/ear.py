"""Owns the ear, which tells loud states of a panel from quiet ones, and small from large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.mesh import Bools, Floats
from solver.simulate import Loop

SPARSE = 29  # every so many points of the grid show most loud motions to be loud, without a look at the others
LINEAR = 3e-3  # of h: where B = 0 the membrane's forces, which go with the cube, are 1e-5 of the others there


@dataclass(frozen=True)
class Ear:
    """Tells loud states from quiet ones, with a look at the whole panel only where that is not plain."""

    shapes: Floats
    """(n, points) mode shapes over h times the limit of what is quiet [1/(m·√kg)]."""
    few: Floats
    """(n, some points) of them [1/(m·√kg)]."""
    peak: Floats
    """(n,) their largest absolute values [1/(m·√kg)]."""
    linear: float
    """`LINEAR` over that limit [-]."""

    @staticmethod
    def of(loop: Loop) -> Ear:
        """The ear for the limit of the design's run."""
        model, design = loop.plant.model, loop.plant.design
        shapes = np.ascontiguousarray(model.coarse.T) / (design.panel.thickness * design.run.settled)
        few = np.ascontiguousarray(shapes[:, ::SPARSE])
        return Ear(shapes, few, np.abs(shapes).max(axis=1), LINEAR / design.run.settled)

    def loud(self, states: Floats) -> Bools:
        """(samples,) whether the largest |w| of states (samples, 2n) is not below the limit."""
        q = states[:, : len(self.peak)]
        loud = np.zeros(len(q), dtype=bool)
        unsure = np.flatnonzero(~(np.abs(q) @ self.peak < 1.0))
        for shapes in (self.few, self.shapes) if len(unsure) else ():
            heard = ~(np.abs(q[unsure] @ shapes).max(axis=1) < 1.0)
            loud[unsure[heard]] = True
            unsure = unsure[~heard]
        return loud

    def small(self, states: Floats) -> bool:
        """Whether |w| of all states (samples, 2n) is so small that they are linear."""
        q = np.abs(states[:, : len(self.peak)])
        return bool(q[-1] @ self.peak < self.linear) and bool((q @ self.peak).max() < self.linear)
