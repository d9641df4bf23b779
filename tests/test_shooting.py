"""Periodic orbits against an independent integrator, exact laws of Floquet theory and the cycles found in time."""

import dataclasses

import msgspec
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from solver import Design, Loop, ModalModel, Plant, first_mode_at_rest, limit_cycle, load_design
from solver.branches import follow
from solver.cycles import limit_cycles
from solver.mesh import Floats
from solver.shooting import Orbit, find_orbit, free_loop, orbit_states
from solver.trace import probe_shapes
from solver.variational import FlowMap
from solver.vonkarman import membrane_force

SEED = load_design("seed-bare")
MODELS = {modes: ModalModel.of(SEED.with_reduction("family", modes)) for modes in (4, 6)}  # λ is no part of them


def family(modes: int, pressure: float) -> Plant:
    return Plant.of(SEED.with_reduction("family", modes).with_dynamic_pressure(pressure), MODELS[modes])


def rate(plant: Plant, state: Floats) -> Floats:
    """Ẋ by the plain form of the law, in numpy."""
    q, v = np.split(state, 2)
    force = plant.stiffness @ q + plant.damping @ v + membrane_force(plant.model.membrane, q)
    return np.concatenate([v, plant.model.load - force])


@pytest.fixture(scope="module")
def coexisting() -> dict[float, list[Orbit]]:
    """Stable cycles of the four-mode panel at some λ."""
    return {pressure: limit_cycles(family(4, pressure)) for pressure in (800.0, 1000.0, 1200.0)}


@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_transition_matrix_is_the_derivative_of_the_flow(damping: float) -> None:
    """By central differences, which are good to the square of their relative step, 1e-8, and to rounding over it."""
    flow_field = msgspec.structs.replace(SEED.flow, damping=damping)
    plant = Plant.of(msgspec.structs.replace(SEED.with_reduction("family", 4), flow=flow_field), MODELS[4])
    flow, rng = FlowMap.of(plant), np.random.default_rng(0)
    state = rng.standard_normal(8) / flow.weights * plant.model.omega[0] * SEED.panel.thickness / plant.model.peak[0]
    _, matrix = flow.transition(state, plant.period)
    for k in range(8):
        nudge = np.zeros(8)
        nudge[k] = 1e-5 * np.linalg.norm(flow.weights * state) / flow.weights[k]
        ends = [flow.transition(state + sign * nudge, plant.period)[0] for sign in (1, -1)]
        column = (ends[0] - ends[1]) / (2 * nudge[k])
        error = np.abs(flow.weights * (column - matrix[:, k])).max()
        assert error < 1e-6 * np.abs(flow.weights * matrix[:, k]).max()


def test_transition_matrix_with_a_cubic_law() -> None:
    """The part of an unsymmetric lay-up, here a made-up one, by the same differences on one short stretch."""
    plant = family(4, 840.0)
    plain, rng = FlowMap.of(plant), np.random.default_rng(1)
    state = rng.standard_normal(8) / plain.weights * plant.model.omega[0] * SEED.panel.thickness / plant.model.peak[0]
    size = np.abs(plain.spread).max() * np.abs(state[:4]).max()
    flow = dataclasses.replace(plain, cubic=rng.standard_normal((10, 4)) * size)
    jacobian = flow.jacobian(state)
    for k in range(8):
        nudge = np.zeros(8)
        nudge[k] = 1e-5 * np.linalg.norm(flow.weights * state) / flow.weights[k]
        column = (flow.rate(state + nudge) - flow.rate(state - nudge)) / (2 * nudge[k])
        assert column == pytest.approx(jacobian[:, k], abs=1e-6 * np.abs(jacobian[:, k]).max())


def test_linear_flow_is_the_matrix_exponential() -> None:
    """At small amplitude; the highest mode is turned 1e-6 a radian too slowly, some 30 radians here."""
    plant = family(4, 600.0)
    flow = FlowMap.of(plant)
    _, matrix = flow.transition(np.zeros(8), plant.period)
    exact = scipy.linalg.expm(plant.system_matrix * plant.period)
    balance = flow.weights[:, None] / flow.weights
    assert np.abs((matrix - exact) * balance).max() < 1e-4 * np.abs(exact * balance).max()


