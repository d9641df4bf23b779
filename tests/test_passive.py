"""The passive map: every element's change of growth against the patched panel's own eigenproblem, and symmetries."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from solver import Design, Flow, Load, MeshSize, Panel, Patches, Ply
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.passive import patch_growth

SIX = (20, 21, 26, 27, 32, 33)
# 1/s: growth is known to 1e-10 of |s|, of some 1e3 1/s; what the map's samples leave out is up to 1e-9 of it more
EXACT = 1e-5
NEAREST = 12


def design(
    pressure: float,
    elements: tuple[int, ...] = (),
    mesh: tuple[int, int] = (24, 6),
    yaw: float = 0.0,
    load: Load | None = None,
    panel: Panel | None = None,
    damping: float = 0.01,
) -> Design:
    return Design(
        panel=panel or Panel(),
        mesh=MeshSize(*mesh),
        flow=Flow(dynamic_pressure=pressure, damping=damping, yaw_deg=yaw),
        load=load or Load(),
        patches=Patches(elements=elements),
    )


def laminate(*angles: float, inplane: str = "iiii") -> Panel:
    plies = tuple(Ply("graphite-epoxy", angle, 0.00025) for angle in angles)
    return Panel(thickness=0.00025 * len(angles), inplane=inplane, plies=plies)


def companion(chosen: Design) -> tuple[sp.csc_array, sp.csc_array]:
    """A and B of A z = s B z for z = (x, s x / 1000), all of the panel's unknowns and no reduction."""
    plate, stream, unit = PlateMatrices.of(chosen), Stream.of(chosen), 1000.0
    stiffness, mass = plate.linear(loaded=True)
    slope = stream.cosine * plate.space.slope_x + stream.sine * plate.space.slope_y
    flow = plate.widened(stream.dynamic_pressure * stream.slope_unit * slope)
    damping = plate.widened(stream.rate(stream.dynamic_pressure) * plate.space.bare_mass)
    one = sp.eye_array(mass.shape[0])
    left = sp.block_array([[None, unit * one], [-(stiffness + flow) / unit, -damping]])
    return sp.csc_array(left), sp.csc_array(sp.block_diag([one, mass]))


