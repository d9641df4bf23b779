"""Owns the root-locus plot: the poles without and with the controller, and the way between them as the gain grows."""

from __future__ import annotations

import numpy as np
import viser
import viser.uplot as uplot
from numpy.typing import NDArray

from flutterviz.charts import axes, columns, dots, empty, scales
from flutterviz.outlook import Outlook
from flutterviz.rig import Rig

Complexes = NDArray[np.complexfloating]

OPEN, CLOSED, PATH, ZERO = "#4c9be8", "#d65db1", "#8a93a3", "#d64541"
MODES = 8  # whose frequencies the plot reaches up to
ROOM = 1.12  # of the outermost pole
HEIGHT = 330


class LocusPlot:
    """A plot of growth rate across and frequency up, in a tab that the caller has opened."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Add the plot."""
        self._drawn: tuple[Rig, Outlook | None] | None = None
        self._plot = server.gui.add_uplot(
            empty(4),
            (
                uplot.Series(label="poles"),
                dots("as the gain grows", PATH, 3),
                dots("open loop", OPEN, 10, hollow=True),
                dots("closed loop", CLOSED, 6),
                uplot.Series(label="stability limit", stroke=ZERO, width=1.0, points={"show": False}),
            ),
            title="frequency [Hz] over growth rate [1/s]",
            scales=scales((-1.0, 1.0), (0.0, 1.0)),
            axes=axes(),
            legend=uplot.Legend(show=True, live=False),
            height=HEIGHT,
        )

    def show(self, rig: Rig, outlook: Outlook | None) -> None:
        """Draw the poles of a rig, and the locus where it is known."""
        if self._drawn is not None and self._drawn[0] is rig and self._drawn[1] is outlook:
            return
        self._drawn = (rig, outlook)
        plant = rig.plant
        top = 1.1 * float(plant.model.omega[min(MODES, plant.size) - 1]) / (2 * np.pi)
        growing = rig.loop.poles[rig.loop.poles.real > 0]
        top = max(top, 1.1 * float(growing.imag.max(initial=0.0)) / (2 * np.pi))  # what makes it unstable is in sight
        before, after = (_upper(poles, top) for poles in (_open(rig), rig.loop.poles))
        path = _upper(outlook.locus.ravel(), top) if outlook is not None else np.zeros((0, 2))
        left = max(ROOM * min(before[:, 0].min(initial=-1.0), after[:, 0].min(initial=-1.0)), -ROOM * 4e3)
        right = ROOM * max(before[:, 0].max(initial=1.0), after[:, 0].max(initial=1.0), -0.1 * left)
        axis = np.array([[0.0, 0.0], [0.0, top]])
        self._plot.data = columns((path, before, after, axis))
        self._plot.scales = scales((left, right), (0.0, top))


def _open(rig: Rig) -> Complexes:
    return np.linalg.eigvals(rig.plant.system_matrix).astype(np.complex128)


def _upper(poles: Complexes, top: float) -> NDArray[np.floating]:
    """(k, 2) growth rate [1/s] and frequency [Hz] of one of each pair of poles, up to a frequency."""
    hertz = poles.imag / (2 * np.pi)
    kept = (hertz >= 0) & (hertz <= top)
    return np.column_stack([poles.real[kept], hertz[kept]])
