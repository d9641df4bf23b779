"""Static states: the wells of a buckled panel, what heat bends, and where a rising stream ends the rest."""

import msgspec
import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, Flow, MeshSize, ModalModel, Panel, Patches, Plant, buckling_factor, static_states
from solver.assembly import PlateMatrices
from solver.design import Basis, Load, Ply, Reduction
from solver.equilibrium import EndOfRest, critical_pressure_deflected, motion_about, rest, still_air_rest
from solver.flutter import buckled
from solver.mesh import Floats
from solver.vonkarman import pair_products

UNSYMMETRIC = (Ply("graphite-epoxy", 0, 0.0004), Ply("graphite-epoxy", 90, 0.0004))


def design(
    load: Load,
    pressure: float = 0.0,
    mesh: tuple[int, int] = (12, 6),
    modes: int = 16,
    basis: Basis = "patched",
    damping: float = 0.01,
    elements: tuple[int, ...] = (),
    plies: tuple[Ply, ...] = (),
    inplane: str = "iiii",
) -> Design:
    thickness = sum(ply.thickness for ply in plies) or 0.00127
    return Design(
        panel=Panel(plies=plies, thickness=thickness, inplane=inplane),
        mesh=MeshSize(*mesh),
        flow=Flow(pressure, damping),
        load=load,
        patches=Patches(elements=elements),
        reduction=Reduction(basis, modes),
    )


def both(value: float) -> Load:
    """Compression alike along x and y, R; a simply supported square buckles at 2."""
    return Load(preload_x=value, preload_y=value)


def plant(chosen: Design) -> Plant:
    return Plant.of(chosen).symmetric()


def potential(there: Plant, q: Floats) -> float:
    """Energy of the forces that have one: all but the flow's [J]."""
    model, pairs = there.model, pair_products(q)
    law = model.membrane
    flat = q @ (np.diag(model.omega**2) + model.geometric) @ q / 2
    cubic = pairs @ law.cubic @ q if len(law.cubic) else 0.0
    return float(flat + pairs @ law.quartic @ pairs / 2 + cubic - model.load @ q)


def imbalance(there: Plant, q: Floats) -> float:
    """Largest force that is left, by differences of the energy and the flow's own, over the largest in the balance."""
    model, step = there.model, 1e-3 * np.abs(q).max()
    axes = step * np.eye(len(q))
    # the energy is a quartic: along a line the five-point formula has its slope with no error but rounding
    one, two = (np.array([potential(there, q + k * d) - potential(there, q - k * d) for d in axes]) for k in (1, 2))
    conservative = (8 * one - two) / (12 * step)
    flow = (there.stiffness - np.diag(model.omega**2) - model.geometric) @ q
    return float(np.abs(conservative + flow).max() / np.abs(model.omega**2 * q).max())


# --- the wells of a buckled panel -------------------------------------------------------------------------------------


def test_a_buckled_square_has_two_wells_and_an_unstable_flat_state() -> None:
    there = plant(design(both(4.0)))
    flat, *wells = static_states(there)
    assert len(wells) == 2
    assert not flat.amplitudes.any()
    assert not flat.stable
    # flat, mode (1,1) has κ = Ω²(1 - R/2): at twice the buckling load it grows at Ω, to the mesh's error in that load
    assert flat.growth.real == pytest.approx(there.model.omega[0], rel=1e-4)
    assert flat.growth.imag == 0
    for well in wells:
        assert well.stable
        assert well.largest > 0.5
        assert imbalance(there, well.amplitudes) < 1e-7  # Newton's method ends at 1e-10; the differences are rounding
    low, high = wells
    # mirror images of one another, to what Newton's method leaves
    np.testing.assert_allclose(low.amplitudes, -high.amplitudes, atol=1e-8 * np.abs(high.amplitudes).max())
    assert low.deflection == pytest.approx(-high.deflection, rel=1e-8)
    assert low.largest == pytest.approx(high.largest, rel=1e-8)


