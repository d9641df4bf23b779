"""The session: whatever a user does, the motion carries over to the model that comes of it."""

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from sessions import (
    BARE,
    FULL,
    LIGHT,
    STRETCH,
    changes,
    field,
    nodal_jump,
    projected,
    rig,
    run_on,
    session_on,
)

from flutterviz import commands as do
from flutterviz.status import status_of
from solver import Design, Flow, MeshSize, Panel, Ply, Reduction


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


# --- other bases and skins --------------------------------------------------------------------------------------------


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
