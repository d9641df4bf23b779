"""Owns the page's placement search: its task as it is set, its job, and what stands of its result."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import msgspec

from flutterviz import commands as do
from flutterviz.found import Found
from flutterviz.jobs import Job
from flutterviz.searchwords import layout_words, result_words
from flutterviz.session import Session
from solver import Design
from solver.ranking import design_with
from solver.score import Score
from solver.task import Task

USUAL_ELEMENTS = 6  # where the design has none, as the paper
MOST_ELEMENTS = 24

Phase = Literal["idle", "running", "finished", "cancelled", "failed"]


@dataclass(frozen=True)
class SetTask:
    """Set a field of the task."""

    field: Literal["method", "objective", "elements", "symmetric"]
    """Which, as in a search's task."""
    value: str | int | bool
    """To what."""


@dataclass(frozen=True)
class StartSearch:
    """Search on the design as it is now, in place of a search under way for something else."""


@dataclass(frozen=True)
class CancelSearch:
    """End the search under way; what it has found stays."""


@dataclass(frozen=True)
class ClearSearch:
    """Forget what was found."""


@dataclass(frozen=True)
class LoadFound:
    """Load the design of a layout as it was searched."""

    score: Score
    """The layout."""


SearchWish = SetTask | StartSearch | CancelSearch | ClearSearch | LoadFound
"""What a user asks of the search."""


class Finder:
    """The search as the loop sees it; nothing in it waits, but `close`."""

    def __init__(self, design: Design, job: Job) -> None:
        """Begin with a task that fits a design."""
        self.task = Task(elements=min(len(design.patches.elements), MOST_ELEMENTS) or USUAL_ELEMENTS)
        self.design: Design | None = None  # what was searched on last
        self.phase: Phase = "idle"
        self._asked = self.task
        self._begun = self._ended = 0.0
        self._job = job
        self._best: Score | None = None
        self._marks: tuple[int, ...] = ()

    @property
    def found(self) -> Found | None:
        """What the last search has found, of it what there is so far."""
        return self._job.found if self.phase != "idle" else None

    @property
    def seconds(self) -> float:
        """How long the last search has taken, from when it was asked for [s]."""
        return (time.monotonic() if self.phase == "running" else self._ended) - self._begun

    @property
    def trouble(self) -> str:
        """Why the last search has come to nothing, or not to its end."""
        return self._job.trouble if self.phase == "failed" else ""

    def marks_on(self, design: Design) -> tuple[int, ...]:
        """Elements of the best layout so far, to be marked on the panel of a design; none on another mesh or panel."""
        own = self.design
        fits = own is not None and (own.panel, own.mesh) == (design.panel, design.mesh)
        return self._marks if fits else ()

    def design_of(self, score: Score) -> Design | None:
        """The design of a layout as it was searched; None once the search is forgotten."""
        return design_with(self.design, self._asked, score.elements) if self.design is not None else None

    def grant(self, wish: SearchWish, session: Session) -> None:
        """Do what a user asks; what is loaded is loaded by the session, which can undo it."""
        match wish:
            case SetTask(field, value):
                self.task = msgspec.structs.replace(self.task, **{field: value})
            case StartSearch():
                self._start(session)
            case CancelSearch():
                if self.phase == "running":
                    self._job.cancel()
                    self._end("cancelled")
                    session.note("search cancelled")
            case ClearSearch():
                if self.phase == "running":
                    session.note("search cancelled")
                self._job.cancel()
                self.phase, self.design, self._best, self._marks = "idle", None, None, ()
            case LoadFound(score):
                design = self.design_of(score)
                if design is not None:
                    self._marks = ()
                    session.apply(do.LoadDesign(design, f"found layout ({layout_words(score, self._asked)})"))

    def follow(self, session: Session) -> None:
        """Take in what the job tells; never waits."""
        self._job.follow()
        if self.phase != "running":
            return
        found = self._job.found
        best = found.top[0] if found is not None and found.top else None
        if best is not None and (self._best is None or best.elements != self._best.elements):
            self._best, self._marks = best, best.elements
        if not self._job.running:
            self._end("failed" if self._job.trouble else "finished")
            session.note(f"search: {self._job.trouble or result_words(found)}")

    def close(self) -> None:
        """End the search, and wait for that."""
        self._job.close()

    def _end(self, phase: Phase) -> None:
        self.phase, self._ended = phase, time.monotonic()

    def _start(self, session: Session) -> None:
        """Search; asked for twice what is under way goes on, so that a double click begins one search."""
        wanted = session.design.with_elements(())
        same = self.design is not None and self.design.with_elements(()) == wanted and self._asked == self.task
        if self.phase == "running" and same:
            return
        self.design, self._asked = session.design, self.task
        self._best, self._marks, self.phase = None, (), "running"
        self._begun = time.monotonic()
        self._job.start(self.design, self.task)
        session.note(f"search begun: {self.task.method}, at most {self.task.elements} elements")
