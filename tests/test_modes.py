"""Modal bases: orthonormal, true to the symmetry of the panel, and families that no near-equal frequency can mix up."""

import dataclasses
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, DesignError, Flow, MeshSize, ModalModel, Panel, critical_pressure
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.bases import family_modes, family_shapes, lowest_modes
from solver.design import Patches, Reduction
from solver.laminate import Laminate
from solver.mesh import Floats, Mesh

SIX = (20, 21, 26, 27, 32, 33)
SMALL = MeshSize(8, 4)
LAYOUT = st.sets(st.integers(0, 31), max_size=12).map(lambda found: tuple(sorted(found)))


def design(
    elements: tuple[int, ...] = (),
    modes: int = 12,
    basis: Literal["patched", "family"] = "patched",
    mesh: MeshSize | None = None,
) -> Design:
    return Design(
        mesh=mesh or MeshSize(),
        flow=Flow(damping=0.01),
        patches=Patches(elements=elements),
        reduction=Reduction(basis, modes),
    )


def smallest_cosine(plate: PlateMatrices, one: Floats, other: Floats) -> float:
    """Cosine of the largest angle between two spaces of M-orthonormal shapes: 1 if they are one space."""
    return float(np.linalg.svd(one.T @ (plate.mass @ other), compute_uv=False).min())


@pytest.mark.parametrize("basis", ["patched", "family"])
@pytest.mark.parametrize("elements", [(), SIX, (5, 30, 31)])
def test_modes_are_orthonormal(basis: Literal["patched", "family"], elements: tuple[int, ...]) -> None:
    model = ModalModel.of(design(elements, 4 if basis == "family" else 24, basis))
    plate, shapes = model.plate, model.shapes
    np.testing.assert_allclose(shapes.T @ (plate.mass @ shapes), np.eye(model.size), atol=1e-9)
    stiffness = shapes.T @ (plate.stiffness @ shapes)
    # Lanczos leaves the energies of modes coupled by about 1e-12 of the largest
    np.testing.assert_allclose(stiffness, np.diag(model.omega**2), atol=1e-9 * model.omega[-1] ** 2)
    assert np.all(np.diff(model.omega) >= -1e-9 * model.omega[-1])


@pytest.mark.parametrize("elements", [(), SIX])
def test_parity_split_finds_the_same_spectrum(elements: tuple[int, ...]) -> None:
    plate = PlateMatrices.of(design(elements))
    assert plate.mirrored
    _, split, parity = lowest_modes(plate, 20)
    _, whole, none = lowest_modes(dataclasses.replace(plate, mirrored=False), 20)
    np.testing.assert_allclose(split, whole, rtol=1e-8)  # both are eigenvalues to rounding times the condition of K
    assert set(parity) == {1, -1}
    assert not none.any()


@settings(max_examples=20, deadline=None)
@given(
    st.tuples(st.integers(6, 12), st.integers(4, 12)),
    st.floats(0.1, 10.0),
    st.sampled_from(["ssss", "cccc", "cfff", "scff", "fcss"]),
    st.integers(2, 20),
    st.sets(st.integers(0, 143), max_size=20),
)
def test_the_lowest_of_either_parity_are_the_lowest_of_all(
    size: tuple[int, int], aspect: float, edges: str, count: int, some: set[int]
) -> None:
    # of a narrow panel's lowest modes nearly all are symmetric, of a wide one's half
    panel = Panel(length=0.3, width=0.3 * aspect, edges=edges)
    mesh = Mesh.of(panel, MeshSize(*size))
    half = tuple(e for e in some if e < mesh.elements)
    elements = tuple(sorted({*half, *mesh.mirror_image(half)}))
    plate = PlateMatrices.of(Design(panel=panel, mesh=MeshSize(*size), patches=Patches(elements=elements)))
    shapes, split, parity = lowest_modes(plate, count)
    # K⁻¹ M has the low frequencies to rounding, where K itself has them to rounding of the highest
    inverse = np.linalg.inv(plate.stiffness.toarray())
    root = np.linalg.cholesky(plate.mass.toarray())
    expected = np.linalg.eigvalsh(root.T @ inverse @ root)[::-1][:count] ** -0.5
    np.testing.assert_allclose(split, expected, rtol=1e-7)
    np.testing.assert_allclose(shapes.T @ (plate.mass @ shapes), np.eye(count), atol=1e-9)
    for one in (1, -1):
        basis = plate.space.sector(one).bending.basis
        own = shapes[:, parity == one]
        np.testing.assert_allclose(basis @ (basis.T @ own), own, atol=1e-12 * np.abs(shapes).max())  # in its sector


def test_parity_is_what_it_says() -> None:
    model = ModalModel.of(design(SIX))
    w = model.sampled(1, 1)
    # absolute against the largest deflection: shapes are symmetric by construction, up to rounding
    np.testing.assert_allclose(w[:, ::-1], w * model.parity, atol=1e-9 * np.abs(w).max())
    assert model.symmetric().size == np.sum(model.parity == 1)


