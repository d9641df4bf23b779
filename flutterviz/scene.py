"""Owns the 3D view: what stands in the scene, how it is moved, and which element a ray from the mouse hits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

from flutterviz import colormap
from flutterviz.heatmap import element_colours
from flutterviz.rig import Rig
from flutterviz.surface import DisplayGrid, SurfacePacker, anchor_glb
from solver import Design, Mesh
from solver.authority import AuthorityMap

Floats = NDArray[np.floating]

EXAGGERATIONS = (1.0, 5.0, 10.0, 20.0, 40.0, 80.0)
FIELD_OF_VIEW = math.radians(40)
TYPICAL_ASPECT = 0.9  # of the free part of a laptop's window between the docked panels
MARGIN = 1.03  # of the camera's distance over that at which the view just fits
RAY_SAMPLES = 400  # on the part of a ray that passes the panel; a hit is then refined linearly


class Scene:
    """The panel and what stands around it, in scene units (the panel's longer side is 1)."""

    def __init__(self, server: viser.ViserServer, rig: Rig, patched: tuple[int, ...]) -> None:
        """Put everything into the scene of a server."""
        self.exaggeration = 20.0
        self.limit = 1.5  # displacement at the ends of the colour scale, over h
        self._server = server
        self._aimed: dict[int, tuple[float, tuple[float, float, float]]] = {}
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map(None)
        server.scene.world_axes.visible = False
        # Inside the first view, or the browser never compiles its shader and does so at each frame instead.
        server.scene.add_glb(
            "/anchor", anchor_glb(), scale=1e-5, position=(0.5, 0.5, -1e-3), cast_shadow=False, receive_shadow=False
        )
        self.grid = rig.grid  # of the picture that is shown, as `height`
        self._packer = SurfacePacker(rig.grid, patched)
        self._painted: AuthorityMap | None = None
        self.height = np.zeros(rig.grid.shape)
        rest = np.zeros(rig.grid.shape)
        self._panel = server.scene.add_glb(
            "/panel", self._packer.pack(rest, rest), cast_shadow=False, receive_shadow=False
        )
        self._surrounded: tuple[float, ...] = ()
        self.surround(rig.design)

    def _aim_first(self) -> None:
        """The view that a page begins with, and returns to on "Reset View"."""
        camera, (position, target) = self._server.initial_camera, self.view(TYPICAL_ASPECT)
        camera.position, camera.look_at, camera.up = position, target, (0.0, 0.0, 1.0)
        camera.fov, camera.near, camera.far = FIELD_OF_VIEW, 0.05, 20.0

    def keep_framed(self, clients: dict[int, viser.ClientHandle]) -> None:
        """Aim the cameras of pages whose window or docked panels changed size, until their user takes the camera."""
        self._aimed = {key: self._aimed[key] for key in clients if key in self._aimed}
        for key, client in clients.items():
            aspect, position = self._aimed.setdefault(key, (TYPICAL_ASPECT, self.view(TYPICAL_ASPECT)[0]))
            untouched = np.allclose(client.camera.position, position, atol=1e-3)
            if untouched and abs(client.camera.aspect - aspect) > 0.01:
                self.aim(client)

    def aim(self, client: viser.ClientHandle) -> None:
        """Move one page's camera so that the panel fills what its docked panels leave free."""
        aspect = client.camera.aspect
        position, target = self.view(aspect)
        self._aimed[client.client_id] = (aspect, position)
        with client.atomic():
            client.camera.position = np.array(position)
            client.camera.look_at = np.array(target)

    def view(self, aspect: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Camera position and target at which panel and flow arrow just fit a window of width/height `aspect`."""
        length, width = self._sides
        points = np.array([(x, y, z) for x in (-0.19 * length, length) for y in (0, width) for z in (-0.1, 0.1)])
        backward = np.array([-0.12, -0.70, 0.72])
        backward /= np.linalg.norm(backward)
        right = np.cross([0, 0, 1], backward)
        right /= np.linalg.norm(right)
        up = np.cross(backward, right)
        tangent = math.tan(FIELD_OF_VIEW / 2)
        target, distance = np.array([0.4 * length, 0.5 * width, 0.0]), 1.0
        for _ in range(8):  # fit, centre, and again: both settle within a few turns
            offset = points - target
            across, upward, near = offset @ right, offset @ up, offset @ backward
            # in view at distance d, if the offset across is below tangent·(d - the offset towards the camera)
            distance = float(np.max(np.maximum(np.abs(across) / max(aspect, 0.1), np.abs(upward)) / tangent + near))
            x, y = across / (distance - near), upward / (distance - near)
            target = target + 0.5 * distance * ((x.min() + x.max()) * right + (y.min() + y.max()) * up)
        eye = target + MARGIN * distance * backward
        return (float(eye[0]), float(eye[1]), float(eye[2])), (float(target[0]), float(target[1]), float(target[2]))

    @property
    def _sides(self) -> tuple[float, float]:
        return self.grid.length * self.grid.scale, self.grid.width * self.grid.scale

    def surround(self, design: Design) -> None:
        """Draw what stands about the panel, and look at all of it, where its sides or the flow's direction change."""
        if self._surrounded != (*self._sides, design.flow.yaw_deg):
            self._surrounded = (*self._sides, design.flow.yaw_deg)
            self._surroundings(design)
            self._aim_first()
            self._aimed = {key: (0.0, position) for key, (_, position) in self._aimed.items()}  # as on another window

    def _surroundings(self, design: Design) -> None:
        """The undeformed outline, the direction of the flow and the names of the edges."""
        scene, (length, width) = self._server.scene, self._sides
        outline = np.array([[0, 0], [length, 0], [length, width], [0, width], [0, 0]])
        corners = np.column_stack([outline, np.zeros(5)])
        segments = np.stack([corners[:-1], corners[1:]], axis=1)
        scene.add_line_segments("/outline", segments, (90, 96, 108), thickness=1.5, thickness_units="screen")
        yaw = math.radians(design.flow.yaw_deg)
        along, aside = np.array([math.cos(yaw), math.sin(yaw), 0]), np.array([-math.sin(yaw), math.cos(yaw), 0])
        centre = np.array([0.5 * length, 0.5 * width, 0.0])
        strokes = []
        for offset in (-0.25, 0.0, 0.25):
            tip = centre - 0.55 * along + offset * aside
            strokes += [(tip - 0.12 * along, tip)]
            strokes += [(tip - 0.045 * along + side * 0.022 * aside, tip) for side in (-1, 1)]
        scene.add_line_segments("/flow", np.array(strokes), (20, 120, 200), thickness=4.0, thickness_units="screen")
        start = centre - 0.61 * along + 0.31 * aside
        scene.add_label("/flow_name", "flow", position=tuple(start), anchor="bottom-center", font_screen_scale=1.1)
        scene.add_label(
            "/axis_x", "x, downstream", position=(0.5 * length, -0.03, 0.0), anchor="top-center", font_screen_scale=0.9
        )

    def rebuild(self, grid: DisplayGrid, patched: tuple[int, ...], marked: tuple[int, ...] = ()) -> None:
        """Lay the panel out again for other patches, other marked elements or another mesh."""
        if (grid, patched, marked) != (self._packer.grid, self._packer.patched, self._packer.marked):
            self._packer = SurfacePacker(grid, patched, marked)
            self._painted = None

    def paint(self, shown: AuthorityMap | None) -> None:
        """Colour every element by a map, until another or none is given; then by the displacement."""
        if shown is self._painted:
            return
        fits = shown is not None and len(shown.values) == self._packer.grid.nx * self._packer.grid.ny
        self._packer.paint(element_colours(shown) if shown is not None and fits else None)
        self._painted = shown

    def show(self, w_over_h: Floats, thickness: float) -> None:
        """Draw the panel: (nvx, nvy) displacement over h, and h [m]."""
        if w_over_h.shape != self._packer.grid.shape:
            return  # a rig for another mesh is on its way
        self.grid = self._packer.grid
        self.height = w_over_h * (thickness * self.grid.scale * self.exaggeration)
        self._panel.glb_data = self._packer.pack(self.height, w_over_h / self.limit)

    def step_exaggeration(self, steps: int) -> None:
        """Draw the displacement higher, or lower if negative, by so many steps of a ladder."""
        place = EXAGGERATIONS.index(self.exaggeration) + steps
        self.exaggeration = EXAGGERATIONS[min(max(place, 0), len(EXAGGERATIONS) - 1)]

    def legend(self, thickness: float) -> str:
        """The colour scale as SVG with its unit, and the exaggeration of the height."""
        svg = colormap.legend_svg(self.limit, title="displacement w / h")
        note = f"h = {1e3 * thickness:.3g} mm · ends at ±{1e3 * self.limit * thickness:.3g} mm"
        height = f"height × {self.exaggeration:g}"
        text = f'<div style="opacity:.75">{note} · {height}</div>'
        return f'<div style="text-align:center;font-size:0.8em;padding-bottom:8px">{svg}{text}</div>'


def pick(grid: DisplayGrid, height: Floats, origin: Floats, direction: Floats) -> tuple[float, float] | None:
    """Where a ray first meets the deformed panel.

    Args:
        grid: where the surface is sampled.
        height: (nvx, nvy) height of the surface [scene units].
        origin: (3,) start of the ray [scene units].
        direction: (3,) its direction.

    Returns:
        (x, y) on the panel [m], or None if the ray misses it.
    """
    if abs(direction[2]) <= 1e-12 * np.linalg.norm(direction):
        return None  # seen edge-on there is nothing to click on
    # the part of the ray within the box that holds the surface: slab by slab
    low = np.array([0.0, 0.0, height.min() - 1e-6])
    high = np.array([grid.length * grid.scale, grid.width * grid.scale, height.max() + 1e-6])
    with np.errstate(all="ignore"):
        enter, leave = np.sort([(low - origin) / direction, (high - origin) / direction], axis=0)
    start, end = max(float(np.nanmax(enter)), 0.0), float(np.nanmin(leave))
    if not start < end:
        return None
    points = origin + np.linspace(start, end, RAY_SAMPLES)[:, None] * direction
    x, y = points[:, 0] / grid.scale, points[:, 1] / grid.scale
    gap = points[:, 2] - _height_at(grid, height, x, y)
    crossing = np.flatnonzero(gap[:-1] * gap[1:] <= 0)
    if not len(crossing):
        return None
    k = crossing[0]
    part = gap[k] / (gap[k] - gap[k + 1]) if gap[k] != gap[k + 1] else 0.0
    hit_x, hit_y = x[k] + part * (x[k + 1] - x[k]), y[k] + part * (y[k + 1] - y[k])
    return float(np.clip(hit_x, 0, grid.length)), float(np.clip(hit_y, 0, grid.width))


@dataclass(frozen=True)
class Ray:
    """Where the mouse points, in scene units."""

    origin: tuple[float, float, float]
    """Where it begins [scene units]."""
    direction: tuple[float, float, float]
    """Where it goes [scene units]."""


def picked_element(mesh: Mesh, grid: DisplayGrid, height: Floats, ray: Ray) -> int | None:
    """Id of the element that a ray first meets, or None; on another panel than is shown, at the same shares of it."""
    point = pick(grid, height, np.array(ray.origin), np.array(ray.direction))
    if point is None:
        return None
    return mesh.element_at(point[0] * (mesh.length / grid.length), point[1] * (mesh.width / grid.width))


def _height_at(grid: DisplayGrid, height: Floats, x: Floats, y: Floats) -> Floats:
    """Bilinear height at points (k,) [m], held at the rim beyond it."""
    nvx, nvy = grid.shape
    s = np.clip(x / grid.length * (nvx - 1), 0, nvx - 1)
    t = np.clip(y / grid.width * (nvy - 1), 0, nvy - 1)
    i, j = np.minimum(s.astype(int), nvx - 2), np.minimum(t.astype(int), nvy - 2)
    s, t = s - i, t - j
    return (
        (1 - s) * (1 - t) * height[i, j]
        + s * (1 - t) * height[i + 1, j]
        + (1 - s) * t * height[i, j + 1]
        + s * t * height[i + 1, j + 1]
    )
