"""Owns the GLB of a surface that moves: laid out once, with heights and colours in it that are written over each frame.

What a frame costs to send is decided here. Indices do not compress, so pieces that are alike share theirs: those of a
column of elements, or of the frame of an element, stand in the file for a few of them, and are drawn from vertex after
vertex. Heights do compress, once they are rounded to what can be seen.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Run = tuple[int, int]
"""First of some vertices that follow each other, and their number."""

_STEP: Final = 2.0**-16  # scene units, about a hundredth of a pixel, to which places are rounded
_BOUND_WIDTH: Final = 17  # characters of "-1.234567890e+01", which is exact for a float32, and one to spare
_FLOAT, _SHORT, _INT = 5126, 5123, 5125  # glTF's component types


@dataclass(frozen=True)
class Part:
    """Pieces that are alike, one after the other, in one colour or in those of their vertices."""

    first: int
    """Vertex with which the first piece begins."""
    stride: int
    """Vertices from the beginning of a piece to that of the next."""
    span: int
    """Vertices that a piece reaches over; more than `stride` where it shares some with the next."""
    pieces: int
    """How many there are."""
    together: int
    """How many are one draw call, and share indices with the others."""
    faces: NDArray[np.intp]
    """(m, 3) triangles of a piece, by vertices of its own, counter-clockwise from above."""
    colour: NDArray[np.uint16] | None = None
    """(4,) linear RGBA [0..65535]; None to take those of the vertices."""
    lifts: tuple[float, ...] = (0.0,)
    """Heights over its vertices at which it is drawn, once at each [scene units]."""

    def calls(self) -> Iterator[tuple[Run, int]]:
        """The vertices and the number of pieces of each draw call."""
        for piece in range(0, self.pieces, self.together):
            count = min(self.together, self.pieces - piece)
            yield (self.first + piece * self.stride, (count - 1) * self.stride + self.span), count

    def indices(self) -> NDArray[np.integer]:
        """(together · m · 3,) indices of a draw call; a last one of fewer pieces takes the first of them."""
        pieces = np.arange(min(self.pieces, self.together))
        found = (pieces[:, None, None] * self.stride + self.faces).ravel()
        return found.astype(np.uint16 if found.max() < 65536 else np.uint32)


class Glb:
    """A GLB in memory, in which heights and colours are written over."""

    def __init__(self, points: Floats, coloured: int, parts: list[Part]) -> None:
        """Lay it out.

        Args:
            points: (n, 2) places of the vertices on the undeformed panel [scene units].
            coloured: how many of them, from the first on, have colours of their own.
            parts: what is drawn.
        """
        position = np.zeros((len(points), 3), np.float32)
        position[:, :2] = _rounded(points)
        document = _Document(position)
        for part in parts:
            document.draw(part)
        self._buffer, self._bounds, start = document.written(coloured)
        self._z: Final = np.ndarray(position.shape, np.float32, self._buffer, start)[:, 2]
        self.colours: Final = np.ndarray((coloured, 4), np.uint16, self._buffer, start + position.nbytes)
        """(coloured, 4) linear RGBA of the vertices, to be written over [0..65535]."""

    def pack(self, heights: Floats) -> bytes:
        """The file with its vertices at heights (n,) [scene units]."""
        z = _rounded(heights)
        self._z[:] = z
        for (first, count), places in self._bounds.items():
            run = z[first : first + count]
            for at, bound in zip(places, (run.min(), run.max()), strict=True):
                self._buffer[at : at + _BOUND_WIDTH] = b"%*.9e" % (_BOUND_WIDTH, bound)
        return bytes(self._buffer)


def _rounded(places: Floats) -> Floats:
    """Places on a grid too fine to be seen: their last bits would be noise, which no compression makes smaller."""
    return np.rint(places * (1.0 / _STEP)) * _STEP


@dataclass
class _Document:
    """A glTF document that is being written; vertices, indices and materials that are used twice are in it once."""

    position: NDArray[np.float32]
    meshes: list[dict[str, Any]] = field(default_factory=list)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    indices: bytes = b""
    materials: dict[bytes | None, int] = field(default_factory=dict)
    numbers: dict[tuple[object, ...], int] = field(default_factory=dict)  # of the accessors, by what they are of
    orders: dict[bytes, int] = field(default_factory=dict)  # where indices begin

    def draw(self, part: Part) -> None:
        """Add a part."""
        indices = part.indices()
        blob, kind = indices.tobytes(), _SHORT if indices.dtype == np.uint16 else _INT
        if blob not in self.orders:
            self.orders[blob] = len(self.indices)
            self.indices += blob + bytes(-len(blob) % 4)
        colour = None if part.colour is None else part.colour.tobytes()
        material = self.materials.setdefault(colour, len(self.materials))
        primitives = []
        for run, pieces in part.calls():
            attributes = {"POSITION": self._accessor(0, 12 * run[0], _FLOAT, run[1], "VEC3")}
            if part.colour is None:
                attributes["COLOR_0"] = self._accessor(1, 8 * run[0], _SHORT, run[1], "VEC4")
            order = self._accessor(2, self.orders[blob], kind, pieces * part.faces.size, "SCALAR")
            primitives.append({"attributes": attributes, "indices": order, "material": material})
        self.nodes += [{"mesh": len(self.meshes), "translation": [0.0, 0.0, lift]} for lift in part.lifts]
        self.meshes.append({"primitives": primitives})

    def _accessor(self, view: int, start: int, kind: int, count: int, shape: str) -> int:
        number = self.numbers.setdefault((view, start, count), len(self.accessors))
        if number == len(self.accessors):
            entry = {"bufferView": view, "byteOffset": start, "componentType": kind, "count": count, "type": shape}
            self.accessors.append(entry | ({"normalized": True} if view == 1 else {}))
        return number

    def written(self, coloured: int) -> tuple[bytearray, dict[Run, tuple[int, int]], int]:
        """The file, where in it the lowest and the highest z of each run of vertices stand, and its positions begin.

        glTF demands the bounds of positions in its JSON; they stand there as numbers of fixed width, written over.
        """
        runs = []
        for entry in self.accessors:
            if entry["bufferView"] == 0:
                first, count = entry["byteOffset"] // 12, entry["count"]
                flat = self.position[first : first + count, :2]
                entry["min"], entry["max"] = ([*ends.tolist(), "z"] for ends in (flat.min(axis=0), flat.max(axis=0)))
                runs.append((first, count))
        blobs = (self.position.tobytes(), bytes(8 * coloured), self.indices)
        starts = np.cumsum([0, *map(len, blobs)]).tolist()
        kinds = ({"byteStride": 12, "target": 34962}, {"byteStride": 8, "target": 34962}, {"target": 34963})
        document = {
            "asset": {"version": "2.0", "generator": "flutterviz"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.nodes)))}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": [_material(colour) for colour in self.materials],
            "accessors": self.accessors,
            "bufferViews": [
                {"buffer": 0, "byteOffset": start, "byteLength": len(blob), **kind}
                for start, blob, kind in zip(starts, blobs, kinds, strict=False)
            ],
            "buffers": [{"byteLength": starts[-1]}],
        }
        text = json.dumps(document, separators=(",", ":")).replace('"z"', " " * _BOUND_WIDTH).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + starts[-1]
        head = struct.pack("<4sIII4s", b"glTF", 2, total, len(text), b"JSON") + text
        head += struct.pack("<I4s", starts[-1], b"BIN\0")
        places = [found.start() for found in re.finditer(b" " * _BOUND_WIDTH, head)]
        bounds = dict(zip(runs, zip(places[::2], places[1::2], strict=True), strict=True))
        return bytearray(head + b"".join(blobs)), bounds, len(head)


def _material(colour: bytes | None) -> dict[str, Any]:
    unlit: dict[str, Any] = {"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}
    if colour is not None:
        factor = np.frombuffer(colour, np.uint16) / 65535.0
        unlit["pbrMetallicRoughness"] = {"baseColorFactor": factor.tolist()}
    return unlit
