"""Authority maps: where they point, their symmetry, and each against something that is computed another way."""

from functools import lru_cache

import control
import msgspec
import numpy as np
import pytest
import scipy.linalg
from panels import balance, eigen, whole

from solver import AuthorityMap, Design, MeshSize, Reduction, authority, load_design, nfcg
from solver.authority import CRITERIA, Criterion, closed_loop_cost, controllability, nkfeg
from solver.mesh import Floats
from solver.piezo import element_forces

COARSE = Design(mesh=MeshSize(8, 4), reduction=Reduction("patched", 12)).with_dynamic_pressure(840.0)


@lru_cache
def grid(criterion: Criterion, pressure: float) -> Floats:
    """(nx, ny) the seed's map."""
    design = load_design("seed-bare").with_dynamic_pressure(pressure)
    return authority(design, criterion).values.reshape(design.mesh.nx, design.mesh.ny)


@pytest.mark.parametrize("pressure", [840.0, 1200.0])
@pytest.mark.parametrize("criterion", ["nfcg", "controllability"])
def test_actuators_belong_in_the_leading_third(criterion: Criterion, pressure: float) -> None:
    values = grid(criterion, pressure)
    i, _ = np.unravel_index(np.argmax(values), values.shape)
    assert i < 8
    assert np.all(values > 0)


@pytest.mark.parametrize("pressure", [840.0, 1200.0])
@pytest.mark.parametrize("criterion", ["nfcg", "nkfeg", "controllability"])
def test_maps_of_a_symmetric_panel_are_symmetric(criterion: Criterion, pressure: float) -> None:
    values = grid(criterion, pressure)
    # rounding in a Riccati equation of 48 states with 144 inputs
    np.testing.assert_allclose(values, values[:, ::-1], rtol=1e-6)


def test_cost_is_symmetric_where_it_is_not_made_so() -> None:
    """A stream at 1e-9 of a degree is none that the half of a panel is enough for."""
    flow = msgspec.structs.replace(COARSE.flow, yaw_deg=1e-9)
    halved, full = (closed_loop_cost(d).reshape(8, 4) for d in (COARSE, msgspec.structs.replace(COARSE, flow=flow)))
    np.testing.assert_array_equal(halved, halved[:, ::-1])
    np.testing.assert_allclose(full, halved, rtol=1e-5)
    assert np.isfinite(halved).all()


def test_estimators_gain_is_that_of_python_control() -> None:
    bare = whole(COARSE)
    n, forces = bare.size, element_forces(bare.model, COARSE)
    c = np.hstack([forces.T, np.zeros_like(forces.T)])
    ratio = COARSE.control.observer_weight
    into = np.vstack([np.zeros((n, n)), np.eye(n)])
    gain, _, _ = control.lqe(bare.system_matrix, into, c, ratio**2 * np.eye(n), np.eye(len(c)))
    np.testing.assert_allclose(nkfeg(COARSE), np.linalg.norm(gain, axis=0), rtol=1e-6)  # not balanced


@pytest.mark.parametrize("element", [1, 6, 13, 30])
def test_cost_is_that_of_the_elements_own_closed_loop(element: int) -> None:
    """Of white forces of unit intensity in every mode, E ∫ (XᵀQX + R V²) dt is the trace of S over the rates, with
    (A - bK)ᵀ S + S (A - bK) + Q + Kᵀ R K = 0; K from python-control."""
    bare = whole(COARSE)
    n, weights = bare.size, COARSE.control
    force = element_forces(bare.model, COARSE)[:, [element]]
    a, b = bare.system_matrix, np.vstack([0 * force, force])
    q = weights.state_weight * np.diag(balance(bare) ** 2)
    gain, _, _ = control.lqr(a, b, q, weights.effort_weight)
    cost = scipy.linalg.solve_continuous_lyapunov((a - b @ gain).T, -(q + weights.effort_weight * gain.T @ gain))
    assert closed_loop_cost(COARSE)[element] == pytest.approx(np.trace(cost[n:, n:]), rel=1e-6)  # not balanced


def test_cost_is_what_a_run_from_an_impulse_adds_up_to() -> None:
    """The same by quadrature of exp((A - bK) t): impulses of unit size in every mode, one after the other."""
    bare, element = whole(COARSE), 6
    n, weights = bare.size, COARSE.control
    force = element_forces(bare.model, COARSE)[:, [element]]
    q = weights.state_weight * np.diag(balance(bare) ** 2)
    b = np.vstack([0 * force, force])
    gain, _, _ = control.lqr(bare.system_matrix, b, q, weights.effort_weight)
    step = 2 * np.pi / bare.model.omega[-1] / 30
    once = scipy.linalg.expm((bare.system_matrix - b @ gain) * step)
    x, total = np.vstack([np.zeros((n, n)), np.eye(n)]), 0.0
    measure = q + weights.effort_weight * gain.T @ gain
    for k in range(6000):
        total += (0.5 if k == 0 else 1.0) * step * float(np.einsum("ij,ik,kj->", x, measure, x))
        x = once @ x
    # trapezoids of what swings twice in a period, 15 of them: they err in the decay alone, and the end is e^-10
    assert closed_loop_cost(COARSE)[element] == pytest.approx(total, rel=1e-3)


