"""Modal bases in a stream: aeroelastic modes have the full mesh's roots, at λ = 0 they are the plain lowest modes."""

import dataclasses

import msgspec
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, DesignError, Flow, Loop, MeshSize, ModalModel, Panel, Patches, Plant, limit_cycle
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.bases import aeroelastic_modes, lowest_modes
from solver.design import Basis, Load, Ply, Reduction
from solver.flutter import leading_eigenvalue, system_matrix
from solver.mesh import Floats

SIX = (20, 21, 26, 27, 32, 33)  # on the 24 x 6 mesh
ANGLE_PLY = (Ply("graphite-epoxy", 45, 0.0004), Ply("graphite-epoxy", 0, 0.0004))
CROSS_PLY = (Ply("graphite-epoxy", 90, 0.0004), Ply("graphite-epoxy", 0, 0.0004))
SMALL = (8, 4)


def design(
    basis: Basis = "aeroelastic",
    modes: int = 8,
    pressure: float = 840.0,
    mesh: tuple[int, int] = (24, 6),
    elements: tuple[int, ...] = (),
    yaw: float = 0.0,
    plies: tuple[Ply, ...] = (),
    damping: float = 0.01,
    edges: str = "ssss",
    load: Load | None = None,
) -> Design:
    return Design(
        panel=Panel(plies=plies, thickness=sum(ply.thickness for ply in plies) or 0.00127, edges=edges),
        mesh=MeshSize(*mesh),
        flow=Flow(pressure, damping, yaw),
        load=load or Load(),
        patches=Patches(elements=elements),
        reduction=Reduction(basis, modes),
    )


def root(chosen: Design) -> complex:
    """Leading root at the design's own λ, in its basis."""
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    return leading_eigenvalue(system_matrix(model, stream, stream.dynamic_pressure))


def full_matrices(chosen: Design) -> tuple[Floats, Floats, Floats]:
    """Dense mass, damping and stiffness of the whole mesh in its stream, in-plane displacements condensed out."""
    plate, stream = PlateMatrices.of(chosen), Stream.of(chosen)
    slope = stream.cosine * plate.space.slope_x + stream.sine * plate.space.slope_y
    stiffness = plate.condensed_stiffness() + stream.dynamic_pressure * stream.slope_unit * slope.toarray()
    if plate.geometric is not None:
        stiffness += plate.geometric.toarray()
    return plate.mass.toarray(), stream.rate(stream.dynamic_pressure) * plate.space.bare_mass.toarray(), stiffness


def full_root(chosen: Design) -> complex:
    """Leading root at the design's own λ with every dof of the mesh, by a dense eigensolver on the companion matrix."""
    mass, damping, stiffness = full_matrices(chosen)
    n = len(mass)
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    values = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower]))
    value = values[np.argmax(values.real)]
    return complex(value.real, abs(value.imag))


# --- growth at the design's own λ -------------------------------------------------------------------------------------


@pytest.mark.parametrize("elements", [(), SIX])
@pytest.mark.parametrize("yaw", [0.0, 30.0])
def test_eight_modes_grow_as_eighty(elements: tuple[int, ...], yaw: float) -> None:
    rich = root(design("patched", 110, elements=elements, yaw=yaw))
    few = root(design(elements=elements, yaw=yaw))
    # kinks at patches' edges leave a hundred plain modes some 1e-4 short; eight aeroelastic ones are nearer than that
    assert few.real == pytest.approx(rich.real, rel=1e-3)
    assert few.imag == pytest.approx(rich.imag, rel=1e-4)
    poor = root(design("patched", 8, elements=elements, yaw=yaw))
    assert abs(poor.real / rich.real - 1) > 0.2  # so many plain modes are far from it: half of the growth is missing


