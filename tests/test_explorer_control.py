"""Control on the page: the tab's widgets, the root locus, the look ahead, and authority maps on the panel."""

import json
import struct
import time
from concurrent.futures import ThreadPoolExecutor

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from pages import DESIGN, Page, refreshed, rig, status, ticks, until

from flutterviz import colormap, heatmap
from flutterviz import commands as do
from flutterviz.app import Explorer
from flutterviz.background import Background, map_basis
from flutterviz.controltab import DIALS, Dial
from flutterviz.outlook import FACTORS, outlook_of
from solver import Control, authority
from solver.authority import CRITERIA, AuthorityMap, Criterion

Numbers = NDArray[np.floating]


def slider(explorer: Explorer, field: str):  # noqa: ANN201 - one of viser's handles
    return next(handle for dial, handle in explorer.controls._control._dials if dial.field == field)


def drawn(explorer: Explorer) -> NDArray[np.uint16]:
    """(vertices, 4) colours of the panel as it was sent last."""
    data = explorer.scene._panel.glb_data
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    view = tree["bufferViews"][1]
    count = view["byteLength"] // 2
    return np.frombuffer(data, np.uint16, count, 28 + length + view["byteOffset"]).reshape(-1, 4)


# --- the tab ----------------------------------------------------------------------------------------------------------


def test_buttons_choose_controller_weights_and_wiring(explorer: Explorer, page: Page) -> None:
    tab = explorer.controls._control
    page.update(tab._kind, "LQG")
    until(explorer, lambda: explorer.session.rig.design.control.kind == "lqg")
    page.update(tab._weighting, "Identity")
    page.update(tab._channels, "Elements")
    until(explorer, lambda: len(explorer.session.rig.plant.channels) == 6)
    assert explorer.session.design.control.weighting == "identity"
    refreshed(explorer)
    for said in ("LQG", "each element on a voltage of its own", "Q = s·I"):
        assert said in tab._chosen.content
    assert "6 channels" in tab._facts.content
    explorer._inbox.put(do.Undo())
    explorer._inbox.put(do.Undo())
    explorer._inbox.put(do.Undo())
    until(explorer, lambda: explorer.session.rig.design == DESIGN)
    assert "LQR" in (refreshed(explorer) and tab._chosen.content)


def test_a_slider_sets_its_field_and_is_not_written_back(explorer: Explorer, page: Page) -> None:
    handle = slider(explorer, "delay")
    ticks(explorer, 3)
    page.received()
    for value in (0.1, 0.2, 0.3):
        page.update(handle, value)
        ticks(explorer, 3)
    until(explorer, lambda: explorer.session.rig.design.control.delay == pytest.approx(3e-4))
    ticks(explorer, 10)
    assert page.writes_to(handle) == []  # or a dragged slider would jump back
    explorer._inbox.put(do.Undo())
    ticks(explorer, 3)
    assert page.writes_to(handle) == [0.0]


def test_only_what_a_controller_uses_is_shown(explorer: Explorer, page: Page) -> None:
    shown = {
        "lqr": {"state_weight", "effort_weight", "voltage_limit", "delay"},
        "lqg": {"state_weight", "effort_weight", "observer_weight", "voltage_limit", "delay", "sensor_noise"},
        "rate": {"rate_gain", "voltage_limit", "delay", "sensor_noise"},
        "off": set(),
    }
    for kind, fields in shown.items():
        explorer._inbox.put(do.SetControl("kind", kind))
        ticks(explorer, 2)
        visible = {dial.field for dial, handle in explorer.controls._control._dials if handle.visible}
        assert visible == fields


@pytest.mark.parametrize("dial", DIALS, ids=lambda dial: dial.field)
def test_sliders_read_back_what_they_set_and_set_what_a_design_takes(dial: Dial) -> None:
    for place in np.linspace(dial.low, dial.high, 7):
        fields = msgspec.to_builtins(Control()) | {dial.field: dial.value(float(place))}
        control = msgspec.convert(fields, Control)  # the design refuses none of them
        assert dial.place(control) == pytest.approx(place, abs=1e-9)


def test_the_limit_goes_up_to_the_coercive_field(explorer: Explorer, page: Page) -> None:
    thick = msgspec.structs.replace(DESIGN.patches, thickness=5e-4)
    explorer._inbox.put(do.LoadDesign(msgspec.structs.replace(DESIGN, patches=thick), "thick patches"))
    ticks(explorer, 2)
    assert slider(explorer, "voltage_limit").max == pytest.approx(300.0)


