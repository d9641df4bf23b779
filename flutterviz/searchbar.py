"""Owns the progress bar of a search in the terminal: where it stands, how fast it is and how long it still takes."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.progress import Task as Bar

from flutterviz.ranktable import objective_value
from solver.search import Progress as Found
from solver.task import Task

STAGES = {"screen": "looking", "run": "running"}


def bar_of(task: Task, console: Console, clock: Callable[[], float] | None = None) -> Progress:
    """The bar of a search that has not begun; clock [s] stands in for the time of the day."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(20),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.fields[best]}"),
    )
    bars = Progress(*columns, console=console, transient=True, get_time=clock)
    bars.add_task(task.method, total=None, rate="", left="", best="")
    return bars


def show(bars: Progress, task: Task, found: Found, known: int) -> None:
    """Draw where a search stands that began with so many scores known."""
    bar = bars.tasks[0]
    if bar.completed >= found.done and not found.complete:
        bars.update(bar.id, total=found.due + 1)  # a total that changes forgets the speed of the stage before
    bars.update(
        bar.id,
        total=found.due,
        completed=found.done,
        description=f"{task.method}: {found.evaluated} looked at, {found.measured} run · {STAGES[found.stage]}",
    )
    remaining = _remaining(bar, task, found, known)
    bars.update(
        bar.id,
        rate=f"{bar.speed:.1f}/s" if bar.speed else "",
        left=f"{timedelta(seconds=int(remaining))} left at most" if remaining is not None else "",
        best=f"best {objective_value(task, found.best)}" if found.best else "",
    )


def _remaining(bar: Bar, task: Task, found: Found, known: int) -> float | None:
    """How long a search still takes at most [s], where it names all layouts at once or is told how many to look at."""
    if task.method in ("nfcg", "exhaustive"):
        return bar.time_remaining
    fresh = found.evaluated - known  # what was known took no time
    if task.evaluations is None or not bar.elapsed or fresh <= 0 or found.evaluated >= task.evaluations:
        return None
    return bar.elapsed / fresh * (task.evaluations - found.evaluated)
