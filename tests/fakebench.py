"""Owns parts of a benchmark that measure nothing; as a module, the command with one part that never ends.

`python -m fakebench FILE WORDS…` makes the file once it is measuring what never ends.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from flutterviz import cli
from flutterviz.bench import run
from flutterviz.bench.figure import Baseline, Figure, Part

FIGURES = [
    Figure("a | thing", 20.0, "ms", (19.0, 2345.6), 25.0, "at most", Baseline("done slowly", 80.0), note="of 3"),
    Figure("a pace", 40.0, "/s", (30.0, 50.0), 50.0, "at least", Baseline("done slowly", 10.0), note="of 3"),
    Figure("a number", 1.5, "-", (1.5, 1.5)),
    Figure("a gap", math.nan, "kB", (math.nan, math.nan), 5.0, note="no browser"),
]


def good(quick: bool) -> list[Figure]:
    """All that can be measured."""
    return FIGURES[:1] if quick else FIGURES[:3]


def with_a_gap(quick: bool) -> list[Figure]:
    """One of two figures."""
    return FIGURES[2:]


def broken(quick: bool) -> list[Figure]:
    """None: it fails."""
    raise ModuleNotFoundError("No module\nnamed 'there'")


def broken_halfway(quick: bool) -> Iterator[Figure]:
    """One figure, and then it fails."""
    yield FIGURES[0]
    raise ArithmeticError


def interrupted(quick: bool) -> list[Figure]:
    """None: Ctrl-C comes first."""
    raise KeyboardInterrupt


def endless(quick: bool) -> list[Figure]:
    """None, ever."""
    Path(sys.argv[1]).touch()
    time.sleep(600)
    return []


if __name__ == "__main__":
    run.PARTS = (Part("rebuild", "good", good), Part("start", "endless", endless))
    sys.exit(cli.run(sys.argv[2:]))
