"""Scores that cost nothing, for tests of the search itself: what a layout is worth follows from its elements alone.

Another process imports them by name.
"""

from __future__ import annotations

import importlib
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache

import msgspec
import pytest
from hypothesis import HealthCheck, Phase, settings

from solver import Design, MeshSize, Patches, Reduction, Run, load_design
from solver.layouts import Layout
from solver.mesh import Mesh
from solver.piezo import channels
from solver.ranking import Ranking
from solver.score import Score
from solver.scoring import known_within
from solver.search import Progress
from solver.task import Task

Worth = Callable[[Layout], float]
FEW = settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.generate],  # to shrink a failure would take minutes
)


@lru_cache
def coarse(nx: int = 8, ny: int = 4, pressure: float = 840.0, wiring: str = "connected") -> Design:
    """The seed's panel on a coarse mesh without patches, in few modes, with a short run."""
    design = load_design("seed-840").with_dynamic_pressure(pressure)
    patches = msgspec.convert({"elements": (), "channels": wiring}, Patches)
    return msgspec.structs.replace(
        design,
        mesh=MeshSize(nx, ny),
        patches=patches,
        reduction=Reduction("patched", 8),
        run=Run(control_on=0.1, duration=0.5),
    )


def drawn(what: object) -> float:
    """A number from 0 to 1 that only looks random."""
    return zlib.crc32(repr(what).encode()) / 2**32


def plain(elements: Layout) -> float:
    """The fewest and the lowest ids, as a damping time."""
    return 0.1 + 1e-3 * sum(elements) / len(elements) + 1e-4 * len(elements)


def rough(salt: object) -> Worth:
    """Damping times without any order in them, many of them equal."""
    return lambda elements: round(0.1 + 0.4 * drawn((salt, elements)), 2)


@dataclass
class Measured:
    """What was asked for."""

    screens: list[Layout] = field(default_factory=list)
    """Layouts screened."""
    runs: list[Layout] = field(default_factory=list)
    """Layouts measured, to their end or until a bound."""


@contextmanager
def measuring(worth: Worth = plain, mixed: bool = False, delay: float = 0.0) -> Iterator[Measured]:
    """Let a search in this process measure nothing.

    Args:
        worth: damping time of a layout.
        mixed: whether some layouts are passive, unstable and so on, and estimates of damping times are far off.
        delay: longest time that a layout takes [s].
    """
    asked = Measured()

    def screened(design: Design, task: Task, elements: Layout) -> Score:
        asked.screens.append(elements)
        time.sleep(delay * drawn(("screen", elements)))
        return fake_screen(design, elements, worth, mixed)

    def scored(design: Design, task: Task, screen: Score, bound: float | None) -> Score:
        asked.runs.append(screen.elements)
        time.sleep(delay * drawn(("run", screen.elements)))
        return fake_score(task, screen, bound, worth, mixed)

    searching = importlib.import_module("solver.search")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(searching, "screened", screened)
        patch.setattr(searching, "scored", scored)
        yield asked


def fake_screen(design: Design, elements: Layout, worth: Worth, mixed: bool) -> Score:
    """Linear figures."""
    chance = drawn(("state", elements)) if mixed else 1.0
    state = "passive" if chance < 0.1 else "unstable" if chance < 0.2 else "screened"
    # as far from the measured time as a search may take it to be, and farther above it
    off = 0.3 + 1.65 * drawn(("estimate", elements)) if mixed else 1.0
    return Score(
        elements=elements,
        channels=len(channels(design.with_elements(elements))),
        mass=float(len(elements)),
        state=state,
        estimate=off * worth(elements) if state == "screened" else None,
        lambda_cr=900.0 if state == "passive" else 700.0,
        closed_loop_growth_per_s=None if state == "passive" else 1.0 if state == "unstable" else -1.0,
    )


def fake_score(task: Task, screen: Score, bound: float | None, worth: Worth, mixed: bool) -> Score:
    """Full figures, or as many as a bound lets."""
    value = worth(screen.elements)
    if mixed and drawn(("run", screen.elements)) < 0.1:
        return known_within(task, msgspec.structs.replace(screen, state="not suppressed"), bound)
    if bound is not None and value > bound:
        return msgspec.structs.replace(screen, state="beyond", bound=bound)
    state = "in part" if mixed and drawn(("part", screen.elements)) < 0.1 else "suppressed"
    return msgspec.structs.replace(screen, state=state, value=value, robust_damping_time_s=value)


def found(steps: Iterable[Progress]) -> tuple[dict[Layout, Score], Ranking]:
    """What a search knows of every layout in the end, and its ranking."""
    scores: dict[Layout, Score] = {}
    last: Progress | None = None
    for last in steps:
        if last.score is not None:
            scores[last.score.elements] = last.score
    assert last is not None
    assert last.complete
    return scores, last.ranking


def mirrored(design: Design, elements: Layout) -> bool:
    """Whether a layout is symmetric about y = b/2."""
    return Mesh.of(design.panel, design.mesh).mirror_image(elements) == elements
