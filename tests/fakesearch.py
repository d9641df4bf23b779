"""Searches that measure nothing, for tests of what runs, shows and ends them; another process imports them by name."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from flutterviz.jobs import Job
from solver import Design, DesignError, load_design
from solver.ranking import ranking_of
from solver.score import Score
from solver.search import Progress
from solver.task import Task
from solver.workers import local_workers

DESIGN = load_design("seed-840")


def score(place: int, value: float | None = None, count: int = 6) -> Score:
    """A layout of so many elements from a place on, that damps in so many seconds, or is passive."""
    elements = tuple(range(place, place + count))
    return Score(
        elements=elements,
        channels=1,
        mass=0.01 * count,
        state="passive" if value is None else "suppressed",
        value=value,
        robust_damping_time_s=value,
        damping_time_s=None if value is None else 0.9 * value,
    )


def progress(
    scores: list[Score], known: int, complete: bool, design: Design = DESIGN, task: Task | None = None
) -> Progress:
    """The progress of a search that has found some scores."""
    ranking = ranking_of(design, task or Task(elements=6), scores, score(18, 0.1021), complete)
    return Progress(
        score=scores[-1],
        known=known,
        evaluated=ranking.evaluated,
        measured=ranking.measured,
        best=ranking.best,
        stage="run",
        done=len(scores),
        due=known,
        complete=complete,
        _ranking=lambda: ranking,
    )


def quick(design: Design, task: Task) -> Iterator[Progress]:
    """Twelve layouts, each better than the last, one of them passive and some with fewer elements; a moment each."""
    scores = []
    for k in range(12):
        time.sleep(0.02)
        scores.append(score(5 * k, None if k == 3 else 0.12 - 0.005 * k, count=4 if k % 3 else 6))
        yield progress(scores, 12, k == 11, design, task)


def slow(design: Design, task: Task) -> Iterator[Progress]:
    """One that takes half a minute, and finds better layouts now and then."""
    scores = []
    for k in range(60):
        time.sleep(0.5)
        scores.append(score((7 * k) % 120, 0.13 - 0.002 * k if k % 5 else None, count=3 + k % 10))
        yield progress(scores, 60, k == 59, design, task)


def endless(design: Design, task: Task) -> Iterator[Progress]:
    """A first layout, and then others without end."""
    scores = [score(0, 0.2)]
    while True:
        yield progress(scores, len(scores), False, design, task)
        time.sleep(0.05)
        scores.append(score(len(scores) % 100, 0.3))


def chatty(design: Design, task: Task) -> Iterator[Progress]:
    """Two hundred times as much as a pipe holds, if all of it were told."""
    scores = [score(k % 130, 0.1 + 1e-4 * k) for k in range(200)]
    for k in range(2000):
        yield progress(scores, 2000, k == 1999, design, task)


def with_helper(design: Design, task: Task) -> Iterator[Progress]:
    """A worker of its own beside it, which nobody has told to end; says its process id as the number of the known."""
    helper = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    while True:
        yield progress([score(0, 0.2)], helper.pid, False, design, task)
        time.sleep(0.05)


def pooled(design: Design, task: Task) -> Iterator[Progress]:
    """Two workers at work, as where there are processors to spare; says the process id of one as the number known."""
    with local_workers(2) as pool:
        pid = pool.submit(os.getpid).result()
        under_way = [pool.submit(time.sleep, 600) for _ in range(4)]
        while not any(future.done() for future in under_way):
            yield progress([score(0, 0.2)], pid, False, design, task)
            time.sleep(0.05)


def stubborn(design: Design, task: Task) -> Iterator[Progress]:
    """One that will not be told to end."""
    yield progress([score(0, 0.2)], 1, False, design, task)
    while True:
        try:
            time.sleep(600)
        except SystemExit:
            continue


def refused(design: Design, task: Task) -> Iterator[Progress]:
    """One that a user can mend."""
    raise DesignError("control.kind = off: a search needs a controller")
    yield


def marked_up(design: Design, task: Task) -> Iterator[Progress]:
    """One whose complaint is no text for a page that runs scripts."""
    raise ArithmeticError('<b onload="no">')
    yield


def broken(design: Design, task: Task) -> Iterator[Progress]:
    """One with a fault of its own, after a while."""
    yield progress([score(0, 0.2)], 1, False, design, task)
    raise ArithmeticError("no such\nnumber")


def page_that_dies(note: Path) -> None:
    """Start a search with a helper, write down both process ids, and go on until killed."""
    job = Job(with_helper)
    job.start(DESIGN, Task(elements=6))
    while True:
        job.follow()
        if job.found is not None and job._process is not None:
            note.write_text(f"{job._process.pid} {job.found.known} {os.getpid()}\n")
        time.sleep(0.05)


if __name__ == "__main__":
    page_that_dies(Path(sys.argv[1]))