@pytest.mark.parametrize(("load", "pressure"), [(both(4.0), 0.0), (both(4.0), 120.0), (both(8.0), 50.0)])
def test_stability_is_that_of_small_motions(load: Load, pressure: float) -> None:
    there = plant(design(load, pressure, damping=0.1))
    states = static_states(there)
    assert any(state.stable for state in states)
    for state in states:
        values = np.linalg.eigvals(motion_about(there, state.amplitudes))
        assert state.growth.real == pytest.approx(values.real.max(), abs=1e-6 * there.model.omega[0])  # rounding
        if state.stable:
            assert values.real.max() <= 1e-6 * there.model.omega[0]  # by no more than rounding
        if state.largest:
            assert imbalance(there, state.amplitudes) < 1e-7  # as above


def test_small_motions_about_a_well_turn_as_the_energy_bends() -> None:
    """In still air the squares of the frequencies are the eigenvalues of the energy's second derivative."""
    there = plant(design(both(4.0), modes=6))
    well = static_states(there)[-1]
    step = 1e-3 * np.abs(well.amplitudes).max()
    n = there.size
    axes = step * np.eye(n)
    bend = np.empty((n, n))
    for r in range(n):
        for s in range(n):
            signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
            energies = [potential(there, well.amplitudes + a * axes[r] + b * axes[s]) for a, b in signs]
            bend[r, s] = (energies[0] - energies[1] - energies[2] + energies[3]) / (4 * step**2)
    frequencies = np.sort(np.abs(np.linalg.eigvals(motion_about(there, well.amplitudes)).imag))[::2]
    # central differences err by step² of a quartic, 1e-6, and by rounding of energies over step², which is as much
    np.testing.assert_allclose(frequencies**2, np.linalg.eigvalsh(bend), rtol=1e-4)


def test_below_the_buckling_load_there_is_nothing_but_flat() -> None:
    states = static_states(plant(design(both(1.9))))
    assert len(states) == 1
    assert states[0].stable
    assert states[0].largest == 0
    assert still_air_rest(plant(design(both(1.9)))) is None
    assert still_air_rest(plant(design(Load()))) is None


def test_a_second_mode_buckles_at_its_own_load() -> None:
    # (2,1) and (1,2) give way at R = 5: beyond it more states come, all unstable but for the first wells
    counts = [len(static_states(plant(design(both(value))))) for value in (4.0, 6.0)]
    assert counts == [3, 5]
    states = static_states(plant(design(both(6.0))))
    assert [state.stable for state in states] == [False, False, False, True, True]


@pytest.mark.parametrize("value", [2.2, 3.0, 4.0])
def test_one_mode_after_buckling(value: float) -> None:
    """Ω²(1 - R/2) q + 2 G q³ = 0, so that q² = Ω²(R/2 - 1)/(2 G), and of the plate itself W.

    In the mode W sin(πx/a) sin(πy/a), with edges held along their normals alone, von Kármán's equations are solved
    exactly: the in-plane stresses add W² π⁴ E h/(8 a⁴) (1 + 2/(1 - ν)) to D (2π²/a²)² (1 - R/2), and so (W/h)² =
    (R/2 - 1) 8/(3 (1 + ν)(3 - ν)) (after Chu and Herrmann, J. Appl. Mech. 23, 1956).
    """
    there = plant(design(both(value), basis="family", modes=2, mesh=(16, 16), inplane="nnnn"))
    model = there.model
    well = static_states(there)[-1]
    amplitude = np.sqrt(model.omega[0] ** 2 * (value / 2 - 1) / (2 * model.membrane.quartic[0, 0]))
    # the mesh buckles at 2 (1 + 1e-5): R/2 - 1 is off by as much, which at R = 2.2 is a tenth
    assert abs(well.amplitudes[0]) == pytest.approx(amplitude, rel=2e-4)
    assert abs(well.amplitudes[1]) < 1e-6 * amplitude  # the energy is even in it, and stiff: rounding
    nu = there.design.panel.poisson
    exact = np.sqrt((value / 2 - 1) * 8 / (3 * (1 + nu) * (3 - nu)))
    assert well.largest == pytest.approx(exact, rel=5e-3)  # bilinear in-plane displacements: some (π/16)²/10


