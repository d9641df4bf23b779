"""The scene: rays from the mouse find their element on the deformed panel, and the first view shows all of it."""

import math
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from flutterviz.rig import Rig, rig_of
from flutterviz.scene import FIELD_OF_VIEW, Ray, Scene, pick, picked_element
from flutterviz.surface import DisplayGrid
from solver import Mesh, load_design

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

DESIGN = load_design("seed-840").with_reduction("patched", 6)  # the scene does not care how well the panel moves
MESH = Mesh.of(DESIGN.panel, DESIGN.mesh)
GRID = DisplayGrid(DESIGN.panel.length, DESIGN.panel.width, DESIGN.mesh.nx, DESIGN.mesh.ny)
SHORT = DisplayGrid(0.1, 0.4, 5, 7)  # a panel wider than long, its scene 0.25 by 1

unit = st.floats(0.02, 0.98)


def wave(grid: DisplayGrid, height: float) -> Floats:
    """(nvx, nvy) a flutter-like shape [scene units]."""
    x, y = grid.x / grid.length, grid.y / grid.width
    return height * np.outer(np.sin(2 * np.pi * x) - 0.6 * np.sin(np.pi * x), np.sin(np.pi * y))


def on_surface(grid: DisplayGrid, height: Floats, s: float, t: float) -> Floats:
    """(3,) the point of the drawn surface over (s, t), parts of length and width [scene units]."""
    nvx, nvy = grid.shape
    i, j = min(int(s * (nvx - 1)), nvx - 2), min(int(t * (nvy - 1)), nvy - 2)
    u, v = s * (nvx - 1) - i, t * (nvy - 1) - j
    corner = height[i : i + 2, j : j + 2]
    z = np.array([1 - u, u]) @ corner @ np.array([1 - v, v])
    return np.array([s * grid.length * grid.scale, t * grid.width * grid.scale, z])


def direction(azimuth: float, elevation: float) -> Floats:
    """(3,) unit vector towards a camera."""
    flat = math.cos(elevation)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])


@pytest.mark.parametrize("grid", [GRID, SHORT])
@pytest.mark.parametrize("side", [1, -1])
@given(unit, unit, st.floats(0, 2 * np.pi), st.floats(0.6, 1.5), st.floats(-0.1, 0.1), st.floats(1, 8))
@settings(deadline=None)
def test_a_ray_through_a_point_of_the_surface_finds_it(
    grid: DisplayGrid, side: int, s: float, t: float, azimuth: float, elevation: float, rise: float, distance: float
) -> None:
    # From above and from below, at 34° and more: the wave's slope is 28° at most, so nothing stands in the way.
    height = wave(grid, rise * (grid.length * grid.scale))
    point, back = on_surface(grid, height, s, t), side * direction(azimuth, elevation)
    found = pick(grid, height, point + distance * back, -3.0 * back)  # a ray's direction need not have length 1
    assert found is not None
    # 400 samples over a ray's part within the wave (0.3 of the side), refined linearly: 1e-4 is a 40th of a sub-cell
    assert np.hypot(*(np.array(found) * grid.scale - point[:2])) < 1e-4


@given(st.integers(0, MESH.elements - 1), st.floats(0.1, 0.9), st.floats(0.1, 0.9), st.floats(-0.1, 0.1))
@settings(deadline=None)
def test_a_click_well_inside_an_element_names_it(element: int, s: float, t: float, rise: float) -> None:
    i, j = divmod(element, MESH.ny)
    height = wave(GRID, rise)
    point = on_surface(GRID, height, (i + s) / MESH.nx, (j + t) / MESH.ny)
    back = direction(-1.73, 0.72)  # that of the first view
    assert picked_element(MESH, GRID, height, Ray(tuple(point + 3 * back), tuple(-back))) == element


@given(st.floats(0.3, 0.45), st.floats(0.4, 0.6))
@settings(deadline=None)
def test_of_two_flanks_the_nearer_is_hit(s: float, t: float) -> None:
    height = wave(GRID, 0.3)
    point, back = on_surface(GRID, height, s, t), direction(np.pi, 0.45)
    found = pick(GRID, height, point + 3 * back, -back)
    assert found is not None
    assert found[0] * GRID.scale < s - 0.03  # the point lies behind the crest at 0.24, seen from upstream


@given(st.floats(0, 2 * np.pi), st.floats(0.01, 1.0))
@settings(deadline=None)
def test_rays_past_the_panel_hit_nothing(azimuth: float, beside: float) -> None:
    height = wave(GRID, 0.1)
    rim = np.array([0.5 + (0.71 + beside) * math.cos(azimuth), 0.5 + (0.71 + beside) * math.sin(azimuth), 2.0])
    assert pick(GRID, height, rim, np.array([0.0, 0.0, -1.0])) is None


