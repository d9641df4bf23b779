"""The session: what each command does, what cannot be, and how it is all taken back."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sessions import BARE, FULL, LIGHT, SAMPLE, STRETCH, changes, elements, run_on, session_on, texts

from flutterviz import commands as do
from flutterviz.status import status_of
from solver import Reduction, Trace

# --- undo -------------------------------------------------------------------------------------------------------------


@given(st.lists(changes, max_size=12))
@settings(deadline=None, max_examples=40)
def test_undo_goes_all_the_way_back_and_redo_all_the_way_forward(commands: list[do.Command]) -> None:
    session = session_on(LIGHT)
    for command in commands:
        session.apply(command)
    last = session.design
    steps = 0
    while session.can_undo:
        session.apply(do.Undo())
        steps += 1
    assert session.design == LIGHT
    assert steps <= len(commands)
    for _ in range(steps):
        session.apply(do.Redo())
    assert session.design == last
    assert not session.can_redo
    session.take_events()
    session.apply(do.Redo())
    assert texts(session) == ["nothing to redo"]


@given(st.lists(changes, max_size=4), elements)
@settings(deadline=None, max_examples=40)
def test_a_patch_toggled_twice_leaves_the_design_as_it_was(commands: list[do.Command], element: int) -> None:
    session = session_on(LIGHT)
    for command in commands:
        session.apply(command)
    before = session.design
    session.apply(do.TogglePatch(element))
    assert set(session.design.patches.elements) ^ set(before.patches.elements) == {element}
    session.apply(do.TogglePatch(element))
    assert session.design == before


def test_a_drag_of_the_slider_is_undone_at_once() -> None:
    session = session_on(LIGHT)
    for value in (850.0, 860.0, 870.0):
        session.apply(do.SetFlow(value))
    session.apply(do.Undo())
    assert session.design == LIGHT
    session.apply(do.Redo())
    assert session.design.flow.dynamic_pressure == 870


def test_a_new_change_ends_what_could_be_redone() -> None:
    session = session_on(LIGHT)
    session.apply(do.TogglePatch(0))
    session.apply(do.Undo())
    session.apply(do.TogglePatch(1))
    assert not session.can_redo


# --- what cannot be ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", [-1, 144, 10**9])
def test_an_element_that_is_not_there_is_told_as_an_event(element: int) -> None:
    session = session_on(LIGHT)
    session.apply(do.TogglePatch(element))
    assert session.design == LIGHT
    assert texts(session) == [f"there is no element {element}: the mesh has 0 to 143"]


@pytest.mark.parametrize("reduction", [Reduction(modes="all"), Reduction("family", 100)])
def test_a_design_that_cannot_run_is_taken_back(reduction: Reduction) -> None:
    session = session_on(LIGHT)
    session.apply(do.LoadDesign(msgspec.structs.replace(LIGHT, reduction=reduction), "impossible"))
    session.settle()
    assert session.design == LIGHT
    assert any("reduction.modes" in text for text in texts(session))
    assert session.advance(STRETCH) is not None


@pytest.mark.parametrize("at", [(0.0, 0.5, 1.0), (0.5, 1.0, 1.0), (2.0, 2.0, 1.0), (0.5, 0.5, np.inf)])
def test_a_pluck_outside_the_panel_or_without_measure_does_nothing(at: tuple[float, float, float]) -> None:
    session = session_on(LIGHT)
    before = session.state.copy()
    session.apply(do.Pluck(*at))
    np.testing.assert_array_equal(session.state, before)
    assert len(texts(session)) == 1


def test_divergence_pauses_with_an_error_and_reset_recovers() -> None:
    session = session_on(LIGHT)
    session.apply(do.Pluck(0.3, 0.4, 1e9))
    before = session.state.copy()
    assert session.advance(STRETCH) is None
    assert session.paused
    assert session.error is not None
    np.testing.assert_array_equal(session.state, before)  # the last state that is known is kept
    session.apply(do.Step())
    assert session.advance(STRETCH) is None
    session.apply(do.Pause(False))  # a user who insists meets it again
    assert session.advance(STRETCH) is None
    assert session.error is not None
    session.apply(do.Reset())
    assert session.error is None
    assert session.advance(STRETCH) is not None


# --- pause, step, reset, pluck ----------------------------------------------------------------------------------------


def test_a_paused_panel_stands_still_and_steps_one_picture_at_a_time() -> None:
    session = session_on(LIGHT)
    session.apply(do.Pause())
    assert session.advance(STRETCH) is None
    session.apply(do.Step())
    session.apply(do.Step())
    assert session.advance(STRETCH) is not None
    assert session.advance(STRETCH) is not None
    assert session.advance(STRETCH) is None
    session.apply(do.Pause())
    assert session.advance(STRETCH) is not None


def test_a_step_pauses_a_panel_in_motion() -> None:
    session = session_on(LIGHT)
    session.apply(do.Step())
    assert session.paused
    assert session.advance(STRETCH) is not None
    assert session.advance(STRETCH) is None


def test_reset_is_at_rest_in_the_first_mode_with_the_controller_off() -> None:
    session = session_on(LIGHT)
    session.apply(do.Engage())
    session.apply(do.Pause())
    session.advance(STRETCH)
    session.apply(do.Reset())
    n = session.rig.plant.size
    assert not session.engaged
    assert not session.paused
    assert not session.state[1:].any()
    # by definition of the start; the peak of the mode is sampled on the same grid as the largest |w|
    w = session.rig.coarse @ session.state[:n]
    assert np.abs(w).max() / session.rig.thickness == pytest.approx(LIGHT.run.initial_amplitude, rel=1e-12)
    assert session.design == LIGHT


@pytest.mark.parametrize("x", [1e-2, 1e-6, 6e-173])
def test_a_pluck_at_an_edge_moves_no_other_point_many_times_as_fast(x: float) -> None:
    session = session_on(LIGHT)
    before = session.state.copy()
    session.apply(do.Pluck(x, 0.34, 5.0))
    n = session.rig.plant.size
    given = session.rig.coarse @ (session.state - before)[n:]
    assert 0 < np.abs(given).max() <= 4 * 5.0 * (1 + 1e-12)  # rounding of the scale
    run_on(session, 0.02)
    assert session.error is None


def test_a_pluck_gives_the_point_its_velocity_and_moves_nothing() -> None:
    session = session_on(LIGHT)
    before = session.state.copy()
    session.apply(do.Pluck(0.35, 0.37, 0.8))
    n = session.rig.plant.size
    shape = session.rig.plant.model.at(0.35 * LIGHT.panel.length, 0.37 * LIGHT.panel.width)
    np.testing.assert_array_equal(session.state[:n], before[:n])
    assert shape @ (session.state - before)[n:] == pytest.approx(0.8, rel=1e-9)


def test_no_time_and_no_number_move_nothing() -> None:
    session = session_on(LIGHT)
    for seconds in (0.0, -1.0, float("nan")):
        assert session.advance(seconds) is None
    assert session.time == 0


# --- control ----------------------------------------------------------------------------------------------------------


def test_the_controller_damps_the_flutter_and_the_session_tells_when() -> None:
    session = session_on(FULL)
    run_on(session, 0.05)
    start = session.state.copy()
    session.apply(do.Engage())
    session.take_events()
    run_on(session, 0.3)
    assert session.damping_time is not None
    # the seed has 0.072 to 0.0836 s, other phases of the limit cycle 0.088 to 0.123 s
    assert 0.05 < session.damping_time < 0.2
    assert texts(session) == [f"damped {session.damping_time:.4f} s after switching on"]
    states, volts = session.rig.loop.stretch(start, SAMPLE, 1500, engaged=True)
    trace = Trace(session.rig.plant, SAMPLE * np.arange(1, 1501), states, volts)
    loud = np.flatnonzero(trace.largest >= FULL.run.settled)[-1]
    # the solver counts to the first quiet sample, the session to the last loud one; stretches of 5 ms add no more
    assert session.damping_time == pytest.approx(trace.times[loud], abs=1.5 * SAMPLE)
    session.apply(do.Engage())
    assert session.damping_time is None


def test_a_passive_layout_is_said_to_be_passive_and_has_no_damping_time() -> None:
    passive = FULL.with_dynamic_pressure(530.0)  # above the bare panel's 514.9, below the patched 545
    session = session_on(FULL)
    session.apply(do.Engage())
    session.apply(do.SetFlow(530.0))
    session.settle()
    assert session.rig.design == passive
    assert status_of(session).word == "Passive"
    run_on(session, 0.4)
    assert session.amplitude < FULL.run.settled  # damped it is, and not by control alone
    assert session.damping_time is None
    assert status_of(session).word == "Passive"


def test_a_panel_without_patches_flutters_on() -> None:
    session = session_on(BARE)
    session.apply(do.Engage())
    run_on(session, 0.1)
    assert session.amplitude > 0.5  # the limit cycle at λ = 840 is above 1 h
    assert session.damping_time is None
    assert not session.volts.size


def test_a_refusal_ends_a_drag() -> None:
    """Or what the slider brings next would undo into the design before."""
    session = session_on(LIGHT)
    session.apply(do.TogglePatch(0))
    patched = session.design
    session.settle()
    session.apply(do.SetFlow(700.0))
    session.refuse("for some reason")
    assert session.design == patched
    session.apply(do.SetFlow(710.0))
    session.apply(do.Undo())
    assert session.design == patched
    assert session.can_undo