def test_newton_needs_no_good_start() -> None:
    there = plant(design(both(4.0)))
    wells = static_states(there)[1:]
    for scale in (0.7, 1.0, 3.0, 30.0):  # much nearer to flat, it is flat that it finds
        found = rest(there, scale * wells[1].amplitudes)
        assert found is not None
        assert min(np.abs(found - well.amplitudes).max() for well in wells) < 1e-6 * np.abs(wells[1].amplitudes).max()


def test_a_static_pressure_bends_the_flat_panel() -> None:
    there = plant(design(Load(preload_x=1e-9), modes=6))  # a load of no weight: the panel is flat but for the pressure
    force = np.zeros(there.size)
    force[0] = 1e-4 * there.model.omega[0] ** 2 * there.design.panel.thickness / there.model.peak[0]
    found = rest(there, np.zeros(there.size), force)
    assert found is not None
    # so small a deflection, 1e-4 h, is linear to the square of that
    np.testing.assert_allclose(found, force / there.model.omega**2, atol=1e-6 * np.abs(found).max())


# --- heat in an unsymmetric lay-up ------------------------------------------------------------------------------------


def test_heat_bends_an_unsymmetric_layup_at_once() -> None:
    chosen = design(Load(temperature=0.5), plies=UNSYMMETRIC, modes=10)
    there = plant(chosen)
    assert there.model.load.any()
    (state,) = static_states(there)
    assert state.stable
    assert state.largest > 1e-3
    assert imbalance(there, state.amplitudes) < 1e-7  # Newton's method ends at 1e-10; the differences are rounding


def test_a_little_heat_bends_it_linearly() -> None:
    deflections = []
    for rise in (1e-4, 2e-4):
        there = plant(design(Load(temperature=rise), plies=UNSYMMETRIC, modes=10))
        (state,) = static_states(there)
        linear = np.linalg.solve(there.stiffness, there.model.load)
        # the quadratic force is smaller than the linear one by w/h, here some 1e-5
        np.testing.assert_allclose(state.amplitudes, linear, rtol=0, atol=1e-3 * np.abs(linear).max())
        deflections.append(state.largest)
    assert deflections[1] == pytest.approx(2 * deflections[0], rel=1e-3)  # likewise


def test_a_warped_panel_has_no_mirror_image() -> None:
    """Turned over, the lay-up bends to the other side by as much."""
    over = tuple(reversed(UNSYMMETRIC))
    one, other = (
        static_states(plant(design(Load(temperature=6.0), plies=plies, modes=10))) for plies in (UNSYMMETRIC, over)
    )
    assert len(one) == len(other) > 1
    # the deepest well of the one is that of the other, mirrored; Newton's method and rounding of two models
    assert one[-1].deflection == pytest.approx(-other[-1].deflection, rel=1e-6)
    assert abs(one[-1].largest - one[-2].largest) > 0.01 or one[-1].stable != one[-2].stable


# --- in a rising stream -----------------------------------------------------------------------------------------------


def end(chosen: Design) -> EndOfRest:
    found = critical_pressure_deflected(plant(chosen))
    assert found is not None
    return found


