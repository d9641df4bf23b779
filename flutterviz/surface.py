"""Owns the shape of the deformed panel as it is drawn: coloured surface, element grid, patch frames and marks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from flutterviz import colormap
from flutterviz.glb import Glb, Part

if TYPE_CHECKING:
    import trimesh

Floats = NDArray[np.floating]

# Lengths in scene units (the panel's longer side is 1).
_LINE_WIDTH: Final = 0.0018  # about one pixel and a half when the panel fills a laptop's screen
_LIFT: Final = 0.0005  # of a frame over the surface: more than the two can differ by bending, too little to be seen

# A frame's rims, from an element's edge inwards, as fractions of the element's shorter side. Dark on either side of the
# gold keeps it visible on grey, blue and red alike; what is left inside shows the displacement.
_FRAME_DARK: Final = (0.0, 0.225)
_FRAME_GOLD: Final = (0.055, 0.195)
# A mark's frame is broader, so that it is told from a patch's without its colour, and lies within one where both are.
_MARK_DARK: Final = (0.0, 0.33)
_MARK_BRIGHT: Final = (0.055, 0.3)
_WITHIN_DARK: Final = (0.225, 0.46)
_WITHIN_BRIGHT: Final = (0.255, 0.43)

_LINE: Final = colormap.single((58, 66, 80))
_DARK: Final = colormap.single((28, 32, 40))
_GOLD: Final = colormap.single((236, 178, 42))
MARK: Final = (214, 93, 177)  # sRGB [0..255]
_BRIGHT: Final = colormap.single(MARK)

# Draw calls share indices: more of them cost the browser, fewer the wire.
_BLOCKS: Final = 4  # draw calls of the plate
_RINGS_TOGETHER: Final = 16  # rings to a draw call

# Rims, height over the surface, and colour.
_Ring = tuple[tuple[float, float], float, NDArray[np.uint16]]
_PATCH_RINGS: Final = ((_FRAME_DARK, _LIFT, _DARK), (_FRAME_GOLD, 2.0 * _LIFT, _GOLD))
_MARK_RINGS: Final = ((_MARK_DARK, _LIFT, _DARK), (_MARK_BRIGHT, 2.0 * _LIFT, _BRIGHT))
_WITHIN_RINGS: Final = ((_WITHIN_DARK, _LIFT, _DARK), (_WITHIN_BRIGHT, 2.0 * _LIFT, _BRIGHT))

_Z_LIMIT: Final = 10.0  # scene units; a diverging run must not take the depth range along


@dataclass(frozen=True)
class DisplayGrid:
    """Where the panel is sampled for display: element edges, and equal sub-cells between them.

    Node (p, q) of the grid is node p * nvy + q in flat arrays; element (i, j) is element i * ny + j.
    """

    length: float
    """Panel length along the flow, x [m]."""
    width: float
    """Panel width across the flow, y [m]."""
    nx: int
    """Elements along x [-]."""
    ny: int
    """Elements along y [-]."""
    per_x: int = 4
    """Sub-cells of an element along x [-]."""
    per_y: int = 8
    """Sub-cells of an element along y [-]."""

    @property
    def shape(self) -> tuple[int, int]:
        """(nvx, nvy), the numbers of nodes along x and y [-]."""
        return self.nx * self.per_x + 1, self.ny * self.per_y + 1

    @cached_property
    def x(self) -> Floats:
        """(nvx,) node positions along the flow [m]."""
        return np.linspace(0.0, self.length, self.shape[0])

    @cached_property
    def y(self) -> Floats:
        """(nvy,) node positions across the flow [m]."""
        return np.linspace(0.0, self.width, self.shape[1])

    @property
    def scale(self) -> float:
        """Scene units to a metre; the longer side of the panel is one scene unit [1/m]."""
        return 1.0 / max(self.length, self.width)


class SurfacePacker:
    """Packs the panel's momentary shape and colours as a GLB; everything that stands still is laid out once.

    The GLB is drawn with unlit, double-sided materials, the plate's with vertex colours. The element grid is not drawn
    over the surface but *in* it, as dark strips between the cells, so it can never flicker against it and shows from
    below as well. Frames of patched and marked elements float a hair above it and below it. Its axes are the panel's
    (x downstream, y across, z up), its unit the scene's (`DisplayGrid.scale`).
    """

    def __init__(self, grid: DisplayGrid, patched: tuple[int, ...] = (), marked: tuple[int, ...] = ()) -> None:
        """Lay out the buffer.

        Args:
            grid: where the panel is sampled.
            patched: ids of the elements that carry a patch, each in 0..nx*ny-1.
            marked: ids of the elements that are pointed out beside, as those of a layout that a search has found.
        """
        beyond = [element for element in (*patched, *marked) if not 0 <= element < grid.nx * grid.ny]
        if beyond:
            raise ValueError(f"no such elements: {beyond}; a {grid.nx} x {grid.ny} mesh has 0..{grid.nx * grid.ny - 1}")
        self.grid: Final = grid
        self.patched: Final = patched
        self.marked: Final = marked
        plate = _plate(grid)
        self._plate: Final = plate
        self._painted = False
        points, weights, parts = [plate.points], [plate.weights], list(plate.parts)
        alone = tuple(element for element in marked if element not in patched)
        within = tuple(element for element in marked if element in patched)
        for elements, rings in ((patched, _PATCH_RINGS), (alone, _MARK_RINGS), (within, _WITHIN_RINGS)):
            for rims, lift, colour in rings if elements else ():
                part = _ring_part(grid, sum(map(len, points)), len(elements), lift, colour)
                points.append(_ring_points(grid, elements, rims))
                weights.append(_interpolation(grid, points[-1]))
                parts.append(part)
        self._weights: Final = sparse.vstack(weights, format="csr") if len(weights) > 1 else plate.weights
        self._glb: Final = Glb(np.vstack(points), len(plate.points), parts)

    def paint(self, colours: NDArray[np.uint16] | None) -> None:
        """Show a map: each element in one colour, in every frame from the next on, instead of the displacement.

        Args:
            colours: (nx * ny, 4) colour of each element as `colormap.sequential_rgba` and `colormap.gltf_rgba` give
                them [0..65535]; they are copied. None goes back to the colours of the displacement.
        """
        if colours is not None:
            wanted = (self.grid.nx * self.grid.ny, 4)
            if colours.shape != wanted or colours.dtype != np.uint16:
                # Colours of another type, as 0..1 or 0..255, would fit and all come out black.
                raise ValueError(f"element colours must be {wanted} of uint16, not {colours.shape} of {colours.dtype}")
            self._glb.colours[:] = colours[self._plate.element]
        self._painted = colours is not None

    def pack(self, z: ArrayLike, values: ArrayLike) -> bytes:
        """One frame.

        Args:
            z: (nvx, nvy) height [scene units]; what is not finite is drawn at rest.
            values: (nvx, nvy) displacement over the colour scale's limit [-], clipped to -1..1; NaN is drawn grey. Not
                looked at while the elements are painted, except for its shape.

        Returns:
            A complete GLB file.
        """
        height, shade = np.asarray(z, dtype=float), np.asarray(values, dtype=float)
        if not height.shape == shade.shape == self.grid.shape:
            raise ValueError(f"z {height.shape} and values {shade.shape} must both have the grid's {self.grid.shape}")
        flat = np.nan_to_num(height.ravel(), posinf=0.0, neginf=0.0).clip(-_Z_LIMIT, _Z_LIMIT)
        if not self._painted:
            self._glb.colours[:] = colormap.gltf_rgba(self._plate.weights @ shade.ravel())
        return self._glb.pack(self._weights @ flat)


def anchor_glb() -> bytes:
    """A GLB of one small cell with the material of every `SurfacePacker`'s.

    A browser forgets a compiled shader with the last material that uses it, and each frame of a stream replaces its
    material. This one, added to the scene once, never replaced and kept out of sight, makes it remember.
    """
    return SurfacePacker(DisplayGrid(1.0, 1.0, 1, 1, 1, 1)).pack(np.zeros((2, 2)), np.zeros((2, 2)))


def to_trimesh(grid: DisplayGrid, z: ArrayLike, values: ArrayLike) -> trimesh.Trimesh:
    """The bare surface, without grid and frames, in the colours of the screen: for exports.

    Args:
        grid: where the panel is sampled.
        z: (nvx, nvy) height [scene units].
        values: (nvx, nvy) displacement over the colour scale's limit [-].

    Returns:
        A mesh of nvx * nvy vertices [scene units], vertex p * nvy + q at node (p, q), faces wound for a normal upwards.
    """
    import trimesh  # here, because exports alone need it, and the page is to open soon

    x, y = np.meshgrid(grid.x * grid.scale, grid.y * grid.scale, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.asarray(z, dtype=float).ravel()])
    colours = colormap.display_rgb(np.ravel(values))
    return trimesh.Trimesh(vertices, _triangles(_cells(grid.shape)), vertex_colors=colours, process=False)


@dataclass(frozen=True)
class _Plate:
    """The cells of the plate and the strips between them, which share their vertices."""

    points: Floats  # (n, 2) vertices, place on the undeformed panel [scene units]
    weights: sparse.csr_array  # (n, nvx * nvy) their interpolation
    element: NDArray[np.intp]  # (n,) the element whose cells a vertex belongs to
    parts: tuple[Part, ...]


@lru_cache(maxsize=4)
def _plate(grid: DisplayGrid) -> _Plate:
    """The plate of a grid; kept, because it is the larger part of the work and a patch toggle does not change it.

    A strip parts the cells of two elements everywhere, so each vertex of a cell belongs to one element only, which is
    counted off and not measured, so that rounding cannot matter. Vertices on the panel's rim, beyond the outermost
    strip, belong to no cell.
    """
    x, seam_x = _split_axis(grid.length * grid.scale, grid.nx, grid.per_x)
    y, seam_y = _split_axis(grid.width * grid.scale, grid.ny, grid.per_y)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    # Along each side an element has per + 1 positions of its own; one before the first lies on the panel's rim.
    i = ((np.arange(len(x)) - 1) // (grid.per_x + 1)).clip(0, grid.nx - 1)
    j = ((np.arange(len(y)) - 1) // (grid.per_y + 1)).clip(0, grid.ny - 1)
    # A piece is a column of elements along y with the strip before it; the last strip of all is a piece of its own.
    per = grid.per_x + 1
    cells = _cells((per + 1, len(y)))
    seam = (seam_x[:per, None] | seam_y).ravel()
    stride, span, together = per * len(y), (per + 1) * len(y), -(-grid.nx // _BLOCKS)
    parts = (
        Part(0, stride, span, grid.nx, together, _triangles(cells[~seam])),
        Part(0, stride, span, grid.nx, together, _triangles(cells[seam]), _LINE),
        Part(grid.nx * stride, stride, 2 * len(y), 1, 1, _triangles(_cells((2, len(y)))), _LINE),
    )
    return _Plate(points, _interpolation(grid, points), (i[:, None] * grid.ny + j).ravel(), parts)


def _split_axis(side: float, elements: int, per: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Positions along one side, each element edge widened to a strip, and which intervals between them are strips."""
    nodes = np.linspace(0.0, side, elements * per + 1)
    edges = nodes[::per]
    between = np.delete(nodes, np.s_[::per])
    positions = np.sort(np.concatenate([between, edges - _LINE_WIDTH / 2, edges + _LINE_WIDTH / 2]))
    return positions, np.arange(len(positions) - 1) % (per + 1) == 0


