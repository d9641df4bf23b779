"""The layouts that a search goes through: how many there are, by counts of another kind, and which are allowed."""

from itertools import combinations, product

import numpy as np
import pytest
from fakescores import coarse, mirrored

from solver import load_design
from solver.assembly import PlateMatrices
from solver.layouts import Layout, allowed, layout, most_elements, patch_mass, shapes_of, union, units_of
from solver.mesh import Mesh
from solver.task import Task

SEED = load_design("seed-840")
FINE = Mesh.of(SEED.panel, SEED.mesh)


def rectangles(nx: int, ny: int) -> set[Layout]:
    """Every rectangle of a mesh, as the elements between two corners."""
    corners = list(product(range(nx), range(ny)))
    return {
        tuple(i * ny + j for i, j in corners if min(a, c) <= i <= max(a, c) and min(b, d) <= j <= max(b, d))
        for (a, b), (c, d) in product(corners, corners)
    }


def test_there_are_900_symmetric_rectangles_on_24_by_6() -> None:
    """24·25/2 stretches in x, and three widths about y = b/2."""
    shapes = list(shapes_of(FINE, Task(method="exhaustive")))
    assert len(shapes) == len(set(shapes)) == 24 * 25 // 2 * 3 == 900
    assert all(mirrored(SEED, shape) for shape in shapes)


def test_there_are_6300_rectangles_on_24_by_6() -> None:
    shapes = list(shapes_of(FINE, Task(method="exhaustive", symmetric=False)))
    assert len(shapes) == len(set(shapes)) == 300 * 21
    # an element (i, j) lies in (i + 1)(24 - i)(j + 1)(6 - j) of them
    for e in (0, 20, 77, 143):
        i, j = divmod(e, 6)
        assert sum(e in shape for shape in shapes) == (i + 1) * (24 - i) * (j + 1) * (6 - j)


@pytest.mark.parametrize(("nx", "ny"), [(4, 4), (5, 3), (3, 5), (2, 6), (6, 2)])
def test_rectangles_are_those_between_two_corners(nx: int, ny: int) -> None:
    design = coarse(nx, ny)
    mesh, every = Mesh.of(design.panel, design.mesh), rectangles(nx, ny)
    shapes = list(shapes_of(mesh, Task(method="exhaustive", symmetric=False)))
    assert len(shapes) == len(every)
    assert set(shapes) == every
    symmetric = list(shapes_of(mesh, Task(method="exhaustive")))
    assert len(symmetric) == len(set(symmetric))
    assert set(symmetric) == {shape for shape in every if mesh.mirror_image(shape) == shape}


@pytest.mark.parametrize(("nx", "ny"), [(4, 4), (3, 5), (2, 6), (5, 2)])
def test_pairs_are_a_rectangle_and_its_image_with_a_bare_row_between(nx: int, ny: int) -> None:
    design = coarse(nx, ny)
    mesh = Mesh.of(design.panel, design.mesh)
    every = {
        union([one, mesh.mirror_image(one)])
        for one in rectangles(nx, ny)
        if len(mesh.connected_groups(union([one, mesh.mirror_image(one)]))) == 2
    }
    pairs = list(shapes_of(mesh, Task(method="exhaustive", shapes="pairs")))
    assert len(pairs) == len(set(pairs))
    assert set(pairs) == every
    both = list(shapes_of(mesh, Task(method="exhaustive", shapes="both")))
    assert len(both) == len(set(both))
    assert set(both) == set(pairs) | set(shapes_of(mesh, Task(method="exhaustive")))


def test_a_layout_names_each_element_once_in_order() -> None:
    assert layout([7, 3, 7, 1]) == (1, 3, 7)
    assert union([(4, 5), (2,), (5, 9)]) == (2, 4, 5, 9)
    assert union([]) == ()


@pytest.mark.parametrize("ny", [3, 4])
def test_units_are_elements_or_pairs_and_leave_out_what_is_kept_bare(ny: int) -> None:
    design = coarse(5, ny)
    mesh = Mesh.of(design.panel, design.mesh)
    assert units_of(mesh, Task(symmetric=False)) == [(e,) for e in range(5 * ny)]
    pairs = units_of(mesh, Task())
    assert sorted(e for unit in pairs for e in unit) == list(range(5 * ny))
    assert {len(unit) for unit in pairs} == ({1, 2} if ny == 3 else {2})
    assert all(mesh.mirror_image(unit) == unit for unit in pairs)
    assert units_of(mesh, Task(symmetric=False, keep_out=(0, 2))) == [(e,) for e in range(5 * ny) if e not in (0, 2)]
    # with an element its image stays bare
    assert {e for unit in units_of(mesh, Task(keep_out=(0,))) for e in unit} == set(range(5 * ny)) - {0, ny - 1}


def test_a_patch_weighs_what_the_mass_matrix_gains_by_it() -> None:
    bare, one = (PlateMatrices.of(SEED.with_elements(elements)).mass for elements in ((), (20,)))
    moved = np.zeros(4 * FINE.nodes)
    moved[::4] = 1.0  # all nodes by w = 1 m, without slope; element 20 touches no edge
    moved = moved[FINE.free_bending]
    # a sum over some thousand entries of the mass matrices, and their difference
    assert patch_mass(SEED) == pytest.approx(float(moved @ ((one - bare) @ moved)), rel=1e-9)


def test_the_most_elements_are_by_number_mass_and_what_is_left() -> None:
    mass = patch_mass(SEED)
    assert most_elements(SEED, Task()) == 144
    assert most_elements(SEED, Task(elements=6)) == 6
    assert most_elements(SEED, Task(mass=6 * mass)) == 6  # rounding takes none away
    assert most_elements(SEED, Task(mass=5.999 * mass)) == 5
    assert most_elements(SEED, Task(mass=1e-9)) == 0
    assert most_elements(SEED, Task(elements=200, keep_out=tuple(range(10)))) == 144 - 12  # 10 and 11 mirror 7 and 6
    assert most_elements(SEED, Task(elements=200, keep_out=tuple(range(10)), symmetric=False)) == 134


def test_allowed_is_what_every_limit_allows() -> None:
    design = coarse(6, 4)
    mass = patch_mass(design)
    tasks = [
        (Task(symmetric=False, elements=3), lambda one: len(one) <= 3),
        (Task(symmetric=False, mass=2.5 * mass), lambda one: len(one) <= 2),
        (Task(symmetric=False, keep_out=(5, 9)), lambda one: not {5, 9} & set(one)),
        (Task(), lambda one: all(e // 4 * 4 + 3 - e % 4 in one for e in one)),
    ]
    layouts = [one for count in (1, 2, 3, 4) for one in combinations(range(4, 12), count)]
    for task, rule in tasks:
        assert [one for one in layouts if allowed(design, task, one)] == [one for one in layouts if rule(one)]
        assert not allowed(design, task, ())


@pytest.mark.parametrize(("wiring", "count"), [("connected", 2), ("element", 4), ("single", 1)])
def test_channels_are_counted_as_they_are_wired(wiring: str, count: int) -> None:
    design, apart = coarse(6, 4, wiring=wiring), (4, 7, 8, 11)  # a strip on either side
    for most in (1, 2, 3, 4, 5):
        assert allowed(design, Task(channels=most), apart) is (count <= most)
