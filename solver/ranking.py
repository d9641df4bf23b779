"""Owns the ranking of layouts: the best first, the passive ones apart, and the front of objective against number."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgspec

from solver.design import Design
from solver.score import LINEAR, Score, merit
from solver.task import Task


@dataclass(frozen=True)
class Ranking:
    """Layouts in order."""

    design: Design
    """What was searched on."""
    task: Task
    """What was looked for."""
    ranked: tuple[Score, ...]
    """Layouts with a value of the objective, the best first."""
    passive: tuple[Score, ...]
    """Layouts that end the flutter by stiffness and mass alone, the fewest elements first; never among the others."""
    front: tuple[Score, ...]
    """Of the ranked ones those that none beats in both objective and number of elements, the fewest elements first."""
    reference: Score | None
    """What the elements of highest NFCG give, as many as the task allows; None where it names no number, or does not
    allow them otherwise."""
    scores: tuple[Score, ...]
    """Every layout that was looked at, the fewest elements first."""
    complete: bool
    """Whether the search came to its end."""

    @property
    def evaluated(self) -> int:
        """How many layouts were looked at."""
        return len(self.scores)

    @property
    def measured(self) -> int:
        """How many of them were run in full, or until a bound cut them short."""
        return sum(1 for score in self.scores if score.state not in LINEAR)

    @property
    def best(self) -> Score | None:
        """The first of the ranking."""
        return self.ranked[0] if self.ranked else None

    def design_of(self, score: Score) -> Design:
        """The design of a layout as it was measured."""
        return design_with(self.design, self.task, score.elements)


def design_with(design: Design, task: Task, elements: tuple[int, ...]) -> Design:
    """A design with a layout on it, under the task's voltage limit if it has one."""
    if task.voltage_limit is not None and task.voltage_limit != design.control.voltage_limit:
        design = design.with_control(msgspec.structs.replace(design.control, voltage_limit=task.voltage_limit))
    return design.with_elements(elements)


def ranking_of(design: Design, task: Task, scores: Iterable[Score], reference: Score | None, complete: bool) -> Ranking:
    """Put scores in order."""
    scores = list(scores)
    ranked = sorted((s for s in scores if s.ranked), key=lambda s: merit(task, s))
    passive = sorted((s for s in scores if s.state == "passive"), key=lambda s: (len(s.elements), s.elements))
    front: list[Score] = []
    for score in sorted(ranked, key=lambda s: (len(s.elements), merit(task, s))):
        assert score.value is not None
        if not front or task.cost(score.value) < task.cost(front[-1].value or 0.0):
            front.append(score)
    return Ranking(
        design=design,
        task=task,
        ranked=tuple(ranked),
        passive=tuple(passive),
        front=tuple(front),
        reference=reference,
        # in an order of their own: which came first is a matter of the workers
        scores=tuple(sorted(scores, key=lambda s: (len(s.elements), s.elements))),
        complete=complete,
    )
