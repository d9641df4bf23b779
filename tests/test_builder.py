"""Rigs built beside the loop: as if built in place, with what the page has already only named, and no click lost."""

import pickle
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import ParamSpec, TypeVar

import msgspec
import numpy as np
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st
from pages import DESIGN, Page, centre, explorer_on, rig, ticks, until

from flutterviz import commands as do
from flutterviz.app import Explorer
from flutterviz.beside import Beside
from flutterviz.builder import Builder, Built
from flutterviz.parcel import packed, unpacked
from flutterviz.rig import Rig, in_flutter, rig_of
from flutterviz.scene import Ray
from flutterviz.session import Session
from solver import DesignError, Reduction

P = ParamSpec("P")
T = TypeVar("T")


ELEMENTS = DESIGN.mesh.nx * DESIGN.mesh.ny
IMPOSSIBLE = msgspec.structs.replace(DESIGN, reduction=Reduction(modes="all"))
OTHER_MESH = msgspec.structs.replace(DESIGN.with_elements((5, 6)), mesh=type(DESIGN.mesh)(12, 4))


class Failing(Executor):
    """Does nothing that it is asked for; by default as a process that is killed each time."""

    def __init__(self, error: Exception | None = None) -> None:
        self.asked = 0
        self.error = error or BrokenExecutor("ended")

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        self.asked += 1
        future: Future[T] = Future()
        future.set_exception(self.error)
        return future


@pytest.fixture(scope="module")
def beside() -> Iterator[Beside]:
    beside = Beside()
    yield beside
    beside.shutdown()