@pytest.mark.parametrize("basis", ["patched", "family"])
def test_the_stream_presses_a_shallow_buckle_out(basis: Basis) -> None:
    """R = 3: the flat panel's stiffness is singular at the λ at which the deflection ends, in a pitchfork."""
    chosen = design(both(3.0), basis=basis, modes=16 if basis == "patched" else 6)
    found = end(chosen)
    assert found.kind == "flat"
    assert found.frequency == 0
    assert found.dynamic_pressure == pytest.approx(170.4, abs=0.3)  # three bases and meshes lie that near to another
    there = plant(chosen)

    def sign(pressure: float) -> float:
        stiffness = there.at_pressure(pressure).stiffness
        return float(np.linalg.det(stiffness / there.model.omega[:, None] ** 2))

    singular = scipy.optimize.root_scalar(sign, bracket=(100.0, 200.0), xtol=1e-6).root
    assert found.dynamic_pressure == pytest.approx(singular, rel=1e-5)  # followed to 1e-6, and to FLAT
    for share, flat in ((0.999, False), (1.001, True)):
        states = static_states(there.at_pressure(share * singular))
        assert states[0].stable is flat
        assert len(states) == (1 if flat else 3)


def test_the_deflection_falls_as_a_root_where_the_stream_presses_it_out() -> None:
    chosen = design(both(3.0))
    last = end(chosen).dynamic_pressure
    there = plant(chosen)
    depths = [static_states(there.at_pressure(last * (1 - away)))[-1].largest for away in (4e-3, 1e-3, 2.5e-4)]
    # a pitchfork: a quarter of the distance, half of the depth; what is next in the series is the distance itself
    np.testing.assert_allclose([depths[0] / depths[1], depths[1] / depths[2]], 2.0, rtol=0.01)
    assert depths[2] < 0.03


@pytest.mark.parametrize("value", [4.0, 6.0])
def test_a_deep_buckle_goes_over_into_motion(value: float) -> None:
    chosen = design(both(value))
    found = end(chosen)
    assert found.kind == "motion"
    assert found.frequency == 0
    there = plant(chosen)
    assert any(state.stable for state in static_states(there.at_pressure(0.999 * found.dynamic_pressure)))
    above = there.at_pressure(1.001 * found.dynamic_pressure)
    assert above.flutters
    assert not any(state.stable for state in static_states(above))


def test_a_flat_panel_has_no_rest_to_end() -> None:
    assert critical_pressure_deflected(plant(design(both(1.0)))) is None
    assert critical_pressure_deflected(plant(design(Load()))) is None


def test_up_to_the_end_the_rest_is_stable() -> None:
    chosen = design(both(6.0))
    last = end(chosen).dynamic_pressure
    there = plant(chosen)
    for share in (0.0, 0.3, 0.6, 0.9, 0.99):
        deflected = [state for state in static_states(there.at_pressure(share * last)) if state.largest]
        assert any(state.stable for state in deflected)


def test_damping_moves_no_end_that_is_not_flutter() -> None:
    # a static bifurcation knows nothing of rates; both are followed to 1e-6
    light, heavy = (end(design(both(3.0), damping=damping)).dynamic_pressure for damping in (0.01, 1.0))
    assert heavy == pytest.approx(light, rel=1e-5)


# --- passive ----------------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 9.0), st.floats(0.0, 600.0))
def test_a_panel_at_rest_in_a_buckle_is_never_passive(value: float, pressure: float) -> None:
    chosen = design(both(value), pressure, mesh=(8, 4), modes=8, elements=(9, 10))
    there = plant(chosen)
    states = static_states(there)
    if there.passive:
        # nothing to end: flat is where it stays, and it has nowhere else to rest
        assert not there.flutters
        assert states[0].stable
        assert states[0].largest == 0
        assert not any(state.stable and state.largest for state in states)
    if buckled(there.model) and any(state.stable and state.largest for state in states):
        assert not there.passive


def test_still_air_never_makes_a_buckled_panel_passive() -> None:
    for value in (4.0, 8.0, 40.0):
        there = plant(design(both(value), mesh=(8, 4), modes=8, elements=(9, 10)))
        assert buckled(there.model)
        assert not there.passive


