"""Owns the limit cycles that coexist: the stable orbits which several starts, and slow changes of λ, lead to."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from solver.mesh import Floats
from solver.plant import Plant
from solver.shooting import (
    SMALL,
    UNIT_SAMPLES,
    WINDOW,
    Orbit,
    free_loop,
    orbit_near,
    orbit_states,
    unit_of_time,
)
from solver.simulate import Loop, first_mode_at_rest
from solver.variational import FlowMap

PATIENCE = 40  # windows; near a bifurcation the way to a cycle is long, but Newton shortens it
ALONG = 0.03  # of its size: so near to a known orbit it is taken for that; the orbit's samples alone make half
ASIDE = 0.15  # of λ, from where cycles are carried here: the ranges of coexistence that were seen are wider
CARRIES = 5  # steps on the way, 3 % of λ each: the motion stays near its cycle


def limit_cycles(plant: Plant) -> list[Orbit]:
    """The stable cycles that coexist at the plant's λ, as far as several starts find them.

    The starts are the seed protocol's; the first mode much smaller and much larger; the second and third mode; two that
    no symmetry maps onto themselves; and the cycles found at a λ below and above, carried here as by a wind tunnel
    whose pressure changes slowly: few other starts may lead there. Each is integrated until near a cycle, which
    shooting completes.

    Returns:
        Orbits by amplitude. A cycle and its mirror image -w count as one: where an orbit is not `symmetric` there is a
        twin, which is not listed.
    """
    if not plant.flutters and not plant.damping.any():
        return []  # nothing drives or damps it: every motion is its own
    pressure = plant.stream.dynamic_pressure
    found = _collected(free_loop(plant), _starts(plant))
    for away in (1 - ASIDE, 1 + ASIDE):
        path = [free_loop(plant.at_pressure(share * pressure)) for share in np.linspace(away, 1, CARRIES + 1)]
        for orbit in _collected(path[0], _starts(plant)):
            for there in path[1:]:
                orbit = _settled(there, orbit.state)
                if orbit is None:
                    break
            found = _joined(found, orbit)
    return sorted(found, key=lambda orbit: orbit.amplitude)


def _collected(loop: Loop, starts: Iterable[Floats]) -> list[Orbit]:
    """The orbits that motions from these starts settle into, each once."""
    found: list[Orbit] = []
    for start in starts:
        found = _joined(found, _settled(loop, start, found))
    return found


def _joined(known: list[Orbit], orbit: Orbit | None) -> list[Orbit]:
    return known if orbit is None or any(_same(orbit, other) for other in known) else [*known, orbit]


def _starts(plant: Plant) -> Iterable[Floats]:
    n, height = plant.size, plant.design.panel.thickness / plant.model.peak
    own = plant.design.run.initial_amplitude
    yield first_mode_at_rest(plant, own * plant.design.panel.thickness)
    yield first_mode_at_rest(plant, 0.1 * own * plant.design.panel.thickness)
    yield first_mode_at_rest(plant, 3 * plant.design.panel.thickness)
    for parts in ((0.0, 1.0), (0.0, 0.0, 1.0), (1.5, -1.0, 0.5), (-0.5, 1.5, 0.25, 0.5)):
        state = np.zeros(2 * n)
        count = min(n, len(parts))
        state[:count] = np.array(parts[:count]) * height[:count]
        yield state


def _settled(loop: Loop, state: Floats, known: Iterable[Orbit] = ()) -> Orbit | None:
    """The stable orbit that the motion from a state comes to run along; None if it comes to rest or does not.

    A motion that runs along a known orbit already needs no shooting.
    """
    plant, weights = loop.plant, FlowMap.of(loop.plant).weights
    tracks = [(orbit, orbit_states(plant, orbit) * weights) for orbit in known]
    sample = unit_of_time(plant) / UNIT_SAMPLES
    still = SMALL * plant.design.panel.thickness / plant.model.peak
    for _ in range(PATIENCE):
        states, _ = loop.stretch(state, sample, WINDOW * UNIT_SAMPLES, engaged=False)
        if len(states) < WINDOW * UNIT_SAMPLES:
            return None
        state, q = states[-1], states[:, : plant.size]
        moved = np.any(np.abs(q) > still)
        if np.all(np.ptp(q, axis=0) < still) and (moved or not plant.flutters):  # else it may just begin to grow
            return None
        for orbit, track in tracks:
            if any(_along(sign * states[-UNIT_SAMPLES:] * weights, track) for sign in (1, -1)):
                return orbit
        orbit = orbit_near(plant, states, sample)
        if orbit:
            return orbit
    return None


def _along(motion: Floats, track: Floats) -> bool:
    """Whether a motion runs along an orbit, both (samples, 2n) balanced, for as long as the motion is given."""
    size = np.linalg.norm(track, axis=1).max()
    gaps = [np.linalg.norm(track - state, axis=1).min() for state in motion[::8]]
    return bool(max(gaps) < ALONG * size)


def _same(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits are one up to phase and mirror image, by three figures that neither changes."""
    pairs = ((one.period, other.period), (one.amplitude, other.amplitude), (one.half_range, other.half_range))
    return all(abs(a - b) <= 1e-4 * b for a, b in pairs)  # sampled peaks are good to 1e-5