@pytest.mark.parametrize(
    ("chosen", "rel"),
    [
        # aerodynamic damping on a bare plate is a multiple of its mass, and changes no mode: exact
        (design(mesh=SMALL), 1e-7),
        (design(mesh=SMALL, yaw=25.0), 1e-7),
        (design(mesh=SMALL, plies=ANGLE_PLY, pressure=300.0), 1e-7),
        (design(mesh=SMALL, plies=ANGLE_PLY, pressure=300.0, yaw=-20.0), 1e-7),
        (design(mesh=SMALL, plies=CROSS_PLY, pressure=200.0), 1e-7),
        (design(mesh=SMALL, load=Load(preload_x=1.5, preload_y=1.0)), 1e-7),
        (design(mesh=SMALL, edges="cccc", pressure=1100.0), 1e-7),
        # on a patched one it is not, but the error in the root is of second order in that of the modes
        (design(mesh=SMALL, elements=(9, 10, 13)), 1e-4),
        (design(mesh=SMALL, elements=(9, 10), yaw=40.0), 1e-4),
        # without damping nothing but rounding is left in any of these
        (design(mesh=SMALL, elements=(9, 10, 13), damping=0.0), 1e-7),
        (design(mesh=SMALL, elements=(9, 10), plies=ANGLE_PLY, pressure=500.0, damping=0.0), 1e-7),
    ],
)
def test_the_leading_root_is_that_of_the_whole_mesh(chosen: Design, rel: float) -> None:
    exact = full_root(chosen)
    assert exact.real > 1.0  # it flutters, so that there is a growth to be compared
    assert abs(root(chosen) - exact) < rel * abs(exact)


@pytest.mark.parametrize("yaw", [0.0, 35.0])
@pytest.mark.parametrize("plies", [(), ANGLE_PLY])
def test_the_basis_holds_right_and_left_eigenvectors(plies: tuple[Ply, ...], yaw: float) -> None:
    """Galerkin's method in such a space has eigenvalues of the undamped panel exactly, and they are the lowest ones."""
    chosen = design(mesh=SMALL, plies=plies, pressure=250.0, yaw=yaw, elements=(9,), damping=0.0)
    mass, _, stiffness = full_matrices(chosen)
    exact = scipy.linalg.eigvals(stiffness, mass)
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    reduced = np.linalg.eigvals(-system_matrix(model, stream, 250.0)[model.size :, : model.size])
    lowest = exact[np.argsort(np.abs(exact))][:4]
    for value in lowest:  # of eight vectors two a root, right and left: the four lowest roots
        assert np.abs(reduced - value).min() < 1e-7 * abs(value)  # Arnoldi's eigenvectors, to their rounding


# --- without a stream -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("plies", [(), ANGLE_PLY, CROSS_PLY])
@pytest.mark.parametrize("elements", [(), (9, 10), (9, 13)])
def test_without_flow_they_are_the_lowest_modes(plies: tuple[Ply, ...], elements: tuple[int, ...]) -> None:
    chosen = design(mesh=SMALL, pressure=0.0, plies=plies, elements=elements, modes=10)
    plate = PlateMatrices.of(chosen)
    shapes, omega, _ = aeroelastic_modes(plate, Stream.of(chosen), 10)
    plain, frequencies, _ = lowest_modes(plate, 10)
    np.testing.assert_allclose(omega, frequencies, rtol=1e-8)  # two eigensolvers: rounding times the condition of K
    cosines = np.linalg.svd(shapes.T @ (plate.mass @ plain), compute_uv=False)
    assert cosines.min() > 1 - 1e-8  # one space


# --- what every basis keeps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "chosen",
    [
        design(elements=SIX, modes=12),
        design(mesh=SMALL, yaw=30.0, modes=9),
        design(mesh=SMALL, plies=ANGLE_PLY, pressure=400.0, modes=12),
        design(mesh=SMALL, plies=CROSS_PLY, pressure=200.0, modes=7),
        design(mesh=SMALL, load=Load(preload_x=3.0, preload_y=3.0), pressure=100.0, modes=8),
    ],
)
def test_modes_are_orthonormal_and_diagonal(chosen: Design) -> None:
    model = ModalModel.of(chosen)
    assert model.size == chosen.reduction.modes
    shapes = model.shapes
    np.testing.assert_allclose(shapes.T @ (model.plate.mass @ shapes), np.eye(model.size), atol=1e-9)  # rounding
    energy = shapes.T @ model.plate.condensed_stiffness() @ shapes
    np.testing.assert_allclose(energy, np.diag(model.omega**2), atol=1e-9 * model.omega[-1] ** 2)  # rounding
    assert np.all(np.diff(model.omega) >= 0)


@pytest.mark.parametrize("plies", [(), CROSS_PLY])
@pytest.mark.parametrize("elements", [(), (9, 10)])
def test_parity_is_what_it_says(plies: tuple[Ply, ...], elements: tuple[int, ...]) -> None:
    model = ModalModel.of(design(mesh=SMALL, plies=plies, pressure=200.0, elements=elements))
    assert set(model.parity) == {1, -1}
    w = model.sampled(2, 2)
    # absolute against the largest deflection: each is sought among motions of its parity, so that rounding is all
    np.testing.assert_allclose(w[:, ::-1], w * model.parity, atol=1e-9 * np.abs(w).max())
    assert model.symmetric().size == np.sum(model.parity == 1)