# --- looking ahead ----------------------------------------------------------------------------------------------------


def test_the_status_says_how_far_the_layout_holds(explorer: Explorer, page: Page) -> None:
    until(explorer, lambda: explorer._background.outlook is not None)
    outlook = explorer._background.outlook
    assert outlook is not None
    assert outlook.hold is not None
    assert f"λ = {outlook.hold.dynamic_pressure:.0f}" in refreshed(explorer)
    explorer._inbox.put(do.ClearPatches())
    until(explorer, lambda: not explorer.session.stale and not explorer.session.rig.plant.channels)
    assert "stabilises up to" in refreshed(explorer)
    assert "λ = " not in status(explorer)


def test_the_poles_move_when_a_patch_is_toggled(explorer: Explorer, page: Page) -> None:
    until(explorer, lambda: explorer._background.outlook is not None)
    refreshed(explorer)
    before = explorer.locus._plot.data
    explorer._inbox.put(do.TogglePatch(40))
    until(explorer, lambda: not explorer.session.stale)
    refreshed(explorer)
    x, *_, closed, _ = explorer.locus._plot.data
    poles = explorer.session.rig.loop.poles
    drawn_poles = np.column_stack([x, closed])[~np.isnan(closed)]
    for growth, hertz in drawn_poles:
        assert np.abs(poles - complex(growth, 2 * np.pi * hertz)).min() < 1e-6 * np.abs(poles).max()
    assert not np.array_equal(before[0], x)


def test_the_locus_goes_from_the_open_loop_to_the_closed() -> None:
    outlook = outlook_of(rig())
    plant, loop = rig().plant, rig().loop
    for row, expected in ((0, np.linalg.eigvals(plant.system_matrix)), (-1, loop.poles)):
        one, other = np.sort_complex(outlook.locus[row]), np.sort_complex(expected)
        np.testing.assert_allclose(one, other, atol=1e-8 * np.abs(other).max())  # eigenvalues of one matrix twice
    assert FACTORS[0] == 0
    assert FACTORS[-1] == 1


# --- maps -------------------------------------------------------------------------------------------------------------


def test_a_map_colours_the_elements_and_goes_away_again(explorer: Explorer, page: Page) -> None:
    explorer._inbox.put(("map", 1.0))
    until(explorer, lambda: explorer._background.map is not None)
    ticks(explorer, 10)
    shown = explorer._background.map
    assert shown is not None
    assert "NFCG" in explorer.controls._legend.content
    wanted = {tuple(row) for row in heatmap.element_colours(shown).tolist()}
    assert wanted <= {tuple(row) for row in drawn(explorer).tolist()}
    explorer._inbox.put(do.TogglePatch(40))  # the packer is another now
    until(explorer, lambda: not explorer.session.stale)
    ticks(explorer, 10)
    assert wanted <= {tuple(row) for row in drawn(explorer).tolist()}
    explorer._inbox.put(("map", 0.0))
    ticks(explorer, 10)
    assert "displacement" in explorer.controls._legend.content
    assert not wanted <= {tuple(row) for row in drawn(explorer).tolist()}


def test_a_map_follows_the_flow(explorer: Explorer, page: Page) -> None:
    explorer._inbox.put(("map", 3.0))
    until(explorer, lambda: explorer._background.map is not None)
    before = explorer._background.map
    assert before is not None
    explorer._inbox.put(do.SetFlow(1200.0))
    until(explorer, lambda: explorer._background.map is not None and explorer._background.map is not before)
    after = explorer._background.map
    assert after is not None
    assert after.criterion == "controllability"
    assert not np.allclose(after.values, before.values)


