"""The search itself, on scores that cost nothing: bounds that lose nothing, one result however it runs, going on."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import get_args

import msgspec
import pytest
from fakescores import FEW, coarse, drawn, found, measuring, rough
from hypothesis import given
from hypothesis import strategies as st

from solver import DesignError
from solver.layouts import Layout
from solver.score import LINEAR, Score
from solver.search import search
from solver.task import Method, Objective, Task

METHODS: tuple[Method, ...] = get_args(Method)
DESIGN = coarse(6, 4)


def task_of(method: Method, seed: int = 1, top: int = 3, evaluations: int | None = 90) -> Task:
    return Task(method, elements=None if method == "exhaustive" else 8, seed=seed, top=top, evaluations=evaluations)


class Backwards(Executor):
    """Does the last that it was given first, and nothing before somebody waits; as a cluster in no hurry might."""

    def __init__(self) -> None:
        self._inner = ThreadPoolExecutor(1)
        self._waiting: list[tuple[Future[Score], object, tuple[object, ...]]] = []

    def submit(self, fn: object, /, *args: object, **kwargs: object) -> Future[Score]:  # pyright: ignore[reportIncompatibleMethodOverride] - of scores alone
        future: Future[Score] = Future()
        self._waiting.append((future, fn, args))
        self._inner.submit(self._last)
        return future

    def _last(self) -> None:
        future, fn, args = self._waiting.pop()
        if future.set_running_or_notify_cancel():
            assert callable(fn)
            score = fn(*args)
            assert isinstance(score, Score)
            future.set_result(score)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._inner.shutdown(wait, cancel_futures=cancel_futures)


@contextmanager
def executors() -> Iterator[list[Executor | None]]:
    """In this thread, one other, three that overtake each other, and one that does everything backwards."""
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(3) as three, Backwards() as backwards:
        yield [None, one, three, backwards]


@FEW
@given(salt=st.integers(0, 10**6), top=st.integers(1, 14))
def test_bounds_lose_neither_the_best_nor_the_front(salt: int, top: int) -> None:
    """Against the same space measured in full; many values are equal, and estimates as far off as they may be."""
    whole, bounded = (Task("exhaustive", shapes="both", top=number) for number in (100_000, top))
    with measuring(rough(salt), mixed=True) as asked:
        _, full = found(search(DESIGN, whole))
        every, asked.runs[:] = len(asked.runs), []
        _, ranking = found(search(DESIGN, bounded))
    assert ranking.ranked[:top] == full.ranked[:top]
    assert ranking.front == full.front
    assert ranking.passive == full.passive
    assert ranking.evaluated == full.evaluated
    assert len(asked.runs) <= every
    # what a method reads is the order, which no bound may change for the best
    assert not {s.elements for s in ranking.ranked} - {s.elements for s in full.ranked}


def test_bounds_spare_most_of_the_work() -> None:
    """Where times differ by much and linear estimates are right; AHEAD = 16 may run before one is settled."""
    with measuring(lambda one: 0.05 * (1 + min(one))) as asked:
        _, ranking = found(search(coarse(8, 4), Task("exhaustive", top=1)))
    assert len(asked.screens) == 72
    assert len(asked.runs) < 36
    assert ranking.best is not None
    assert ranking.best.value == 0.05


def test_the_ranking_is_in_order_and_the_front_is_what_none_beats() -> None:
    with measuring(rough("front"), mixed=True):
        scores, ranking = found(search(DESIGN, Task("exhaustive", shapes="both", top=1000)))
    values = [(s.value or 0.0, len(s.elements), s.elements) for s in ranking.ranked]
    assert values == sorted(values)
    assert {s.elements for s in ranking.ranked} == {e for e, s in scores.items() if s.value is not None}
    assert {s.state for s in ranking.ranked} == {"suppressed", "in part"}
    front = {
        s.elements
        for s in ranking.ranked
        if not any(
            other[0] <= (s.value or 0.0) and other[1] <= len(s.elements) and other[:2] != (s.value, len(s.elements))
            for other in values
        )
    }
    # of equals in both, the one that comes first
    assert {s.elements for s in ranking.front} <= front
    assert {(s.value, len(s.elements)) for s in ranking.front} == {
        (s.value, len(s.elements)) for s in ranking.ranked if s.elements in front
    }
    assert [len(s.elements) for s in ranking.front] == sorted({len(s.elements) for s in ranking.front})


def test_passive_layouts_are_apart_and_never_ranked() -> None:
    with measuring(rough("passive"), mixed=True) as asked:
        scores, ranking = found(search(DESIGN, Task("exhaustive", shapes="both")))
    passive = {e for e, s in scores.items() if s.state == "passive"}
    assert len(passive) > 2
    assert {s.elements for s in ranking.passive} == passive
    assert [len(s.elements) for s in ranking.passive] == sorted(len(e) for e in passive)
    assert not passive & {s.elements for s in (*ranking.ranked, *ranking.front)}
    assert not passive & set(asked.runs)


@pytest.mark.parametrize("method", METHODS)
def test_the_result_is_one_on_any_executor(method: Method) -> None:
    with executors() as every, measuring(rough(method), mixed=True, delay=2e-3):
        results = [found(search(DESIGN, task_of(method), executor)) for executor in every]
    scores, ranking = results[0]
    assert len(scores) > 3
    for others, another in results[1:]:
        assert others == scores
        assert another == ranking


@FEW
@given(data=st.data())
def test_a_search_that_was_interrupted_goes_on_from_what_it_had(data: st.DataObject) -> None:
    """Whenever, and wherever it ran; nothing that is known is computed again, and the end is the same."""
    method = data.draw(st.sampled_from(METHODS))
    task, worth = task_of(method, data.draw(st.integers(0, 9)), data.draw(st.integers(1, 12))), rough(method)
    with measuring(worth, mixed=True) as asked, executors() as every:
        scores, ranking = found(search(DESIGN, task))
        whole = list(asked.screens), list(asked.runs)
        first, second = (data.draw(st.sampled_from(every)) for _ in range(2))
        count = data.draw(st.integers(0, len(whole[0]) + len(whole[1])))
        known: dict[Layout, Score] = {}
        begun = search(DESIGN, task, first)
        for step in islice(begun, count):
            if step.score is not None:
                known[step.score.elements] = step.score
        begun.close()  # type: ignore[attr-defined]
        asked.screens.clear()
        asked.runs.clear()
        others, another = found(search(DESIGN, task, second, known.values()))
    assert others == scores
    assert another == ranking
    assert not set(asked.screens) & set(known)
    assert not set(asked.runs) & {e for e, s in known.items() if s.state not in LINEAR}
    assert set(asked.screens) | set(known) == set(whole[0])


@pytest.mark.parametrize("method", METHODS)
def test_known_to_its_end_it_computes_nothing(method: Method) -> None:
    with measuring(rough(method), mixed=True) as asked:
        scores, ranking = found(search(DESIGN, task_of(method)))
        asked.screens.clear()
        asked.runs.clear()
        again = found(search(DESIGN, task_of(method), known=scores.values()))
    assert again == (scores, ranking)
    assert asked.screens == asked.runs == []


@pytest.mark.parametrize("method", METHODS)
def test_a_search_that_ran_out_of_evaluations_goes_on_to_the_same_best(method: Method) -> None:
    """With a larger number later it comes to what one that had it from the start finds, though not by the same runs."""
    with measuring(rough(method), mixed=True) as asked:
        few, _ = found(search(DESIGN, task_of(method, evaluations=20)))
        assert len(few) <= 20
        _, ranking = found(search(DESIGN, task_of(method)))
        asked.screens.clear()
        _, another = found(search(DESIGN, task_of(method), known=few.values()))
    assert not set(asked.screens) & set(few)
    assert another.ranked[:3] == ranking.ranked[:3]
    assert another.front == ranking.front
    assert another.evaluated == ranking.evaluated


def test_progress_counts_up_to_the_end() -> None:
    with measuring(rough("progress"), mixed=True) as asked:
        steps = list(search(DESIGN, task_of("iterative")))
    assert [s.complete for s in steps] == [False] * (len(steps) - 1) + [True]
    assert steps[-1].score is None
    for name in ("known", "evaluated", "measured"):
        counts = [getattr(step, name) for step in steps]
        assert counts == sorted(counts)
    assert (steps[-1].evaluated, steps[-1].measured) == (len(asked.screens), len(asked.runs))
    assert all(s.evaluated <= s.known and s.measured <= s.evaluated and s.done <= s.due for s in steps)
    best: Score | None = None
    for step in steps:
        if step.best is not None and best is not None and step.best != best:
            assert (step.best.value or 0.0) <= (best.value or 0.0)
        best = step.best
    assert best == steps[-1].ranking.best


def test_what_was_not_asked_for_is_not_begun() -> None:
    """A search does nothing ahead of whoever reads it, but for what is under way; closed, it ends."""
    with measuring() as asked, ThreadPoolExecutor(1) as executor:
        begun = search(coarse(8, 4), Task("exhaustive"), executor)
        next(begun)
        begun.close()  # type: ignore[attr-defined]
    assert len(asked.screens) <= 17  # AHEAD, and the one that was told
    assert asked.runs == []


def test_an_error_of_a_layout_ends_the_search_with_it() -> None:
    with measuring(lambda one: 1 / (len(one) - 4)), pytest.raises(ZeroDivisionError):
        found(search(DESIGN, Task("exhaustive")))


@pytest.mark.parametrize(("objective", "better"), [("robust", min), ("seed", min), ("energy", min), ("reach", max)])
def test_the_best_is_the_largest_of_reach_and_the_least_of_all_else(objective: Objective, better: object) -> None:
    with measuring(lambda one: 800 + drawn(one)):
        _, ranking = found(search(DESIGN, Task("exhaustive", objective=objective, top=1000)))
    values = [score.value for score in ranking.ranked]
    assert ranking.best is not None
    assert callable(better)
    assert ranking.best.value == better(values)
    assert values == sorted(values, key=lambda value: ranking.task.cost(value or 0.0))


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (Task(), "needs the most elements"),
        (Task(elements=1), "no layout is allowed"),
        (Task(elements=4, keep_out=tuple(range(24))), "no layout is allowed"),
        (Task(elements=4, mass=1e-6), "no layout is allowed"),
        (Task(elements=4, keep_out=(24,)), "keep_out = 24: the mesh has elements 0 to 23"),
        (Task(objective="range", pressures=(100.0, 400.0), elements=4), "there is no flutter to suppress"),
    ],
)
def test_what_can_find_nothing_is_refused_before_anything_is_computed(task: Task, said: str) -> None:
    with measuring() as asked, pytest.raises(DesignError, match=said):
        found(search(DESIGN, task))
    assert asked.screens == []


def test_a_design_that_nothing_drives_or_that_does_not_flutter_is_refused() -> None:
    off = msgspec.structs.replace(DESIGN, control=msgspec.structs.replace(DESIGN.control, kind="off"))
    short = msgspec.structs.replace(DESIGN, run=msgspec.structs.replace(DESIGN.run, control_on=0.5))
    calm = DESIGN.with_dynamic_pressure(300.0)
    for design, said in ((off, "control.kind = off"), (short, "no time for control"), (calm, "λ_cr of the bare panel")):
        with pytest.raises(DesignError, match=said):
            found(search(design, Task(elements=4)))