@pytest.mark.parametrize(
    "chosen",
    [
        design(mesh=SMALL, yaw=10.0),
        design(mesh=SMALL, plies=ANGLE_PLY),
        design(mesh=SMALL, elements=(8,)),
        design(mesh=SMALL, edges="sscs"),
    ],
)
def test_where_nothing_is_symmetric_no_parity_is_claimed(chosen: Design) -> None:
    assert not ModalModel.of(chosen).parity.any()


@settings(max_examples=15, deadline=None)
@given(
    st.sets(st.integers(0, 31), max_size=8).map(lambda found: tuple(sorted(found))),
    st.floats(0, 900),
    st.floats(-90, 90),
    st.integers(4, 16),
)
def test_any_stream_gives_a_basis(elements: tuple[int, ...], pressure: float, yaw: float, modes: int) -> None:
    chosen = design(mesh=SMALL, elements=elements, pressure=pressure, yaw=yaw, modes=modes)
    model = ModalModel.of(chosen)
    assert model.size == modes
    np.testing.assert_allclose(model.shapes.T @ (model.plate.mass @ model.shapes), np.eye(modes), atol=1e-8)  # rounding
    _, lowest, _ = lowest_modes(model.plate, 1)
    assert model.omega[0] >= lowest[0] * (1 - 1e-9)  # Rayleigh's principle: no space is softer than the lowest mode


@pytest.mark.parametrize(("mesh", "modes"), [((2, 2), 8), ((4, 2), 16)])
def test_half_of_the_dofs_is_the_most(mesh: tuple[int, int], modes: int) -> None:
    most = design(mesh=mesh, modes=modes)
    assert ModalModel.of(most).size == modes
    with pytest.raises(DesignError, match=rf"reduction\.modes = {modes + 1}"):
        ModalModel.of(design(mesh=mesh, modes=modes + 1))


def test_a_run_repeats_to_the_last_digit() -> None:
    chosen = design(elements=SIX)
    np.testing.assert_array_equal(ModalModel.of(chosen).shapes, ModalModel.of(chosen).shapes)


# --- large deflection -------------------------------------------------------------------------------------------------


def test_four_symmetric_modes_have_the_limit_cycle_of_a_rich_basis() -> None:
    def amplitude(basis: Basis, modes: int) -> tuple[int, float]:
        plant = Plant.of(design(basis, modes, elements=SIX)).symmetric()
        cycle = limit_cycle(Loop.of(plant))
        assert cycle is not None
        assert cycle.converged
        return plant.size, cycle.amplitude

    rich = amplitude("patched", 48)[1]
    size, few = amplitude("aeroelastic", 8)
    assert size == 4
    assert few == pytest.approx(rich, rel=0.02)  # what is asked of a basis; measured 0.6 %, on the bare panel too
    assert abs(amplitude("patched", 8)[1] / rich - 1) > 0.2  # what as many plain modes miss by


# --- families with free edges -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 5])
def test_family_of_a_plate_clamped_at_its_leading_edge(count: int) -> None:
    chosen = design("family", max(count, 2), mesh=(12, 6), edges="cfff")
    model = ModalModel.of(chosen).first(count)
    w = model.sampled(2, 2)
    np.testing.assert_allclose(w[:, ::-1], w, atol=1e-9 * np.abs(w).max())  # even across, up to rounding
    assert np.all(model.parity == 1)
    patched = ModalModel.of(msgspec.structs.replace(chosen, reduction=Reduction("patched", 12)))
    assert model.omega[0] == pytest.approx(patched.omega[0], rel=1e-9)  # it is that mode: rounding of eigensolvers
    # in air or not, all of them are modes of the plate with no node along the span: the even ones of the rich basis
    for omega in model.omega[:3]:
        assert np.abs(patched.omega[patched.parity == 1] / omega - 1).min() < 1e-8


@pytest.mark.parametrize("edges", ["cfff", "sfsf", "ffcf", "scff", "ffcc"])
def test_family_does_not_depend_on_how_symmetry_is_used(edges: str) -> None:
    for mirrored in (True, False):
        chosen = design("family", 3, mesh=(8, 4), edges=edges)
        plate = PlateMatrices.of(chosen)
        model = ModalModel.of(chosen, dataclasses.replace(plate, mirrored=plate.mirrored and mirrored))
        np.testing.assert_allclose(model.omega, ModalModel.of(chosen).omega, rtol=1e-6)  # as eigenvectors in a cluster
