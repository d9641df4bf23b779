"""The panel's GLB: a valid file whose surface, grid and frames follow the shape and the colours that were asked for."""

import io
import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trimesh
import zstandard
from trimesh.visual import ColorVisuals, TextureVisuals

from flutterviz import colormap
from flutterviz.surface import DisplayGrid, SurfacePacker, anchor_glb, to_trimesh

GRID = DisplayGrid(length=0.5, width=0.4, nx=24, ny=6)
PATCHED = (20, 21, 26, 27, 143)
X, Y = np.meshgrid(GRID.x * GRID.scale, GRID.y * GRID.scale, indexing="ij")
SHAPE = np.sin(2 * np.pi * X) * np.sin(np.pi * Y / 0.8)
HEIGHT = 0.1 * SHAPE
STEP = 2.0**-16  # to which places are rounded
FLOAT = 1e-6  # of float32
LIFT = 1.1e-3  # the highest that a frame floats over the surface


@dataclass(frozen=True)
class Glb:
    """A GLB taken apart by the specification, with no library in between: what is drawn, primitive by primitive."""

    document: dict[str, Any]
    position: np.ndarray
    colour: np.ndarray
    faces: np.ndarray


def array(document: dict[str, Any], binary: bytes, accessor: int) -> np.ndarray:
    """The numbers of an accessor."""
    entry = document["accessors"][accessor]
    view = document["bufferViews"][entry["bufferView"]]
    dtype = np.dtype({5126: "<f4", 5123: "<u2", 5125: "<u4"}[entry["componentType"]])
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[entry["type"]]
    assert view.get("byteStride", dtype.itemsize) == columns * dtype.itemsize
    size = entry["count"] * columns * dtype.itemsize
    assert entry["byteOffset"] + size <= view["byteLength"]
    assert entry["byteOffset"] % dtype.itemsize == 0
    return np.frombuffer(binary, dtype, entry["count"] * columns, view["byteOffset"] + entry["byteOffset"]).reshape(
        -1, columns
    )


