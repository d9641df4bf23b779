"""Sweeps: rows upwards and back, cycles that coexist, any numeric field as the parameter, errors as one line."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import (
    Design,
    DesignError,
    Loop,
    Plant,
    Stream,
    SweepRow,
    buckling_factor,
    limit_cycle,
    load_design,
    set_field,
    sweep,
)
from solver.design import Load, MeshSize, Patches

BARE = load_design("seed-bare")
FAMILY = BARE.with_reduction("family", 4)
PATCHED = load_design("seed-840").with_reduction("patched", 8)
COARSE = msgspec.structs.replace(BARE.with_reduction("patched", 8), mesh=MeshSize(8, 4))


def run(design: Design, name: str, values: Sequence[float]) -> list[SweepRow]:
    rows = list(sweep(design, name, values))
    # up through all values, then down from the last but one
    assert [row.value for row in rows] == [*values, *list(values)[-2::-1]]
    assert [row.direction for row in rows] == ["up"] * len(values) + ["down"] * (len(values) - 1)
    return rows


def pairs(rows: list[SweepRow]) -> list[tuple[SweepRow, SweepRow]]:
    """Rows upwards and downwards at the same value."""
    down = {row.value: row for row in rows if row.direction == "down"}
    return [(row, down[row.value]) for row in rows if row.direction == "up" and row.value in down]


# --- over dynamic pressure --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def coexisting() -> list[SweepRow]:
    """Four modes about the range in which two cycles coexist, 970 to 1300, entered from below.

    Steps of 3 %: in far greater ones the motion falls now into one cycle's basin, now into the other's.
    """
    return run(
        FAMILY, "flow.dynamic_pressure", [900.0, 925.0, 950.0, 975.0, 1000.0, 1025.0, 1050.0, 1100.0, 1150.0, 1400.0]
    )


def test_up_and_down_part_where_two_cycles_coexist(coexisting: list[SweepRow]) -> None:
    apart = []
    for up, down in pairs(coexisting):
        assert up.lco_amplitude_over_h is not None
        assert down.lco_amplitude_over_h is not None
        for row in (up, down):
            assert row.lco_converged
            assert row.floquet is not None
            assert row.floquet < 1
        assert up.growth_per_s == pytest.approx(down.growth_per_s, rel=1e-9)  # the flat panel has no memory: rounding
        if abs(up.lco_amplitude_over_h / down.lco_amplitude_over_h - 1) > 0.05:
            apart.append(up.value)
            assert up.lco_frequency_hz is not None
            assert down.lco_frequency_hz is not None
            # the cycle that is not alike in up and down is the larger and slower one, and is carried from below
            assert up.lco_amplitude_over_h > down.lco_amplitude_over_h
            assert up.lco_frequency_hz < 0.98 * down.lco_frequency_hz
        else:
            # one cycle, reached from either side to what time integration counts as converged, 1e-3
            assert up.lco_amplitude_over_h == pytest.approx(down.lco_amplitude_over_h, rel=1e-3)
    assert apart == [975.0, 1000.0, 1025.0, 1050.0, 1100.0, 1150.0]


def test_the_first_row_is_the_cycle_of_the_seed_protocol(coexisting: list[SweepRow]) -> None:
    cycle = limit_cycle(Loop.of(Plant.of(FAMILY.with_dynamic_pressure(900.0)).symmetric()))
    assert cycle is not None
    # the same computation, but for rounding, which moves the samples on the cycle from which its peak is read
    assert coexisting[0].lco_amplitude_over_h == pytest.approx(cycle.amplitude, rel=1e-4)
    assert coexisting[0].lco_frequency_hz == pytest.approx(cycle.frequency, rel=1e-4)


def test_through_the_onset_of_flutter() -> None:
    rows = run(BARE.with_reduction("patched", 8), "flow.dynamic-pressure", [400.0, 520.0, 600.0, 700.0])
    for row in rows:
        assert row.dynamic_pressure == row.value
        assert row.lambda_cr == pytest.approx(554.0, rel=1e-2)  # eight plain modes are a poor basis
        assert (row.growth_per_s > 0) == (row.value > 554.1)
        assert not row.passive
        assert row.damping_time_s is None  # there are no patches
        if row.value < 554:
            # no cycle, and so nothing that is said of one
            assert row.lco_amplitude_over_h is None
            assert row.lco_frequency_hz is None
            assert row.floquet is None
            assert not row.lco_converged
    amplitudes = [row.lco_amplitude_over_h for row in rows if row.lco_amplitude_over_h and row.direction == "up"]
    assert len(amplitudes) == 2
    assert amplitudes[0] < amplitudes[1]


def test_a_patched_panel_from_passive_to_controlled() -> None:
    rows = run(PATCHED, "flow.dynamic_pressure", [530.0, 700.0])
    passive, driven, _ = rows
    assert passive.passive
    assert passive.damping_time_s is None
    assert not driven.passive
    assert driven.closed_loop_growth_per_s is not None
    assert driven.closed_loop_growth_per_s < 0 < driven.growth_per_s
    assert driven.damping_time_s is not None
    assert 0 < driven.damping_time_s < PATCHED.run.duration - PATCHED.run.control_on


def test_one_value_is_one_row() -> None:
    (row,) = run(COARSE, "flow.dynamic_pressure", [700.0])
    assert row.lco_converged


def test_rows_come_as_they_are_computed() -> None:
    rows = sweep(COARSE, "flow.dynamic_pressure", [600.0 + k for k in range(500)])
    assert next(rows).value == 600.0  # five hundred would take minutes


# --- over anything else -----------------------------------------------------------------------------------------------


def test_over_the_thickness_of_the_patches() -> None:
    design = msgspec.structs.replace(PATCHED, control=msgspec.structs.replace(PATCHED.control, voltage_limit=100.0))
    rows = run(design, "patches.thickness", [0.0002, 0.0003, 0.0004])
    for row in rows:
        changed = msgspec.structs.replace(design, patches=msgspec.structs.replace(design.patches, thickness=row.value))
        found = Plant.of(changed).critical
        assert found is not None
        assert row.lambda_cr == pytest.approx(found[0], rel=1e-9)  # the same computation
    assert len({row.lambda_cr for row in rows}) == 3


def test_a_thickness_that_the_drive_would_depole_is_refused() -> None:
    with pytest.raises(DesignError, match=r"patches\.thickness = 0\.0003: .*loses its poling") as caught:
        list(sweep(PATCHED, "patches.thickness", [0.0003, 0.0004]))
    assert "\n" not in str(caught.value)


def test_over_temperature_through_buckling() -> None:
    warm = COARSE.with_dynamic_pressure(120.0)
    rows = run(warm, "load.temperature", [0.0, 0.5, 1.5])
    factor = buckling_factor(Plant.of(warm.with_load(Load(temperature=1.0))).model.plate)
    assert factor is not None
    assert 0.5 < factor < 1.5  # K: 0.976 by the closed form
    # at so small a λ the flat panel is unstable beyond its buckling temperature, and rests in a deflection: no cycle
    assert [row.growth_per_s > 0 for row in rows] == [False, False, True, False, False]
    assert all(row.lco_amplitude_over_h is None for row in rows)
    lambdas = [row.lambda_cr for row in rows[:3]]
    assert None not in lambdas
    assert np.all(np.diff(np.array(lambdas, dtype=float)) < 0)  # heat presses


def test_over_mach_number() -> None:
    rows = run(COARSE, "flow.mach", [2.0, 2.5])
    for row in rows:
        stream = Stream.of(msgspec.structs.replace(COARSE, flow=msgspec.structs.replace(COARSE.flow, mach=row.value)))
        assert row.dynamic_pressure == stream.dynamic_pressure
    # λ = γ p M² a³/(√(M² - 1) D): nothing but M changes, to rounding
    exact = (2.5**2 / np.sqrt(2.5**2 - 1)) / (4 / np.sqrt(3))
    assert rows[1].dynamic_pressure / rows[0].dynamic_pressure == pytest.approx(exact, rel=1e-12)


def test_over_the_mesh() -> None:
    rows = run(COARSE, "mesh.nx", [8.0, 12.0])
    for up, down in pairs(rows):
        # another mesh holds no motion to carry over, and so the way back is the way up
        assert up.lco_amplitude_over_h == down.lco_amplitude_over_h
    first, second = (row.lambda_cr for row in rows[:2])
    assert first is not None
    assert second == pytest.approx(first, rel=5e-3)  # eight elements are fine already: (4π/8)⁴/720 of mode (4,1)
    assert first != second


def test_over_the_number_of_modes() -> None:
    rows = run(COARSE, "reduction.modes", [8, 12])
    for row in rows:
        found = Plant.of(COARSE.with_reduction("patched", int(row.value))).critical
        assert found is not None
        assert row.lambda_cr == pytest.approx(found[0], rel=1e-9)  # the same computation


# --- fields -----------------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(
    st.sampled_from(
        [
            ("flow.dynamic_pressure", 0.0, 1e5),
            ("flow.damping", 0.0, 100.0),
            ("flow.yaw_deg", -360.0, 360.0),
            ("panel.young", 1e9, 1e12),
            ("load.temperature", -2000.0, 2000.0),
            ("control.effort_weight", 1.0, 1e3),
        ]
    ),
    st.floats(0, 1),
)
def test_a_number_is_set_and_nothing_else(field: tuple[str, float, float], share: float) -> None:
    name, low, high = field
    value = low + share * (high - low)
    part, own = name.split(".")
    changed = set_field(BARE, name, value)
    assert getattr(getattr(changed, part), own) == value
    back = msgspec.structs.replace(getattr(changed, part), **{own: getattr(getattr(BARE, part), own)})
    assert msgspec.structs.replace(changed, **{part: back}) == BARE


@pytest.mark.parametrize("name", ["mesh.nx", "mesh.ny", "reduction.modes"])
def test_whole_numbers_stay_whole(name: str) -> None:
    part, own = name.split(".")
    for given_as in (12, 12.0):
        value = getattr(getattr(set_field(BARE, name, given_as), part), own)
        assert value == 12
        assert isinstance(value, int)


def test_dashes_and_underscores_are_one() -> None:
    assert set_field(BARE, "flow.dynamic-pressure", 700.0) == set_field(BARE, "flow.dynamic_pressure", 700.0)


def test_a_whole_value_of_a_real_field() -> None:
    assert isinstance(set_field(BARE, "panel.young", 70e9).panel.young, float)


def test_mach_number_and_dynamic_pressure_replace_each_other() -> None:
    at_mach = set_field(BARE, "flow.mach", 2.0)
    assert at_mach.flow.mach == 2.0
    assert Stream.of(at_mach).dynamic_pressure == pytest.approx(717.24, rel=1e-4)  # five digits by hand
    back = set_field(at_mach, "flow.dynamic_pressure", 700.0)
    assert back.flow.mach is None
    assert Stream.of(back).dynamic_pressure == 700.0
    assert Stream.of(back).damping == Stream.of(at_mach).damping  # the flight's C_a stays, as in the explorer


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("flow.pressure", 1.0, "no such number"),
        ("stream.mach", 2.0, "no such number"),
        ("flow", 1.0, "no such number"),
        ("", 1.0, "no such number"),
        (".", 1.0, "no such number"),
        ("schema_version", 1.0, "no such number"),
        ("panel.edges", 1.0, "no such number"),
        ("control.kind", 1.0, "no such number"),
        ("patches.material", 1.0, "no such number"),
        ("panel.held", 1.0, "no such number"),
        ("flow.dynamic_pressure.x", 1.0, "no such number"),
        ("patches.elements", 3.0, "patches.elements"),
        ("panel.plies", 3.0, "panel.plies"),
        ("patches.elements.0", 3.0, "no such number"),
        ("reduction.modes", 2.5, "reduction.modes"),
        ("reduction.modes", 1.0, "reduction.modes"),
        ("reduction.modes", 1000.0, "reduction.modes"),
        ("mesh.nx", 12.5, "mesh.nx"),
        ("mesh.nx", 0.0, "mesh.nx"),
        ("mesh.nx", float("inf"), "mesh.nx"),
        ("panel.thickness", -0.001, "panel.thickness"),
        ("panel.thickness", float("nan"), "panel.thickness"),
        ("flow.mach", 0.9, "flow.mach"),
        ("flow.dynamic_pressure", float("nan"), "flow.dynamic_pressure"),
        ("run.control_on", 5.0, "run.control_on"),
    ],
)
def test_what_cannot_be_set_is_refused_in_one_line(name: str, value: float, said: str) -> None:
    with pytest.raises(DesignError) as caught:
        set_field(BARE, name, value)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bad_value_is_refused_before_anything_is_computed() -> None:
    with pytest.raises(DesignError):
        next(sweep(BARE, "flow.dynamic_pressure", [700.0, -1.0]))
    with pytest.raises(DesignError, match="patches would move"):
        sweep(msgspec.structs.replace(BARE, patches=Patches(elements=(143,))), "mesh.nx", [24.0, 8.0])


def test_all_modes_serve_no_sweep() -> None:
    with pytest.raises(DesignError, match=r"reduction\.modes = all"):
        next(sweep(BARE.with_reduction("patched", "all"), "flow.dynamic_pressure", [700.0]))
