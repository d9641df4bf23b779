"""Owns what the page is told of a search: an excerpt of its progress, light enough for several times a second."""

from __future__ import annotations

from dataclasses import dataclass

from solver.score import Score
from solver.search import Progress, Stage
from solver.task import Task

PASSIVE_TOLD = 3


@dataclass(frozen=True)
class Found:
    """What a search has found so far."""

    task: Task
    """What it looks for, with what the design fills in."""
    top: tuple[Score, ...]
    """The best layouts, as many as the task asks for."""
    front: tuple[Score, ...]
    """Those that none beats in both objective and number of elements, the fewest elements first."""
    passive: tuple[Score, ...]
    """The lightest of the layouts that end the flutter without control."""
    passive_count: int
    """How many of those there are [-]."""
    reference: Score | None
    """What the elements of highest NFCG give."""
    evaluated: int
    """Layouts looked at [-]."""
    measured: int
    """Layouts run in full, or until a bound cut them short [-]."""
    known: int
    """Layouts that the method has named so far [-]."""
    stage: Stage
    """What is being done: looking at layouts by linear theory, or running the promising ones."""
    done: int
    """How many layouts that was done to, of those that the method has named last [-]."""
    due: int
    """How many it is to be done to at most [-]."""
    complete: bool
    """Whether the search came to its end."""
    elapsed: float
    """Since the job began, its imports left out [s]."""
    in_stage: float
    """Since the present stage began [s]."""


def found_in(progress: Progress, elapsed: float, in_stage: float) -> Found:
    """What is told of the progress of a search."""
    ranking = progress.ranking
    return Found(
        task=ranking.task,
        top=ranking.ranked[: ranking.task.top],
        front=ranking.front,
        passive=ranking.passive[:PASSIVE_TOLD],
        passive_count=len(ranking.passive),
        reference=ranking.reference,
        evaluated=progress.evaluated,
        measured=progress.measured,
        known=progress.known,
        stage=progress.stage,
        done=progress.done,
        due=progress.due,
        complete=progress.complete,
        elapsed=elapsed,
        in_stage=in_stage,
    )
