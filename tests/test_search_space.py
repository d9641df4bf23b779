"""The whole space of symmetric rectangles, measured here one by one, against the search with its screens and bounds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import pytest
from fakescores import coarse, found

from solver import ControlError, Loop, Plant, limit_cycle
from solver.ranking import Ranking
from solver.robust import robust_damping
from solver.score import Score, linear_part
from solver.scoring import SHORTEST, scored, screened
from solver.search import search
from solver.task import Task

Elements = tuple[int, ...]
NX, NY = 8, 4
EVERYTHING = 100_000  # places of a ranking: no layout is cut short or left out


@dataclass
class Space:
    """What plain loops find."""

    times: dict[Elements, float]
    """Worst damping time of the layouts that every phase is damped with [s]."""
    passive: set[Elements]
    """Those below their own λ_cr."""
    count: int = 0
    """How many there were."""


@lru_cache
def brute_force(pressure: float) -> Space:
    """Every rectangle symmetric about y = b/2, each run in full."""
    design, space = coarse(NX, NY, pressure), Space({}, set())
    for first in range(NX):
        for last in range(first, NX):
            for margin in range(NY // 2):  # bare rows on either side
                elements = tuple(i * NY + j for i in range(first, last + 1) for j in range(margin, NY - margin))
                space.count += 1
                plant = Plant.of(design.with_elements(elements))
                assert plant.critical is not None
                if plant.critical[0] > pressure:
                    space.passive.add(elements)
                    continue
                try:
                    loop = Loop.of(plant.symmetric())
                except ControlError:
                    continue
                robust = robust_damping(loop, limit_cycle(loop))
                if robust is not None and robust.worst is not None:
                    space.times[elements] = robust.worst
    return space


@lru_cache
def searched(pressure: float, top: int) -> tuple[dict[Elements, Score], Ranking]:
    """A search for so many; linear figures are those of the one for all, which saves their time."""
    every = {} if top == EVERYTHING else searched(pressure, EVERYTHING)[0]
    known = [linear_part(score) for score in every.values()]
    return found(search(coarse(NX, NY, pressure), Task("exhaustive", top=top), known=known))


def in_order(space: Space) -> list[Elements]:
    """The layouts by time; of equals the one with fewer elements."""
    return sorted(space.times, key=lambda elements: (space.times[elements], len(elements), elements))


def front_of(space: Space) -> set[Elements]:
    """Layouts that none with as few elements or fewer is as good as."""
    return {
        one
        for one in in_order(space)
        if not any(
            len(other) <= len(one)
            and (space.times[other], len(other), other) < (space.times[one], len(one), one)
            and space.times[other] <= space.times[one]
            for other in space.times
        )
    }


@pytest.mark.parametrize("top", [10, 3, 1])
def test_the_search_finds_what_plain_loops_find(top: int) -> None:
    space, (_, ranking) = brute_force(840.0), searched(840.0, top)
    assert ranking.evaluated == space.count == NX * (NX + 1) // 2 * (NY // 2)
    assert len(space.times) >= 12
    assert [score.elements for score in ranking.ranked[:top]] == in_order(space)[:top]
    # the same runs: what differs is which of two processes adds up first, and nothing does
    assert [score.value for score in ranking.ranked] == [space.times[score.elements] for score in ranking.ranked]
    assert {score.elements for score in ranking.front} == front_of(space)
    assert {score.elements for score in ranking.passive} == space.passive


def test_measured_in_full_the_whole_ranking_is_theirs() -> None:
    space, (scores, ranking) = brute_force(840.0), searched(840.0, EVERYTHING)
    assert [score.elements for score in ranking.ranked] == in_order(space)
    assert {e: s.value for e, s in scores.items() if s.value is not None} == space.times


def test_passive_layouts_have_a_critical_pressure_above_the_design_and_no_place() -> None:
    _, ranking = searched(840.0, EVERYTHING)
    assert len(ranking.passive) > 10
    assert all(score.lambda_cr is not None and score.lambda_cr > 840.0 for score in ranking.passive)
    assert all(score.lambda_cr is not None and score.lambda_cr < 840.0 for score in ranking.ranked)
    assert not {s.elements for s in ranking.passive} & {s.elements for s in (*ranking.ranked, *ranking.front)}
    counts = [len(score.elements) for score in ranking.passive]
    assert counts == sorted(counts)


@pytest.mark.parametrize("pressure", [840.0, 1000.0])
def test_no_layout_is_damped_sooner_than_the_search_takes_for_possible(pressure: float) -> None:
    scores, _ = searched(pressure, EVERYTHING)
    ratios = {e: s.value / s.estimate for e, s in scores.items() if s.value is not None and s.estimate}
    assert len(ratios) >= 12
    assert min(ratios.values()) >= SHORTEST, min(ratios, key=lambda e: ratios[e])


@pytest.mark.parametrize("elements", [(9, 10, 13, 14, 17, 18, 21, 22, 25, 26), tuple(range(32, 48))])
def test_nor_is_the_one_that_comes_closest_far_above(elements: Elements) -> None:
    """At λ = 1200 on 12 x 4 the limit cycle of these is smaller than that of the bare panel leads to expect."""
    design, task = coarse(12, 4, 1200.0), Task("exhaustive")
    score = scored(design, task, screened(design, task, elements), None)
    assert score.value is not None
    assert score.estimate is not None
    assert SHORTEST * score.estimate <= score.value


def test_screens_and_bounds_lose_nothing_at_another_pressure() -> None:
    _, full = searched(1000.0, EVERYTHING)
    _, ranking = searched(1000.0, 3)
    assert ranking.ranked[:3] == full.ranked[:3]
    assert ranking.front == full.front
    assert ranking.passive == full.passive
    assert ranking.measured <= full.measured


def test_iterative_does_no_worse_than_nfcg_on_the_panel_itself() -> None:
    design = coarse(6, 4)
    _, by_nfcg = found(search(design, Task("nfcg", elements=4)))
    _, ranking = found(search(design, Task("iterative", elements=4, seed=1, evaluations=10)))
    assert ranking.reference == by_nfcg.reference
    assert ranking.reference is not None
    values = [score.value for score in by_nfcg.ranked if len(score.elements) == 4]
    best = ranking.best.value if ranking.best else None
    assert values
    assert best is not None
    assert all(value is not None and best <= value for value in (*values, ranking.reference.value))
