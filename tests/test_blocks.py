"""The split into blocks, and of patched elements into groups, against the graph search of scipy."""

import numpy as np
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from solver import MeshSize, Panel
from solver.blocks import blocks_of
from solver.mesh import Bools, Mesh


def by_scipy(coupled: Bools) -> set[tuple[int, ...]]:
    count, label = connected_components(sp.csr_array(coupled.astype(float)), directed=False)
    return {tuple(int(k) for k in np.flatnonzero(label == part)) for part in range(count)}


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 30), st.floats(0, 0.2))
def test_blocks_are_the_connected_parts(seed: int, size: int, density: float) -> None:
    coupled = np.random.default_rng(seed).random((size, size)) < density  # one way only, mostly
    found = blocks_of(coupled)
    assert {tuple(int(k) for k in block) for block in found} == by_scipy(coupled)
    assert [block[0] for block in found] == sorted(block[0] for block in found)


def test_nothing_has_no_blocks() -> None:
    assert blocks_of(np.zeros((0, 0), dtype=bool)) == []


@settings(deadline=None)
@given(st.integers(1, 9), st.integers(1, 7), st.data())
def test_groups_of_elements_hang_together_by_edges(nx: int, ny: int, data: st.DataObject) -> None:
    mesh = Mesh.of(Panel(), MeshSize(max(nx, 2), max(ny, 2)))
    chosen = data.draw(st.sets(st.integers(0, mesh.elements - 1)))
    elements = tuple(data.draw(st.permutations(sorted(chosen))))  # in any order
    i, j = np.divmod(np.array(elements, dtype=int), mesh.ny)
    touching = np.abs(i[:, None] - i) + np.abs(j[:, None] - j) == 1
    expected = {tuple(sorted(elements[k] for k in part)) for part in by_scipy(touching)} if elements else set()
    found = mesh.connected_groups(elements)
    assert set(found) == expected
    assert found == sorted(found)