def _ring_points(grid: DisplayGrid, elements: tuple[int, ...], rims: tuple[float, float]) -> Floats:
    """(elements * ring, 2) vertices of a ring in each element: the outer rim's, then the inner rim's."""
    size = np.array([grid.length / grid.nx, grid.width / grid.ny]) * grid.scale
    corners = np.column_stack(np.divmod(elements, grid.ny)) * size
    ring = np.vstack([_rim(size, grid.per_x, grid.per_y, rim * size.min()) for rim in rims])
    return (corners[:, None] + ring).reshape(-1, 2)


def _ring_part(grid: DisplayGrid, first: int, count: int, lift: float, colour: NDArray[np.uint16]) -> Part:
    """A ring in each of so many elements, drawn once above the panel and once below."""
    around = np.arange(2 * (grid.per_x + grid.per_y))
    after = np.roll(around, -1)
    quads = np.column_stack([around, after, after + len(around), around + len(around)])
    size = 2 * len(around)
    return Part(first, size, size, count, _RINGS_TOGETHER, _triangles(quads), colour, (lift, -lift))


def _rim(size: Floats, per_x: int, per_y: int, inset: float) -> Floats:
    """(2 * (per_x + per_y), 2) a rectangle in an element, counter-clockwise, able to bend where the surface does."""
    x = np.linspace(0.0, size[0], per_x + 1).clip(inset, size[0] - inset)
    y = np.linspace(0.0, size[1], per_y + 1).clip(inset, size[1] - inset)
    sides = ((x[:-1], y[0]), (x[-1], y[:-1]), (x[:0:-1], y[-1]), (x[0], y[:0:-1]))
    return np.vstack([np.column_stack(np.broadcast_arrays(*side)) for side in sides])


