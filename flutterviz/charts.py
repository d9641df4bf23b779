"""Owns what the page's charts have in common: axes, scales, series of points, and their columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser.uplot as uplot
from numpy.typing import NDArray

Columns = tuple[NDArray[np.float64], ...]


def axes() -> tuple[uplot.Axis, uplot.Axis]:
    """Axes in a muted colour that reads on light and dark."""
    muted, faint = "#8a93a3", "#8a93a340"
    grid, ticks = uplot.Axis_Grid(stroke=faint, width=1), uplot.Axis_Ticks(stroke=faint, width=1)
    return (
        uplot.Axis(stroke=muted, grid=grid, ticks=ticks, size=28, font="11px system-ui"),
        uplot.Axis(stroke=muted, grid=grid, ticks=ticks, size=42, font="11px system-ui"),
    )


def scales(x: tuple[float, float], y: tuple[float, float]) -> dict[str, uplot.Scale]:
    """Ranges that hold still until they are set anew."""
    return {"x": uplot.Scale(time=False, auto=False, range=x), "y": uplot.Scale(auto=False, range=y)}


def dots(label: str, colour: str, size: int, line: float = 0.0, hollow: bool = False) -> uplot.Series:
    """Points of one kind, joined if the line has a width; hollow ones show what lies in them."""
    fill = "rgba(0,0,0,0)" if hollow else colour
    points: uplot.Series_Points = {"show": True, "size": size, "fill": fill, "stroke": colour, "width": 2}
    return uplot.Series(label=label, stroke=colour, width=line, points=points, spanGaps=True)


def empty(kinds: int) -> Columns:
    """What a chart of so many kinds of points holds before there are any."""
    return np.array([0.0, 1.0]), *(np.full(2, np.nan) for _ in range(kinds))


def columns(groups: Sequence[NDArray[np.floating]]) -> Columns:
    """Groups of points, (k, 2) each, as uPlot takes them: x of all in order, then each group's y, NaN at the others."""
    x = np.concatenate([group[:, 0] for group in groups])
    order = np.argsort(x, kind="stable")
    ys = np.full((len(groups), len(x)), np.nan)
    start = 0
    for y, group in zip(ys, groups, strict=True):
        y[start : start + len(group)] = group[:, 1]
        start += len(group)
    return tuple(np.array(column[order], dtype=np.float64) for column in (x, *ys))  # each of its own, for viser
