"""The explorer on a real server, ticked by the test, with pages that speak viser's websocket and draw nothing."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import viser
from pages import DESIGN, Page, centre, refreshed, rig, status, ticks, until

from flutterviz import app
from flutterviz import commands as do
from flutterviz.app import Explorer
from flutterviz.clock import FRAME, LADDER, rate_name
from flutterviz.session import Session
from solver import Reduction, load_design


def test_time_stands_still_while_nobody_looks(explorer: Explorer) -> None:
    explorer._inbox.put(do.TogglePatch(0))
    ticks(explorer, 5)
    assert explorer.session.time == 0
    assert explorer.session.design.patches.elements[0] == 0  # yet commands are carried out
    until(explorer, lambda: not explorer.session.stale)


def test_a_page_sees_the_panel_move_and_reads_its_state(explorer: Explorer, page: Page) -> None:
    before = explorer.scene._panel.glb_data
    text = refreshed(explorer)
    assert explorer.session.time > 0
    assert explorer.scene._panel.glb_data != before
    for said in ("Limit cycle", "λ / λ_cr", "growth rate", "1 page", rate_name(explorer.clock.rate)):
        assert said in text
    assert "1 page" in text
    assert any(m["type"] == "SceneNodeUpdateMessage" for m in page.received())


def test_a_click_patches_the_element_at_once_and_the_model_follows(explorer: Explorer, page: Page) -> None:
    element = 12 * 6 + 3
    page.click(*centre(element))
    until(explorer, lambda: element in explorer.session.design.patches.elements)
    assert explorer.session.design.patches.elements == (*DESIGN.patches.elements, element)
    ticks(explorer, 1)
    assert element in explorer.scene._packer.patched  # drawn in the same picture
    until(explorer, lambda: element in explorer.session.rig.design.patches.elements)
    refreshed(explorer)
    assert "7 patched, 2 channels" in explorer.controls._facts.content
    page.click(*centre(element))
    until(explorer, lambda: explorer.session.design == DESIGN)


def test_a_click_beside_the_panel_does_nothing(explorer: Explorer, page: Page) -> None:
    page.click(1.2, 0.5)
    ticks(explorer, 10)
    assert explorer.session.design == DESIGN


def test_the_motion_goes_on_while_a_rig_is_built(explorer: Explorer, page: Page) -> None:
    explorer._inbox.put(do.TogglePatch(40))
    explorer.tick()
    assert explorer.session.stale
    before = explorer.session.time
    ticks(explorer, 1)
    assert explorer.session.time > before
    until(explorer, lambda: not explorer.session.stale)


def test_the_slider_sets_the_flow_and_is_not_written_back(explorer: Explorer, page: Page) -> None:
    slider = explorer.controls._pressure
    ticks(explorer, 3)
    page.received()
    for value in (900.0, 905.0, 910.0):
        page.update(slider, value)
        ticks(explorer, 3)
    until(explorer, lambda: explorer.session.rig.design.flow.dynamic_pressure == 910)
    ticks(explorer, 10)
    assert page.writes_to(slider) == []  # or a dragged slider would jump back
    explorer._inbox.put(do.Undo())
    ticks(explorer, 3)
    assert slider.value == 840
    assert page.writes_to(slider) == [840.0]


def test_a_design_beyond_the_slider_draws_it_further(explorer: Explorer, page: Page) -> None:
    explorer._inbox.put(do.LoadDesign(explorer.session.design.with_dynamic_pressure(2500.0), "a fast stream"))
    ticks(explorer, 2)
    assert explorer.controls._pressure.value == 2500
    assert explorer.controls._pressure.max >= 2500


def test_a_slider_ahead_of_the_design_is_left_alone(explorer: Explorer, page: Page) -> None:
    explorer.controls._pressure.value = 905.0  # as a page does while it drags: its last command is still in the inbox
    explorer._inbox.put(do.SetFlow(900.0))
    ticks(explorer, 2)
    assert explorer.session.design.flow.dynamic_pressure == 900
    assert explorer.controls._pressure.value == 905


def test_the_key_engages_the_controller_and_the_motion_falls(explorer: Explorer, page: Page) -> None:
    explorer.clock.rate = 1 / 20
    until(explorer, lambda: explorer.session.time > 2 * explorer.session.period)
    before = explorer.session.amplitude
    page.key("Engage or release the controller")
    until(explorer, lambda: explorer.session.engaged)
    refreshed(explorer)
    assert explorer.controls._engage.label == "Release controller (C)"
    assert "Controlled" in status(explorer)
    until(explorer, lambda: explorer.session.amplitude < 0.2 * before)
    page.key("Engage or release the controller")
    until(explorer, lambda: not explorer.session.engaged)
    refreshed(explorer)
    assert explorer.controls._engage.label == "Engage controller (C)"


def test_every_key_does_what_it_says(explorer: Explorer, page: Page) -> None:
    session = explorer.session
    page.key("Pause or continue")
    until(explorer, lambda: session.paused)
    assert "Paused" in refreshed(explorer)
    before = session.time
    page.key("Step one picture")
    until(explorer, lambda: session.time > before)
    stepped = session.time
    ticks(explorer, 5)
    assert session.time == stepped
    page.key("Reset the motion")
    until(explorer, lambda: not session.paused)
    page.click(*centre(0))
    until(explorer, lambda: 0 in session.design.patches.elements)
    page.key("Undo")
    until(explorer, lambda: session.design == DESIGN)
    page.key("Redo")
    until(explorer, lambda: 0 in session.design.patches.elements)


def test_a_preset_is_loaded_and_named_until_edited(explorer: Explorer, page: Page) -> None:
    page.update(explorer.controls._preset, "seed-bare")
    until(explorer, lambda: explorer.session.design == load_design("seed-bare"))
    assert explorer.controls._pressure.value == 840
    until(explorer, lambda: not explorer.session.stale)
    explorer._inbox.put(do.TogglePatch(7))
    until(explorer, lambda: "as edited: 1 patched" in explorer.controls._facts.content)
    explorer._inbox.put(do.Undo())
    until(explorer, lambda: "seed-bare: 0 patched" in explorer.controls._facts.content)


def test_rate_and_height_go_by_steps_on_their_ladders(explorer: Explorer, page: Page) -> None:
    first = explorer.clock.rate
    for rate in LADDER[LADDER.index(first) + 1 :]:
        page.update(explorer.controls._rate, "Faster")
        until(explorer, lambda rate=rate: explorer.clock.rate == rate)
    page.update(explorer.controls._rate, "Slower")
    until(explorer, lambda: explorer.clock.rate == LADDER[-2])
    page.update(explorer.controls._rate, "Auto")
    until(explorer, lambda: explorer.clock.rate == first)
    page.update(explorer.controls._height, "Higher")
    until(explorer, lambda: explorer.scene.exaggeration == 40)
    until(explorer, lambda: "height × 40" in explorer.controls._legend.content)


def test_fitted_colours_hold_the_motion(explorer: Explorer, page: Page) -> None:
    explorer.clock.rate = 1 / 20
    ticks(explorer, 20)
    explorer._inbox.put("fit colours")
    explorer.tick()
    recent = explorer.session.history.largest.max()
    assert 0.99 * explorer.session.amplitude <= explorer.scene.limit <= 1.5 * recent  # the next round number above
    assert f"{explorer.scene.limit:g}" in explorer.controls._legend.content


def test_two_pages_are_counted_and_one_may_leave(explorer: Explorer, page: Page) -> None:
    other = Page(explorer.server)
    until(explorer, lambda: "2 pages" in status(explorer))
    other.click(*centre(3))
    until(explorer, lambda: 3 in explorer.session.design.patches.elements)
    other.socket.socket.close()  # a tab that dies, without a word
    until(explorer, lambda: "1 page<" in status(explorer))
    before = explorer.session.time
    ticks(explorer, 2)
    assert explorer.session.time > before


@pytest.mark.parametrize(
    "wish",
    [
        do.SetFlow(-5.0),
        do.SetFlow(float("nan")),
        do.TogglePatch(-3),
        do.LoadDesign(msgspec.structs.replace(DESIGN, reduction=Reduction(modes="all")), "all modes"),
    ],
)
def test_what_cannot_be_is_told_and_the_panel_moves_on(
    explorer: Explorer, page: Page, wish: do.Command, capsys: pytest.CaptureFixture[str]
) -> None:
    explorer._inbox.put(wish)
    ticks(explorer, 2)
    until(explorer, lambda: not explorer.session.stale)
    before = explorer.session.time
    ticks(explorer, 2)
    assert explorer.session.design == DESIGN
    assert explorer.session.time > before
    assert explorer.controls._pressure.value == 840
    said = capsys.readouterr().out.splitlines()
    assert len(said) in (1, 2)  # what was wished, if it was tried, and why not
    assert " ms  " in said[-1]


def test_divergence_stops_the_motion_and_says_what_to_do(explorer: Explorer, page: Page) -> None:
    explorer._inbox.put(do.Pluck(0.4, 0.4, 1e9))
    text = refreshed(explorer)
    assert "Stopped" in text
    assert "reset" in text
    explorer._inbox.put(do.Reset())
    assert "Stopped" not in refreshed(explorer)


def test_the_button_starts_and_stops_a_recording(
    explorer: Explorer, page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page.update(explorer.controls._record, True)
    until(explorer, lambda: explorer.controls._record.label == "Stop recording")
    (path,) = tmp_path.glob("flutterviz-*.rrd")
    assert path.name in explorer.controls._recording.content
    page.update(explorer.controls._record, True)
    until(explorer, lambda: explorer.controls._record.label == "Record")
    assert explorer.controls._recording.content == ""
    assert path.read_bytes().startswith(b"RRF")
    assert path.stat().st_size > 20_000  # a frame alone is some tens of kB


def test_a_recording_begun_in_the_second_of_another_does_not_replace_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("run.rrd", "run-2.rrd", "run-3.rrd"):
        path = app._unused("run")
        assert path.name == name
        path.touch()


def test_a_recording_from_the_start_runs_without_a_page(server: viser.ViserServer, tmp_path: Path) -> None:
    explorer = Explorer(Session(DESIGN, rig()), server, tmp_path / "run.rrd")
    ticks(explorer, 3)
    assert explorer.session.time > 0
    explorer.close()
    assert (tmp_path / "run.rrd").read_bytes().startswith(b"RRF")


def test_a_recording_that_cannot_be_written_is_refused_at_once(server: viser.ViserServer, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="cannot record to"):
        Explorer(Session(DESIGN, rig()), server, tmp_path / "nowhere" / "run.rrd")


def test_the_plots_draw_the_recent_past(explorer: Explorer, page: Page) -> None:
    ticks(explorer, 12)
    times, probe = explorer.plots._probe.data[:2]
    assert len(times) == len(probe) > 2
    assert (np.diff(times) > 0).all()
    # in milliseconds, at most three pictures behind
    assert times[-1] == pytest.approx(1e3 * explorer.session.time, abs=1e3 * 4 * FRAME * explorer.clock.rate)
