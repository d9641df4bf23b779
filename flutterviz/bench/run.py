"""Owns the command `bench`: its parts one after another, progress while they run, and what Ctrl-C does."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence

import msgspec
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from flutterviz.bench.figure import Figure, Part, PartName
from flutterviz.bench.machine import Machine
from flutterviz.bench.table import markdown, notes, terminal_table, told
from flutterviz.tables import ERR, OUT, warn

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


def _rebuild(quick: bool) -> Iterable[Figure]:
    from flutterviz.bench.rebuild import measure

    return measure(quick)


def _integration(quick: bool) -> Iterable[Figure]:
    from flutterviz.bench.integration import measure

    return measure(quick)


def _search(quick: bool) -> Iterable[Figure]:
    from flutterviz.bench.placement import measure

    return measure(quick)


def _stream(quick: bool) -> Iterable[Figure]:
    from flutterviz.bench.stream import measure

    return measure(quick)


def _start(quick: bool) -> Iterable[Figure]:
    from flutterviz.bench.startup import measure

    return measure(quick)


PARTS = (
    Part("rebuild", "toggling a patch on three meshes", _rebuild),
    Part("integration", "running the closed loop", _integration),
    Part("search", "evaluating placements", _search),
    Part("stream", "drawing the page", _stream),
    Part("start", "starting up", _start),
)


def run_bench(names: Sequence[PartName], quick: bool, as_markdown: bool, as_json: bool) -> int:
    """Measure, and show the figures; gives the exit code: 0 all measured, 1 some could not be, 130 interrupted.

    A target that is missed is told, and no failure: it says as much about the machine.

    Args:
        names: parts to measure; all if empty.
        quick: fewer repeats.
        as_markdown: print a Markdown table.
        as_json: print one JSON object, and nothing else on stdout.
    """
    machine = Machine.present()
    warn(machine.warnings)
    figures: list[Figure] = []
    chosen = [part for part in PARTS if not names or part.name in names]
    interrupted = False
    try:
        for figure in _measured(chosen, quick):
            figures.append(figure)  # noqa: PERF402 - what there is when Ctrl-C comes is kept
    except KeyboardInterrupt:
        interrupted = True
        ERR.print(f"interrupted{': what was measured so far follows' if figures else ' before anything was measured'}")
    if as_json:
        sys.stdout.write(msgspec.json.encode(told(machine, figures)).decode() + "\n")
    elif as_markdown:
        sys.stdout.write(markdown(machine, figures))
    else:
        OUT.print(str(machine), markup=False, highlight=False)
        if figures:
            OUT.print(terminal_table(figures))
            OUT.print(notes(figures), markup=False, highlight=False)
    if interrupted:
        return INTERRUPTED
    return 0 if all(math.isfinite(figure.value) for figure in figures) else 1


def _measured(parts: Sequence[Part], quick: bool) -> Iterator[Figure]:
    """The figures of each part; of one that fails, a figure that says why."""
    columns = (TextColumn("{task.description}"), BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn())
    # once a second: who draws the line takes turns with what is measured; where there is no terminal, not at all
    with Progress(*columns, console=ERR, transient=True, refresh_per_second=1, disable=not ERR.is_terminal) as bars:
        bar = bars.add_task("", total=len(parts))
        for part in parts:
            bars.update(bar, description=f"{part.name}: {part.about}", refresh=True)
            try:
                yield from part.measure(quick)
            except Exception as error:  # whatever it is, the other parts are worth measuring
                reason = " ".join(str(error).split()) or type(error).__name__
                line = f"flutterviz: bench: {part.name} could not be measured: {reason}"
                ERR.print(line, style="red", markup=False, emoji=False, highlight=False, soft_wrap=True)
                yield Figure(part.name, math.nan, "", (math.nan, math.nan), note=reason)
            bars.advance(bar)
