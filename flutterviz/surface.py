"""The deformed panel as one binary glTF buffer a frame: coloured surface, element grid, patch frames and marks."""

import json
import struct
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from flutterviz import colormap

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

# Rims, height over the surface, and colour.
_Ring = tuple[tuple[float, float], float, NDArray[np.uint16]]
_PATCH_RINGS: Final = ((_FRAME_DARK, _LIFT, _DARK), (_FRAME_GOLD, 2.0 * _LIFT, _GOLD))
_MARK_RINGS: Final = ((_MARK_DARK, _LIFT, _DARK), (_MARK_BRIGHT, 2.0 * _LIFT, _BRIGHT))
_WITHIN_RINGS: Final = ((_WITHIN_DARK, _LIFT, _DARK), (_WITHIN_BRIGHT, 2.0 * _LIFT, _BRIGHT))

_BOUND_WIDTH: Final = 17  # characters of "-1.234567890e+01", which is exact for a float32, and one to spare
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

    The GLB holds one mesh with one unlit, double-sided material and vertex colours: one draw call in the browser. The
    element grid is not drawn over the surface but *in* it, as dark strips between the cells, so it can never flicker
    against it and shows from below as well. Frames of patched and marked elements float a hair above it and below it.
    Its axes are the panel's (x downstream, y across, z up), its unit the scene's (`DisplayGrid.scale`).
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
        plate, lines, weights, element = _plate(grid)
        parts = [plate, lines]
        alone = tuple(element for element in marked if element not in patched)
        within = tuple(element for element in marked if element in patched)
        for elements, rings in ((patched, _PATCH_RINGS), (alone, _MARK_RINGS), (within, _WITHIN_RINGS)):
            if elements:
                frames = _frames(grid, elements, rings)
                weights = sparse.vstack([weights, _interpolation(grid, frames.points)], format="csr")
                parts.append(frames)
        mesh = _joined(parts)
        self._coloured: Final = len(plate.points)
        self._element: Final = element
        self._painted = False
        self._weights: Final = weights
        self._lift: Final = mesh.lift
        self._buffer, self._bounds, start = _layout(mesh)
        count = len(mesh.points)
        self._position: Final = np.ndarray((count, 3), np.float32, self._buffer, start)
        self._colour: Final = np.ndarray((count, 4), np.uint16, self._buffer, start + 12 * count)

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
            self._colour[: self._coloured] = colours[self._element]
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
        self._position[:, 2] = self._weights @ flat + self._lift
        if not self._painted:
            self._colour[: self._coloured] = colormap.gltf_rgba((self._weights @ shade.ravel())[: self._coloured])
        tops = self._position[:, 2]
        for at, bound in zip(self._bounds, (tops.min(), tops.max()), strict=True):
            self._buffer[at : at + _BOUND_WIDTH] = b"%*.9e" % (_BOUND_WIDTH, bound)
        return bytes(self._buffer)


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
    x, y = np.meshgrid(grid.x * grid.scale, grid.y * grid.scale, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.asarray(z, dtype=float).ravel()])
    colours = colormap.display_rgb(np.ravel(values))
    return trimesh.Trimesh(vertices, _triangles(_cells(grid.shape)), vertex_colors=colours, process=False)


@dataclass(frozen=True)
class _Part:
    """Vertices that lie on the panel and move with it."""

    points: Floats  # (n, 2) place on the undeformed panel [scene units]
    lift: Floats  # (n,) height over the deformed panel [scene units]
    colours: NDArray[np.uint16]  # (n, 4) as glTF takes them
    faces: NDArray[np.intp]  # (m, 3) vertices, counter-clockwise from above


def _joined(parts: list[_Part]) -> _Part:
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    return _Part(
        np.vstack([part.points for part in parts]),
        np.hstack([part.lift for part in parts]),
        np.vstack([part.colours for part in parts]),
        np.vstack([part.faces + start for part, start in zip(parts, starts, strict=False)]),
    )


