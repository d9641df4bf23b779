"""Owns fair timing: calls that are to be compared take turns, so that a busy spell of the machine meets them all."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Times:
    """Wall times of repeated calls."""

    seconds: tuple[float, ...]
    """One a call [s]."""

    @property
    def median(self) -> float:
        """Their median [s]."""
        return float(np.median(self.seconds))

    @property
    def spread(self) -> tuple[float, float]:
        """The shortest and the longest [s]."""
        return min(self.seconds), max(self.seconds)


def taking_turns(*calls: Callable[[], object], repeats: int, warm: int = 1) -> list[Times]:
    """Time calls in turns, after calling each `warm` times untimed.

    Args:
        calls: what is timed; what they return is dropped.
        repeats: timed calls of each.
        warm: calls of each before, which compile kernels and fill caches.
    """
    for call in calls:
        for _ in range(warm):
            call()
    found: list[list[float]] = [[] for _ in calls]
    for _ in range(repeats):
        for call, times in zip(calls, found, strict=True):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
    return [Times(tuple(times)) for times in found]
