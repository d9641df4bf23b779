"""Owns one figure of the benchmark: what was measured, what is asked of it, and the baseline timed beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

PartName = Literal["rebuild", "integration", "search", "stream", "start"]


@dataclass(frozen=True)
class Baseline:
    """What a figure is measured against, in the same run."""

    name: str
    """What it is, in a few words."""
    value: float
    """Its median [the figure's unit]."""


@dataclass(frozen=True)
class Figure:
    """One measured figure."""

    name: str
    """What was measured, as `rebuild 24 x 6, 12 symmetric modes`."""
    value: float
    """Median of the measurements [unit]; NaN where it could not be measured, and the note says why."""
    unit: str
    """As ms, x (times), /s, % of a core, kB."""
    spread: tuple[float, float]
    """Lowest and highest of the measurements [unit]."""
    target: float | None = None
    """What is asked of the value [unit]; None where it is only told."""
    sense: Literal["at most", "at least"] = "at most"
    """Which way the target is to be missed by nothing."""
    baseline: Baseline | None = None
    """What was timed beside it."""
    note: str = ""
    """What else is to be known, as how many were measured."""

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None where there is none."""
        if self.target is None:
            return None
        if not math.isfinite(self.value):
            return False
        return self.value <= self.target if self.sense == "at most" else self.value >= self.target

    @property
    def ratio(self) -> float | None:
        """How many times better than the baseline: less where little is good, more where much is; None without one, and
        for a number of no unit, as an exponent, of which a multiple says nothing.
        """
        if self.baseline is None or self.unit == "-" or not self.value or not self.baseline.value:
            return None
        ratio = self.baseline.value / self.value
        return ratio if self.sense == "at most" else 1 / ratio


@dataclass(frozen=True)
class Part:
    """A part of the benchmark: what it measures, and the function that does."""

    name: PartName
    """As on the command line."""
    about: str
    """What it measures, for the progress line."""
    measure: Callable[[bool], Iterable[Figure]]
    """Measures all of its figures, one after another where they are not a list; True for a quick look, with fewer
    repeats and a wider spread."""
