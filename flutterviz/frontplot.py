"""Owns the plot of a search: objective over number of elements, the front of the two, and NFCG's layout beside."""

from __future__ import annotations

import numpy as np
import viser
import viser.uplot as uplot
from numpy.typing import NDArray

from flutterviz.charts import axes, columns, dots, empty, scales
from flutterviz.found import Found
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
        self._words = server.gui.add_html(f'<div style="{SMALL}">{WAITING}</div>')
        self._plot = server.gui.add_uplot(
            empty(4),
            (
                uplot.Series(label="elements"),
                dots("ranked", OTHERS, 5),
                dots("front", FRONT, 7, 1.5),
                dots("NFCG's", REFERENCE, 11, hollow=True),
                dots("best", BEST, 12, hollow=True),
            ),
            title=EMPTY,
            scales=scales((0.0, 10.0), (0.0, 1.08)),
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
            self._plot.data = empty(4)
            return
        groups = [_places(scores) for scores in _points_of(found)]
        x, y = np.concatenate(groups).T
        if not len(x):
            return
        self._plot.data = columns(groups)
        room = ROOM * (y.max() - y.min()) or ROOM * abs(float(y.max())) or 1.0
        right = max(float(x.max()) + 1.0, 4.0)
        self._plot.scales = scales((0.0, right), (float(y.min()) - room, float(y.max()) + room))
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


def _axes() -> tuple[uplot.Axis, ...]:
    """Axes with whole numbers of elements."""
    across, up = axes()
    across["incrs"] = (1.0, 2.0, 5.0, 10.0)
    up["size"] = 52  # seconds to the millisecond
    return across, up
