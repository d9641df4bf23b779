"""The verdict in words: one for every state a panel can be in."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from flutterviz import commands as do
from flutterviz.rig import Rig, rig_of
from flutterviz.session import Session
from flutterviz.status import STEADY, recent_growth, status_of
from solver import Design, Load, load_design, static_states

SEED = load_design("seed-840").with_reduction("patched", 12)
BARE = load_design("seed-bare").with_reduction("patched", 12)


@lru_cache
def rig(design: Design) -> Rig:
    """The rig of a design, built once for all tests."""
    return rig_of(design)


def running(design: Design, seconds: float, *commands: do.Command) -> Session:
    """A session that carried out commands and then ran for some simulated time."""
    session = Session(design, rig(design))
    for command in commands:
        session.apply(command)
    for _ in range(round(seconds / 0.005)):
        session.advance(0.005)
    return session


def word_of(session: Session) -> str:
    return status_of(session).word


def test_below_the_critical_pressure_the_panel_is_stable() -> None:
    status = status_of(running(BARE.with_dynamic_pressure(400.0), 0.02))
    assert status.word == "Stable"
    assert status.tone == "good"
    assert status.growth < 0
    assert status.pressure_ratio is not None
    assert status.pressure_ratio < 1


def test_full_flutter_is_a_limit_cycle() -> None:
    session = running(BARE, 0.05)
    status = status_of(session)
    assert status.word == "Limit cycle"
    assert status.growth > 0
    assert status.pressure_ratio == pytest.approx(840 / 514.9, rel=0.02)  # 12 modes have λ_cr to 1.5 %
    trend = recent_growth(session)
    assert trend is not None
    assert abs(trend) * session.period < STEADY


def test_at_the_opening_the_word_is_already_right() -> None:
    assert word_of(running(SEED, 0.0)) == "Limit cycle"


def test_from_a_small_start_flutter_grows() -> None:
    session = running(BARE.with_dynamic_pressure(600.0), 0.02, do.Reset())
    assert word_of(session) == "Flutter growing"
    trend = recent_growth(session)
    assert trend is not None
    assert trend > 0


def test_a_motion_too_large_settles() -> None:
    session = running(BARE, 0.05)
    session.apply(do.SetFlow(560.0))  # whose limit cycle is about half as large
    session.settle()
    words = set()
    for _ in range(12):  # the verdict looks back over a few periods; later the amplitude beats, and grows for a while
        session.advance(0.005)
        words.add(word_of(session))
    assert "Settling to the limit cycle" in words


def test_the_controller_at_work_then_done() -> None:
    session = running(SEED, 0.0, do.Engage())
    session.advance(0.002)
    status = status_of(session)
    assert status.word == "Controlled"
    assert status.detail == "at the voltage limit"  # full flutter asks for more than the drive gives
    assert status.growth < 0  # as it is driven now
    for _ in range(60):
        session.advance(0.005)
    assert word_of(session) == "Controlled, quiet"
    assert status_of(session).tone == "good"


def test_patches_that_end_the_flutter_alone_are_passive_engaged_or_not() -> None:
    passive = SEED.with_dynamic_pressure(530.0)
    for command in (do.Engage(False), do.Engage(True)):
        status = status_of(running(passive, 0.02, command))
        assert status.word == "Passive"
        assert f"{rig(passive).bare_critical:.0f}" in status.detail


def test_a_patched_panel_below_both_critical_pressures_is_stable() -> None:
    assert word_of(running(SEED.with_dynamic_pressure(300.0), 0.02)) == "Stable"


def test_a_controller_without_patches_says_so() -> None:
    status = status_of(running(BARE, 0.02, do.Engage()))
    assert status.word == "Controller has no patches"
    assert "patch" in status.detail


def test_a_controller_that_cannot_be_gives_its_reason() -> None:
    session = running(SEED, 0.0)
    session.adopt(replace(session.rig, refusal="no regulator exists"))
    session.apply(do.Engage())
    status = status_of(session)
    assert (status.word, status.detail) == ("Controller impossible", "no regulator exists")
    assert status.growth > 0  # nothing drives the panel


def test_a_stopped_run_says_why() -> None:
    session = running(BARE, 0.01, do.Pluck(0.3, 0.4, 1e9))
    status = status_of(session)
    assert status.word == "Stopped"
    assert status.detail == session.error
    assert status.tone == "bad"


def test_a_pause_is_named_beside_the_state() -> None:
    assert word_of(running(BARE, 0.0, do.Pause())) == "Paused · Limit cycle"


def test_no_two_states_share_an_icon_and_a_word() -> None:
    # states are told apart without colour: the icons of the commonest differ
    sessions = [
        running(BARE.with_dynamic_pressure(400.0), 0.0),
        running(BARE, 0.0),
        running(BARE.with_dynamic_pressure(600.0), 0.02, do.Reset()),
        running(SEED, 0.01, do.Engage()),
        running(SEED.with_dynamic_pressure(530.0), 0.0),
    ]
    verdicts = [status_of(session) for session in sessions]
    assert len({verdict.icon for verdict in verdicts}) == len({verdict.word for verdict in verdicts}) == len(verdicts)


def test_a_panel_that_was_quiet_already_is_said_to_be() -> None:
    session = running(SEED, 0.0, do.Engage())
    session.state = np.zeros_like(session.state)
    session.history.clear()
    assert word_of(session) == "Controlled, quiet"
    assert session.damping_time is None  # none was measured


# --- buckled ----------------------------------------------------------------------------------------------------------

PRESSED = BARE.with_load(Load(preload_x=3.0, preload_y=3.0))  # one and a half times its buckling load


def test_a_panel_at_rest_in_a_buckle_is_buckled() -> None:
    session = running(PRESSED.with_dynamic_pressure(60.0), 0.02)
    status = status_of(session)
    assert status.word == "Buckled"
    assert status.tone == "warn"
    assert "deflection" in status.detail
    assert status.growth > 0  # of the flat panel, which it is not
    assert session.amplitude == pytest.approx(static_states(session.rig.plant)[-1].largest, rel=1e-2)  # still ringing
    assert word_of(running(PRESSED.with_dynamic_pressure(60.0), 0.0)) == "Buckled"  # the session begins settled


def test_a_buckled_panel_that_the_stream_presses_flat_is_stable() -> None:
    assert word_of(running(PRESSED.with_dynamic_pressure(220.0), 0.02)) == "Stable"  # 170 and more flatten it


def test_a_buckled_panel_that_flutters_is_not_said_to_rest() -> None:
    assert word_of(running(PRESSED.with_dynamic_pressure(840.0), 0.05)) != "Buckled"


def test_patches_on_a_buckled_panel_make_it_no_passive_one() -> None:
    # the patched panel buckles at 5.8, and is pressed by 6.5; λ is far below both critical pressures
    pressed = SEED.with_load(Load(preload_x=6.5, preload_y=6.5)).with_dynamic_pressure(60.0)
    assert word_of(running(pressed, 0.1)) == "Buckled"
