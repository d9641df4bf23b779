"""The full-order model: its forces, its steps in time, and what the reduced model answers to it for."""

import msgspec
import numpy as np
import pytest

from solver import Design, Flow, Loop, MeshSize, ModalModel, Panel, Patches, Plant, limit_cycle, seed_protocol
from solver.design import Load, Ply, Reduction, Run
from solver.fullorder import FullModel, lu_solver
from solver.fullrun import full_limit_cycle, full_run, full_seed_protocol
from solver.mesh import Floats
from solver.vonkarman import membrane_force

SMALL = MeshSize(4, 3)
CROSS = (Ply("graphite-epoxy", 0.0, 0.0006), Ply("graphite-epoxy", 90.0, 0.0006))
DESIGNS = {
    "patched": Design(mesh=SMALL, patches=Patches(elements=(4, 5))),
    "heated": Design(mesh=SMALL, load=Load(preload_x=0.3, temperature=8.0, temperature_centre=5.0)),
    "straight": Design(mesh=SMALL, panel=Panel(inplane="ssss", edges="scss"), load=Load(preload_y=0.5)),
    "across": Design(mesh=MeshSize(3, 5), panel=Panel(inplane="snfn", edges="ssfs"), flow=Flow(yaw_deg=20.0)),
    "unsymmetric": Design(
        mesh=SMALL,
        panel=Panel(thickness=0.0012, plies=CROSS),
        patches=Patches(elements=(1,)),
        load=Load(temperature=12.0, temperature_centre=4.0),
    ),
}
STILL = Flow(dynamic_pressure=0.0, damping=0.0)
# the seed's panel on a coarser mesh with four elements patched: symmetric, so that 22 modes do for 40
COARSE = Design(mesh=MeshSize(12, 4), patches=Patches(elements=(5, 6, 9, 10)), reduction=Reduction("patched", 40))


@pytest.fixture(params=DESIGNS)
def design(request: pytest.FixtureRequest) -> Design:
    return DESIGNS[request.param]


def anywhere(full: FullModel, seed: int) -> Floats:
    """A random x of about 1 h."""
    return np.random.default_rng(seed).standard_normal(full.size) * full.design.panel.thickness / full.scale


def test_force_is_the_gradient_of_the_energy(design: Design) -> None:
    full = FullModel.of(design)
    x = anywhere(full, 1)
    step = 0.1 * design.panel.thickness / full.scale
    # along a line the energy is a quartic, whose slope the five-point formula gives without truncation
    u = [np.array([full.energy(x + k * d) for d in np.diag(step)]) for k in (-2, -1, 1, 2)]
    gradient = (u[0] - 8 * u[1] + 8 * u[2] - u[3]) / 12
    force = full.internal_force(x) * step
    # rounding of the whole panel's energy, 1e-16 of it, against the work of one dof
    np.testing.assert_allclose(gradient, force, atol=1e-14 * full.energy(x), rtol=1e-9)


def test_tangent_is_the_derivative_of_the_force(design: Design) -> None:
    full = FullModel.of(design)
    x = anywhere(full, 2)
    step = 0.1 * design.panel.thickness / full.scale
    # the force is a cubic along a line: again no truncation
    f = [np.array([full.internal_force(x + k * d) for d in np.diag(step)]) for k in (-2, -1, 1, 2)]
    derivative = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / 12 / full.scale
    tangent = full.tangent(x).toarray() * step[:, None] / full.scale
    np.testing.assert_allclose(derivative, tangent, atol=1e-12 * np.abs(tangent).max())  # rounding


def test_blocks_of_inertia_and_flow_add_up_to_their_matrices(design: Design) -> None:
    full = FullModel.of(design)
    x = anywhere(full, 3)
    added = full.tangent(x, full.inertial_blocks(2.0, 3.0)) - full.tangent(x)
    matrix = (2 * full.plate.mass + 3 * full.damping + full.flow).toarray()
    found = added.toarray()[np.ix_(full.bending, full.bending)]
    # what is left of a difference of tangents that are stiffer by far
    np.testing.assert_allclose(found, matrix, atol=1e-13 * np.abs(full.tangent(x).data).max())