@pytest.mark.parametrize("pressure", [840.0, 700.0])
def test_controllability_is_how_far_an_element_moves_the_growing_root(pressure: float) -> None:
    """By finite differences, on the one growing root s of this panel.

    Feedback V = -ε k X on an element with B = (0, b): ds/dε = -(ψᴴ B)(k φ) / (ψᴴ φ). With W = V⁻¹ of the eigenvectors'
    matrix V the row w of s has w φ = 1, and ψ of unit norm in the balanced state (Ωq, q̇) is w over |w| there.
    """
    design = COARSE.with_dynamic_pressure(pressure)
    bare = whole(design)
    values, right = eigen(bare.system_matrix)
    assert (values.real > 1e-3).sum() == 2  # a pair
    leading = int(np.argmax(values.real + 1e-9 * values.imag))
    row = np.linalg.inv(right)[leading]
    norm = np.linalg.norm(row / balance(bare))
    forces = element_forces(bare.model, design)
    k = np.random.default_rng(3).standard_normal((1, 2 * bare.size)) * balance(bare)
    seen = abs((k @ right[:, leading])[0])
    found = []
    for e in range(forces.shape[1]):
        b = np.vstack([0 * forces[:, [e]], forces[:, [e]]])
        ends = []
        for size in (1e-4, -1e-4):
            moved = np.linalg.eigvals(bare.system_matrix - size * b @ k)
            ends.append(moved[np.abs(moved - values[leading]).argmin()])
        found.append(abs(ends[0] - ends[1]) / 2e-4 / seen / norm)
    # central differences, and what the eigensolver leaves of them
    np.testing.assert_allclose(controllability(design), found, rtol=1e-4, atol=1e-4 * max(found))


def test_below_flutter_controllability_is_of_the_motion_that_dies_out_slowest() -> None:
    """And so a few more modes, all far above it, change it little."""
    design = COARSE.with_dynamic_pressure(300.0)
    few, many = (controllability(design.with_reduction("patched", modes)) for modes in (12, 24))
    np.testing.assert_allclose(few, many, rtol=0.1, atol=0.1 * many.max())


def test_of_several_growing_motions_all_count() -> None:
    """At 1200 an antisymmetric one grows as well: on the middle line of an odd mesh nothing drives that."""
    design = msgspec.structs.replace(COARSE, mesh=MeshSize(12, 5)).with_dynamic_pressure(1300.0)
    bare = whole(design)
    values, left = scipy.linalg.eig((bare.system_matrix * balance(bare)[:, None] / balance(bare)).T)
    growing = (values.real > 1) & (values.imag > 0)
    assert growing.sum() == 2
    inputs = np.vstack([np.zeros((bare.size, 60)), element_forces(bare.model, design)])
    wanted = np.sqrt((np.abs(left[:, growing].T @ inputs) ** 2).sum(axis=0))
    np.testing.assert_allclose(controllability(design), wanted, rtol=1e-6)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_best_elements_come_first(criterion: Criterion) -> None:
    found = authority(COARSE.with_elements((9, 10)), criterion)
    assert found.values.shape == (32,)
    values = found.values[found.best]
    rise = np.diff(values) / np.abs(values).max()
    assert (rise if found.better == "larger" else -rise).max() < 1e-8  # mirror images differ by rounding
    assert set(found.best) == {int(e) for e in np.flatnonzero(np.isfinite(found.values))}
    # only the passive map knows of patches that are there
    assert bool(np.isnan(found.values[[9, 10]]).all()) == (criterion == "growth")
    assert found.title
    assert found.unit


def test_elements_without_a_value_are_in_no_order() -> None:
    values = np.array([3.0, np.nan, 1.0, 2.0])
    assert AuthorityMap("h2", "", "", "smaller", values, "").best == [2, 3, 0]
    assert AuthorityMap("nfcg", "", "", "larger", values, "").best == [0, 3, 2]


def test_patches_do_not_enter_but_for_growth() -> None:
    patched = COARSE.with_elements((9, 10))
    for of in (nfcg, nkfeg, controllability):
        np.testing.assert_array_equal(of(COARSE), of(patched))
