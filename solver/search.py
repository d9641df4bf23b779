"""Owns the placement search: a generator of progress that a command line, a page and a test share."""

from __future__ import annotations

from bisect import insort
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from typing import Literal

from solver.design import Design
from solver.errors import DesignError
from solver.layouts import Layout, allowed, most_elements, units_of
from solver.mesh import Mesh
from solver.methods import Proposals, by_nfcg, exhaustive, greedy, iterative, reference_layout
from solver.plant import Plant
from solver.ranking import Ranking, ranking_of
from solver.score import LINEAR, Score, linear_part, merit
from solver.scoring import bare_flutter, hopeless, known_within, pressures_of, scored, screened
from solver.task import Task, task_for
from solver.workers import Serial

# Layouts measured at once at most. What a bound may be taken from is what stood so many places before in the queue, so
# that it does not depend on how many workers there are, or which of them is faster.
AHEAD = 16
Stage = Literal["screen", "run"]


@dataclass(frozen=True)
class Progress:
    """Where a search stands."""

    score: Score | None
    """What is new: a layout's figures, by linear theory or in full."""
    known: int
    """How many layouts the method has named so far; all of them, for one that names them at once."""
    evaluated: int
    """How many of them were looked at."""
    measured: int
    """How many of those were run in full, or until a bound cut them short."""
    best: Score | None
    """The best layout so far."""
    stage: Stage
    """What is being done: looking at layouts by linear theory, or running the promising ones."""
    done: int
    """How many layouts that was done to, of those that the method has named last."""
    due: int
    """How many it is to be done to at most."""
    complete: bool
    """Whether this is the end."""
    _ranking: Callable[[], Ranking]

    @property
    def ranking(self) -> Ranking:
        """All that was found until the moment at which it is asked for, in order."""
        return self._ranking()


def search(
    design: Design, task: Task, executor: Executor | None = None, known: Iterable[Score] = ()
) -> Iterator[Progress]:
    """Look for the layouts that serve a task best. To end early, stop asking: then nothing more is begun.

    The result depends on design and task alone: neither on the executor nor on how many workers it has, nor on whether
    a search was interrupted and went on with what was known.

    Args:
        design: what is searched on; its own patches count for nothing but their number, where the task names none.
        task: what is looked for, and how.
        executor: where layouts are measured, of any kind that concurrent.futures describes; here, if none is given.
        known: scores of an earlier search for the same task on the same design.

    Yields:
        Progress, whenever a layout was looked at or measured, and at the end.

    Raises:
        DesignError: task and design do not go together, or nothing flutters.
        ControlError: no controller of the design's kind can be made at all.
    """
    task = task_for(task, design)
    _refuse(design, task)
    run = _Run(design, task, executor or Serial(), {score.elements: score for score in known})
    return run.progress()


def proposals(design: Design, task: Task) -> Proposals:
    """The generator of a task's method."""
    match task.method:
        case "nfcg":
            return by_nfcg(design, task)
        case "iterative":
            return iterative(design, task)
        case "greedy":
            return greedy(design, task)
        case "exhaustive":
            return exhaustive(design, task)
        case "genetic":
            from solver.genetic import genetic  # here, because it brings its library with it

            return genetic(design, task)


def _refuse(design: Design, task: Task) -> None:
    """Refuse a search that could find nothing."""
    units = units_of(Mesh.of(design.panel, design.mesh), task)
    if not units or most_elements(design, task) < min(len(unit) for unit in units):
        raise DesignError("no layout is allowed: give more elements or mass, keep fewer out, or drop the symmetry")
    bare = Plant.of(design.with_elements(()))
    found = bare.critical
    highest = pressures_of(design, task)[0]
    if found is None or highest <= found[0]:
        value = "there is none" if found is None else f"it is {found[0]:.1f}"
        raise DesignError(f"λ = {highest:g} is below λ_cr of the bare panel ({value}): there is no flutter to suppress")
    if bare_flutter(design.with_elements(()), highest) is None and not bare.at_pressure(highest).flutters:
        raise DesignError(f"the bare panel has no limit cycle at λ = {highest:g}: there is nothing to suppress")