@pytest.mark.parametrize("name", ["patched", "straight"])  # banded, and tied together by its straight edges
def test_factors_solve(name: str) -> None:
    full = FullModel.of(msgspec.structs.replace(DESIGNS[name], mesh=MeshSize(10, 8)))
    x = anywhere(full, 4) / 100
    tangent = full.tangent(x, full.inertial_blocks(1e9, 1e4))
    right = tangent @ x
    np.testing.assert_allclose(lu_solver(tangent)(right) * full.scale, x * full.scale, atol=1e-12)  # m: 1e-7 of x


def test_in_modes_it_is_the_reduced_law(design: Design) -> None:
    """With u condensed, Φᵀ f(Φ q) = Ω² q + Φᵀ K_N Φ q + f_cubic(q) - p: the same integrals in another order."""
    model = ModalModel.of(msgspec.structs.replace(design, reduction=Reduction("patched", 8)))
    full = FullModel.of(design, model.plate)
    for seed in range(3):
        q = np.random.default_rng(seed).standard_normal(8) * design.panel.thickness / model.peak
        w = model.shapes @ q
        force = full.internal_force(full.unknowns(w, full.condensed(w)))
        reduced = model.omega**2 * q + model.geometric @ q + membrane_force(model.membrane, q) - model.load
        # rounding, and that of the eigenvectors; parts of ∫ of large stresses cancel each other
        np.testing.assert_allclose(model.shapes.T @ force[full.bending], reduced, atol=1e-9 * np.abs(reduced).max())
        assert np.abs(force[full.inplane]).max() < 1e-9 * np.abs(force).max()


def test_small_motion_turns_at_the_natural_frequencies() -> None:
    """The mid-point rule turns a mode by 2 atan(ω Δt / 2) a step, exactly, and so in all modes at once."""
    design = msgspec.structs.replace(COARSE, flow=STILL, reduction=Reduction("patched", 6))
    loop = Loop.of(Plant.of(design))
    model, step, count = loop.plant.model, loop.plant.period / 100, 150
    amplitude = 1e-4 * design.panel.thickness / model.peak
    trace = full_run(loop, np.append(amplitude, 0 * amplitude), step, count, False, steps=1, rho=1.0)
    angle = 2 * np.arctan(model.omega * step / 2)
    exact = amplitude * np.cos(np.arange(count + 1)[:, None] * angle)
    # of the amplitude: stretching adds (w/h)² = 1e-8 to the stiffness, over a turn or ten; Newton's method less
    np.testing.assert_allclose(trace.amplitudes / amplitude, exact / amplitude, atol=2e-6)


def energies(loop: Loop, periods: int, steps: int) -> Floats:
    """Energy at every step of a free motion by the mid-point rule, from 1 h in the first two modes [J]."""
    plant = loop.plant
    full = FullModel.of(plant.design, plant.model.plate)
    start = np.zeros(2 * plant.size)
    start[:2] = plant.design.panel.thickness / plant.model.peak[:2] * [1.0, 0.4]
    trace = full_run(loop, start, plant.period / steps, periods * steps, False, full=full, steps=1, rho=1.0)
    strain = [full.energy(full.unknowns(w, full.condensed(w))) for w in trace.deflections]
    return strain + np.einsum("ki,ki->k", trace.rates, trace.rates @ full.plate.mass) / 2


def test_energy_of_an_undisturbed_panel_is_kept() -> None:
    loop = Loop.of(Plant.of(msgspec.structs.replace(DESIGNS["patched"], flow=STILL, reduction=Reduction("patched", 4))))
    coarse, fine = (energies(loop, 4, steps) for steps in (100, 200))
    # the mid-point rule is symplectic: the energy swings by some Δt², a quarter at half the step, and does not drift
    assert np.ptp(coarse) < 0.01 * coarse.mean()
    assert np.ptp(fine) < 0.3 * np.ptp(coarse)
    half = len(fine) // 2
    assert fine[half:].mean() == pytest.approx(fine[:half].mean(), rel=1e-3)  # half the swing


