"""Marked elements on the panel: frames of their own beside the gold of the patches, drawn in the scene and cleared."""

import numpy as np
import pytest
from pages import DESIGN, rig
from test_surface import GRID, HEIGHT, LIFT, SHAPE, read
from viser import ViserServer

from flutterviz import colormap
from flutterviz.scene import Scene
from flutterviz.surface import MARK, DisplayGrid, SurfacePacker

MAGENTA = colormap.single(MARK)
GOLD = colormap.single((236, 178, 42))
SIZE = np.array([1.0 / GRID.nx, 0.8 / GRID.ny])  # of an element, in scene units


def places(packer: SurfacePacker, colour: np.ndarray) -> np.ndarray:
    """(n, 2) where the vertices of a colour lie on the panel."""
    glb = read(packer.pack(HEIGHT, SHAPE))
    return glb.position[(glb.colour == colour).all(axis=1), :2]


def elements_at(points: np.ndarray) -> set[int]:
    i, j = (points / SIZE).astype(int).T
    return set((i * GRID.ny + j).tolist())


@pytest.mark.parametrize("patched", [(), (20, 21), (143,)])
def test_marks_lie_within_their_elements(patched: tuple[int, ...]) -> None:
    packer = SurfacePacker(GRID, patched, (20, 40, 143))
    assert elements_at(places(packer, MAGENTA)) == {20, 40, 143}
    assert elements_at(places(packer, GOLD)) == set(patched)


def test_an_element_that_is_patched_and_marked_shows_both() -> None:
    """Seen from above no mark covers gold, nor gold a mark: the mark's rim is inside the patch's."""
    packer = SurfacePacker(GRID, (20,), (20,))
    middle = (np.array(divmod(20, GRID.ny)) + 0.5) * SIZE
    gold, magenta = (
        (SIZE / 2 - np.abs(places(packer, colour) - middle)).min(axis=1)  # from the element's edge inwards
        for colour in (GOLD, MAGENTA)
    )
    assert len(gold) == len(magenta) > 0
    assert gold.max() < magenta.min()
    assert magenta.max() < SIZE.min() / 2  # and something of the displacement is left to see


def test_a_mark_is_told_from_a_patch_without_its_colour() -> None:
    """Its bright ring is half as broad again."""
    gold, mark = SurfacePacker(GRID, (20,)), SurfacePacker(GRID, (), (20,))
    assert _ring_width(mark, MAGENTA) > 1.5 * _ring_width(gold, GOLD)


def _ring_width(packer: SurfacePacker, colour: np.ndarray) -> float:
    """Along y, where an element is longer than its frame is broad: from the outer rim to the inner one."""
    y = np.unique(np.round(places(packer, colour)[:, 1], 6))
    low = (20 % GRID.ny) * SIZE[1]
    from_edge = np.sort(y - low)
    return float(from_edge[1] - from_edge[0])


def test_marks_float_over_the_panel_and_follow_it() -> None:
    slope = np.array([0.3, -0.2])
    x, y = np.meshgrid(GRID.x * GRID.scale, GRID.y * GRID.scale, indexing="ij")
    glb = read(SurfacePacker(GRID, (20,), (20, 60)).pack(x * slope[0] + y * slope[1], SHAPE))
    bright = (glb.colour == MAGENTA).all(axis=1)
    distance = glb.position[bright, 2] - glb.position[bright, :2] @ slope
    assert np.abs(distance).min() > 0.3 * LIFT
    assert np.abs(distance).max() < LIFT
    assert (distance > 0).sum() == (distance < 0).sum()  # seen from above and from below


def test_the_surface_and_the_patches_are_what_they_were() -> None:
    plain, marked = (read(SurfacePacker(GRID, (20, 21), marks).pack(HEIGHT, SHAPE)) for marks in ((), (60, 61)))
    count, faces = len(plain.position), len(plain.faces)
    np.testing.assert_array_equal(marked.position[:count], plain.position)
    np.testing.assert_array_equal(marked.colour[:count], plain.colour)
    np.testing.assert_array_equal(marked.faces[:faces], plain.faces)
    assert len(marked.position) > count


@pytest.mark.parametrize("marked", [(-1,), (GRID.nx * GRID.ny,)])
def test_marks_beyond_the_mesh_are_refused(marked: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="no such elements"):
        SurfacePacker(GRID, (), marked)


def test_the_scene_lays_out_anew_only_when_marks_change(server: ViserServer) -> None:
    scene = Scene(server, rig(), DESIGN.patches.elements)
    grid = rig().grid
    scene.rebuild(grid, (20,), (30, 31))
    packer = scene._packer
    assert packer.marked == (30, 31)
    scene.rebuild(grid, (20,), (30, 31))
    assert scene._packer is packer
    scene.rebuild(grid, (20,))
    assert scene._packer.marked == ()
    coarse = DisplayGrid(grid.length, grid.width, 12, 4)
    scene.rebuild(coarse, (1,), (47,))
    scene.show(np.zeros(coarse.shape), rig().thickness)  # another mesh, with marks
    assert read(scene._panel.glb_data).position.shape[1] == 3