class _Run:
    """The book of one search: what it knows, in which order, and what a layout has to beat."""

    def __init__(self, design: Design, task: Task, executor: Executor, before: dict[Layout, Score]) -> None:
        self._design, self._task, self._executor = design, task, executor
        self._before = before
        self._scores: dict[Layout, Score] = {}
        self._named: set[Layout] = set()
        self._measured: set[Layout] = set()
        self._top: list[float] = []  # costs of the best, in order
        self._by_number: dict[int, float] = {}  # the least cost of so many elements
        self._best: Score | None = None
        self._reference: Layout | None = None
        self._futures: set[Future[Score]] = set()
        self._stage: Stage = "screen"
        self._done = self._due = 0

    def progress(self) -> Iterator[Progress]:
        """Run the method to its end."""
        method = proposals(self._design, self._task)
        batch = next(method, None)
        highest = reference_layout(self._design, self._task) if self._task.elements is not None else ()
        foreign = self._task.method == "exhaustive" and highest not in (batch or ())
        if allowed(self._design, self._task, highest) and not foreign:
            self._reference = highest
            yield from self._generation([highest])
        while batch is not None:
            wanted = [one for one in dict.fromkeys(batch) if allowed(self._design, self._task, one)]
            if self._task.evaluations is not None:
                room = self._task.evaluations - len(self._named)
                beyond = set([one for one in wanted if one not in self._named][room:])
                wanted = [one for one in wanted if one not in beyond]
            yield from self._generation(wanted)
            if self._task.evaluations is not None and len(self._named) >= self._task.evaluations:
                break
            try:
                batch = method.send([self._scores[one] for one in wanted])
            except StopIteration:
                batch = None
        yield self._told(None, complete=True)

    def ranking(self, complete: bool) -> Ranking:
        """All scores in order; before the end, with what was known and has not come up yet."""
        scores = dict(self._scores)
        if not complete:
            for one, before in self._before.items():
                if one not in scores or (scores[one].state in LINEAR and before.state not in LINEAR):
                    scores[one] = before
        reference = scores.get(self._reference) if self._reference else None
        return ranking_of(self._design, self._task, list(scores.values()), reference, complete)

    def _generation(self, layouts: Sequence[Layout]) -> Iterator[Progress]:
        """Screen layouts, then measure the promising ones, the most promising first."""
        self._named.update(layouts)
        fresh = [one for one in layouts if one not in self._scores]
        yield from self._pass("screen", fresh, self._screen, lambda score: None)
        open_ones = [self._scores[one] for one in layouts if self._scores[one].state == "screened"]
        open_ones.sort(key=lambda score: merit(self._task, score))
        yield from self._pass("run", [score.elements for score in open_ones], self._measure, self._settle)

    def _pass(
        self,
        stage: Stage,
        layouts: Sequence[Layout],
        begin: Callable[[Layout], Future[Score] | Score | None],
        settle: Callable[[Score], None],
    ) -> Iterator[Progress]:
        """Do something to every layout, several at once; scores are settled in the order of the layouts."""
        queue: deque[Future[Score] | Score] = deque()
        self._stage, self._done, self._due = stage, 0, len(layouts)
        for one in layouts:
            if len(queue) == AHEAD:
                yield from self._next(queue, settle)
            begun = begin(one)
            if begun is None:
                self._done += 1
                continue
            queue.append(begun)
            if isinstance(begun, Future):
                self._futures.add(begun)
            else:
                yield self._noted(begun)
            yield from self._arrived()
        while queue:
            yield from self._next(queue, settle)

    def _next(self, queue: deque[Future[Score] | Score], settle: Callable[[Score], None]) -> Iterator[Progress]:
        """Wait for the first in a queue, telling of others that come before it, and settle it."""
        first = queue.popleft()
        while isinstance(first, Future) and first in self._futures:
            wait(self._futures, return_when=FIRST_COMPLETED)
            yield from self._arrived()
        settle(first.result() if isinstance(first, Future) else first)

    def _arrived(self) -> Iterator[Progress]:
        """Tell of what is done."""
        for future in [future for future in self._futures if future.done()]:
            self._futures.discard(future)
            yield self._noted(future.result())

    def _noted(self, score: Score) -> Progress:
        self._scores[score.elements] = score
        self._done += 1
        return self._told(score)

    def _told(self, score: Score | None, complete: bool = False) -> Progress:
        best = self._best
        if score is not None and score.ranked and (best is None or self._order(score) < self._order(best)):
            self._best = score
        if score is not None and score.state not in LINEAR:
            self._measured.add(score.elements)
        return Progress(
            score=score,
            known=len(self._named),
            evaluated=len(self._scores),
            measured=len(self._measured),
            best=self._best,
            stage=self._stage,
            done=self._done,
            due=self._due,
            complete=complete,
            _ranking=lambda: self.ranking(complete),
        )

    def _order(self, score: Score) -> tuple[float, ...]:
        return merit(self._task, score)

    def _screen(self, one: Layout) -> Future[Score] | Score:
        before = self._before.get(one)
        if before is not None:
            return linear_part(before)
        return self._executor.submit(screened, self._design, self._task, one)

    def _measure(self, one: Layout) -> Future[Score] | Score | None:
        screen, bound = self._scores[one], self._bound(len(one))
        if hopeless(self._task, screen, bound):
            return None
        before = self._before.get(one)
        if before is not None and before.state not in LINEAR and self._serves(before, bound):
            return known_within(self._task, before, bound)
        return self._executor.submit(scored, self._design, self._task, screen, bound)

    def _serves(self, before: Score, bound: float | None) -> bool:
        """Whether an earlier score tells enough: one that was cut short does only below its bound."""
        return before.bound is None or (bound is not None and self._task.cost(before.bound) >= self._task.cost(bound))

    def _settle(self, score: Score) -> None:
        """Let a score count for what later ones have to beat."""
        if score.value is None:
            return
        cost, count = self._task.cost(score.value), len(score.elements)
        insort(self._top, cost)
        self._by_number[count] = min(cost, self._by_number.get(count, cost))

    def _bound(self, count: int) -> float | None:
        """What the objective of so many elements has to beat to be among the best, or on the front; None for nothing.

        On the front is what no layout of as many elements, or fewer, beats.
        """
        top = self._task.top
        if len(self._top) < top:
            return None
        lighter = [cost for number, cost in self._by_number.items() if number <= count]
        if not lighter:
            return None
        return self._task.cost(max(self._top[top - 1], min(lighter)))
