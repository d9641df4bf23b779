"""Owns the command `search`: its options, what is kept of it while it runs, and what Ctrl-C does."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Annotated

import msgspec
import tyro

from flutterviz.arguments import DesignName, JsonFlag
from flutterviz.aside import Aside
from flutterviz.ranktable import print_ranking
from flutterviz.tables import ERR, warn
from solver import Design, Stream
from solver.ranking import Ranking
from solver.rankingfile import Journal, file_of
from solver.search import Progress as Found
from solver.search import search
from solver.task import Task, task_for
from solver.workers import workers

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM."""


@dataclass(frozen=True)
class SearchOptions:
    """Find the layouts of patches that damp the flutter best."""

    design: DesignName
    task: Annotated[Task, tyro.conf.OmitArgPrefixes] = field(default_factory=Task)
    """What is looked for, and how."""
    save: Path | None = None
    """Keep the ranking in this file (.json); a search that was interrupted goes on from there."""
    workers: int | None = None
    """Processes of this machine: one a core, unless given; 0 works in this process."""
    executor: str = "local"
    """local, or dask://HOST:PORT for the scheduler of a Dask cluster."""
    json: JsonFlag = False


def run_search(options: SearchOptions, design: Design) -> int:
    """Search, and show what was found; gives the exit code.

    Raises:
        DesignError: the task makes no sense for the design, or the file or the executor cannot be used.
        ControlError: no controller of the design's kind exists.
        OSError: the file cannot be written, or workers went away.
    """
    task = task_for(options.task, design)
    if task.symmetric and Stream.of(design).sine:
        warn(["the stream is yawed, and only layouts symmetric about y = b/2 are looked at; --no-symmetric for all"])
    with _stopped_once(), contextlib.ExitStack() as ending:
        journal = Journal(options.save, design, task) if options.save is not None else None
        if journal is not None:
            ending.callback(journal.close, None)
            if journal.known:
                ERR.print(f"going on with {len(journal.known)} layouts known from {options.save}", markup=False)
        last = _watched(options, task, design, journal)
        if last is None:
            ERR.print("interrupted before anything was found")
            return INTERRUPTED
        ranking = last.ranking
        if journal is not None:
            journal.close(ranking)
            ERR.print(f"saved {options.save}", highlight=False, markup=False)
        if options.json:
            sys.stdout.write(msgspec.json.encode(_told(ranking)).decode() + "\n")
        else:
            print_ranking(ranking)
    return 0 if ranking.complete else INTERRUPTED


@contextlib.contextmanager
def _stopped_once() -> Iterator[None]:
    """Take the first Ctrl-C or SIGTERM for the end of the search, and none after it for the end of what follows."""
    stopped = False

    def stop(number: int, frame: FrameType | None) -> None:
        # not by SIG_IGN from here: Python prints a traceback of a signal that came before it was set and is due after
        nonlocal stopped
        if not stopped:
            stopped = True
            raise KeyboardInterrupt

    before = [(number, signal.signal(number, stop)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def _watched(options: SearchOptions, task: Task, design: Design, journal: Journal | None) -> Found | None:
    """Follow a search to its end, or until it is interrupted; gives where it then stood."""
    last: Found | None = None
    try:
        from flutterviz.searchbar import bar_of, show  # here, because other commands have no use for it

        with (
            Aside[Found]() as aside,
            workers(options.executor, options.workers) as executor,
            bar_of(task, ERR) as bars,
        ):
            known = journal.known if journal is not None else ()
            steps = search(design, task, executor, known)
            # where this process does the work itself, nobody waits for a lock, and Ctrl-C need not wait for a layout
            for last in steps if options.workers == 0 else aside.steps(steps):
                if journal is not None and last.score is not None:
                    journal.add(last.score)
                show(bars, task, last, len(known))
    except KeyboardInterrupt:
        if last is not None:
            ERR.print("interrupted: what was found so far follows")
    except CancelledError:
        raise OSError(
            "the Dask scheduler went away; with --save the same command goes on from what was found"
        ) from None
    except BrokenExecutor:
        raise OSError(
            "a worker process was ended from outside, perhaps for want of memory; with --save the same command goes on "
            "from what was found, --workers 1 takes less memory"
        ) from None
    return last


def _told(ranking: Ranking) -> dict[str, object]:
    """What `--json` prints: the file without the scores of all layouts."""
    whole: dict[str, object] = msgspec.to_builtins(file_of(ranking))
    del whole["scores"]
    best = ranking.best
    return {"best": msgspec.to_builtins(best) if best else None} | whole