def built(builder: Builder) -> Built:
    """Wait for what is being built."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        found = builder.taken()
        if found is not None:
            return found
        time.sleep(0.01)
    raise AssertionError("it never came about")


def settled(builder: Builder) -> None:
    """Wait for what is still computed of the rig taken last."""
    end = time.monotonic() + 60
    while builder.completing and time.monotonic() < end:
        assert builder.taken() is None
        time.sleep(0.01)


def assert_alike(one: Rig, other: Rig) -> None:
    """Bit by bit: both come of the same computation."""
    assert one.design == other.design
    np.testing.assert_array_equal(one.surface, other.surface)
    np.testing.assert_array_equal(one.coarse, other.coarse)
    np.testing.assert_array_equal(one.plant.stiffness, other.plant.stiffness)
    np.testing.assert_array_equal(one.plant.model.membrane.quartic, other.plant.model.membrane.quartic)
    np.testing.assert_array_equal(one.loop.law.gain, other.loop.law.gain)
    np.testing.assert_array_equal(one.loop.poles, other.loop.poles)
    assert one.plant.critical == other.plant.critical
    assert (one.bare_critical, one.refusal, one.shortfall) == (other.bare_critical, other.refusal, other.shortfall)


# --- parcels ----------------------------------------------------------------------------------------------------------


@given(st.sets(st.integers(0, ELEMENTS - 1), max_size=8), st.floats(300, 1200), st.sampled_from(["lqr", "lqg", "off"]))
@settings(deadline=None, max_examples=8)
def test_a_parcel_brings_the_rig_itself(elements: set[int], pressure: float, kind: str) -> None:
    design = DESIGN.with_elements(tuple(elements)).with_dynamic_pressure(pressure)
    control = msgspec.structs.replace(design.control, kind=kind)
    sent = rig_of(design.with_control(control))
    assert_alike(unpacked(packed(sent)), sent)


def test_what_the_receiver_has_is_not_sent() -> None:
    last = rig()
    faster = rig_of(DESIGN.with_dynamic_pressure(900.0), last)
    parcel = packed(faster, last)
    assert len(parcel) < 0.1 * len(packed(faster)) < 0.1 * len(pickle.dumps(faster))
    received = unpacked(parcel, last)
    assert received.plant.model is last.plant.model  # by which a session sees that its modes go on
    assert received.surface is last.surface
    assert_alike(received, faster)
    assert received.plant.model.plate.space is last.plant.model.plate.space


# --- the builder ------------------------------------------------------------------------------------------------------


def test_a_rig_from_the_other_process_is_what_this_one_would_build(beside: Beside) -> None:
    woken: list[bool] = []
    builder = Builder(beside, lambda: woken.append(True))
    more = DESIGN.with_elements((*DESIGN.patches.elements, 100))
    builder.begin(more, rig())
    assert builder.busy
    found = built(builder)
    assert woken == [True]
    assert not builder.busy
    assert found.start is None
    assert not found.rig.complete
    assert builder.completing
    settled(builder)
    assert found.rig.complete
    assert_alike(found.rig, rig_of(more))
    assert len(woken) == 2
    builder.begin(more.with_dynamic_pressure(900.0), found.rig)
    second = built(builder)
    assert second.rig.plant.model is found.rig.plant.model
    assert second.rig.complete
    assert not builder.completing
    assert_alike(second.rig, rig_of(more.with_dynamic_pressure(900.0), found.rig))


def test_another_mesh_comes_with_its_flutter(beside: Beside) -> None:
    builder = Builder(beside, lambda: None)
    builder.begin(OTHER_MESH, rig())
    found = built(builder)
    assert found.start is not None
    np.testing.assert_array_equal(found.start, in_flutter(found.rig))
    session = Session(DESIGN, rig())
    session.adopt(found.rig, found.start)
    assert session.state is found.start


def test_a_design_that_cannot_be_is_refused_with_its_reason(beside: Beside) -> None:
    builder = Builder(beside, lambda: None)
    builder.begin(IMPOSSIBLE, rig())
    with pytest.raises(DesignError, match="all"):
        built(builder)
    assert not builder.busy


def test_a_process_that_is_killed_is_asked_once_more() -> None:
    failing = Failing()
    builder = Builder(failing, lambda: None)
    builder.begin(DESIGN, rig())
    assert builder.taken() is None
    assert not builder.busy  # so that it will be asked again
    builder.begin(DESIGN, rig())
    with pytest.raises(OSError, match="ended from outside"):
        builder.taken()
    assert failing.asked == 2


def test_a_rig_is_complete_even_if_its_process_dies_over_it() -> None:
    class Half(Failing):
        """Loses all but the first thing that it is asked for."""

        def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
            self.asked += 1
            return (
                ThreadPoolExecutor(1).submit(fn, *args, **kwargs)
                if self.asked == 1
                else super().submit(fn, *args, **kwargs)
            )

    builder = Builder(Half(), lambda: None)
    more = DESIGN.with_elements((*DESIGN.patches.elements, 100))
    builder.begin(more, rig())
    found = built(builder)
    settled(builder)
    assert not builder.completing  # words no longer wait for it
    assert not found.rig.complete
    assert found.rig.plant.critical == rig_of(more).plant.critical  # and it is computed where it is asked for


# --- on the page ------------------------------------------------------------------------------------------------------


def test_a_page_whose_builder_dies_says_so_and_moves_on(
    server: viser.ViserServer, capsys: pytest.CaptureFixture[str]
) -> None:
    failing = Failing()
    explorer = Explorer(Session(DESIGN, rig()), server, builder=failing, looker=ThreadPoolExecutor(1))
    page = Page(server)
    until(explorer, lambda: bool(server.get_clients()))
    explorer._inbox.put(do.TogglePatch(0))
    until(explorer, lambda: failing.asked == 2 and not explorer.session.stale)
    before = explorer.session.time
    ticks(explorer, 2)
    assert explorer.session.design == DESIGN
    assert explorer.session.time > before
    assert "the change was taken back: the process that was building it was ended" in capsys.readouterr().out
    page.close()
    explorer.close()


def test_whatever_a_rig_fails_by_the_change_is_taken_back_once(
    server: viser.ViserServer, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sparse factors and eigensolvers raise a RuntimeError."""
    failing = Failing(RuntimeError("Factor is exactly singular"))
    explorer = Explorer(Session(DESIGN, rig()), server, builder=failing, looker=ThreadPoolExecutor(1))
    page = Page(server)
    until(explorer, lambda: bool(server.get_clients()))
    explorer._inbox.put(do.TogglePatch(0))
    until(explorer, lambda: failing.asked == 1 and not explorer.session.stale)
    ticks(explorer, 5)
    assert failing.asked == 1
    assert explorer.session.error is None
    said = capsys.readouterr()
    assert "the change was taken back: Factor is exactly singular" in said.out
    assert "Traceback" not in said.err
    page.close()
    explorer.close()