def test_a_map_that_fails_is_told(explorer: Explorer, page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(design: object, criterion: object) -> AuthorityMap:
        raise ArithmeticError("no such\nmap")

    monkeypatch.setattr("flutterviz.background.authority", broken)
    explorer._inbox.put(("map", 2.0))
    until(explorer, lambda: bool(explorer._background.trouble))
    ticks(explorer, 10)
    assert "no map: ArithmeticError: no such map" in explorer.controls._legend.content
    assert not explorer.session.error


@pytest.mark.parametrize("error", [ValueError("bad"), TypeError("worse"), RuntimeError("worst")])
def test_an_outlook_that_fails_is_tried_once_and_harms_nothing(
    explorer: Explorer, page: Page, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    calls = []

    def broken(rig: object) -> None:
        calls.append(rig)
        raise error

    until(explorer, lambda: explorer._background.outlook is not None)
    monkeypatch.setattr("flutterviz.background.outlook_of", broken)
    explorer._inbox.put(do.SetFlow(900.0))
    until(explorer, lambda: bool(calls))
    before = explorer.session.time
    ticks(explorer, 15)
    assert explorer.session.time > before
    assert len(calls) == 1
    assert "…" in refreshed(explorer)  # unknown


def test_a_growing_pole_is_in_sight(explorer: Explorer, page: Page) -> None:
    """Collocated rate feedback with a delay excites modes far above the flutter."""
    for change in (do.SetControl("kind", "rate"), do.SetControl("delay", 2e-4)):
        explorer._inbox.put(change)
    until(explorer, lambda: explorer.session.rig.design.control.delay == 2e-4)
    refreshed(explorer)
    poles = explorer.session.rig.loop.poles
    worst = poles[np.argmax(poles.real)]
    x, *_, closed, _ = explorer.locus._plot.data
    shown = np.column_stack([x, closed])[~np.isnan(closed)]
    assert np.abs(shown - [worst.real, abs(worst.imag) / (2 * np.pi)]).sum(axis=1).min() < 1e-6 * abs(worst)


def test_another_mesh_takes_the_map_along(explorer: Explorer, page: Page) -> None:
    explorer._inbox.put(("map", 1.0))
    until(explorer, lambda: explorer._background.map is not None)
    coarse = msgspec.structs.replace(DESIGN.with_elements((5, 6)), mesh=type(DESIGN.mesh)(12, 4))
    explorer._inbox.put(do.LoadDesign(coarse, "a coarser mesh"))
    until(explorer, lambda: explorer._background.map is not None and len(explorer._background.map.values) == 48)
    ticks(explorer, 5)
    assert not explorer.session.error


def test_every_criterion_has_a_button() -> None:
    from flutterviz.controls import MAPS

    assert sorted(MAPS.values()) == list(range(len(CRITERIA) + 1))


@pytest.mark.parametrize("criterion", CRITERIA)
def test_colours_and_legend_of_every_criterion(criterion: Criterion) -> None:
    shown = authority(DESIGN, criterion)
    colours = heatmap.element_colours(shown).astype(int)
    best, worst = shown.best[0], shown.best[-1]
    if criterion == "growth":
        np.testing.assert_array_equal(colours[best], colormap.gltf_rgba([-1.0])[0])
        missing = colormap.gltf_rgba([np.nan])[0]
        assert all((colours[list(DESIGN.patches.elements)] == missing).all(axis=1))
    else:
        np.testing.assert_array_equal(colours[best], colormap.sequential_rgba([1.0])[0])
        np.testing.assert_array_equal(colours[worst], colormap.sequential_rgba([0.0])[0])
    assert shown.title in heatmap.legend(shown)
    assert shown.unit in heatmap.legend(shown)


@pytest.mark.parametrize("values", [np.full(6, np.nan), np.zeros(6), np.array([1.0, np.nan, 1, 1, 1, 1])])
@pytest.mark.parametrize("criterion", ["nfcg", "h2", "growth"])
def test_maps_without_a_spread_are_drawn_all_the_same(values: Numbers, criterion: Criterion) -> None:
    better = "larger" if criterion == "nfcg" else "smaller"
    shown = AuthorityMap(criterion, "a map", "-", better, values, "nothing")
    assert heatmap.element_colours(shown).shape == (6, 4)
    assert "a map" in heatmap.legend(shown)


def test_maps_depend_on_what_they_say() -> None:
    more = DESIGN.with_elements((*DESIGN.patches.elements, 3))
    assert map_basis(DESIGN, "nfcg") == map_basis(more, "nfcg")
    assert map_basis(DESIGN, "growth") != map_basis(more, "growth")
    late = DESIGN.with_control(Control(delay=1e-3, voltage_limit=10.0, kind="lqg"))
    assert all(map_basis(DESIGN, criterion) == map_basis(late, criterion) for criterion in CRITERIA)
    weak = DESIGN.with_control(Control(effort_weight=1.0))
    assert map_basis(DESIGN, "nfcg") != map_basis(weak, "nfcg")
    assert map_basis(DESIGN, "growth") == map_basis(weak, "growth")


def test_it_closes_while_it_is_busy() -> None:
    background = Background(ThreadPoolExecutor(1))
    background.ask("h2")
    background.follow(rig())
    start = time.perf_counter()
    background.close()  # waits for what runs, starts nothing else
    assert time.perf_counter() - start < 30
