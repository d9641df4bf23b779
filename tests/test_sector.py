"""Sectors of a plate: half the elements and fewer unknowns, against the whole matrices in a basis of the sector."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, MeshSize, Panel, Patches
from solver.assembly import PlateMatrices
from solver.banded import Cholesky, compliance_products, definite_solver
from solver.mesh import Floats, Mesh
from solver.pattern import Pattern
from solver.sector import Parity

EDGES = ("ssss", "cccc", "cfss", "ssff", "ccff")
INPLANE = ("iiii", "nnnn", "nnii", "iiff", "ssss", "nnss", "ssff", "ffff")


@st.composite
def mirrored(draw: st.DrawFn) -> PlateMatrices:
    """Plates symmetric about y = b/2, an even or an odd number of elements wide."""
    panel = Panel(edges=draw(st.sampled_from(EDGES)), inplane=draw(st.sampled_from(INPLANE)))
    size = MeshSize(draw(st.integers(2, 8)), draw(st.integers(2, 8)))
    mesh = Mesh.of(panel, size)
    some = draw(st.sets(st.integers(0, mesh.elements - 1)))
    elements = tuple(sorted(some | set(mesh.mirror_image(tuple(some)))))
    plate = PlateMatrices.of(Design(panel=panel, mesh=size, patches=Patches(elements=elements)))
    assert plate.mirrored
    return plate


def dense(bands: Floats) -> Floats:
    """The symmetric matrix of upper bands."""
    width, size = len(bands) - 1, bands.shape[1]
    upper = sum(np.diag(bands[width - k, k:], k) for k in range(min(width + 1, size)))
    return np.asarray(upper + np.triu(upper, 1).T)


@settings(max_examples=30, deadline=None)
@given(mirrored(), st.sampled_from([0, 1, -1]))
def test_half_a_plate_has_the_matrices_of_the_whole(plate: PlateMatrices, parity: Parity) -> None:
    sector = plate.space.sector(parity)
    basis = sector.bending.basis
    np.testing.assert_allclose((basis.T @ basis).toarray(), np.eye(sector.bending.size), atol=1e-15)
    for blocks, whole in zip(plate.bending_blocks(sector.elements), (plate.stiffness, plate.mass), strict=True):
        expected = (basis.T @ whole @ basis).toarray()
        found = sector.bending_pattern.matrix(blocks).toarray()
        np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())  # sums in another order
        np.testing.assert_allclose(dense(sector.bending_pattern.bands(blocks)), found, atol=1e-15 * np.abs(found).max())
    if sector.inplane is None:
        return
    basis = sector.inplane.basis
    np.testing.assert_allclose((basis.T @ basis).toarray(), np.eye(sector.inplane.size), atol=1e-15)
    expected = (basis.T @ plate.membrane @ basis).toarray()
    found = sector.inplane_pattern.matrix(plate.membrane_blocks(sector.elements)).toarray()
    np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max(initial=0.0))


@settings(max_examples=20, deadline=None)
@given(mirrored())
def test_the_two_parities_share_out_every_motion(plate: PlateMatrices) -> None:
    even, odd = plate.space.sector(1), plate.space.sector(-1)
    for one, other, size in (
        (even.bending, odd.bending, plate.space.bending.size),
        (even.inplane, odd.inplane, plate.space.inplane.size),
    ):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            assert one.size + other.size == size
            assert not np.any(np.abs((one.basis.T @ other.basis).toarray()) > 1e-15)
    # the plate keeps them apart
    between = (even.bending.basis.T @ plate.stiffness @ odd.bending.basis).toarray()
    assert np.abs(between).max(initial=0.0) < 1e-12 * abs(plate.stiffness).max()


@pytest.mark.parametrize(("inplane", "whole"), [("iiii", True), ("nnii", True), ("nnff", False), ("ffff", False)])
def test_a_pinned_corner_breaks_the_symmetry(inplane: str, whole: bool) -> None:
    plate = PlateMatrices.of(Design(panel=Panel(inplane=inplane), mesh=MeshSize(4, 4)))
    assert (plate.space.sector(1).inplane is not None) is whole


@pytest.mark.parametrize("size", [(24, 6), (6, 24), (30, 9)])
@pytest.mark.parametrize("parity", [0, 1, -1])
def test_bands_are_as_wide_as_the_shorter_side(size: tuple[int, int], parity: Parity) -> None:
    sector = PlateMatrices.of(Design(mesh=MeshSize(*size))).space.sector(parity)
    across = min(size) if parity == 0 or size[0] < size[1] else (size[1] + 1) // 2
    assert sector.bending_pattern.width < 4 * (across + 3)  # four dofs a node, of a column and a node or two


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 60), st.integers(1, 6), st.integers(0, 4), st.integers(0, 10**6), st.booleans())
def test_compliance_products(size: int, count: int, others: int, seed: int, tied: bool) -> None:
    rng = np.random.default_rng(seed)
    dofs = np.arange(size)[:, None] + np.arange(2)
    unknowns = np.append(np.arange(size), -1)
    if tied:  # one number at both ends
        unknowns[size - 1] = 0
    root = rng.standard_normal((size, 2, 2))
    blocks = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(2)
    pattern = Pattern.of(dofs, unknowns)
    matrix = pattern.matrix(blocks).toarray()
    forces, more = rng.standard_normal((pattern.size, count)), rng.standard_normal((pattern.size, others))
    expected = forces.T @ np.linalg.solve(matrix, np.hstack([forces, more]))
    found = compliance_products(pattern, blocks, forces, more)
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())  # rounding, condition some 1e3
    np.testing.assert_allclose(
        Cholesky.of(pattern.bands(blocks)).solve(forces), definite_solver(pattern.matrix(blocks))(forces), rtol=1e-8
    )


def test_what_is_not_definite_is_refused() -> None:
    pattern = Pattern.of(np.array([[0, 1], [1, 2]]), np.arange(3))
    blocks = np.broadcast_to(np.array([[1.0, -1.0], [-1.0, 1.0]]), (2, 2, 2))  # free to move as a whole
    with pytest.raises(np.linalg.LinAlgError):
        Cholesky.of(pattern.bands(blocks - 0.1 * np.eye(2)))
