"""Control in a running session: every setting reaches the motion, drags undo as one, and nothing raises."""

from functools import cache

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flutterviz import commands as do
from flutterviz.rig import Rig, rig_of
from flutterviz.session import DRAG, LONG, Session
from flutterviz.status import status_of
from solver import Design, Reduction, load_design

LIGHT = msgspec.structs.replace(load_design("seed-840"), reduction=Reduction("patched", 8))  # quick to build
PICTURE = 1.5e-4  # s of simulated time a picture, about a fortieth of a flutter period


@cache
def rig(design: Design) -> Rig:
    return rig_of(design)


def session_on(design: Design) -> Session:
    session = Session(design, rig(design))
    session.take_events()
    return session


def with_control(design: Design, **fields: float | str) -> Design:
    control = msgspec.to_builtins(design.control) | fields
    return design.with_control(msgspec.convert(control, type(design.control)))


def texts(session: Session) -> list[str]:
    return [event.text for event in session.take_events()]


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate", "off"])
def test_every_kind_of_controller_runs(kind: str) -> None:
    session = session_on(LIGHT)
    session.apply(do.SetControl("kind", kind))
    session.apply(do.Engage(True))
    session.settle()
    rows = session.advance(20 * session.period)
    assert rows is not None
    assert np.isfinite(session.state).all()
    assert bool(np.abs(rows.volts).max() > 0) == (kind != "off")
    assert session.rig.design.control.kind == kind


def test_a_change_of_controller_uses_the_same_modes() -> None:
    session = session_on(LIGHT)
    model = session.rig.plant.model
    session.apply(do.SetControl("state_weight", 1e5))
    session.apply(do.SetChannels("element"))
    session.settle()
    assert session.rig.plant.model is model
    assert len(session.rig.plant.channels) == 6


def test_a_dragged_field_undoes_as_one_and_is_told_when_it_ends() -> None:
    session = session_on(LIGHT)
    for value in (1e-4, 2e-4, 3e-4):
        session.apply(do.SetControl("delay", value))
    assert texts(session) == []
    session.settle()
    for _ in range(DRAG):
        session.advance(PICTURE)
    assert texts(session) == ["control.delay set to 0.0003"]
    session.apply(do.Undo())
    assert session.design == LIGHT


def test_two_sliders_are_two_changes() -> None:
    session = session_on(LIGHT)
    session.apply(do.SetControl("delay", 1e-4))
    session.apply(do.SetControl("voltage_limit", 100.0))
    session.apply(do.SetFlow(900.0))
    assert texts(session) == ["control.delay set to 0.0001", "control.voltage_limit set to 100"]
    session.apply(do.Undo())
    assert session.design == with_control(LIGHT, delay=1e-4, voltage_limit=100.0)
    session.apply(do.Undo())
    assert session.design == with_control(LIGHT, delay=1e-4)


@pytest.mark.parametrize(
    ("field", "value"),
    [("voltage_limit", 1e6), ("delay", -1.0), ("kind", "magic"), ("state_weight", float("nan")), ("rate_gain", 1e99)],
)
def test_a_setting_that_cannot_be_is_told_and_changes_nothing(field: do.ControlField, value: float | str) -> None:
    session = session_on(LIGHT)
    session.apply(do.SetControl(field, value))
    assert session.design == LIGHT
    (told,) = texts(session)
    assert told
    assert "\n" not in told


def test_a_delayed_drive_gives_nothing_before_the_delay_has_passed() -> None:
    delay = 1e-3
    session = session_on(with_control(LIGHT, delay=delay))
    session.apply(do.Engage(True))
    volts = []
    for _ in range(20):
        rows = session.advance(1e-4)
        assert rows is not None
        volts.append(np.abs(rows.volts).max())
    quiet = round(delay / 1e-4)
    assert max(volts[: quiet - 1]) == 0
    assert max(volts[quiet + 1 :]) > 0


@pytest.mark.parametrize(
    ("delay", "close"),
    [
        (0.0, 1e-4),  # Runge-Kutta's steps differ in length
        (4e-4, 1e-2),  # and the jump, when the first voltage comes through, falls within one of them: a part of a step
    ],
)
def test_pictures_of_any_length_give_the_same_motion(delay: float, close: float) -> None:
    """An estimator and a delay line go on from picture to picture as if the run were one."""
    design = with_control(LIGHT, kind="lqg", delay=delay)
    ends = []
    for pictures in (1, 40):
        session = session_on(design)
        session.apply(do.Engage(True))
        for _ in range(pictures):
            session.advance(8e-3 / pictures)
        ends.append(session.state)
    scale = np.abs(ends[0]).max()
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=close * scale)


