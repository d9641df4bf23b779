"""Owns the live plots: w at the 0.75 a point, modal amplitudes and control voltages over simulated time."""

from __future__ import annotations

import numpy as np
import viser
import viser.uplot as uplot
from numpy.typing import NDArray

from flutterviz.charts import axes, scales
from flutterviz.history import CHANNELS_KEPT, History

POINTS = 450  # on a line; more than a docked panel has pixels
MODES_SHOWN = 5
COLOURS = ("#4c9be8", "#ff9f40", "#5cb85c", "#d65db1", "#9675de", "#40bfbf")
LIMIT_COLOUR = "#d64541"
HEIGHT = 156


class Plots:
    """Three plots in a tab of a docked panel."""

    def __init__(self, server: viser.ViserServer, limit: float) -> None:
        """Add the plots where the caller has opened a tab; limit is the drive's largest voltage [V]."""
        self._limit = limit
        self._shown: tuple[int, ...] = ()
        nothing = np.array([0.0, 1e-3])
        blank = np.full(2, np.nan)
        self._probe = server.gui.add_uplot(
            (nothing, blank),
            (uplot.Series(label="t"), _line("w/h", COLOURS[0])),
            title="w / h at 0.75 a, over time [ms]",
            scales=scales((0.0, 1.0), (-1.0, 1.0)),
            axes=axes(),
            legend=uplot.Legend(show=False),
            height=HEIGHT,
        )
        self._modes = server.gui.add_uplot(
            (nothing, *[blank] * MODES_SHOWN),
            (uplot.Series(label="t"), *(_line(f"mode {k + 1}", COLOURS[k]) for k in range(MODES_SHOWN))),
            title="modal amplitudes / h, largest five",
            scales=scales((0.0, 1.0), (-1.0, 1.0)),
            axes=axes(),
            legend=uplot.Legend(show=True, live=False),
            height=HEIGHT + 10,
        )
        self._volts = server.gui.add_uplot(
            (nothing, *[blank] * (CHANNELS_KEPT + 2)),
            (
                uplot.Series(label="t"),
                *(_line(f"channel {k + 1}", COLOURS[k]) for k in range(CHANNELS_KEPT)),
                _line("limit", LIMIT_COLOUR, 1.0),
                _line("limit", LIMIT_COLOUR, 1.0),
            ),
            title=self._volts_title(limit),
            scales=scales((0.0, 1.0), (-1.15 * limit, 1.15 * limit)),
            axes=axes(),
            legend=uplot.Legend(show=False),
            height=HEIGHT,
        )

    @staticmethod
    def _volts_title(limit: float) -> str:
        return f"control voltage [V], limit ±{limit:g}"

    def show(self, history: History, span: float, limit: float) -> None:
        """Draw the last `span` seconds of simulated time, and the drive's limit [V]."""
        if len(history) < 2:
            return
        rows = history.since(history.times[-1] - span).thinned(POINTS)
        if len(rows) < 2:
            return
        ms = 1e3 * rows.times
        start = max(ms[-1] - 1e3 * span, 0.0)  # the first moments fill the plot from the left
        window = (start, start + 1e3 * span)
        self._probe.data = _data(ms, rows.probe)
        self._probe.scales = scales(window, _symmetric(rows.probe, 0.1))
        self._choose_modes(rows)
        unused = [np.full(len(ms), np.nan)] * (MODES_SHOWN - len(self._shown))
        self._modes.data = _data(ms, *(rows.modal[:, k] for k in self._shown), *unused)
        self._modes.scales = scales(window, _symmetric(rows.modal, 0.1))
        ends = np.full(len(ms), limit)
        self._volts.data = _data(ms, *rows.volts.T, ends, -ends)
        self._volts.scales = scales(window, (-1.15 * limit, 1.15 * limit))
        if limit != self._limit:
            self._limit = limit
            self._volts.title = self._volts_title(limit)

    def forget_modes(self) -> None:
        """Choose anew which modes are shown; to be called when the basis has changed."""
        self._shown = ()

    def _choose_modes(self, rows: History) -> None:
        """Keep to the modes that were largest at first, so that colours do not change places while one looks."""
        count = min(MODES_SHOWN, rows.modal.shape[1])
        if len(self._shown) != count or max(self._shown, default=0) >= rows.modal.shape[1]:
            largest = np.argsort(-np.abs(rows.modal).max(axis=0))[:count]
            self._shown = tuple(sorted(int(k) for k in largest))
            names = (_line(f"{k + 1}", colour) for k, colour in zip(self._shown, COLOURS, strict=False))
            spare = (_line("", colour) for colour in COLOURS[count:MODES_SHOWN])
            self._modes.series = (uplot.Series(label="mode"), *names, *spare)
        self._shown = self._shown[:count]


def _data(*columns: NDArray[np.floating]) -> tuple[NDArray[np.float64], ...]:
    """Columns as uPlot takes them: each contiguous and of its own."""
    return tuple(np.array(column, dtype=np.float64) for column in columns)


def _line(label: str, colour: str, width: float = 1.5) -> uplot.Series:
    return uplot.Series(label=label, stroke=colour, width=width, points={"show": False})


def _symmetric(values: np.ndarray, least: float) -> tuple[float, float]:
    """A symmetric range about the values, in steps of a half-decade so that it seldom moves."""
    top = max(float(np.nanmax(np.abs(values), initial=0.0)), least)
    step = 10.0 ** np.floor(np.log10(top))
    top = next(step * m for m in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0) if step * m >= top * 0.999)
    return -1.1 * top, 1.1 * top  # room for the outermost tick's text