def _interpolation(grid: DisplayGrid, points: Floats) -> sparse.csr_array:
    """(len(points), nvx * nvy) bilinear weights of the grid's nodes at points on the panel [scene units]."""
    nvx, nvy = grid.shape
    cells = np.array([nvx - 1, nvy - 1])
    at = (points / (np.array([grid.length, grid.width]) * grid.scale) * cells).clip(0.0, cells)
    lower = np.minimum(at.astype(np.intp), cells - 1)
    u, v = (at - lower).T
    corners = lower @ [nvy, 1] + np.array([[0], [nvy], [1], [nvy + 1]])
    shares = np.array([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    shares[shares < 1e-9] = 0.0  # a node hit exactly but for rounding
    rows = np.arange(0, 4 * len(points) + 1, 4)
    weights = sparse.csr_array((shares.T.ravel(), corners.T.ravel(), rows), shape=(len(points), nvx * nvy))
    weights.eliminate_zeros()  # or a NaN at one node would reach its neighbours with weight zero
    return weights


def _cells(shape: tuple[int, int]) -> NDArray[np.intp]:
    """(cells, 4) corner nodes of the cells of a grid, counter-clockwise from above."""
    nodes = np.arange(shape[0] * shape[1]).reshape(shape)
    corners = nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def _triangles(quads: NDArray[np.intp]) -> NDArray[np.intp]:
    """(2 n, 3) halves of (n, 4) quads, wound alike."""
    return np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
