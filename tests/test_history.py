"""The recent past of a run: rows kept, cut, thinned."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from flutterviz.history import CHANNELS_KEPT, ROWS, History

Floats = NDArray[np.floating]


def column(times: Floats, k: int) -> Floats:
    """Values that tell their time and their column, all different."""
    return 1000.0 * (k + 1) + times


def filled(*lengths: int, modes: int = 2, channels: int = 1) -> History:
    """A history of stretches of rows a second apart, the first at 0 s."""
    history, start = History(modes), 0
    for length in lengths:
        times = np.arange(start, start + length, dtype=float)
        volts = np.column_stack([column(times, 2 + c) for c in range(channels)]) if channels else np.empty((length, 0))
        modal = np.column_stack([column(times, 50 + r) for r in range(modes)])
        history.append(times, column(times, 0), column(times, 1), volts, modal)
        start += length
    return history


@given(st.lists(st.integers(0, 3000), max_size=5))
@settings(deadline=None)
def test_the_latest_rows_are_kept_in_order(lengths: list[int]) -> None:
    history, total = filled(*lengths), sum(lengths)
    assert len(history) == min(total, ROWS)
    np.testing.assert_array_equal(history.times, np.arange(max(total - ROWS, 0), total))
    np.testing.assert_array_equal(history.probe, column(history.times, 0))
    np.testing.assert_array_equal(history.largest, column(history.times, 1))
    np.testing.assert_array_equal(history.volts[:, 0], column(history.times, 2))
    for r in range(2):
        np.testing.assert_array_equal(history.modal[:, r], column(history.times, 50 + r))


@given(st.integers(0, CHANNELS_KEPT + 4))
@settings(deadline=None)
def test_missing_channels_are_nan_and_surplus_ones_left_out(channels: int) -> None:
    volts = filled(3, channels=channels).volts
    kept = min(channels, CHANNELS_KEPT)
    assert volts.shape == (3, CHANNELS_KEPT)
    assert np.isfinite(volts[:, :kept]).all()
    assert np.isnan(volts[:, kept:]).all()


@given(st.integers(0, 50), st.floats(-10, 60))
@settings(deadline=None)
def test_since_keeps_the_rows_from_a_time_on(length: int, time: float) -> None:
    history = filled(length)
    np.testing.assert_array_equal(history.since(time).times, [t for t in range(length) if t >= time])
    assert len(history) == length  # a view of it, no cut


@given(st.integers(1, 400), st.integers(1, 60))
@settings(deadline=None)
def test_thinned_rows_are_few_even_and_end_with_the_last(length: int, most: int) -> None:
    rows = filled(length).thinned(most).times
    assert 1 <= len(rows) <= most
    assert rows[-1] == length - 1
    assert len(set(np.diff(rows))) <= 1
    if length <= most:
        assert len(rows) == length


def test_an_empty_history_can_be_asked() -> None:
    history = History(3)
    assert len(history) == len(history.since(0.0)) == len(history.thinned(10)) == 0
    assert history.modal.shape == (0, 3)


def test_clear_forgets_the_rows_and_keeps_the_modes() -> None:
    history = filled(5, modes=4)
    history.clear()
    assert len(history) == 0
    assert history.modal.shape == (0, 4)
