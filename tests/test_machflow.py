"""A stream by Mach number and altitude: λ and C_a by hand, what is said of the theory, and what keeps C_a."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flutterviz import commands as do
from flutterviz.rig import rig_of
from flutterviz.session import Session
from solver import Design, DesignError, Flow, MeshSize, Plant, Ply, Stream, critical_pressure, load_design
from solver.aerodynamics import design_at_pressure
from solver.design import Panel
from solver.modes import ModalModel

LIGHT = msgspec.structs.replace(load_design("seed-bare").with_reduction("patched", 8), mesh=MeshSize(12, 4))


def at(mach: float | None, altitude: float = 0.0, base: Design = LIGHT, **flow: float) -> Design:
    return msgspec.structs.replace(base, flow=Flow(mach=mach, altitude=altitude, **flow))


# --- λ and C_a --------------------------------------------------------------------------------------------------------


def test_mach_two_at_sea_level() -> None:
    """By hand: ρ_a = 1.2250 kg/m³ and 340.294 m/s (ICAO), so V = 680.588 m/s and q = 283 710 Pa; β = √3.

    D = 68.95e9 · 0.00127³/(12 · 0.91) = 12.93370 N·m and a³ = 0.02831685 m³, so λ = 2 q a³/(β D) = 16067.5/22.40183 =
    717.24. μ = 1.2250 · 0.3048/(2700 · 0.00127) = 0.1088889, so C_a = (2/3)² μ/√3 = 0.02794090.
    """
    stream = Stream.of(at(2.0))
    assert stream.dynamic_pressure == pytest.approx(717.24, abs=0.01)  # to the digits above
    assert stream.damping == pytest.approx(0.0279409, abs=2e-7)


def test_mach_three_at_ten_kilometres() -> None:
    """By hand: ρ_a = 0.41351 kg/m³ and 299.532 m/s (ICAO, geometric), V = 898.596 m/s, q = 166 947 Pa; β = √8.

    λ = 2 · 166 947 · 0.02831685/(2.828427 · 12.93370) = 9454.85/36.58203 = 258.46. μ = 0.41351 · 0.3048/3.429 =
    0.0367564, and C_a = (7/8)² μ/√8 = 0.00994956.
    """
    stream = Stream.of(at(3.0, 10_000.0))
    assert stream.dynamic_pressure == pytest.approx(258.46, rel=1e-4)  # five digits of the standard's table
    assert stream.damping == pytest.approx(0.00994956, rel=1e-4)


@settings(max_examples=50, deadline=None)
@given(st.floats(1.05, 8.0), st.floats(0.0, 30_000.0), st.floats(0.1, 0.9))
def test_how_they_scale(mach: float, altitude: float, length: float) -> None:
    """λ/M² · β and C_a β ((M² - 1)/(M² - 2))² depend on the air and the panel alone: λ as a³, C_a as a."""
    panel = msgspec.structs.replace(Panel(), length=length, width=length)
    one = Stream.of(at(mach, altitude, msgspec.structs.replace(LIGHT, panel=panel)))
    two = Stream.of(at(2.0, altitude))
    beta = math.sqrt(mach**2 - 1)
    a = length / 0.3048
    assert one.dynamic_pressure == pytest.approx(
        two.dynamic_pressure * a**3 * (mach**2 / beta) / (4 / math.sqrt(3)), rel=1e-9
    )  # rounding
    share = ((mach**2 - 2) / (mach**2 - 1)) ** 2
    assert one.damping == pytest.approx(two.damping * a * share / beta * math.sqrt(3) / (4 / 9), rel=1e-9, abs=1e-15)


def test_the_two_numbers_are_not_used_beside_a_mach_number_and_that_is_said() -> None:
    plain, given = Stream.of(at(2.0)), Stream.of(at(2.0, dynamic_pressure=100.0, damping=7.0))
    assert (given.dynamic_pressure, given.damping) == (plain.dynamic_pressure, plain.damping)
    assert not plain.notes
    assert [note.split()[0] for note in given.notes] == ["flow.dynamic_pressure", "flow.damping"]


def test_a_laminate_has_its_own_reference() -> None:
    plies = (Ply("graphite-epoxy", 0, 0.0004), Ply("graphite-epoxy", 90, 0.0004))
    panel = msgspec.structs.replace(Panel(), thickness=0.0008, plies=plies)
    one = Stream.of(at(2.0, base=msgspec.structs.replace(LIGHT, panel=panel)))
    # q/β is that of the air, whatever the panel: λ D11/(2a³); the same formula twice, so rounding
    assert one.dynamic_pressure * one.slope_unit == pytest.approx(
        Stream.of(at(2.0)).dynamic_pressure * Stream.of(at(2.0)).slope_unit, rel=1e-12
    )


def test_yaw_is_kept() -> None:
    stream = Stream.of(at(2.0, yaw_deg=30.0))
    assert (stream.cosine, stream.sine) == pytest.approx((math.sqrt(3) / 2, 0.5))


# --- what is said of it -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mach", "said"),
    [(1.3, "does not hold at M = 1.3"), (1.5, "doubtful at M = 1.5"), (6.0, "doubtful at M = 6")],
)
def test_notes_at_the_ends_of_the_theory(mach: float, said: str) -> None:
    (note,) = Stream.of(at(mach)).notes
    assert said in note
    assert "\n" not in note
    assert Plant.of(at(mach)).stream.notes == (note,)


@pytest.mark.parametrize("mach", [1.6, 2.0, 5.0, None])
def test_no_notes_where_it_is_used(mach: float | None) -> None:
    assert Stream.of(at(mach)).notes == ()


@pytest.mark.parametrize("mach", [1.0, 0.8, 0.0, -2.0, 101.0, float("nan"), float("inf")])
def test_what_is_not_supersonic_is_refused(mach: float) -> None:
    with pytest.raises(DesignError, match=r"flow\.mach = .*above 1") as caught:
        Flow(mach=mach)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("altitude", [-6000.0, 90_000.0, float("nan")])
def test_an_altitude_without_air_is_refused(altitude: float) -> None:
    with pytest.raises(DesignError, match=r"flow\.altitude"):
        Flow(mach=2.0, altitude=altitude)


# --- another λ --------------------------------------------------------------------------------------------------------


def test_a_dynamic_pressure_ends_the_mach_number() -> None:
    design = at(2.0, 5000.0, yaw_deg=10.0)
    plain = design.with_dynamic_pressure(600.0)
    assert plain.flow.mach is None
    assert plain.flow.yaw_deg == 10.0
    stream = Stream.of(plain)
    assert (stream.dynamic_pressure, stream.damping) == (600.0, 0.01)
    assert stream.notes == ()


@pytest.mark.parametrize("pressure", [0.0, 300.0, 1000.0])
def test_another_pressure_keeps_the_damping(pressure: float) -> None:
    design = at(2.0, 5000.0, yaw_deg=10.0)
    stream = Stream.of(design)
    moved = design_at_pressure(design, pressure)
    assert moved.flow == Flow(pressure, stream.damping, 10.0, None, 5000.0)
    assert Stream.of(moved).damping == stream.damping
    plant = Plant.of(design)
    other = plant.at_pressure(pressure)
    assert other.model is plant.model
    assert (other.stream.dynamic_pressure, other.stream.damping) == (pressure, stream.damping)
    # g_a = √(λ C_a)
    np.testing.assert_allclose(
        other.damping, plant.damping * math.sqrt(pressure / stream.dynamic_pressure), rtol=1e-12, atol=1e-12
    )


def test_another_pressure_of_a_plain_flow() -> None:
    assert design_at_pressure(LIGHT, 600.0) == LIGHT.with_dynamic_pressure(600.0)


def test_the_critical_pressure_is_that_of_its_damping() -> None:
    """λ_cr is sought at the C_a of the flight, not along a line of flights."""
    design = at(2.0)
    plain = msgspec.structs.replace(LIGHT, flow=Flow(damping=Stream.of(design).damping))
    model = ModalModel.of(plain)
    one, other = critical_pressure(model, Stream.of(design)), critical_pressure(model, Stream.of(plain))
    assert one is not None
    assert other is not None
    assert one[0] == pytest.approx(other[0], rel=1e-9)  # the same equation


def test_faster_flight_flutters_and_slower_does_not() -> None:
    # on this panel flutter begins at λ = 554 in eight modes, between 1.9 at 4 km and 2 at sea level
    high, low = Plant.of(at(1.9, 4000.0)), Plant.of(at(2.0))
    assert high.stream.dynamic_pressure < 554 < low.stream.dynamic_pressure
    assert not high.flutters
    assert low.flutters


# --- in the explorer --------------------------------------------------------------------------------------------------


def test_a_session_keeps_the_damping_of_its_flight() -> None:
    design = at(2.0)
    damping = Stream.of(design).damping
    session = Session(design)
    assert session.rig.plant.stream.dynamic_pressure == Stream.of(design).dynamic_pressure
    before = session.state.copy()
    session.apply(do.SetFlow(600.0))
    session.apply(do.SetFlow(650.0))
    assert session.design.flow == Flow(650.0, damping, mach=None)
    session.settle()
    assert session.rig.plant.stream.damping == damping
    np.testing.assert_array_equal(session.state, before)  # a change of flow alone moves nothing
    session.apply(do.Undo())  # both were one drag
    assert session.design == design
    session.settle()
    assert session.rig.plant.stream.dynamic_pressure == Stream.of(design).dynamic_pressure


def test_the_rig_of_a_flight() -> None:
    design = at(2.0)
    first = rig_of(design)
    assert first.bare_critical is not None
    found = Plant.of(design).critical
    assert found is not None
    assert first.bare_critical == pytest.approx(found[0], rel=1e-9)  # no patches: the same panel, at the same C_a
    second = rig_of(at(2.5), first)
    assert second.plant.model is first.plant.model  # the structure does not know the flow
    assert second.surface is first.surface
    assert second.plant.stream.dynamic_pressure == Stream.of(at(2.5)).dynamic_pressure
    assert second.bare_critical != first.bare_critical  # λ_cr depends on C_a


def test_below_the_theory_it_still_runs_and_says_so() -> None:
    session = Session(at(1.3))
    assert session.rig.plant.stream.notes
    assert session.advance(0.005) is not None