@pytest.mark.parametrize("engaged", [False, True])
def test_error_goes_with_the_square_of_the_step(engaged: bool) -> None:
    loop = Loop.of(Plant.of(msgspec.structs.replace(COARSE, reduction=Reduction("patched", 12))))
    plant = loop.plant
    start = np.zeros(2 * plant.size)
    # controlled from so small a motion that nothing saturates, which would be a kink in time
    start[0] = (0.01 if engaged else 0.5) * plant.design.panel.thickness / plant.model.peak[0]
    counts = np.array([40, 80, 160, 320])
    ends = [full_run(loop, start, plant.period / 2, 2, engaged, steps=int(k) // 2).amplitudes[-1] for k in counts]
    assert not engaged or np.abs(loop.law.gain @ start).max() < loop.law.limit
    change = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    slope = np.polyfit(np.log(counts[:-1]), np.log(change), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.15)  # an asymptote; these steps are on the way to it


def test_limit_cycle_is_that_of_a_rich_basis() -> None:
    loop = Loop.of(Plant.of(COARSE.with_elements(())).symmetric())
    reduced, full = limit_cycle(loop), full_limit_cycle(loop, 64)
    assert reduced is not None
    assert full is not None
    assert full.converged
    # 0.1 % of both is how well a cycle counts as converged, 0.1 % the step, 0.2 % the modes left out
    assert full.amplitude == pytest.approx(reduced.amplitude, rel=4e-3)
    # (2π/64)²/12 is what the step lengthens the period by
    assert full.frequency == pytest.approx(reduced.frequency, rel=2e-3)


def test_controlled_run_is_that_of_a_rich_basis() -> None:
    """To 0.01 h: below, fast modes that no basis has ring on, struck when the controller switches on."""
    run = Run(control_on=0.05, duration=0.12, initial_amplitude=0.5, settled=0.01)
    design = msgspec.structs.replace(COARSE, run=run, reduction=Reduction("patched", 48))
    loop = Loop.of(Plant.of(design).symmetric())
    reduced, full = seed_protocol(loop), full_seed_protocol(loop)
    assert reduced.damping_time is not None
    np.testing.assert_allclose(full.times, reduced.times[: len(full.times)], rtol=1e-12)
    # until t_on nothing but the basis and the step differ; 2 % of 1.6 h is measured, of phase, after eight turns
    free = full.times <= run.control_on
    np.testing.assert_allclose(full.probe[free], reduced.probe[: free.sum()], atol=0.06)
    # 0.7 % is measured; half a turn of the second mode, by which the last swing above 0.01 h may be another, is 4 %
    assert full.damping_time == pytest.approx(reduced.damping_time, rel=0.04)
    # 1 % is measured, 1.5 % with half the step: in voltage the fast modes weigh more, and samples miss their peaks
    assert full.peak_voltage == pytest.approx(reduced.peak_voltage, rel=0.03)
    assert reduced.peak_voltage > 100  # near the limit: this is not small motion


def test_a_run_goes_on_from_its_end() -> None:
    loop = Loop.of(Plant.of(msgspec.structs.replace(COARSE, reduction=Reduction("patched", 8))))
    plant, sample = loop.plant, loop.plant.period / 20
    start = np.zeros(2 * plant.size)
    start[0] = 0.2 * plant.design.panel.thickness / plant.model.peak[0]
    whole = full_run(loop, start, sample, 20, True, steps=20)
    first = full_run(loop, start, sample, 10, True, steps=20)
    second = full_run(loop, first.end, sample, 10, True, steps=20)
    # a start finds its acceleration from equilibrium, a step from the one before: both to second order in the step
    np.testing.assert_allclose(second.probe, whole.probe[10:], atol=1e-3 * np.abs(whole.probe).max())


def test_a_step_that_does_not_converge_is_said_to() -> None:
    loop = Loop.of(Plant.of(msgspec.structs.replace(COARSE, reduction=Reduction("patched", 8))))
    state = np.zeros(2 * loop.plant.size)
    state[loop.plant.size] = 1e6 * loop.plant.design.panel.thickness / loop.plant.model.peak[0] / loop.plant.period
    with pytest.raises(ArithmeticError, match="use more steps"):
        full_run(loop, state, loop.plant.period, 4, False, steps=1)