def test_a_deleted_recording_is_told_and_the_panel_moves_on(
    explorer: Explorer, page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    explorer._inbox.put("record")
    ticks(explorer, 2)
    (file,) = tmp_path.glob("*.rrd")
    file.unlink()
    before = explorer.session.time
    ticks(explorer, 40)
    assert explorer.session.error is None
    assert explorer.session.time > before
    assert explorer._recording_facts() == f"{file.name}, which is no longer there"


@given(st.lists(st.tuples(st.integers(0, ELEMENTS - 1), st.floats(0, 0.1)), min_size=2, max_size=12))
@settings(deadline=None, max_examples=10)
def test_no_click_is_lost_however_fast(clicks: list[tuple[int, float]]) -> None:
    """Clicks on the page, less than 0.1 s apart, while rigs are built: each counts."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    explorer = explorer_on(server)
    page = Page(server)
    until(explorer, lambda: bool(server.get_clients()))
    wanted = set(DESIGN.patches.elements)
    for element, pause in clicks:
        page.click(*centre(element))
        wanted ^= {element}
        end = time.perf_counter() + pause
        while time.perf_counter() < end:
            explorer.tick()
    until(explorer, lambda: set(explorer.session.design.patches.elements) == wanted)
    until(explorer, lambda: not explorer.session.stale)
    assert set(explorer.session.rig.design.patches.elements) == wanted
    page.close()
    explorer.close()
    server.stop()


def test_a_click_after_a_change_that_fails_is_not_taken_back_with_it(explorer: Explorer, page: Page) -> None:
    """What is wanted by then is another design, which may do."""
    explorer._inbox.put(do.LoadDesign(IMPOSSIBLE, "all modes"))
    explorer._react()
    assert explorer._builder.busy
    explorer._inbox.put(do.LoadDesign(DESIGN, "the seed's"))
    explorer._inbox.put(do.TogglePatch(7))
    explorer._react()
    until(explorer, lambda: not explorer.session.stale)
    assert explorer.session.rig.design == DESIGN.with_elements((*DESIGN.patches.elements, 7))


def test_the_loop_reacts_between_two_pictures(explorer: Explorer) -> None:
    """What is put in is carried out while the loop waits for the next picture, and so is the rig taken."""
    pictures, seen = 0, []
    tick, apply, adopt = explorer.tick, explorer.session.apply, explorer.session.adopt

    def drawn() -> None:
        nonlocal pictures
        tick()
        pictures += 1
        if pictures == 1:
            explorer._inbox.put(do.TogglePatch(3))
        if pictures == 1000:
            explorer.running = False

    def applied(command: do.Command) -> None:
        seen.append(("applied", pictures))
        apply(command)

    def adopted(rig: Rig, start: None = None) -> None:
        adopt(rig, start)
        seen.append(("adopted", pictures))
        explorer.running = False

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(explorer, "tick", drawn)
        patch.setattr(explorer.session, "apply", applied)
        patch.setattr(explorer.session, "adopt", adopted)
        explorer.run()
    assert seen[0] == ("applied", 1)
    assert seen[1][0] == "adopted"
    assert explorer.session.rig.design.patches.elements[0] == 3


def test_a_click_counts_while_another_mesh_is_on_its_way(explorer: Explorer, page: Page) -> None:
    """It is the wanted mesh's element at that place, be it drawn by now or not."""
    ticks(explorer, 1)
    explorer.ask(do.LoadDesign(OTHER_MESH, "a coarser mesh"))
    explorer._react()
    ray = Ray((0.51, 0.26, 3.0), (0.0, 0.0, -1.0))
    element = int(0.51 * OTHER_MESH.mesh.nx) * OTHER_MESH.mesh.ny + int(0.26 * OTHER_MESH.mesh.ny)
    explorer.ask(ray)
    explorer._react()
    assert set(explorer.session.design.patches.elements) == {5, 6, element}
    end = time.monotonic() + 60
    while explorer.session.stale and time.monotonic() < end:
        explorer._react()  # and no picture meanwhile
    assert explorer.session.rig.grid.shape != explorer.scene.height.shape
    explorer.ask(ray)
    explorer._react()
    assert set(explorer.session.design.patches.elements) == {5, 6}
    until(explorer, lambda: not explorer.session.stale)
    assert not explorer.session.error