@pytest.mark.parametrize(
    "ray",
    [
        ((0.5, 0.5, 2.0), (0.0, 0.0, 1.0)),  # away from it
        ((-1.0, 0.5, 0.5), (1.0, 0.0, 0.0)),  # level, above it
        ((-1.0, 0.5, 0.0), (1.0, 0.0, 0.0)),  # level, within it: seen edge-on there is nothing to click on
        ((0.5, 0.5, 2.0), (0.0, 0.0, 0.0)),  # no direction
    ],
)
def test_rays_that_meet_nothing(ray: tuple[Vector, Vector]) -> None:
    assert pick(GRID, wave(GRID, 0.1), np.array(ray[0]), np.array(ray[1])) is None


def test_a_flat_panel_can_be_clicked() -> None:
    rest = np.zeros(GRID.shape)
    found = pick(GRID, rest, np.array([0.25, 0.75, 3.0]), np.array([0.0, 0.0, -1.0]))
    # straight down on a flat panel the point is exact to rounding
    assert found == pytest.approx((0.25 / GRID.scale, 0.75 / GRID.scale), rel=1e-9)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return rig_of(DESIGN)


@pytest.fixture(scope="module")
def scene(rig: Rig) -> Iterator[Scene]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield Scene(server, rig, DESIGN.patches.elements)
    server.stop()


@given(st.floats(0.4, 2.5))
@settings(deadline=None)
def test_all_corners_are_in_the_first_view_and_fill_it(scene: Scene, aspect: float) -> None:
    eye, target = (np.array(v) for v in scene.view(aspect))
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    # the panel with some room for its motion: 1 h is 0.083 at the first exaggeration
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (-0.083, 0, 0.083)])
    offset = corners - eye
    depth = offset @ forward
    assert (depth > 0.05).all()  # the near plane
    tangent = math.tan(FIELD_OF_VIEW / 2)
    screen = np.abs([offset @ right / (depth * tangent * aspect), offset @ up / (depth * tangent)])
    assert screen.max() <= 1  # at 1 a point is on the border of the window
    # upstream of it stands the arrow of the flow, a fifth of the panel long: the plate has most of what is left
    assert screen.max() > 0.8


def test_the_picture_follows_patches_and_heights(scene: Scene, rig: Rig) -> None:
    w = wave(rig.grid, 1.0)
    scene.rebuild(rig.grid, (0, 5))
    assert scene._packer.patched == (0, 5)
    before = scene._panel.glb_data
    scene.show(w, rig.thickness)
    assert scene._panel.glb_data != before
    # w/h = 1 at an exaggeration of 20 on a panel 240 h long
    np.testing.assert_allclose(scene.height, w * 20 / 240, rtol=1e-12)
    shown = scene._panel.glb_data
    scene.show(np.zeros((3, 3)), rig.thickness)  # a frame of another mesh, on its way out
    assert scene._panel.glb_data == shown


def test_the_legend_tells_unit_ends_and_exaggeration(scene: Scene, rig: Rig) -> None:
    legend = scene.legend(rig.thickness)
    for text in ("w / h", "1.27 mm", "±1.91 mm", "height × 20"):
        assert text in legend


def test_what_stands_about_the_panel_follows_its_sides_and_the_flow(scene: Scene, rig: Rig) -> None:
    """And pages whose user has not taken the camera are aimed anew."""
    scene.show(np.zeros(rig.grid.shape), rig.thickness)
    scene.surround(rig.design)
    before, first = scene.view(1.6), scene._server.initial_camera.position
    oblong = msgspec.structs.replace(
        rig.design,
        panel=msgspec.structs.replace(rig.design.panel, width=2 * rig.design.panel.width),
        flow=msgspec.structs.replace(rig.design.flow, yaw_deg=30.0),
    )
    grid = DisplayGrid(oblong.panel.length, oblong.panel.width, oblong.mesh.nx, oblong.mesh.ny)
    scene._aimed[0] = (1.6, before[0])
    scene.rebuild(grid, ())
    scene.show(np.zeros(grid.shape), rig.thickness)
    scene.surround(oblong)
    assert scene._surrounded == pytest.approx((0.5, 1.0, 30.0))
    assert scene.view(1.6) != before
    assert not np.allclose(scene._server.initial_camera.position, first)
    assert scene._aimed[0] == (0.0, before[0])
    scene._aimed.clear()
    scene.rebuild(rig.grid, ())
    scene.show(np.zeros(rig.grid.shape), rig.thickness)
    scene.surround(rig.design)
    assert scene.view(1.6) == before