# --- the factor on the load -------------------------------------------------------------------------------------------


# (m² + n²)²/(R_x m² + R_y n²) of a simply supported square; a mesh of 12 is high by (π m/12)⁴/720: 7e-6 for m = 1,
# 1e-4 for m = 2, of 24 for m = 5 2.5e-4
@pytest.mark.parametrize(
    ("compression", "mesh", "exact", "rel"),
    [
        ((1.0, 0.0), (12, 12), 4.0, 2e-5),
        ((0.0, 1.0), (12, 12), 4.0, 2e-5),
        ((1.0, 1.0), (12, 12), 2.0, 2e-5),
        ((3.0, 3.0), (12, 12), 2 / 3, 2e-5),
        ((1.0, -1.0), (12, 12), 25 / 3, 2e-4),
        ((1.0, -10.0), (24, 6), 676 / 15, 4e-4),  # five half-waves along x
        ((-10.0, 1.0), (6, 24), 676 / 15, 4e-4),
    ],
)
def test_buckling_factor(compression: tuple[float, float], mesh: tuple[int, int], exact: float, rel: float) -> None:
    plate = PlateMatrices.of(design(Load(*compression), mesh=mesh))
    assert buckling_factor(plate) == pytest.approx(exact, rel=rel)


@pytest.mark.parametrize("rise", [0.5, 2.0, 50.0])
def test_buckling_temperature(rise: float) -> None:
    """E α ΔT h/(1 - ν) = 2 π² D/a² on a square that cannot expand: ΔT = π² h²/(6 (1 + ν) α a²)."""
    panel = Panel()
    exact = np.pi**2 * panel.thickness**2 / (6 * (1 + panel.poisson) * panel.expansion * panel.length**2)
    factor = buckling_factor(PlateMatrices.of(design(Load(temperature=rise))))
    assert factor is not None
    assert factor * rise == pytest.approx(exact, rel=1e-4)  # six elements across: (π/6)⁴/720


@pytest.mark.parametrize(
    ("load", "mesh"),
    [
        (Load(), (12, 6)),
        (both(-1.0), (12, 6)),
        (Load(preload_x=-1.0), (12, 6)),
        (Load(temperature=-5.0), (12, 6)),
        (Load(temperature_centre=-5.0), (12, 6)),
        (Load(preload_y=-1.0), (24, 6)),  # no eigenvalue stands out from the cluster at zero
    ],
)
def test_what_pulls_does_not_buckle(load: Load, mesh: tuple[int, int]) -> None:
    assert buckling_factor(PlateMatrices.of(design(load, mesh=mesh))) is None


def times(load: Load, factor: float) -> Load:
    """All of a load so many times as large."""
    names = ("preload_x", "preload_y", "temperature", "temperature_centre")
    return msgspec.structs.replace(load, **{name: factor * getattr(load, name) for name in names})


@pytest.mark.parametrize("plies", [(), UNSYMMETRIC])
@pytest.mark.parametrize("load", [both(1.0), Load(temperature=1.0), Load(temperature_centre=1.0)])
def test_at_the_factor_the_flat_panel_is_indifferent(load: Load, plies: tuple[Ply, ...]) -> None:
    chosen = design(load, plies=plies, mesh=(6, 6), modes=40)
    plate = PlateMatrices.of(chosen)
    factor = buckling_factor(plate)
    assert factor is not None
    assert plate.geometric is not None
    stiffness = plate.condensed_stiffness()
    values = [
        np.linalg.eigvalsh(stiffness + share * factor * plate.geometric.toarray())[0] for share in (0.999, 1.0, 1.001)
    ]
    assert values[0] > 0 > values[2]
    assert abs(values[1]) < 1e-2 * values[0]  # a thousandth of the load away it is that; here rounding
    for share, over in ((0.99, False), (1.01, True)):
        assert buckled(ModalModel.of(chosen.with_load(times(load, share * factor)))) is over
