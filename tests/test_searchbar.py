"""The progress bar of a search: its speed is that of the stage it is in; the time left is said where it is known."""

from __future__ import annotations

import dataclasses

import fakesearch
import pytest
from rich.console import Console
from rich.progress import Progress

from flutterviz.searchbar import bar_of, show
from solver.search import Progress as Found
from solver.search import Stage
from solver.task import Task

SCORES = [fakesearch.score(0, 0.1)]


class Clock:
    """A time that passes when told."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def standing(stage: Stage, done: int, due: int, evaluated: int) -> Found:
    """A search that stands there."""
    found = fakesearch.progress(SCORES, due, False)
    return dataclasses.replace(found, stage=stage, done=done, due=due, evaluated=evaluated)


def shown(task: Task, clock: Clock) -> Progress:
    return bar_of(task, Console(quiet=True), clock)


def advance(bars: Progress, clock: Clock, task: Task, stage: Stage, steps: range, seconds: float, due: int) -> None:
    """One layout after another, so many seconds each."""
    for done in steps:
        clock.now += seconds
        show(bars, task, standing(stage, done, due, done), 0)


@pytest.mark.parametrize("due", [10, 4])
def test_a_new_stage_forgets_the_speed_of_the_one_before(due: int) -> None:
    """Also where that had as many layouts."""
    clock, task = Clock(), Task("exhaustive")
    bars = shown(task, clock)
    advance(bars, clock, task, "screen", range(1, 11), 0.1, 10)
    assert bars.tasks[0].fields["rate"] == "10.0/s"
    assert bars.tasks[0].fields["left"] == "0:00:00 left at most"
    advance(bars, clock, task, "run", range(1, 4), 2.0, due)
    assert bars.tasks[0].fields["rate"] == "0.5/s"
    assert bars.tasks[0].fields["left"] == f"0:00:{2 * (due - 3):02d} left at most"


def test_time_left_follows_from_the_evaluations_that_remain() -> None:
    clock, task = Clock(), Task("iterative", elements=6, evaluations=50)
    bars = shown(task, clock)
    clock.now = 30.0
    show(bars, task, standing("screen", 5, 8, 20), 5)
    assert bars.tasks[0].fields["left"] == "0:01:00 left at most"  # 30 s for the 15 that were not known; 30 to come


@pytest.mark.parametrize(
    ("task", "evaluated", "known"),
    [
        (Task("iterative", elements=6), 20, 0),
        (Task("greedy", elements=6, evaluations=50), 5, 5),
        (Task("genetic", elements=6, evaluations=50), 50, 0),
    ],
    ids=["no end is known", "nothing took time yet", "none remain"],
)
def test_time_left_is_not_said_where_it_is_not_known(task: Task, evaluated: int, known: int) -> None:
    clock = Clock()
    bars = shown(task, clock)
    clock.now = 30.0
    show(bars, task, standing("run", 2, 8, evaluated), known)
    assert bars.tasks[0].fields["left"] == ""
