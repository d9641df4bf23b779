"""Owns branches of periodic motions over dynamic pressure: each orbit from the last, and what happens on the way."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from solver.plant import Plant
from solver.shooting import NEAR, REACH, Orbit, find_orbit
from solver.variational import FlowMap

RESOLUTION = 1e-4  # of λ, to which ends and changes of stability are located
REAL = 1e-3  # a pair this close to the real axis has not parted from it
VANISHING = 0.1  # of h: an orbit grows as the root of the distance, to this within 1 % of λ_cr
TURNING = 0.3  # at a fold a multiplier meets 1 as the root of the distance does: so near it comes at RESOLUTION


@dataclass(frozen=True)
class Event:
    """What happens to an orbit at some λ."""

    kind: Literal["fold", "symmetry breaking", "period doubling", "Neimark-Sacker", "rest", "lost"]
    """fold: it meets another and both end; symmetry breaking: it meets an orbit and its mirror image; period doubling:
    a multiplier passes -1; Neimark-Sacker: a pair passes the circle, as where a second frequency begins; rest: it
    shrinks to nothing; lost: it was not found any further, for no reason that its multipliers show."""
    dynamic_pressure: float
    """λ where it happens, to one part in ten thousand [-]."""
    multiplier: complex
    """The multiplier that decides, next to the event [-]."""


@dataclass(frozen=True)
class Step:
    """A point of a branch of orbits."""

    orbit: Orbit
    """The orbit."""
    event: Event | None
    """What happened since the point before: a change of stability; or, with `last`, what ends the branch here."""
    last: bool
    """Whether the branch ends here, as far as increasing or decreasing λ follows it."""


def follow(plant: Plant, pressures: Iterable[float], orbit: Orbit) -> Iterator[Step]:
    """Follow a branch of orbits over λ, stable or not, each the guess for the next.

    Natural continuation: λ is given, and the step to it is halved where the next orbit is not found or is not near.
    An orbit with mirror symmetry is followed among such orbits, and so through the loss of that symmetry.

    Args:
        plant: the panel; its λ is not used.
        pressures: λ in the order to visit [-], from the orbit's own.
        orbit: where to start.

    Yields:
        A point at each λ, and one at each change of stability between; after the last one that can be reached nothing
        more.
    """
    before = None
    for target in map(float, pressures):
        while abs(target - orbit.dynamic_pressure) > 1e-9 * abs(target):
            found = _next(plant, before, orbit, target)
            if found is None:
                yield Step(orbit, _ending(orbit, plant, target), last=True)
                return
            event = None
            if found.unstable != orbit.unstable:
                low, found = _narrowed(plant, before, orbit, found)
                event = _change(low, found)
            before, orbit = orbit, found
            if event or orbit.dynamic_pressure == target:
                yield Step(orbit, event, last=False)


def _next(plant: Plant, before: Orbit | None, orbit: Orbit, target: float) -> Orbit | None:
    """The orbit at λ = target, or as near to it as steps halved down to the resolution reach."""
    start = orbit.dynamic_pressure
    change = target - start
    while abs(change) > RESOLUTION * abs(start):
        found = _stepped(plant, before, orbit, start + change if change != target - start else target)
        if found:
            return found
        change /= 2
    return None


def _stepped(plant: Plant, before: Orbit | None, orbit: Orbit, pressure: float) -> Orbit | None:
    """The orbit at a λ nearby on the same branch; None if there is none, or the one found is another's."""
    there = plant.at_pressure(pressure)
    state, period = orbit.state, orbit.period
    if before is not None:
        share = (pressure - orbit.dynamic_pressure) / (orbit.dynamic_pressure - before.dynamic_pressure)
        share = min(share, 1.0)
        state, period = state + share * (state - before.state), period + share * (period - before.period)
    found = find_orbit(there, state, period, mirrored=orbit.symmetric)
    if found is None or found.symmetric != orbit.symmetric or abs(found.period / orbit.period - 1) > REACH:
        return None
    flow = FlowMap.of(there)
    return found if flow.norm(found.state - orbit.state) < REACH * flow.norm(orbit.state) else None


def _narrowed(plant: Plant, before: Orbit | None, low: Orbit, high: Orbit) -> tuple[Orbit, Orbit]:
    """Two orbits next to where stability changes, one on each side of it."""
    while abs(high.dynamic_pressure - low.dynamic_pressure) > RESOLUTION * abs(low.dynamic_pressure):
        middle = _stepped(plant, before, low, (low.dynamic_pressure + high.dynamic_pressure) / 2)
        if middle is None:
            break
        if middle.unstable == low.unstable:
            before, low = low, middle
        else:
            high = middle
    return low, high


def _change(low: Orbit, high: Orbit) -> Event:
    """What the multipliers say of a change of stability between two orbits."""
    more = high if high.unstable > low.unstable else low
    values = more.others if more.roots is None else np.delete(more.roots, more.trivial)
    outside = values[np.abs(values) > 1]
    value = complex(outside[np.argmin(np.abs(np.abs(outside) - 1))])
    if abs(value.imag) > abs(value) * REAL:
        kind = "Neimark-Sacker"
    elif more.roots is not None:
        kind = "fold" if value.real > 0 else "symmetry breaking"
    else:
        kind = "fold" if value.real > 0 else "period doubling"
    pressure = (low.dynamic_pressure + high.dynamic_pressure) / 2
    return Event(kind, pressure, value if more.roots is None else value**2)


def _ending(orbit: Orbit, plant: Plant, target: float) -> Event:
    """Why an orbit has no successor."""
    values = orbit.others if orbit.roots is None else np.delete(orbit.roots, orbit.trivial)
    value = complex(values[np.argmin(np.abs(values - 1))])
    if orbit.half_range < VANISHING:
        kind = "rest"
    elif abs(value - 1) > TURNING:
        kind = "lost"
    else:
        # an orbit without mirror symmetry that comes near to having it ends where it gets it
        kind = "symmetry breaking" if _nearly_symmetric(orbit, plant) else "fold"
    return Event(kind, orbit.dynamic_pressure, value if orbit.roots is None else value**2)


def _nearly_symmetric(orbit: Orbit, plant: Plant) -> bool:
    """Whether an orbit that lacks mirror symmetry is near one that has it."""
    if orbit.symmetric:
        return False
    flow = FlowMap.of(plant.at_pressure(orbit.dynamic_pressure))
    half = flow.moved(orbit.state, orbit.period / 2)
    return flow.norm(half + orbit.state) < NEAR * flow.norm(orbit.state)