def test_dense_and_sparse_eigensolvers_agree() -> None:
    sparse = ModalModel.of(design((3, 4, 5), 6, mesh=SMALL))
    dense = ModalModel.of(design((3, 4, 5), 90, mesh=SMALL))
    np.testing.assert_allclose(sparse.omega, dense.omega[:6], rtol=1e-9)  # rounding times the condition of K


def test_projection_on_itself_changes_nothing() -> None:
    model = ModalModel.of(design(SIX))
    q = np.random.default_rng(0).standard_normal((5, model.size))
    np.testing.assert_allclose(model.project(model, q), q, atol=1e-9)


def test_projection_keeps_a_motion_that_both_panels_can_make() -> None:
    bare, patched = ModalModel.of(design((), 40)), ModalModel.of(design(SIX, 40))
    q = np.zeros(40)
    q[0] = 1 / bare.peak[0]
    carried = patched.sampled(1, 1) @ patched.project(bare, q)
    # forty modes hold the bare first mode but for the kinks that the patches' edges put into their curvature
    np.testing.assert_allclose(carried, bare.sampled(1, 1) @ q, atol=0.01)


def test_shapes_are_sampled_where_they_are() -> None:
    model = ModalModel.of(design(SIX, 6))
    grid = model.sampled(2, 3)
    mesh = model.plate.space.mesh
    for i, j in ((0, 0), (7, 5), (31, 11), (48, 18)):
        np.testing.assert_allclose(model.at(i * mesh.hx / 2, j * mesh.hy / 3), grid[i, j], atol=1e-12 * grid.max())


@pytest.mark.parametrize("elements", [(), (40, 41, 52, 53), (41, 42, 53, 54)])
def test_family_survives_equal_frequencies(elements: tuple[int, ...]) -> None:
    # on a square of square elements (1,3) and (3,1) have one frequency, as (1,2) and (2,1), and a solver mixes them
    plate = PlateMatrices.of(design(elements, mesh=MeshSize(12, 12)))
    shapes, omega, _ = family_modes(plate, 4)
    other, omega_other, _ = family_modes(dataclasses.replace(plate, mirrored=False), 4)
    np.testing.assert_allclose(omega, omega_other, rtol=1e-6)  # eigenvectors within a cluster carry its rounding
    assert smallest_cosine(plate, shapes, other) > 1 - 1e-6  # one space, whichever vectors the solver chose
    if not elements:  # patches mix such pairs in earnest; on the bare panel the family is the sines themselves
        wanted = family_shapes(plate.space.mesh, 4)
        wanted /= np.sqrt(np.einsum("im,im->m", wanted, plate.mass @ wanted))
        assert np.diag(abs(shapes.T @ (plate.mass @ wanted))).min() > 1 - 1e-9


def test_family_frequencies_are_closed_form() -> None:
    model = ModalModel.of(design((), 4, "family"))
    hertz = model.omega / (2 * np.pi)
    np.testing.assert_allclose(hertz, [65.67, 164.19, 328.37, 558.23], rtol=2e-4)  # printed to 0.01 Hz; mesh 5e-5


def test_more_modes_than_the_mesh_has() -> None:
    with pytest.raises(DesignError, match=r"reduction\.modes = 90"):
        ModalModel.of(design((), 90, mesh=MeshSize(4, 4)))


@settings(max_examples=15, deadline=None)
@given(LAYOUT, LAYOUT)
def test_patches_only_add_mass_and_stiffness(some: tuple[int, ...], others: tuple[int, ...]) -> None:
    fewer = design(some, mesh=SMALL)
    more = design(tuple(sorted({*some, *others})), mesh=SMALL)
    assert Laminate.of(more).mass.sum() >= Laminate.of(fewer).mass.sum()
    light, heavy = PlateMatrices.of(fewer), PlateMatrices.of(more)
    for low, high in ((light.mass, heavy.mass), (light.stiffness, heavy.stiffness), (light.membrane, heavy.membrane)):
        values = np.linalg.eigvalsh((high - low).toarray())
        assert values[0] >= -1e-12 * abs(high).max()  # the difference is a sum of patches' own: semidefinite


@settings(max_examples=15, deadline=None)
@given(LAYOUT)
def test_matrices_are_positive_definite(elements: tuple[int, ...]) -> None:
    plate = PlateMatrices.of(design(elements, mesh=SMALL))
    for matrix in (plate.stiffness, plate.mass, plate.membrane):
        dense = matrix.toarray()
        np.testing.assert_allclose(dense, dense.T, atol=1e-12 * abs(dense).max())
        np.linalg.cholesky(dense)  # raises if it is not


@settings(max_examples=15, deadline=None)
@given(LAYOUT)
def test_reflected_layouts_flutter_alike(elements: tuple[int, ...]) -> None:
    one = design(elements, 10, mesh=SMALL)
    mirror = PlateMatrices.of(one).space.mesh.mirror_image(elements)
    other = one.with_elements(mirror)
    values = [critical_pressure(ModalModel.of(d), Stream.of(d)) for d in (one, other)]
    assert values[0] is not None
    assert values[1] is not None
    # λ_cr is a root to 1e-9; eigenvectors of close modes are less certain than that
    assert values[0][0] == pytest.approx(values[1][0], rel=1e-6)
