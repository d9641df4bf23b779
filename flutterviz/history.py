"""Owns the recent past of a run: rows for the live plots and for judging the motion, in a buffer of fixed length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]

ROWS = 6000
CHANNELS_KEPT = 6  # voltages shown; more lines than that say nothing


class History:
    """The last rows of a run, oldest first."""

    def __init__(self, modes: int) -> None:
        """Begin empty, for a given number of modes."""
        self.modes = modes
        self._rows = self._buffer = np.empty((0, 3 + CHANNELS_KEPT + modes))
        self._end = 0  # of the rows in the buffer

    def append(self, times: Floats, probe: Floats, largest: Floats, volts: Floats, modal: Floats) -> None:
        """Add k rows: times [s], w at the probe and largest |w| over h, volts (k, channels), modal (k, modes)."""
        begin, end = self._end, self._end + len(times)
        if end > len(self._buffer):  # now and then: rows are moved once in so many, and what was given out stays
            past = self._rows
            self._buffer = np.empty((2 * ROWS + len(times), self._buffer.shape[1]))
            begin, end = len(past), len(past) + len(times)
            self._buffer[:begin] = past
        rows, shown = self._buffer[begin:end], min(CHANNELS_KEPT, volts.shape[1])
        rows[:, 0], rows[:, 1], rows[:, 2] = times, probe, largest
        rows[:, 3 : 3 + shown] = volts[:, :shown]
        rows[:, 3 + shown : 3 + CHANNELS_KEPT] = np.nan
        rows[:, 3 + CHANNELS_KEPT :] = modal
        self._end = end
        self._rows = self._buffer[max(end - ROWS, end - len(self._rows) - len(times)) : end]

    def clear(self) -> None:
        """Forget everything."""
        self._rows = self._rows[:0]

    def since(self, time: float) -> History:
        """The rows from a simulated time [s] on."""
        part = History(self.modes)
        part._rows = self._rows[np.searchsorted(self._rows[:, 0], time) :]
        return part

    def thinned(self, most: int) -> History:
        """At most so many rows, evenly chosen, the last always among them."""
        part = History(self.modes)
        stride = max(1, -(-len(self._rows) // most))
        part._rows = self._rows[::-stride][::-1]
        return part

    def __len__(self) -> int:
        """Number of rows."""
        return len(self._rows)

    @property
    def times(self) -> Floats:
        """(rows,) simulated time [s]."""
        return self._rows[:, 0]

    @property
    def probe(self) -> Floats:
        """(rows,) w at the 0.75 a point over h [-]."""
        return self._rows[:, 1]

    @property
    def largest(self) -> Floats:
        """(rows,) largest |w| on the panel over h [-]."""
        return self._rows[:, 2]

    @property
    def volts(self) -> Floats:
        """(rows, CHANNELS_KEPT) voltages [V]; NaN where there is no such channel."""
        return self._rows[:, 3 : 3 + CHANNELS_KEPT]

    @property
    def modal(self) -> Floats:
        """(rows, modes) modal deflections over h [-]."""
        return self._rows[:, 3 + CHANNELS_KEPT :]