def test_the_estimator_starts_anew_where_the_patches_change() -> None:
    session = session_on(with_control(LIGHT, kind="lqg"))
    session.advance(5 * session.period)
    assert np.abs(session.memory.own).max() > 0
    session.apply(do.TogglePatch(0))
    session.settle()
    assert not session.memory.own.any()
    session.advance(5 * session.period)
    assert np.abs(session.memory.own).max() > 0


def test_the_estimator_goes_on_where_only_the_flow_changes() -> None:
    session = session_on(with_control(LIGHT, kind="lqg"))
    session.advance(5 * session.period)
    before = session.memory.own
    session.apply(do.SetFlow(845.0))
    session.settle()
    np.testing.assert_array_equal(session.memory.own, before)


def test_what_cannot_be_reached_is_named() -> None:
    design = msgspec.structs.replace(LIGHT.with_dynamic_pressure(1300.0), reduction=Reduction("patched", 14))
    session = session_on(design)
    session.apply(do.Engage(True))
    session.advance(session.period)
    status = status_of(session)
    assert status.word == "Controlled in part"
    assert "antisymmetric about y = b/2" in status.detail


def test_a_controller_without_patches_says_so() -> None:
    session = session_on(LIGHT.with_elements(()))
    session.apply(do.Engage(True))
    session.advance(session.period)
    assert status_of(session).word == "Controller has no patches"


def test_rate_feedback_that_does_not_stabilise_is_named() -> None:
    session = session_on(with_control(LIGHT, kind="rate"))
    session.apply(do.Engage(True))
    session.advance(session.period)
    assert "under control a motion still grows" in status_of(session).detail


def test_a_drive_too_weak_is_called_so_in_the_end() -> None:
    session = session_on(with_control(LIGHT, voltage_limit=1.0))
    session.apply(do.Engage(True))
    session.advance(10 * session.period)
    assert status_of(session).word == "Controlled"
    session.advance((LONG - 9) * session.period)
    status = status_of(session)
    assert status.word == "Not suppressed"
    assert "the drive is at its limit" in status.detail


def test_a_controller_that_makes_a_stable_panel_flutter_is_called_harmful() -> None:
    session = session_on(with_control(LIGHT.with_dynamic_pressure(300.0), delay=1e-3))
    assert status_of(session).word == "Stable"
    session.apply(do.Engage(True))
    session.advance(session.period)
    status = status_of(session)
    assert status.word == "Controller does harm"
    assert status.growth > 0


def test_a_controller_that_is_off_is_called_so() -> None:
    session = session_on(with_control(LIGHT, kind="off"))
    session.apply(do.Engage(True))
    session.advance(session.period)
    assert status_of(session).word == "Controller off"


def test_patches_that_move_nothing_are_told_apart_from_a_controller_that_is_off() -> None:
    dead = msgspec.structs.replace(LIGHT, patches=msgspec.structs.replace(LIGHT.patches, d31=0.0))
    session = session_on(dead)
    session.apply(do.Engage(True))
    session.advance(session.period)
    assert status_of(session).detail == "its patches move nothing"


def test_noise_that_keeps_the_panel_moving_is_named() -> None:
    design = with_control(LIGHT.with_dynamic_pressure(600.0), kind="lqg", sensor_noise=1e-10)
    session = session_on(design)
    session.apply(do.Engage(True))
    session.advance((LONG + 30) * session.period)
    assert status_of(session).word == "Held, but not quiet"


COMMANDS = st.one_of(
    st.integers(0, 143).map(do.TogglePatch),
    st.sampled_from(["lqr", "lqg", "rate", "off"]).map(lambda kind: do.SetControl("kind", kind)),
    st.sampled_from(["energy", "identity"]).map(lambda weighting: do.SetControl("weighting", weighting)),
    st.builds(do.SetChannels, st.sampled_from(["connected", "element", "single"])),
    st.floats(2, 9).map(lambda power: do.SetControl("state_weight", 10.0**power)),
    st.floats(4, 10.5).map(lambda power: do.SetControl("observer_weight", 10.0**power)),
    st.floats(2, 6).map(lambda power: do.SetControl("rate_gain", 10.0**power)),
    st.floats(0, 2e-3).map(lambda delay: do.SetControl("delay", delay)),
    st.floats(1e-13, 1e-6).map(lambda noise: do.SetControl("sensor_noise", noise)),
    st.floats(0, 3000).map(do.SetFlow),
    st.sampled_from([do.Engage(), do.Undo(), do.Redo(), do.Reset(), do.Pluck(0.3, 0.4, 0.5), do.ClearPatches()]),
)


@settings(max_examples=12, deadline=None)
@given(st.lists(COMMANDS, min_size=3, max_size=10))
def test_nothing_that_a_user_does_raises(commands: list[do.Command]) -> None:
    session = session_on(LIGHT)
    for command in commands:
        session.apply(command)
        session.settle()
        session.advance(PICTURE)
        assert status_of(session).word