@pytest.mark.parametrize("pressure", [800.0, 1000.0, 1200.0])
def test_orbits_close_under_another_integrator(coexisting: dict[float, list[Orbit]], pressure: float) -> None:
    plant = family(4, pressure)
    weights = FlowMap.of(plant).weights
    for orbit in coexisting[pressure]:
        done = scipy.integrate.solve_ivp(
            lambda _, x: rate(plant, x), (0, orbit.period), orbit.state, "DOP853", rtol=1e-10, atol=1e-16
        )
        gap = np.linalg.norm(weights * (done.y[:, -1] - orbit.state)) / np.linalg.norm(weights * orbit.state)
        assert orbit.residual < 1e-8
        assert gap < 1e-4  # the orbit's own steps err by some 1e-5, see STEP_OMEGA


@pytest.mark.parametrize("pressure", [800.0, 1000.0, 1200.0])
def test_multipliers_obey_what_is_exact(coexisting: dict[float, list[Orbit]], pressure: float) -> None:
    """One is 1, of a shift in time; their product is exp(-tr C T) (Liouville), to the damping that the steps add."""
    damping = np.trace(family(4, pressure).damping)
    for orbit in coexisting[pressure]:
        assert abs(orbit.multipliers[orbit.trivial] - 1) < 1e-5
        assert np.all(np.diff(np.abs(orbit.multipliers)) <= 1e-12)
        product = complex(np.prod(orbit.multipliers))
        assert product.real == pytest.approx(np.exp(-damping * orbit.period), rel=1e-4)
        assert abs(product.imag) < 1e-9
        if orbit.roots is not None:
            assert np.sort(np.abs(orbit.roots) ** 2) == pytest.approx(np.sort(np.abs(orbit.multipliers)))


def test_two_cycles_coexist_at_1000_and_one_at_800(coexisting: dict[float, list[Orbit]]) -> None:
    assert [len(coexisting[pressure]) for pressure in (800.0, 1000.0, 1200.0)] == [1, 2, 2]
    for pressure in (1000.0, 1200.0):
        low, high = coexisting[pressure]
        assert low.stable
        assert high.stable
        assert low.symmetric
        assert not high.symmetric
        assert high.amplitude > 1.05 * low.amplitude
        assert high.frequency < 0.97 * low.frequency


@pytest.mark.parametrize(("modes", "amplitude", "rel"), [(4, 1.1772, 3e-3), (6, 1.1204, 1e-3)])
def test_shooting_agrees_with_time_integration(modes: int, amplitude: float, rel: float) -> None:
    """At λ = 840; the integrated cycle is within its own AGREEMENT of the end, 1e-3.

    Not so with four modes, just below the loss of symmetry: there what is still to come shrinks by 0.0012 a cycle only,
    which the series that time integration stops by takes for less than it is. 1.1795 is where it stops.
    """
    plant = family(modes, 840.0)
    cycle = limit_cycle(Loop.of(plant))
    assert cycle is not None
    orbit = find_orbit(plant, cycle.state, 1 / cycle.frequency)
    assert orbit is not None
    assert orbit.amplitude == pytest.approx(cycle.amplitude, rel=rel)
    assert orbit.frequency == pytest.approx(cycle.frequency, rel=1e-3)
    assert orbit.amplitude == pytest.approx(amplitude, abs=1e-4)  # the digits of the reference
    assert orbit.stable
    assert orbit.symmetric


def test_six_modes_at_1000_are_not_alike_in_up_and_down() -> None:
    plant = family(6, 1000.0)
    cycle = limit_cycle(Loop.of(plant))
    assert cycle is not None
    orbit = find_orbit(plant, cycle.state, 1 / cycle.frequency)
    assert orbit is not None
    assert not orbit.symmetric
    assert (orbit.amplitude, orbit.half_range) == pytest.approx((1.351, 1.341), abs=5e-4)  # the digits of the reference
    twin = find_orbit(plant, -orbit.state, orbit.period)
    assert twin is not None
    w = [orbit_states(plant, o)[:, :6] @ probe_shapes(plant) for o in (orbit, twin)]
    assert w[0].max() == pytest.approx(-w[1].min())
    assert np.abs(np.sort(twin.multipliers) - np.sort(orbit.multipliers)).max() < 1e-6