def growth(chosen: Design) -> float:
    """Growth rate of the leading one of all roots [1/s], by a dense eigensolver."""
    left, right = (matrix.toarray() for matrix in companion(chosen))
    # w and its derivatives as large as each other, or a root that only turns gains a real part of 1e-9 of it
    stiffness = np.abs(np.diag(left[len(left) // 2 :]))
    rows, columns = (np.concatenate([stiffness**power, stiffness**-0.5]) for power in (0.5, -0.5))
    values = scipy.linalg.eigvals(rows[:, None] * left * columns, rows[:, None] * right * columns)
    return float(values[np.isfinite(values)].real.max())


def growth_near(chosen: Design, root: complex) -> float:
    """That of the leading one of the dozen roots nearest to a point, by shift and invert."""
    left, right = companion(chosen)
    start = np.random.default_rng(1).standard_normal(left.shape[0]).astype(complex)
    return float(spla.eigs(left.astype(complex), NEAREST, right, root, v0=start, return_eigenvectors=False).real.max())


def patched(chosen: Design, element: int) -> Design:
    return chosen.with_elements(tuple(sorted((*chosen.patches.elements, element))))


COARSE = {
    "bare": design(840, mesh=(5, 3)),
    "far beyond, both symmetries grow": design(2000, mesh=(5, 3)),
    "patches": design(1000, (7, 8, 14), mesh=(5, 3)),
    "preload": design(600, (5,), mesh=(5, 3), load=Load(preload_x=0.5, preload_y=-0.3)),
    "buckled, still air": design(0.0, mesh=(5, 3), load=Load(preload_x=4.6)),
    "yaw": design(900, mesh=(5, 3), yaw=30.0),
    "across": design(900, mesh=(4, 5), yaw=90.0),
    "undamped": design(900, (3,), mesh=(5, 3), damping=0.0),
    "clamped": design(1500, mesh=(5, 3), panel=Panel(edges="cccc")),
    "cantilever": design(300, mesh=(5, 3), panel=Panel(edges="cfff")),
    "laminate": design(700, mesh=(5, 3), panel=laminate(0, 45, -45, 90)),
    "cross-ply, patches": design(900, (9, 10), mesh=(6, 3), panel=laminate(0, 90)),
    "straight edges": design(700, mesh=(4, 3), panel=laminate(0, 45, -45, 90, inplane="ssss")),
    "heat": design(500, (5,), mesh=(4, 3), load=Load(temperature=4.0, temperature_centre=3.0)),
    "few unknowns": design(900, mesh=(3, 2)),
}


@pytest.mark.parametrize("name", COARSE)
def test_every_element_of_a_coarse_mesh(name: str) -> None:
    chosen = COARSE[name]
    count, today = chosen.mesh.nx * chosen.mesh.ny, growth(chosen)
    assert today > 1.0  # it grows, so that there is no doubt which root leads
    found = patch_growth(chosen)
    assert found.shape == (count,)
    assert np.flatnonzero(np.isnan(found)).tolist() == list(chosen.patches.elements)
    for e in np.flatnonzero(~np.isnan(found)):
        assert found[e] == pytest.approx(growth(patched(chosen, int(e))) - today, abs=EXACT), e


@pytest.mark.parametrize(
    ("pressure", "root", "elements"), [(840, 250 + 1100j, ()), (1200, 350 + 1400j, ()), (1200, 300 + 1300j, SIX)]
)
def test_some_elements_of_the_seed_panel(pressure: float, root: complex, elements: tuple[int, ...]) -> None:
    chosen = design(pressure, elements)
    found, today = patch_growth(chosen), growth_near(chosen, root)
    for e in (0, 8, 44, 62, 104):
        assert found[e] == pytest.approx(growth_near(patched(chosen, e), root) - today, abs=EXACT), e
    assert np.nanmin(found) < -1.0  # some patch calms the panel, well beyond that tolerance


@pytest.mark.parametrize("elements", [SIX, (3, 50)])
def test_no_patch_of_the_seed_panel_takes_the_slow_way(
    elements: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    assembled: list[Design] = []
    assemble = PlateMatrices.of
    monkeypatch.setattr(PlateMatrices, "of", lambda chosen: assembled.append(chosen) or assemble(chosen))
    patch_growth(design(840, elements))
    assert len(assembled) == 1  # the panel of today


def test_mirror_images_do_the_same() -> None:
    found = patch_growth(design(1200, SIX)).reshape(24, 6)
    np.testing.assert_array_equal(found, found[:, ::-1])  # one of the two is computed


def test_mirror_images_do_the_same_where_both_are_computed() -> None:
    # a yaw so small that it moves no root by more than the tolerance, yet is not taken for zero
    found = patch_growth(design(840, mesh=(12, 6), yaw=1e-9)).reshape(12, 6)
    np.testing.assert_allclose(found, found[:, ::-1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found, patch_growth(design(840, mesh=(12, 6))).reshape(12, 6), rtol=0, atol=1e-6)


def test_reversed_flow_has_the_same_map() -> None:
    # the reversed flow's matrix is the transpose, patches and all
    one, other = (patch_growth(design(840, (20, 3), mesh=(12, 4), yaw=yaw)) for yaw in (0.0, 180.0))
    np.testing.assert_allclose(one, other, rtol=0, atol=EXACT)


def test_no_patch_makes_anything_grow_in_still_air() -> None:
    # λ = 0 and C_a = 0: no root grows or decays, whatever is put on
    found = patch_growth(design(0.0, (7,), mesh=(12, 4), damping=0.0))
    assert np.flatnonzero(np.isnan(found)).tolist() == [7]
    np.testing.assert_allclose(np.delete(found, 7), 0.0, atol=EXACT)


def test_a_stable_panel_stays_near_the_damping_of_the_stream() -> None:
    # a bare panel's roots all decay at half C/m; a patch's mass lets one decay a little slower, as long as none grows
    found = patch_growth(design(300.0, mesh=(12, 4)))
    assert np.all(found > 0)
    assert np.all(found < 2.0)  # of 18


def test_a_panel_with_no_room_left() -> None:
    assert np.isnan(patch_growth(design(840, tuple(range(16)), mesh=(4, 4)))).all()


def test_a_flow_by_its_mach_number() -> None:
    flown = Design(mesh=MeshSize(6, 3), flow=Flow(mach=2.0))
    stream = Stream.of(flown)
    given = Design(mesh=MeshSize(6, 3), flow=Flow(dynamic_pressure=stream.dynamic_pressure, damping=stream.damping))
    np.testing.assert_allclose(patch_growth(flown), patch_growth(given), rtol=0, atol=EXACT)
