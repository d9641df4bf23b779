"""The law of large deflection, summed by groups of elements on half a plate, against its definition written plainly."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from solver import Design, DesignError, MeshSize, ModalModel, Panel, Patches, Ply, Reduction, condensation
from solver.assembly import PlateMatrices
from solver.bfs import bending_shape, gauss, membrane_strain
from solver.condensation import condensed_energy
from solver.mesh import Floats, Mesh
from solver.vonkarman import LargeDeflection, index_pairs

EDGES = ("ssss", "cccc", "scss", "cfff", "ssff", "fsss", "ccsf")
INPLANE = ("iiii", "nnnn", "ssss", "ffff", "nnss", "iiff", "fffs", "niff", "nnii")
PLIES = ((), (0, 90), (45, -45), (0, 90, 90, 0), (30, -20, 0))


def plain(plate: PlateMatrices, modes: Floats) -> LargeDeflection:
    """G = EᵀAE - gᵀ K_m⁻¹ g and H = EᵀBκ - gᵀ K_m⁻¹ K_mb Φ, every element at a time and every matrix full."""
    mesh, laminate = plate.space.mesh, plate.laminate
    s, weight = gauss(4)
    weights = np.kron(weight, weight) * mesh.hx * mesh.hy
    r, t = index_pairs(modes.shape[1])
    value = plate.space.expand(modes)
    quartic, cubic = np.zeros((len(r), len(r))), np.zeros((len(r), modes.shape[1]))
    force = np.zeros((2 * mesh.nodes, len(r)))
    slopes = [bending_shape(mesh, s, s, *d) for d in ((1, 0), (0, 1))]
    curvature = [-bending_shape(mesh, s, s, *d) * (2 if d == (1, 1) else 1) for d in ((2, 0), (0, 2), (1, 1))]
    for e in range(mesh.elements):
        local = value[mesh.bending_dofs[e]]
        x, y = (slope @ local for slope in slopes)
        pairs = np.stack([x[:, r] * x[:, t], y[:, r] * y[:, t], x[:, r] * y[:, t] + y[:, r] * x[:, t]]) / 2
        bent = np.stack([shape @ local for shape in curvature])
        quartic += np.einsum("g,agp,ab,bgq->pq", weights, pairs, laminate.extension[e], pairs, optimize=True)
        cubic += np.einsum("g,agp,ab,bgn->pn", weights, pairs, laminate.coupling[e], bent, optimize=True)
        strain = membrane_strain(mesh, s)
        force[mesh.inplane_dofs[e]] += np.einsum(
            "g,agi,ab,bgp->ip", weights, strain, laminate.extension[e], pairs, optimize=True
        )
    size, number = plate.space.inplane.size, mesh.inplane_unknowns
    held = np.zeros((size, 2 * mesh.nodes))
    held[number[number >= 0], np.flatnonzero(number >= 0)] = 1.0
    force = held @ force
    stiffness = plate.membrane.toarray()
    quartic -= force.T @ np.linalg.solve(stiffness, force)
    if plate.coupling is None:
        return LargeDeflection(quartic, np.zeros((0, modes.shape[1])))
    return LargeDeflection(quartic, cubic - force.T @ np.linalg.solve(stiffness, plate.coupling @ modes))


@st.composite
def designs(draw: st.DrawFn) -> Design:
    """Panels of all kinds of edges and lay-ups, patched anywhere or symmetrically about y = b/2."""
    nx, ny = draw(st.integers(3, 7)), draw(st.integers(2, 7))
    elements = draw(st.sets(st.integers(0, nx * ny - 1), max_size=nx * ny))
    angles = draw(st.sampled_from(PLIES))
    try:
        panel = Panel(
            edges=draw(st.sampled_from(EDGES)),
            inplane=draw(st.sampled_from(INPLANE)),
            plies=tuple(Ply("graphite-epoxy", angle, 0.00127 / len(angles)) for angle in angles),
        )
    except DesignError:
        assume(False)
        raise
    mesh = Mesh.of(panel, MeshSize(nx, ny))
    if draw(st.booleans()):
        elements |= set(mesh.mirror_image(tuple(elements)))
    modes = draw(st.integers(2, 7))
    return Design(
        panel=panel,
        mesh=MeshSize(nx, ny),
        patches=Patches(elements=tuple(sorted(elements))),
        reduction=Reduction("patched", modes),
    )


def agree(one: LargeDeflection, other: LargeDeflection, plate: PlateMatrices, shapes: Floats) -> None:
    stretching, bending = np.abs(other.quartic).max(), np.abs(shapes.T @ (plate.stiffness @ shapes)).max()
    # rounding; of H, which couples the two energies, against their geometric mean, that it cannot exceed
    np.testing.assert_allclose(one.quartic, other.quartic, atol=1e-10 * stretching)
    assert one.cubic.shape == other.cubic.shape
    np.testing.assert_allclose(one.cubic, other.cubic, atol=1e-10 * np.sqrt(stretching * bending))


@settings(max_examples=40, deadline=None)
@given(designs())
def test_the_law_is_its_definition(design: Design) -> None:
    model = ModalModel.of(design)
    expected = plain(model.plate, model.shapes)
    agree(condensed_energy(model.plate, model.shapes), expected, model.plate, model.shapes)
    agree(model.membrane, expected, model.plate, model.shapes)


@settings(max_examples=15, deadline=None)
@given(designs(), st.integers(0, 10**6))
def test_any_shapes_will_do(design: Design, seed: int) -> None:
    plate = PlateMatrices.of(design)
    shapes = np.random.default_rng(seed).standard_normal((plate.stiffness.shape[0], 3))
    agree(condensed_energy(plate, shapes), plain(plate, shapes), plate, shapes)


@pytest.mark.parametrize("ny", [4, 5])
@pytest.mark.parametrize("inplane", ["iiii", "nnss", "ffff"])
@pytest.mark.parametrize("angles", [(), (0, 90)])
def test_half_a_plate_tells_of_the_whole(ny: int, inplane: str, angles: tuple[float, ...]) -> None:
    panel = Panel(inplane=inplane, plies=tuple(Ply("graphite-epoxy", angle, 0.000635) for angle in angles))
    elements = (ny, ny + 1, 2 * ny - 2, 2 * ny - 1)
    design = Design(panel=panel, mesh=MeshSize(6, ny), patches=Patches(elements=elements))
    model = ModalModel.of(design.with_reduction("patched", 9))
    assert model.plate.mirrored
    assert set(model.parity) == {1, -1}
    law, whole = model.membrane, condensed_energy(model.plate, model.shapes)
    agree(law, whole, model.plate, model.shapes)
    r, s = index_pairs(9)
    pair = model.parity[r] * model.parity[s]
    assert not law.quartic[pair[:, None] != pair].any()  # exactly: a symmetric motion stays symmetric
    if angles:
        assert len(law.cubic)
        assert not law.cubic[pair[:, None] != model.parity].any()
    # a part of the modes has its part of the law
    alone, even = model.symmetric().membrane, np.flatnonzero(model.parity == 1)
    kept = np.isin(r, even) & np.isin(s, even)
    np.testing.assert_allclose(alone.quartic, law.quartic[np.ix_(kept, kept)], atol=1e-12 * np.abs(law.quartic).max())


def test_groups_of_elements_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    model = ModalModel.of(Design(mesh=MeshSize(7, 3), patches=Patches(elements=(1, 4, 5))).with_reduction("patched", 6))
    whole = condensed_energy(model.plate, model.shapes)
    for cached in (1, 21 * 48 * 5, 2**30):  # an element at a time, five with one left over, all
        monkeypatch.setattr(condensation, "CACHED", cached)
        agree(condensed_energy(model.plate, model.shapes), whole, model.plate, model.shapes)


def test_more_points_are_another_integral() -> None:
    model = ModalModel.of(Design(mesh=MeshSize(8, 4)).with_reduction("patched", 6))
    four, seven = (condensed_energy(model.plate, model.shapes, points).quartic for points in (4, 7))
    assert 1e-8 < np.abs(four - seven).max() / np.abs(seven).max() < 0.05
