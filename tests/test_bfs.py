"""Shape functions: what a Bogner-Fox-Schmit element reproduces exactly, and where its dofs sit in the mesh."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.assembly import Pattern, Space
from solver.bfs import bending_shape, gauss, hermite, inplane_shape
from solver.materials import Material
from solver.mesh import Floats, Mesh

UNIT = Material.isotropic(1.0, 0.3, 1.0, 0.0)
MESH = Mesh(length=0.7, width=0.4, nx=5, ny=3, edges="ssss")
POSITION = st.floats(0, 1)
EXACT = 1e-11  # polynomials that the functions contain: what is left is rounding


def coordinates(mesh: Mesh) -> tuple[Floats, Floats]:
    """(nodes,) x and y of the nodes in the order of their ids."""
    x, y = np.meshgrid(np.linspace(0, mesh.length, mesh.nx + 1), np.linspace(0, mesh.width, mesh.ny + 1), indexing="ij")
    return x.ravel(), y.ravel()


def nodal(mesh: Mesh, polynomial: Floats) -> Floats:
    """(4·nodes,) dofs w, w,x, w,y, w,xy of Σ c_pq x^p y^q."""
    x, y = coordinates(mesh)
    derive = np.polynomial.polynomial.polyder
    values = [polynomial, derive(polynomial, axis=0), derive(polynomial, axis=1), derive(derive(polynomial), axis=1)]
    return np.column_stack([np.polynomial.polynomial.polyval2d(x, y, c) for c in values]).ravel()


@settings(deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=16, max_size=16), POSITION, POSITION, st.integers(0, MESH.elements - 1))
def test_every_bicubic_is_reproduced(coefficients: list[float], s: float, t: float, element: int) -> None:
    polynomial = np.array(coefficients).reshape(4, 4)
    i, j = divmod(element, MESH.ny)
    x, y = (i + s) * MESH.hx, (j + t) * MESH.hy
    local = nodal(MESH, polynomial)[MESH.bending_dofs[element]]
    for dx, dy in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)):
        derived = np.polynomial.polynomial.polyder(np.polynomial.polynomial.polyder(polynomial, dx), dy, axis=1)
        value = bending_shape(MESH, np.array([s]), np.array([t]), dx, dy)[0] @ local
        # rounding of cubics of size 1, divided by the element size up to twice (1/0.13² is 57)
        assert value == pytest.approx(np.polynomial.polynomial.polyval2d(x, y, derived), abs=1e-10)


@settings(deadline=None)
@given(POSITION, POSITION)
def test_values_are_a_partition_of_unity(s: float, t: float) -> None:
    value = bending_shape(MESH, np.array([s]), np.array([t]))[0]
    w = value.reshape(2, 2, 2, 2)[:, 0, :, 0]  # the functions of w itself at the four corners
    assert w.sum() == pytest.approx(1, abs=EXACT)
    assert inplane_shape(MESH, np.array([s]), np.array([t])).sum() == pytest.approx(1, abs=EXACT)


def test_functions_interpolate_the_nodal_dofs() -> None:
    ends = np.array([0.0, 1.0])
    rows = [bending_shape(MESH, ends, ends, dx, dy) for dx in (0, 1) for dy in (0, 1)]  # each (corner, 16)
    # (derivative in x, in y, corner in x, in y) to the functions' own order
    identity = np.array(rows).reshape(2, 2, 2, 2, 16).transpose(2, 0, 3, 1, 4).reshape(16, 16)
    np.testing.assert_allclose(identity, np.eye(16), atol=EXACT)


@settings(deadline=None)
@given(POSITION, st.floats(0.01, 10))
def test_hermite_derivatives_are_derivatives(s: float, size: float) -> None:
    # central differences of a cubic in x = s·size: exact but for the third derivative, 12 h²/6 in s at the most
    step = 1e-4
    around = np.array([s - step, s + step])
    for order in (0, 1):
        low, high = hermite(around, size, order) * size**order
        slope = (high - low) / (2 * step)
        np.testing.assert_allclose(
            hermite(np.array([s]), size, order + 1)[0] * size ** (order + 1), slope, atol=1e-6 * max(1, size)
        )


def free_stiffness() -> Floats:
    """(4·nodes, 4·nodes) stiffness of a plate with D of unit rigidity and ν = 0.3 that no edge holds."""
    pattern = Pattern.of(MESH.bending_dofs, np.arange(4 * MESH.nodes))
    block = np.einsum("ab,abij->ij", UNIT.stiffness, Space(MESH).curvature_integrals)
    return pattern.matrix(np.broadcast_to(block, (MESH.elements, 16, 16))).toarray()


def test_rigid_motions_have_no_energy_and_nothing_else() -> None:
    values = np.linalg.eigvalsh(free_stiffness())
    assert np.sum(values < 1e-9 * values[-1]) == 3  # rounding against the largest; w, and two rotations
    assert values[0] > -1e-9 * values[-1]


@pytest.mark.parametrize("curvature", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.3, -0.8, 0.5)])
def test_constant_curvature_has_exactly_its_energy(curvature: tuple[float, float, float]) -> None:
    kx, ky, kxy = curvature  # κ = -(w,xx, w,yy, 2 w,xy)
    polynomial = np.zeros((4, 4))
    polynomial[2, 0], polynomial[0, 2], polynomial[1, 1] = -kx / 2, -ky / 2, -kxy / 2
    polynomial[:2, 0] = 0.4, -0.7  # rigid motion on top changes nothing
    dofs = nodal(MESH, polynomial)
    exact = np.array(curvature) @ UNIT.stiffness @ np.array(curvature) * MESH.length * MESH.width
    assert dofs @ free_stiffness() @ dofs == pytest.approx(exact, rel=1e-9)  # rounding, cancelled through 1/h²


def test_constant_moment_does_the_work_of_the_edge_rotation() -> None:
    # ∫ (κ_x + κ_y) dA of w = x² + y² is -4 ab
    polynomial = np.zeros((4, 4))
    polynomial[2, 0] = polynomial[0, 2] = 1
    work = nodal(MESH, polynomial)[MESH.bending_dofs] @ Space(MESH).moment_integral[:2].sum(axis=0)
    assert work.sum() == pytest.approx(-4 * MESH.length * MESH.width, rel=EXACT)


def test_linear_inplane_fields_have_constant_strain() -> None:
    x, y = coordinates(MESH)
    field = np.column_stack([0.2 * x - 0.5 * y, 0.9 * x + 0.4 * y]).ravel()
    local = field[MESH.inplane_dofs]  # u at the four corners, then v
    s, _ = gauss(2)
    dx, dy = inplane_shape(MESH, s, s, 1, 0), inplane_shape(MESH, s, s, 0, 1)
    np.testing.assert_allclose(local[:, :4] @ dx.T, 0.2, atol=EXACT)
    np.testing.assert_allclose(local[:, 4:] @ dy.T, 0.4, atol=EXACT)
    np.testing.assert_allclose(local[:, :4] @ dy.T + local[:, 4:] @ dx.T, 0.4, atol=EXACT)


def test_dofs_belong_to_the_corners_of_their_element() -> None:
    x, y = coordinates(MESH)
    for e in range(MESH.elements):
        i, j = divmod(e, MESH.ny)
        corner_x, corner_y = np.repeat([i, i + 1], 2) * MESH.hx, np.tile([j, j + 1], 2) * MESH.hy
        nodes = MESH.inplane_dofs[e, :4] // 2
        np.testing.assert_allclose([x[nodes], y[nodes]], [corner_x, corner_y], atol=EXACT)
        np.testing.assert_array_equal(MESH.inplane_dofs[e, 4:], MESH.inplane_dofs[e, :4] + 1)
        # bending: (node in x, derivative in x, node in y, derivative in y)
        bending = MESH.bending_dofs[e].reshape(2, 2, 2, 2)
        np.testing.assert_array_equal(bending[:, 0, :, 0].ravel(), 4 * nodes)
        np.testing.assert_array_equal(
            bending - bending[:, :1, :, :1], np.broadcast_to(np.array([[0, 2], [1, 3]])[:, None], (2, 2, 2, 2))
        )


def test_deflection_and_slopes_are_continuous_across_elements() -> None:
    dofs = np.random.default_rng(1).standard_normal(4 * MESH.nodes)
    local = dofs[MESH.bending_dofs].reshape(MESH.nx, MESH.ny, 16)
    t, ends = np.linspace(0, 1, 5), (np.array([0.0]), np.array([1.0]))
    for dx, dy in ((0, 0), (1, 0), (0, 1)):
        left, right = (local @ bending_shape(MESH, s, t, dx, dy).T for s in ends)
        np.testing.assert_allclose(right[:-1], left[1:], atol=1e-10)  # rounding of 1/h times values near 1
        lower, upper = (local @ bending_shape(MESH, t, s, dx, dy).T for s in ends)
        np.testing.assert_allclose(upper[:, :-1], lower[:, 1:], atol=1e-10)


def test_edges_hold_what_they_should() -> None:
    simple = Mesh(1.0, 1.0, 4, 3, "ssss").free_bending.reshape(5, 4, 4)
    clamped = Mesh(1.0, 1.0, 4, 3, "cccc").free_bending.reshape(5, 4, 4)
    assert simple[1:-1, 1:-1].all()
    assert clamped[1:-1, 1:-1].all()
    np.testing.assert_array_equal(simple[0, 1], [False, True, False, True])  # at x = 0: w and w,y held
    np.testing.assert_array_equal(simple[1, 0], [False, False, True, True])  # at y = 0: w and w,x held
    np.testing.assert_array_equal(simple[0, 0], [False, False, False, True])
    assert not clamped[0].any()
    assert not clamped[:, -1].any()