@lru_cache(maxsize=4)
def _plate(grid: DisplayGrid) -> tuple[_Part, _Part, sparse.csr_array, NDArray[np.intp]]:
    """Coloured cells, the dark strips of the element grid between them, both parts' interpolation, and elements.

    The last has (n,) the element that each vertex of the coloured cells belongs to. It is one only, because a strip
    parts the cells of two elements everywhere; and it is counted off, not measured, so that rounding cannot matter.

    Cached, because it is the larger part of the work and a patch toggle does not change it.
    """
    x, seam_x = _split_axis(grid.length * grid.scale, grid.nx, grid.per_x)
    y, seam_y = _split_axis(grid.width * grid.scale, grid.ny, grid.per_y)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    quads = _cells((len(x), len(y)))
    seam = (seam_x[:, None] | seam_y).ravel()
    plate, lines = _flat_part(points, quads[~seam]), _flat_part(points, quads[seam])
    # Along each side an element has per + 1 positions of its own; one before the first lies on the panel's rim.
    p, q = np.divmod(np.unique(quads[~seam]), len(y))  # in the order of the part's vertices
    element = (p - 1) // (grid.per_x + 1) * grid.ny + (q - 1) // (grid.per_y + 1)
    return plate, lines, _interpolation(grid, np.vstack([plate.points, lines.points])), element


def _split_axis(side: float, elements: int, per: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Positions along one side, each element edge widened to a strip, and which intervals between them are strips."""
    nodes = np.linspace(0.0, side, elements * per + 1)
    edges = nodes[::per]
    between = np.delete(nodes, np.s_[::per])
    positions = np.sort(np.concatenate([between, edges - _LINE_WIDTH / 2, edges + _LINE_WIDTH / 2]))
    return positions, np.arange(len(positions) - 1) % (per + 1) == 0


def _flat_part(points: Floats, quads: NDArray[np.intp]) -> _Part:
    """The part of a set of points that some quads use, in the colour of the grid lines."""
    used, quads = np.unique(quads, return_inverse=True)
    colours = np.tile(_LINE, (len(used), 1))
    return _Part(points[used], np.zeros(len(used)), colours, _triangles(quads.reshape(-1, 4)))


def _frames(grid: DisplayGrid, elements: tuple[int, ...], rings: tuple[_Ring, _Ring]) -> _Part:
    """Frames of elements: a bright ring on a wider dark one, once above the panel and once below."""
    size = np.array([grid.length / grid.nx, grid.width / grid.ny]) * grid.scale
    corners = np.column_stack(np.divmod(elements, grid.ny)) * size
    around = np.arange(2 * (grid.per_x + grid.per_y))
    after = np.roll(around, -1)
    quads = np.column_stack([around, after, after + len(around), around + len(around)])  # outer rim, then inner rim
    parts = []
    for rims, lift, colour in rings:
        ring = np.vstack([_rim(size, grid.per_x, grid.per_y, rim * size.min()) for rim in rims])
        points = (corners[:, None] + ring).reshape(-1, 2)
        each = np.arange(len(elements))[:, None, None] * len(ring)
        faces = _triangles((each + quads).reshape(-1, 4))
        colours = np.tile(colour, (len(points), 1))
        parts += [_Part(points, np.full(len(points), over), colours, faces) for over in (lift, -lift)]
    return _joined(parts)


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


def _layout(mesh: _Part) -> tuple[bytearray, tuple[int, int], int]:
    """The GLB with everything but heights, the offsets in it of the lowest and highest z, and that of the positions.

    glTF demands the bounds of the positions in its JSON; they stand there as numbers of fixed width, to be overwritten.
    """
    position = np.column_stack([mesh.points, mesh.lift]).astype(np.float32)
    index_type, index_code = (np.uint16, 5123) if len(position) < 65536 else (np.uint32, 5125)
    blobs = (position, mesh.colours, mesh.faces.astype(index_type))  # each a multiple of four bytes, as glTF wants
    starts = np.cumsum([0, *(blob.nbytes for blob in blobs)]).tolist()
    low, high = [*position.min(0)[:2].tolist(), "z"], [*position.max(0)[:2].tolist(), "z"]
    count = len(position)
    document = {
        "asset": {"version": "2.0", "generator": "flutterviz"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "panel"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5123, "count": count, "type": "VEC4", "normalized": True},
            {"bufferView": 2, "componentType": index_code, "count": mesh.faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": blob.nbytes, "target": target}
            for start, blob, target in zip(starts, blobs, (34962, 34962, 34963), strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(document, separators=(",", ":")).replace('"z"', " " * _BOUND_WIDTH).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + starts[-1]
    head = struct.pack("<4sIII4s", b"glTF", 2, total, len(text), b"JSON") + text
    head += struct.pack("<I4s", starts[-1], b"BIN\0")
    lowest = head.index(b" " * _BOUND_WIDTH)
    highest = head.index(b" " * _BOUND_WIDTH, lowest + _BOUND_WIDTH)
    return bytearray(head + b"".join(blob.tobytes() for blob in blobs)), (lowest, highest), len(head)