def test_largest_multiplier_is_the_decay_in_time() -> None:
    """At λ = 835 the symmetry of the cycle returns slowly, by a real multiplier: read off a motion nudged from it."""
    plant = family(4, 835.0)
    cycle = find_orbit(plant, limit_cycles_state(plant), plant.period)
    assert cycle is not None
    leading = cycle.others[0]
    assert leading.imag == 0
    weights = FlowMap.of(plant).weights
    nudge = 1e-2 * cycle.state * np.linspace(1, -1, 8)
    loop = dataclasses.replace(free_loop(plant), precision=np.float64)  # differences come down to 1e-9
    states, _ = loop.stretch(cycle.state + nudge, cycle.period / 512, 210 * 512, engaged=False)
    # second differences of a geometric approach are geometric, and free of a drift by the other kernel's own period
    steps = np.linalg.norm(weights * np.diff(states[::512], n=2, axis=0), axis=1)
    # from 100 cycles on, when the next multipliers (0.85) have died out; a nudge of 1 % moves the rate by its square
    assert (steps[200] / steps[100]) ** 0.01 == pytest.approx(leading.real, abs=1e-3)


def limit_cycles_state(plant: Plant) -> Floats:
    """A state near the plant's cycle, from the start of the seed protocol."""
    states, _ = free_loop(plant).stretch(first_mode_at_rest(plant, 5e-4), 1e-3, 500, engaged=False)
    return states[-1]


def test_a_hopeless_guess_gives_none_and_no_warning() -> None:
    assert find_orbit(family(4, 400.0), np.full(8, 1e-4), 0.005) is None  # below λ_cr there is nothing to find
    assert find_orbit(family(4, 800.0), np.zeros(8), 0.005) is None
    assert find_orbit(family(4, 800.0), np.full(8, 1e9), 0.005) is None


def test_several_periods_are_reduced_to_one(coexisting: dict[float, list[Orbit]]) -> None:
    (orbit,) = coexisting[800.0]
    again = find_orbit(family(4, 800.0), orbit.state, 6 * orbit.period)
    assert again is not None
    assert again.period == pytest.approx(orbit.period, rel=1e-6)


def test_branches_end_and_turn_where_their_multipliers_say(coexisting: dict[float, list[Orbit]]) -> None:
    """The four-mode panel: the first cycle loses its symmetry and regains it, and ends in a fold, as the second began.

    λ is asserted to 0.1 %, a tenth of what separates it from any other event here.
    """
    (first,) = coexisting[800.0]
    steps = list(follow(family(4, 800.0), np.arange(825.0, 1401.0, 25.0), first))
    events = [step.event for step in steps if step.event]
    assert [event.kind for event in events] == ["symmetry breaking", "symmetry breaking", "fold"]
    assert [event.dynamic_pressure for event in events] == pytest.approx([840.75, 1298.1, 1354.65], rel=1e-3)
    assert steps[-1].last
    assert not any(step.orbit.stable for step in steps if 845 < step.orbit.dynamic_pressure < 1295)
    second = list(follow(family(4, 1000.0), np.arange(980.0, 899.0, -20.0), coexisting[1000.0][0]))[-1]
    assert second.last
    assert second.event is not None
    assert second.event.kind == "fold"
    assert second.event.dynamic_pressure == pytest.approx(969.8, rel=1e-3)
    broken = list(follow(family(4, 1200.0), np.arange(1225.0, 1401.0, 25.0), coexisting[1200.0][1]))[-1]
    assert broken.event is not None
    assert broken.event.kind == "symmetry breaking"
    assert broken.event.dynamic_pressure == pytest.approx(1298.1, rel=1e-3)


def test_a_cycle_shrinks_to_rest_at_the_critical_pressure(coexisting: dict[float, list[Orbit]]) -> None:
    plant = family(4, 800.0)
    last = list(follow(plant, np.arange(760.0, 439.0, -40.0), coexisting[800.0][0]))[-1]
    assert plant.critical is not None
    assert last.event is not None
    assert last.event.kind == "rest"
    assert last.event.dynamic_pressure == pytest.approx(plant.critical[0], rel=1e-3)  # ten times RESOLUTION


def test_orbit_of_any_size_of_panel() -> None:
    """At given λ and C_a the amplitude over h holds no length."""
    panel = msgspec.structs.replace(SEED.panel, length=0.03, width=0.03, thickness=0.03 * 0.00417)
    small: Design = msgspec.structs.replace(SEED.with_reduction("family", 4), panel=panel)
    cycle = limit_cycle(Loop.of(Plant.of(small)))
    assert cycle is not None
    orbit = find_orbit(Plant.of(small), cycle.state, 1 / cycle.frequency)
    assert orbit is not None
    assert orbit.amplitude == pytest.approx(1.1772, abs=2e-4)  # a/h is 240 to four digits, and so is the reference
