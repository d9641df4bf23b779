"""The session: whatever a user does, the motion goes on, carries over, and can be taken back."""

from functools import lru_cache

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from numpy.typing import NDArray

from flutterviz import commands as do
from flutterviz.rig import Rig, rig_of
from flutterviz.session import Session
from flutterviz.status import status_of
from solver import Design, Flow, MeshSize, Panel, Ply, Reduction, Trace, load_design

Floats = NDArray[np.floating]

SAMPLE = 2e-4  # s: 28 in a period of the seed panel's flutter

FULL = load_design("seed-840")
LIGHT = FULL.with_reduction("patched", 8)  # what is said here of commands holds for any basis; this one is quick
BARE = load_design("seed-bare").with_reduction("patched", 8)
STRETCH = 0.005  # s: a picture at a twentieth of real time is about a third of it

elements = st.integers(0, 143)
pressures = st.floats(0, 1500)
changes = st.one_of(
    st.builds(do.TogglePatch, elements),
    st.builds(do.ClearPatches),
    st.builds(do.SetFlow, pressures),
    st.sampled_from([do.LoadDesign(BARE, "seed-bare"), do.LoadDesign(LIGHT, "seed-840")]),
)


@lru_cache
def rig(design: Design) -> Rig:
    """The rig of a design, built once for all tests."""
    return rig_of(design)


def session_on(design: Design) -> Session:
    return Session(design, rig(design))


def run_on(session: Session, seconds: float) -> None:
    for _ in range(round(seconds / STRETCH)):
        session.advance(STRETCH)


def texts(session: Session) -> list[str]:
    return [event.text for event in session.take_events()]


def field(rig: Rig, halves: Floats) -> Floats:
    """(2, free dofs) nodal values of w and w,t of a state (2, n)."""
    return halves @ rig.plant.model.shapes.T


def projected(new: Rig, motion: Floats) -> Floats:
    """(2n,) the state of a rig nearest to nodal values (2, free dofs) in its kinetic energy, by normal equations."""
    shapes, mass = new.plant.model.shapes, new.plant.model.plate.mass
    weighed = mass @ shapes
    return np.linalg.solve(shapes.T @ weighed, (motion @ weighed).T).T.ravel()


class Commands(RuleBasedStateMachine):
    """Any order of commands, motion and rebuilds."""

    @initialize(design=st.sampled_from([LIGHT, BARE]))
    def begin(self, design: Design) -> None:
        self.session = session_on(design)
        self.time = 0.0

    @rule(change=changes)
    def change(self, change: do.Command) -> None:
        self.session.apply(change)

    @rule(command=st.sampled_from([do.Undo(), do.Redo(), do.Reset(), do.Step()]))
    def plain(self, command: do.Command) -> None:
        self.session.apply(command)

    @rule(on=st.sampled_from([None, True, False]))
    def engage(self, on: bool | None) -> None:
        self.session.apply(do.Engage(on))

    @rule(on=st.sampled_from([None, True, False]))
    def pause(self, on: bool | None) -> None:
        self.session.apply(do.Pause(on))

    @rule(x=st.floats(-0.2, 1.2), y=st.floats(-0.2, 1.2), velocity=st.floats(-5, 5))
    def pluck(self, x: float, y: float, velocity: float) -> None:
        self.session.apply(do.Pluck(x, y, velocity))

    @rule(seconds=st.just(0.0) | st.floats(1e-6, 0.02))
    def move(self, seconds: float) -> None:
        before = self.session.time
        rows = self.session.advance(seconds)
        assert (rows is None) == (self.session.time == before)
        if rows is not None:
            # sums of up to a hundred samples of 1e-4 s
            assert self.session.time == pytest.approx(before + seconds, abs=1e-12)
            assert (np.diff(rows.times) > 0).all()
            assert np.isfinite(rows.probe).all()

    @precondition(lambda self: self.session.stale)
    @rule()
    def settle(self) -> None:
        session, old, before = self.session, self.session.rig, self.session.state
        motion = field(old, before.reshape(2, -1))
        session.settle()
        assert not session.stale
        if session.rig.plant.model is old.plant.model:
            np.testing.assert_array_equal(session.state, before)
        else:
            expected = projected(session.rig, motion)
            for got, exact in zip(session.state.reshape(2, -1), expected.reshape(2, -1), strict=True):
                # mass-normal modes are orthogonal to 1e-12 or so: that is all the normal equations add
                np.testing.assert_allclose(got, exact, rtol=0, atol=1e-9 * max(np.abs(exact).max(), 1e-30))

    @invariant()
    def runs(self) -> None:
        session, n = self.session, self.session.rig.plant.size
        assert session.state.shape == (2 * n,)
        assert np.isfinite(session.state).all()
        assert session.volts.shape == (len(session.rig.plant.channels),)
        assert session.error is None  # nothing that these commands can do diverges
        assert session.time >= self.time
        self.time = session.time
        assert status_of(session).word


