"""Owns what an uncontrolled panel comes to in the end: its motion, its orbit, and the figures of its limit cycle."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from solver.limitcycle import LimitCycle, limit_cycle
from solver.mesh import Floats
from solver.motion import Motion, settled_motion
from solver.plant import Plant
from solver.shooting import Orbit, orbit_states
from solver.simulate import Loop


@dataclass(frozen=True)
class Outcome:
    """How the uncontrolled panel ends."""

    motion: Motion | None
    """What it settles into; None if it diverged, or nothing drives or damps it."""
    orbit: Orbit | None
    """The stable periodic orbit it runs along, if it does."""
    cycle: LimitCycle | None
    """Figures of its limit cycle; of a quasi-periodic motion those of its last window, not converged. Else None."""


def outcome_of(loop: Loop, start: Floats | None = None) -> Outcome:
    """What a panel comes to from a start (2n,), by default that of the seed protocol."""
    motion, orbit = settled_motion(loop, start)
    if orbit is not None:
        return Outcome(motion, orbit, cycle_along(loop.plant, orbit))
    if motion is None or motion.kind != "quasi-periodic":
        return Outcome(motion, None, None)
    cycle = limit_cycle(loop, start)  # its amplitude may come to rest, though its swings never do
    return Outcome(motion, None, dataclasses.replace(cycle, converged=False) if cycle else None)


def cycle_along(plant: Plant, orbit: Orbit) -> LimitCycle:
    """The figures of a limit cycle, as `limit_cycle` measures them, from its orbit."""
    share = np.abs(orbit_states(plant, orbit)[:, : plant.size]).max(axis=0) * plant.model.peak
    return LimitCycle(True, orbit.amplitude, orbit.frequency, 100 * share / share.sum(), orbit.state)
