"""Linear stability: where flutter sets in, on which side of it motions grow, and what turning the flow leaves alone."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, Flow, MeshSize, ModalModel, Panel, critical_pressure, critical_pressure_full, flutter_facts
from solver.aerodynamics import Stream
from solver.design import Patches, Reduction
from solver.flutter import GROWTH_NOISE, SCAN_STEP, leading_eigenvalue, system_matrix

SIX = (20, 21, 26, 27, 32, 33)


def design(
    modes: int | Literal["all"] = 24,
    basis: Literal["patched", "family"] = "patched",
    elements: tuple[int, ...] = (),
    damping: float = 0.01,
    yaw: float = 0.0,
    mesh: tuple[int, int] = (24, 6),
) -> Design:
    return Design(
        mesh=MeshSize(*mesh),
        flow=Flow(damping=damping, yaw_deg=yaw),
        patches=Patches(elements=elements),
        reduction=Reduction(basis, modes),
    )


def critical(chosen: Design, full: bool = False) -> float:
    find = critical_pressure_full if full else critical_pressure
    found = find(ModalModel.of(chosen), Stream.of(chosen))
    assert found is not None
    return found[0]


@pytest.mark.parametrize("elements", [(), SIX, (3, 50, 51)])
@pytest.mark.parametrize("damping", [0.0, 0.01, 0.1])
def test_motions_decay_below_and_grow_above(elements: tuple[int, ...], damping: float) -> None:
    chosen = design(12, elements=elements, damping=damping)
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    value = critical(chosen)
    below = leading_eigenvalue(system_matrix(model, stream, 0.98 * value)).real
    above = leading_eigenvalue(system_matrix(model, stream, 1.02 * value)).real
    assert above > 1.0  # per second: 2 % above, growth is tens of times that
    if damping:
        assert below < 0
    else:
        assert below < 1e-3  # undamped roots are imaginary to the accuracy of a nearly double eigenvalue


def test_two_modes_have_the_exact_value() -> None:
    # 63π⁴/16; the mesh's two frequencies are 1e-5 off
    assert critical(design(2, "family", damping=0.0)) == pytest.approx(63 * np.pi**4 / 16, rel=1e-4)


def plain(model: ModalModel, stream: Stream) -> float | None:
    """λ_cr by every root of the whole system at each λ of the scan, and halving."""
    noise = GROWTH_NOISE * model.omega[0]

    def grows(value: float) -> bool:
        return np.linalg.eigvals(system_matrix(model, stream, value)).real.max() > noise

    for low in np.arange(0.0, 4000.0, SCAN_STEP):
        if grows(low + SCAN_STEP):
            high = low + SCAN_STEP
            for _ in range(45):
                low, high = (low, (low + high) / 2) if grows((low + high) / 2) else ((low + high) / 2, high)
            return high
    return None


@settings(max_examples=12, deadline=None)
@given(
    st.sets(st.integers(0, 47), max_size=8),
    st.booleans(),
    st.sampled_from([0.0, 20.0]),
    st.sampled_from(["ssss", "cccc", "scss"]),
)
def test_parts_that_do_not_touch_flutter_as_the_whole_does(
    some: set[int], symmetric: bool, yaw: float, edges: str
) -> None:
    mesh = MeshSize(12, 4)
    elements = some | ({e // 4 * 4 + 3 - e % 4 for e in some} if symmetric else set())
    chosen = Design(
        panel=Panel(edges=edges),
        mesh=mesh,
        flow=Flow(damping=0.01, yaw_deg=yaw),
        patches=Patches(elements=tuple(sorted(elements))),
        reduction=Reduction("patched", 10),
    )
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    found, expected = critical_pressure(model, stream), plain(model, stream)
    if expected is None:
        assert found is None or found[0] > 4000
    else:
        assert found is not None
        assert found[0] == pytest.approx(expected, rel=1e-8)  # roots to 1e-9


@pytest.mark.parametrize("edges", ["ssss", "cccc", "scss"])
def test_no_flow_no_instability(edges: str) -> None:
    chosen = Design(panel=Panel(edges=edges))
    model = ModalModel.of(chosen)
    root = leading_eigenvalue(system_matrix(model, Stream.of(chosen), 0.0))
    assert abs(root.real) < 1e-9 * model.omega[-1]  # imaginary to rounding


def test_the_bare_panel_does_not_know_upstream_from_downstream() -> None:
    assert critical(design(yaw=180.0)) == pytest.approx(critical(design()), rel=1e-6)  # rounding of eigenvectors


def test_a_square_does_not_know_x_from_y() -> None:
    # with every mode, because a cut through a pair of one frequency would leave one direction poorer than the other
    one, other = (critical(design(yaw=yaw, mesh=(12, 12)), full=True) for yaw in (0.0, 90.0))
    assert other == pytest.approx(one, rel=1e-6)


def test_modes_across_the_flow_alone_never_flutter() -> None:
    # the trap of the second index: (1,1) to (1,4) counted spanwise do not couple through the slope along x
    chosen = design(4, "family", yaw=90.0)
    assert critical_pressure(ModalModel.of(chosen), Stream.of(chosen)) is None


@pytest.mark.parametrize("damping", [0.0, 0.01])
@pytest.mark.parametrize("elements", [(), (9, 10)])
def test_the_sparse_search_finds_what_all_modes_have(damping: float, elements: tuple[int, ...]) -> None:
    few = design(8, elements=elements, damping=damping, mesh=(8, 4))
    every = design("all", elements=elements, damping=damping, mesh=(8, 4))
    # undamped, growth sets in as a square root, and 1e-6 ω1 of it is not seen
    assert critical(few, full=True) == pytest.approx(critical(every), rel=1e-6)


def test_facts_of_the_six_patches() -> None:
    facts = flutter_facts(design(elements=SIX))
    assert facts.lambda_cr == pytest.approx(545.8, rel=1e-3)  # every mode of the mesh
    assert facts.lambda_cr_in_basis == pytest.approx(545.1, rel=1e-3)  # 24 of them
    growth = np.array(facts.growth_rates).max(axis=1)
    pressures = np.array(facts.dynamic_pressures)
    assert facts.lambda_cr_in_basis is not None
    assert np.all(growth[pressures > 1.001 * facts.lambda_cr_in_basis] > 0)
    assert np.all(growth[(pressures > 0) & (pressures < 0.999 * facts.lambda_cr_in_basis)] < 0)