def read(data: bytes) -> Glb:
    magic, version, total, text_size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, total, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + text_size])
    size, kind = struct.unpack_from("<I4s", data, 20 + text_size)
    assert kind == b"BIN\0"
    binary = data[28 + text_size :]
    assert size == len(binary) == document["buffers"][0]["byteLength"]
    position, colour, faces, count, drawn = [], [], [], 0, set()
    for node in (document["nodes"][k] for k in document["scenes"][0]["nodes"]):
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            places = array(document, binary, primitive["attributes"]["POSITION"])
            bounds = document["accessors"][primitive["attributes"]["POSITION"]]
            np.testing.assert_array_equal(np.float32(bounds["min"]), places.min(axis=0))
            np.testing.assert_array_equal(np.float32(bounds["max"]), places.max(axis=0))
            triangles = array(document, binary, primitive["indices"]).reshape(-1, 3).astype(int)
            assert triangles.max() < len(places)
            used, triangles = np.unique(triangles, return_inverse=True)
            drawn |= set((bounds["byteOffset"] // 12 + used).tolist())
            material = document["materials"][primitive["material"]]
            if "COLOR_0" in primitive["attributes"]:
                shades = array(document, binary, primitive["attributes"]["COLOR_0"])[used]
            else:
                shade = np.array(material["pbrMetallicRoughness"]["baseColorFactor"])
                shades = np.tile(np.rint(65535 * shade).astype(np.uint16), (len(used), 1))
            position.append(places[used].astype(float) + node["translation"])
            colour.append(shades)
            faces.append(triangles.reshape(-1, 3) + count)
            count += len(used)
    assert drawn == set(range(document["bufferViews"][0]["byteLength"] // 12))  # no vertex is idle
    return Glb(document, np.vstack(position), np.vstack(colour), np.vstack(faces))


@pytest.mark.parametrize("patched", [(), PATCHED, tuple(range(144))], ids=["bare", "some", "all"])
def test_the_file_is_sound(patched: tuple[int, ...]) -> None:
    glb = read(SurfacePacker(GRID, patched).pack(HEIGHT, SHAPE))  # which looks at indices and bounds as well
    assert len(glb.position) == len(glb.colour)
    for material in glb.document["materials"]:
        assert material["doubleSided"]
        assert "KHR_materials_unlit" in material["extensions"]
    assert len(glb.document["accessors"]) < 40  # draw calls are few, however many patches


def test_many_vertices_take_wider_indices() -> None:
    grid = DisplayGrid(1.0, 1.0, nx=2, ny=100, per_x=8, per_y=80)
    glb = read(SurfacePacker(grid).pack(np.zeros(grid.shape), np.zeros(grid.shape)))
    kinds = {glb.document["accessors"][p["indices"]]["componentType"] for p in glb.document["meshes"][0]["primitives"]}
    assert kinds == {5125}
    assert (glb.position.max(axis=0) > 0.999).tolist() == [True, True, False]


def test_a_frame_is_small_on_the_wire() -> None:
    """Under viser's own compression; it was 130 kB before indices were shared and heights rounded."""
    data = SurfacePacker(GRID, PATCHED).pack(HEIGHT, SHAPE)
    assert len(zstandard.ZstdCompressor(level=1).compress(data)) < 65_000


def test_trimesh_opens_it_and_the_bounding_box_follows_the_shape() -> None:
    packer = SurfacePacker(GRID, PATCHED)
    for amplitude in (0.0, 0.1, 0.3):
        scene = trimesh.load_scene(io.BytesIO(packer.pack(amplitude * SHAPE, SHAPE)), file_type="glb")
        low, high = scene.bounds
        np.testing.assert_allclose([low[:2], high[:2]], [[0.0, 0.0], [1.0, 0.8]], atol=2e-3)  # half a grid line
        assert low[2] == pytest.approx(-amplitude, abs=LIFT)
        assert high[2] == pytest.approx(amplitude, abs=LIFT)


def test_every_vertex_lies_on_the_deformed_panel() -> None:
    packer = SurfacePacker(GRID, PATCHED)
    slope = np.array([0.3, -0.2])
    position = read(packer.pack(X * slope[0] + Y * slope[1], SHAPE)).position
    inside = np.clip(position[:, :2], [0.0, 0.0], [1.0, 0.8])  # the outermost grid lines reach over the rim
    distance = position[:, 2] - inside @ slope
    bare = len(read(SurfacePacker(GRID).pack(HEIGHT, SHAPE)).position)
    assert np.abs(distance[:bare]).max() < STEP  # half a step of z, and as much again for x and y
    assert np.abs(distance).max() < LIFT
    assert np.abs(distance[bare:]).min() > 0.3 * LIFT  # frames never touch the surface
    assert (distance[bare:] > 0).sum() == (distance[bare:] < 0).sum()  # seen from above and from below


def test_faces_look_up_and_cover_the_panel_once() -> None:
    glb = read(SurfacePacker(GRID).pack(HEIGHT, SHAPE))
    a, b, c = (glb.position[glb.faces[:, k], :2].astype(float) for k in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(0.8, rel=5e-3)  # and the half line over the rim


def test_surface_vertices_carry_the_scale_and_lines_do_not() -> None:
    packer = SurfacePacker(GRID)
    low, high = (read(packer.pack(HEIGHT, np.full(GRID.shape, value))).colour for value in (-1.0, 1.0))
    moved = (low != high).any(axis=1)
    np.testing.assert_array_equal(np.unique(low[moved], axis=0), colormap.gltf_rgba([-1.0]))
    np.testing.assert_array_equal(np.unique(high[moved], axis=0), colormap.gltf_rgba([1.0]))
    assert len(np.unique(low[~moved], axis=0)) == 1
    assert moved.sum() >= GRID.shape[0] * GRID.shape[1]


def test_a_toggled_patch_changes_only_the_frames() -> None:
    bare, some = (read(SurfacePacker(GRID, patched).pack(HEIGHT, SHAPE)) for patched in ((), (20,)))
    vertices, faces = len(bare.position), len(bare.faces)
    np.testing.assert_array_equal(some.position[:vertices], bare.position)
    np.testing.assert_array_equal(some.colour[:vertices], bare.colour)
    np.testing.assert_array_equal(some.faces[:faces], bare.faces)
    frame = some.position[vertices:, :2] / (GRID.scale * np.array([0.5 / 24, 0.4 / 6]))  # in elements
    assert (frame.min(axis=0) >= np.array([3, 2]) - 24 * STEP).all()  # element 20 = 3 * 6 + 2
    assert (frame.max(axis=0) <= np.array([4, 3]) + 24 * STEP).all()


def test_a_frame_is_equally_wide_on_all_sides() -> None:
    position = read(SurfacePacker(GRID, (0,)).pack(np.zeros(GRID.shape), SHAPE)).position
    bare = len(read(SurfacePacker(GRID).pack(HEIGHT, SHAPE)).position)
    frame = position[bare:]
    for level in np.unique(frame[:, 2]):
        ring = frame[frame[:, 2] == level, :2]
        outer, inner = ring[: len(ring) // 2], ring[len(ring) // 2 :]
        widths = [*(inner.min(axis=0) - outer.min(axis=0)), *(outer.max(axis=0) - inner.max(axis=0))]
        assert np.ptp(widths) <= 2 * STEP
        assert 0.1 / 24 < widths[0] < 0.25 / 24


def test_numbers_that_are_not_finite_still_make_a_file() -> None:
    z, values = HEIGHT.copy(), SHAPE.copy()
    z[5, 5], z[6, 6], z[7, 7], values[9, 9] = np.nan, np.inf, 1e300, np.nan
    glb = read(SurfacePacker(GRID, PATCHED).pack(z, values))
    assert np.isfinite(glb.position).all()
    missing = (glb.colour == colormap.gltf_rgba([np.nan])[0]).all(axis=1)
    assert 1 <= missing.sum() <= 4  # the node itself and what a grid line beside it repeats


def test_what_does_not_fit_the_mesh_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no such elements: \[144\]"):
        SurfacePacker(GRID, (3, 144))
    with pytest.raises(ValueError, match=r"must both have the grid's \(97, 49\)"):
        SurfacePacker(GRID).pack(HEIGHT.T, SHAPE)


def test_the_anchor_shares_material_and_vertex_format_and_is_small() -> None:
    anchor, frame = read(anchor_glb()), read(SurfacePacker(GRID).pack(HEIGHT, SHAPE))
    assert anchor.document["materials"] == frame.document["materials"]
    kinds = [
        {frozenset(p["attributes"]) for m in glb.document["meshes"] for p in m["primitives"]} for glb in (anchor, frame)
    ]
    assert kinds[0] == kinds[1]  # with and without colours of their own: a shader each
    assert len(anchor_glb()) < 4000


def test_the_exported_mesh_has_the_grid_its_heights_and_its_colours() -> None:
    mesh = to_trimesh(GRID, HEIGHT, SHAPE)
    assert mesh.vertices.shape == (97 * 49, 3)
    assert mesh.faces.shape == (2 * 96 * 48, 3)
    np.testing.assert_allclose(mesh.vertices[:, 2], HEIGHT.ravel())
    assert mesh.face_normals[:, 2].min() > 0
    assert isinstance(mesh.visual, ColorVisuals)
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], colormap.display_rgb(SHAPE.ravel()))
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    again = trimesh.load_mesh(io.BytesIO(data), file_type="glb")
    assert again.faces.shape == mesh.faces.shape


ELEMENTS = GRID.nx * GRID.ny
MARKED = (0, 5, 20, 77, 138, 143)  # the panel's corners and some in between; no two are neighbours


def middles_shown(data: bytes) -> np.ndarray:
    """(nx * ny, 4) the colour shown at the middle of each element, as an independent reader finds it [0..65535]."""
    triangles, shades = [], []
    for mesh in trimesh.load_scene(io.BytesIO(data), file_type="glb").geometry.values():
        assert isinstance(mesh, trimesh.Trimesh)
        assert isinstance(mesh.visual, TextureVisuals)  # the reader keeps vertex colours of a mesh with a material here
        if "color" in mesh.visual.vertex_attributes:
            triangles.append(mesh.vertices[mesh.faces][:, :, :2])
            shades.append(np.asarray(mesh.visual.vertex_attributes["color"])[mesh.faces])
    size = np.array([GRID.length / GRID.nx, GRID.width / GRID.ny]) * GRID.scale
    # Off the exact middle, where cells meet, and well inside one triangle.
    points = (np.column_stack(np.divmod(np.arange(ELEMENTS), GRID.ny)) + np.array([0.55, 0.53])) * size
    a, b, c = np.moveaxis(np.concatenate(triangles), 1, 0)
    sides = [
        (q - p)[None, :, 0] * (points[:, None, 1] - p[None, :, 1])
        - (q - p)[None, :, 1] * (points[:, None, 0] - p[None, :, 0])
        for p, q in ((a, b), (b, c), (c, a))
    ]
    inside = (np.array(sides) > 0).all(axis=0)
    assert (inside.sum(axis=1) == 1).all()
    corners = np.concatenate(shades)[inside.argmax(axis=1)]
    assert (corners == corners[:, :1]).all()  # one flat colour over the triangle
    return corners[:, 0]


def marked_map() -> np.ndarray:
    """(nx * ny, 4) a map with much at `MARKED` and little elsewhere."""
    return colormap.sequential_rgba(np.isin(np.arange(ELEMENTS), MARKED).astype(float))


def test_painted_elements_show_their_colour_and_neighbours_do_not() -> None:
    packer = SurfacePacker(GRID)
    packer.paint(marked_map())
    shown = middles_shown(packer.pack(HEIGHT, SHAPE))
    little, much = colormap.sequential_rgba([0.0, 1.0])
    marked = np.isin(np.arange(ELEMENTS), MARKED)
    assert (shown[marked] == much).all()
    assert (shown[~marked] == little).all()


@pytest.mark.parametrize("grid", [GRID, DisplayGrid(0.3, 0.7, 5, 3, 1, 1), DisplayGrid(1.0, 1.0, 48, 12, 8, 16)])
def test_every_coloured_vertex_has_the_colour_of_the_element_it_lies_in(grid: DisplayGrid) -> None:
    # Each element's number is written into its colour.
    number = np.arange(grid.nx * grid.ny)
    painted = np.column_stack([number + 1, 2 * number, 3 * number, np.full(len(number), 65535)]).astype(np.uint16)
    packer = SurfacePacker(grid)
    rest = np.zeros(grid.shape)
    low, high = (read(packer.pack(rest, rest + value)) for value in (-1.0, 1.0))
    coloured = (low.colour != high.colour).any(axis=1)
    packer.paint(painted)
    glb = read(packer.pack(rest, rest))
    size = np.array([grid.length / grid.nx, grid.width / grid.ny]) * grid.scale
    i, j = np.floor(glb.position[coloured, :2] / size).astype(int).T
    np.testing.assert_array_equal(glb.colour[coloured], painted[i * grid.ny + j])
    np.testing.assert_array_equal(glb.colour[~coloured], low.colour[~coloured])
    per_element = np.bincount(glb.colour[coloured, 0] - 1)
    assert (per_element == (grid.per_x + 1) * (grid.per_y + 1)).all()


def test_painting_leaves_lines_and_frames_alone() -> None:
    packer = SurfacePacker(GRID, PATCHED)
    plain = read(packer.pack(HEIGHT, np.zeros(GRID.shape)))
    packer.paint(marked_map())
    painted = read(packer.pack(HEIGHT, np.zeros(GRID.shape)))
    coloured = (plain.colour == colormap.gltf_rgba([0.0])[0]).all(axis=1)
    np.testing.assert_array_equal(painted.colour[~coloured], plain.colour[~coloured])
    np.testing.assert_array_equal(painted.position, plain.position)
    np.testing.assert_array_equal(painted.faces, plain.faces)


def test_a_painted_panel_still_moves_and_keeps_its_colours() -> None:
    packer, plain = SurfacePacker(GRID, PATCHED), SurfacePacker(GRID, PATCHED)
    packer.paint(marked_map())
    first = read(packer.pack(HEIGHT, SHAPE))
    second = read(packer.pack(-2.0 * HEIGHT, -SHAPE))
    np.testing.assert_array_equal(second.colour, first.colour)
    np.testing.assert_array_equal(second.position, read(plain.pack(-2.0 * HEIGHT, -SHAPE)).position)
    assert np.abs(second.position[:, 2] - first.position[:, 2]).max() > 0.2


def test_unpainted_is_as_if_never_painted() -> None:
    packer = SurfacePacker(GRID, PATCHED)
    packer.pack(HEIGHT, SHAPE)
    packer.paint(marked_map())
    painted = packer.pack(-HEIGHT, -SHAPE)
    packer.paint(None)
    fresh = SurfacePacker(GRID, PATCHED).pack(0.5 * HEIGHT, 0.5 * SHAPE)
    assert packer.pack(0.5 * HEIGHT, 0.5 * SHAPE) == fresh
    assert len(painted) == len(fresh)


def test_painting_again_replaces_the_map_and_later_changes_of_it_do_not_show() -> None:
    packer, again = SurfacePacker(GRID), SurfacePacker(GRID)
    packer.paint(marked_map())
    later = marked_map()[::-1].copy()
    again.paint(later)
    packer.paint(later)
    later[:] = 0
    assert packer.pack(HEIGHT, SHAPE) == again.pack(HEIGHT, SHAPE)
    assert read(packer.pack(HEIGHT, SHAPE)).colour.any(axis=1).all()


@pytest.mark.parametrize(
    ("colours", "message"),
    [
        (np.zeros((143, 4), np.uint16), r"must be \(144, 4\) of uint16, not \(143, 4\) of uint16"),
        (np.zeros((144, 3), np.uint16), r"not \(144, 3\)"),
        (np.zeros((24, 6, 4), np.uint16), r"not \(24, 6, 4\)"),
        (np.zeros((144, 4)), r"not \(144, 4\) of float64"),
    ],
)
def test_colours_that_do_not_fit_the_elements_are_refused(colours: np.ndarray, message: str) -> None:
    packer = SurfacePacker(GRID)
    before = packer.pack(HEIGHT, SHAPE)
    with pytest.raises(ValueError, match=message) as caught:
        packer.paint(colours)
    assert "\n" not in str(caught.value)
    assert packer.pack(HEIGHT, SHAPE) == before  # and nothing has changed
