"""The error estimate: it covers what a richer basis changes, knows λ_cr exactly, and refines the same plate."""

from functools import lru_cache

import msgspec
import numpy as np
import pytest

from solver import (
    Design,
    ErrorEstimate,
    Estimate,
    Loop,
    ModalModel,
    Patches,
    Plant,
    Stream,
    critical_pressure,
    critical_pressure_full,
    estimate_error,
    limit_cycle,
    load_design,
)
from solver.design import Basis, MeshSize
from solver.estimate import RICH, SECOND_ORDER, _finer
from solver.laminate import Laminate
from solver.mesh import Mesh


def coarse(name: str, mesh: tuple[int, int], elements: tuple[int, ...], basis: Basis, modes: int) -> Design:
    design = load_design(name).with_reduction(basis, modes)
    return msgspec.structs.replace(design, mesh=MeshSize(*mesh), patches=Patches(elements=elements))


SIX = coarse("seed-840", (12, 6), (20, 21, 26, 27), "patched", 12)  # i = 3..4, j = 2..3
BARE = coarse("seed-bare", (8, 4), (), "patched", 12)
FAMILY = coarse("seed-bare", (8, 4), (), "family", 4)


@lru_cache
def estimate(design: Design) -> ErrorEstimate:
    return estimate_error(design)


@lru_cache
def amplitude(design: Design) -> float:
    cycle = limit_cycle(Loop.of(Plant.of(design).symmetric()))
    assert cycle is not None
    return cycle.amplitude


def known(part: Estimate | None) -> Estimate:
    assert part is not None
    assert part.basis_error is not None
    assert part.mesh_error is not None
    return part


@pytest.mark.parametrize("design", [SIX, BARE, FAMILY])
def test_it_covers_a_much_richer_basis(design: Design) -> None:
    found = estimate(design)
    rich = design.with_reduction("patched", 36)
    critical = Plant.of(rich).critical
    assert critical is not None
    off = {
        "λ_cr": (known(found.lambda_cr), critical[0]),
        "LCO": (known(found.lco_amplitude_over_h), amplitude(rich)),
    }
    for name, (part, richer) in off.items():
        assert part.basis_error is not None
        error = abs(richer - part.value)
        # the richer basis is itself off, to either side: its λ_cr by a fiftieth of what is estimated
        assert error <= 1.05 * part.basis_error, name
        # an estimate that covers everything says nothing: it is a few times too large at most
        assert part.basis_error <= 4 * error, name


@pytest.mark.parametrize("design", [SIX, BARE, FAMILY, BARE.with_reduction("aeroelastic", 8)])
def test_the_critical_pressure_is_known_with_every_mode(design: Design) -> None:
    part = known(estimate(design).lambda_cr)
    own = critical_pressure(ModalModel.of(design), Stream.of(design))
    full = critical_pressure_full(ModalModel.of(design.with_reduction("patched", 40)), Stream.of(design))
    assert own is not None
    assert full is not None
    assert part.value == pytest.approx(own[0], rel=1e-9)  # the same computation
    # the full value is a root to Arnoldi's tolerance, from whichever basis it is sought
    assert part.basis_error == pytest.approx(abs(full[0] - own[0]), abs=1e-6 * full[0])


def test_the_figures_are_the_designs_own() -> None:
    found = estimate(SIX)
    assert found.modes == 12
    assert found.richer_modes == 24
    assert found.finer_mesh == (24, 12)
    assert known(found.lco_amplitude_over_h).value == pytest.approx(
        amplitude(SIX), rel=1e-3
    )  # what counts as converged
    damping = found.damping_time_s
    assert damping is not None
    assert damping.basis_error is not None
    assert damping.basis_error >= Plant.of(SIX).symmetric().period / 2  # a peak that just touches the limit


def test_the_changes_are_taken_as_their_orders_say() -> None:
    found = estimate(BARE)
    richer = amplitude(BARE.with_reduction("patched", 24))
    finer = amplitude(msgspec.structs.replace(BARE, mesh=MeshSize(16, 8)))
    part = known(found.lco_amplitude_over_h)
    # the richer one may start from the cycle of the poorer: the same, to what counts as converged, 1e-3 of it
    assert part.basis_error == pytest.approx(2 * abs(richer - part.value), abs=2e-3 * part.value)
    assert part.mesh_error == pytest.approx(SECOND_ORDER * abs(finer - part.value), abs=2e-3 * part.value)


def test_a_family_is_held_against_the_lowest_modes() -> None:
    """More of its own kind would never show what it lacks: the change of λ_cr from 4 to 24 of the family is nothing."""
    found = estimate(FAMILY)
    assert (found.modes, found.richer_modes) == (4, RICH)
    assert known(found.lco_amplitude_over_h).value == pytest.approx(amplitude(FAMILY), rel=1e-3)  # as above
    richer = amplitude(BARE.with_reduction("patched", RICH))
    part = known(found.lco_amplitude_over_h)
    assert part.basis_error == pytest.approx(2 * abs(richer - part.value), abs=2e-3 * part.value)  # as above


# --- nothing to be sure of --------------------------------------------------------------------------------------------


def test_a_stable_panel_has_no_cycle_to_be_wrong_about() -> None:
    found = estimate(BARE.with_dynamic_pressure(300.0))
    assert found.lco_amplitude_over_h is None
    assert found.damping_time_s is None
    assert found.lambda_cr == estimate(BARE).lambda_cr  # which does not depend on λ


def test_a_panel_that_never_flutters() -> None:
    # across the flow alone nothing of a family couples (modes (m,1) and flow along y)
    turned = msgspec.structs.replace(FAMILY, flow=msgspec.structs.replace(FAMILY.flow, yaw_deg=90.0))
    found = estimate(turned)
    assert found.lambda_cr is None
    assert found.lco_amplitude_over_h is None


def test_without_patches_there_is_no_damping_time() -> None:
    assert estimate(BARE).damping_time_s is None


def test_a_mesh_too_large_to_refine_says_so() -> None:
    large = (
        msgspec.structs.replace(BARE, mesh=MeshSize(100, 26)).with_dynamic_pressure(300.0).with_reduction("family", 2)
    )
    assert _finer(large) is None
    assert _finer(msgspec.structs.replace(large, mesh=MeshSize(100, 25))) is not None


# --- the finer mesh ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("elements", [(), (0,), (20, 21, 26, 27), (5, 66, 71), tuple(range(72))])
def test_a_finer_mesh_keeps_patches_where_they_are(elements: tuple[int, ...]) -> None:
    design = SIX.with_elements(elements)
    finer = _finer(design)
    assert finer is not None
    assert (finer.mesh.nx, finer.mesh.ny) == (24, 12)
    assert len(finer.patches.elements) == 4 * len(elements)
    assert finer.with_elements(()) == msgspec.structs.replace(design.with_elements(()), mesh=finer.mesh)
    old, new = (Mesh.of(d.panel, d.mesh) for d in (design, finer))
    masses = [Laminate.of(d).mass for d in (design, finer)]
    # the mass of the plate: sums of a few hundred numbers
    assert masses[1].sum() * new.hx * new.hy == pytest.approx(masses[0].sum() * old.hx * old.hy, rel=1e-12)
    for x in np.linspace(0.01, 0.99, 23) * design.panel.length:
        for y in np.linspace(0.01, 0.99, 13) * design.panel.width:
            here, there = old.element_at(float(x), float(y)), new.element_at(float(x), float(y))
            assert (here in elements) == (there in finer.patches.elements)
    # a channel stays one channel
    assert len(new.connected_groups(finer.patches.elements)) == len(old.connected_groups(elements))