Commands.TestCase.settings = settings(
    max_examples=8,
    stateful_step_count=12,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
TestCommands = Commands.TestCase


# --- the motion carries over ------------------------------------------------------------------------------------------


def toggles(count: int) -> list[int]:
    """Elements to toggle: all corners of the panel, which weigh most on a motion near the edges, and random others."""
    random = np.random.default_rng(20250101).choice(144, count - 4, replace=False)
    return [0, 5, 138, 143, *(int(e) for e in random)]


@pytest.mark.parametrize("controlled", [False, True])
def test_no_node_jumps_when_a_patch_is_toggled(controlled: bool) -> None:
    session = session_on(FULL)
    if controlled:
        session.apply(do.Engage(True))
    session.advance(0.03)
    old, before = session.rig, session.state.copy()
    w = field(old, before.reshape(2, -1))[0]
    nodes = old.plant.model.plate.space.mesh.free_bending.nonzero()[0] % 4 == 0  # w, not its derivatives
    for element in toggles(6):
        session.apply(do.TogglePatch(element))
        session.settle()
        after = field(session.rig, session.state.reshape(2, -1))[0]
        jump = np.abs(after - w)[nodes].max() / FULL.panel.thickness
        # What 24 modes of another panel cannot say of a motion. Over 250 random toggles it was at most 1.5 % of the
        # amplitude; of the momentary |w|, small at some phases, up to 2.2 % in flutter and 3.5 % under control.
        assert jump < 0.02 * session.amplitude, f"element {element}"
        session.adopt(old)
        session.design, session.state = FULL, before.copy()


def test_a_change_of_flow_leaves_the_motion_alone() -> None:
    session = session_on(LIGHT)
    before = session.state.copy()
    session.apply(do.SetFlow(600.0))
    session.settle()
    np.testing.assert_array_equal(session.state, before)


def test_the_panel_moves_on_while_a_rig_is_built() -> None:
    session = session_on(LIGHT)
    session.apply(do.TogglePatch(40))
    assert session.stale
    assert session.advance(STRETCH) is not None
    assert session.rig.design == LIGHT
    session.adopt(rig(session.design))
    assert not session.stale
    assert session.advance(STRETCH) is not None


def test_another_mesh_starts_in_flutter_anew() -> None:
    session = session_on(LIGHT)
    coarse = msgspec.structs.replace(BARE, mesh=msgspec.structs.replace(BARE.mesh, nx=12))
    session.apply(do.LoadDesign(coarse, "coarse"))
    session.settle()
    assert session.rig.design == coarse
    run_on(session, 0.03)
    assert 0.5 < session.amplitude < 2  # the limit cycle at λ = 840 is about 1 h


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


# --- other bases and skins --------------------------------------------------------------------------------------------


def nodal_jump(session: Session, before: Floats) -> float:
    """Largest change of w at a node since nodal values (2, free dofs), over h."""
    nodes = session.rig.plant.model.plate.space.mesh.free_bending.nonzero()[0] % 4 == 0  # w, not its derivatives
    after = field(session.rig, session.state.reshape(2, -1))
    return float(np.abs(after - before)[0, nodes].max() / session.rig.thickness)


def test_a_basis_of_the_stream_changes_with_it_and_the_motion_goes_on() -> None:
    session = session_on(FULL.with_reduction("aeroelastic", 12))
    for pressure in (780.0, 700.0, 780.0, 840.0):
        session.advance(0.013)
        old, before = session.rig, field(session.rig, session.state.reshape(2, -1))
        session.apply(do.SetFlow(pressure))
        session.settle()
        assert session.rig.plant.stream.dynamic_pressure == pressure
        assert session.rig.plant.model is not old.plant.model
        expected = projected(session.rig, before)
        for got, exact in zip(session.state.reshape(2, -1), expected.reshape(2, -1), strict=True):
            np.testing.assert_allclose(got, exact, rtol=0, atol=1e-9 * np.abs(exact).max())  # as in `Commands.settle`
        # flutter shapes of neighbouring λ are alike: the new space misses a few thousandths of the motion
        assert nodal_jump(session, before) < 0.02 * session.amplitude
    run_on(session, 0.1)
    assert 0.5 < session.amplitude < 2  # still the limit cycle at λ = 840, of about 1 h
    assert status_of(session).word in ("Limit cycle", "Settling to the limit cycle")


def test_a_basis_of_the_stream_is_kept_by_what_leaves_the_stream_alone() -> None:
    session = session_on(FULL.with_reduction("aeroelastic", 8))
    model = session.rig.plant.model
    weights = msgspec.structs.replace(session.design.control, effort_weight=20.0)
    session.apply(do.LoadDesign(msgspec.structs.replace(session.design, control=weights), "softer"))
    session.settle()
    assert session.rig.plant.model is model


LAMINATE = Design(
    panel=Panel(thickness=0.0008, plies=tuple(Ply("graphite-epoxy", angle, 0.0002) for angle in (0, 45, -45, 90))),
    mesh=MeshSize(12, 4),
    flow=Flow(300.0, 0.01),
    reduction=Reduction("patched", 16),
)


def test_patches_are_toggled_on_a_laminated_skin() -> None:
    session = session_on(LAMINATE)
    assert session.rig.plant.model.plate.coupling is not None  # the lay-up is unsymmetric
    wanted: list[list[tuple[int, ...]]] = [[(16,)], [(16, 17)], [(16, 17), (30,)], [(16, 17)]]
    for element, channels in zip((16, 17, 30, 30), wanted, strict=True):
        session.advance(0.007)
        before = field(session.rig, session.state.reshape(2, -1))
        session.apply(do.TogglePatch(element))
        session.settle()
        assert session.rig.plant.channels == channels
        assert session.volts.shape == (len(channels),)
        expected = projected(session.rig, before)
        scale = np.abs(expected.reshape(2, -1)).max(axis=1)
        gap = np.abs((session.state - expected).reshape(2, -1)).max(axis=1)
        assert (gap <= 1e-9 * scale).all()  # as in `Commands.settle`
        # a pair of patches weighs four times this thin skin: what 16 modes cannot say is more than on aluminium
        assert nodal_jump(session, before) < 0.1 * session.amplitude
    session.apply(do.Engage())
    assert session.advance(0.01) is not None
    assert np.abs(session.volts).max() > 0
    for _ in range(4):
        session.apply(do.Undo())
    session.settle()
    assert session.design == LAMINATE
    assert session.advance(0.01) is not None


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
