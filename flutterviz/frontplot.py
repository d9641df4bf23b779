"""Owns the plot of a search: objective over number of elements, the front of the two, and NFCG's layout beside."""

from __future__ import annotations

import numpy as np
import viser
import viser.uplot as uplot
from numpy.typing import NDArray

from flutterviz.found import Found
from flutterviz.plots import axes
from flutterviz.surface import MARK
from solver.score import Score
from solver.task import TITLES, UNITS

Floats = NDArray[np.float64]

OTHERS, FRONT, REFERENCE, BEST = "#8a93a3", "#4c9be8", "#ff9f40", "#{:02x}{:02x}{:02x}".format(*MARK)
HEIGHT = 300
ROOM = 0.08  # of the values' spread, above and below them
EMPTY = "objective over number of elements"
SMALL = "font-size:.8em;opacity:.85;padding:2px 8px"
WAITING = "The front of objective and number of elements will be here, once a search has found something."
HELP = "On the front lie the layouts that none beats in both the objective and the number of elements."


class FrontPlot:
    """A plot in a tab that the caller has opened."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Add the plot, empty."""
        self._drawn: Found | None = None
        blank = np.full(2, np.nan)
        self._words = server.gui.add_html(f'<div style="{SMALL}">{WAITING}</div>')
        self._plot = server.gui.add_uplot(
            (np.array([0.0, 1.0]), blank, blank, blank, blank),
            (
                uplot.Series(label="elements"),
                _points("ranked", OTHERS, 5, 0.0),
                _points("front", FRONT, 7, 1.5),
                _points("NFCG's", REFERENCE, 11, 0.0, hollow=True),
                _points("best", BEST, 12, 0.0, hollow=True),
            ),
            title=EMPTY,
            scales=_scales((0.0, 10.0), (0.0, 1.08)),
            axes=_axes(),
            legend=uplot.Legend(show=True, live=False),
            padding=(10, 8, 0, 0),
            height=HEIGHT,
        )

    def show(self, found: Found | None) -> None:
        """Draw what a search has found; nothing for None."""
        if _points_of(found) == _points_of(self._drawn) and (found is None) == (self._drawn is None):
            self._drawn = found
            return
        self._drawn = found
        self._words.content = f'<div style="{SMALL}">{HELP if found is not None and found.top else WAITING}</div>'
        if found is None:
            self._plot.title = EMPTY
            blank = np.full(2, np.nan)
            self._plot.data = (np.array([0.0, 1.0]), blank, blank.copy(), blank.copy(), blank.copy())
            return
        groups = [_places(scores) for scores in _points_of(found)]
        x = np.concatenate([group[:, 0] for group in groups])
        y = np.concatenate([group[:, 1] for group in groups])
        if not len(x):
            return
        order = np.argsort(x, kind="stable")
        columns = []
        for k in range(len(groups)):
            parts = [group[:, 1] if i == k else np.full(len(group), np.nan) for i, group in enumerate(groups)]
            columns.append(np.array(np.concatenate(parts)[order], dtype=np.float64))
        self._plot.data = (np.array(x[order], dtype=np.float64), *columns)
        room = ROOM * (y.max() - y.min()) or ROOM * abs(float(y.max())) or 1.0
        right = max(float(x.max()) + 1.0, 4.0)
        self._plot.scales = _scales((0.0, right), (float(y.min()) - room, float(y.max()) + room))
        self._plot.title = f"{TITLES[found.task.objective]} [{UNITS[found.task.objective]}]"


def _points_of(found: Found | None) -> tuple[tuple[Score, ...], ...]:
    """What is drawn: ranked, front, NFCG's and best."""
    if found is None:
        return ()
    reference = (found.reference,) if found.reference is not None and found.reference.value is not None else ()
    return found.top, found.front, reference, found.top[:1]


def _places(scores: tuple[Score, ...]) -> Floats:
    """(k, 2) number of elements and objective."""
    rows = [(float(len(score.elements)), score.value) for score in scores if score.value is not None]
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def _points(label: str, colour: str, size: int, line: float, hollow: bool = False) -> uplot.Series:
    """Points of one kind, joined if the line has a width; hollow ones show what lies in them."""
    fill = "rgba(0,0,0,0)" if hollow else colour
    points: uplot.Series_Points = {"show": True, "size": size, "fill": fill, "stroke": colour, "width": 2}
    return uplot.Series(label=label, stroke=colour, width=line, points=points, spanGaps=True)


def _scales(x: tuple[float, float], y: tuple[float, float]) -> dict[str, uplot.Scale]:
    return {"x": uplot.Scale(time=False, auto=False, range=x), "y": uplot.Scale(auto=False, range=y)}


def _axes() -> tuple[uplot.Axis, ...]:
    """Axes with whole numbers of elements."""
    across, up = axes()
    across["incrs"] = (1.0, 2.0, 5.0, 10.0)
    up["size"] = 52  # seconds to the millisecond
    return across, up
