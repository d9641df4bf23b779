"""Points laid out for a chart: every one is drawn once, in the colour of its group."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flutterviz.charts import columns, empty

NUMBERS = st.floats(-1e6, 1e6)
GROUPS = st.lists(st.lists(st.tuples(NUMBERS, NUMBERS), max_size=6), min_size=1, max_size=5)


@settings(deadline=None)
@given(groups=GROUPS)
def test_every_point_is_in_its_group_s_column_and_in_no_other(groups: list[list[tuple[float, float]]]) -> None:
    x, *ys = columns([np.array(group, dtype=np.float64).reshape(-1, 2) for group in groups])
    assert len(ys) == len(groups)
    assert np.all(np.diff(x) >= 0)  # as uPlot wants it
    assert np.all(np.sum(np.isfinite(ys), axis=0) == 1)
    for y, group in zip(ys, groups, strict=True):
        drawn = np.isfinite(y)
        assert sorted(zip(x[drawn], y[drawn], strict=True)) == sorted(group)
        assert y.flags.c_contiguous
        assert y.base is None


def test_before_there_are_points_none_is_drawn() -> None:
    x, *ys = empty(3)
    assert np.all(np.diff(x) > 0)
    assert len(ys) == 3
    assert np.isnan(ys).all()
    assert ys[0] is not ys[1]
