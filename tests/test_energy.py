"""Energy of motions in still air: kept by the default step, and never gained where there is damping."""

import dataclasses

import numpy as np
import pytest

from solver import Design, Flow, Loop, MeshSize, Panel, Plant, first_mode_at_rest, load_design
from solver.design import Basis, Load, Ply, Reduction
from solver.mesh import Floats
from solver.simulate import COUPLED, SAMPLES_A_PERIOD, STEP_HIGHEST, STEP_LOWEST, Memory
from solver.vonkarman import pair_products

STILL = load_design("seed-bare").with_dynamic_pressure(0.0)
UNSYMMETRIC = (Ply("graphite-epoxy", 0, 0.0004), Ply("graphite-epoxy", 90, 0.0004))


def plant_of(basis: Basis, modes: int) -> Plant:
    return Plant.of(STILL.with_reduction(basis, modes))


def warped(heat: float, modes: int = 6) -> Plant:
    """A panel whose cubic law has odd terms, and on which heat acts as a static load."""
    panel = Panel(plies=UNSYMMETRIC, thickness=0.0008)
    load, reduction = Load(temperature=heat), Reduction("patched", modes)
    return Plant.of(Design(panel=panel, mesh=MeshSize(8, 6), flow=Flow(0.0), load=load, reduction=reduction))


def energy(plant: Plant, states: Floats) -> Floats:
    """Kinetic energy, energy of bending and prestress, of the membrane, and of the static load [J]."""
    q, rate = states[..., : plant.size], states[..., plant.size :]
    law, pairs = plant.model.membrane, pair_products(q)
    stretched = np.einsum("...p,pk,...k->...", pairs, law.quartic, pairs) / 2
    if len(law.cubic):
        stretched = stretched + np.einsum("...p,pk,...k->...", pairs, law.cubic, q)
    bent = np.einsum("...i,ij,...j->...", q, plant.stiffness, q) / 2
    return (rate**2).sum(axis=-1) / 2 + bent + stretched - q @ plant.model.load


def released(plant: Plant, periods: int, amplitude: float = 0.2) -> Floats:
    """States from the first mode at rest on, at the sampling of a run, the start included."""
    start = first_mode_at_rest(plant, amplitude * plant.design.panel.thickness)
    sample = 2 * np.pi / plant.model.omega[0] / SAMPLES_A_PERIOD
    states, _ = Loop.of(plant).stretch(start, sample, periods * SAMPLES_A_PERIOD, engaged=False)
    assert len(states) == periods * SAMPLES_A_PERIOD
    return np.vstack([start, states])


@pytest.mark.parametrize(
    ("basis", "modes"), [("family", 2), ("family", 4), ("family", 6), ("patched", 6), ("patched", 12), ("patched", 24)]
)
def test_energy_is_kept_over_a_hundred_periods(basis: Basis, modes: int) -> None:
    plant = plant_of(basis, modes)
    assert not plant.damping.any()
    found = energy(plant, released(plant, 100))
    # a step of at most STEP_LOWEST/ω1 loses (ωh)⁶/72 of a mode's energy: 2e-7 of the first one's in 100 periods
    np.testing.assert_allclose(found, found[0], rtol=1e-6)


@pytest.mark.parametrize(("heat", "loss"), [(0.0, 1e-6), (2.0, 3e-5)])
def test_energy_of_an_unsymmetric_layup(heat: float, loss: float) -> None:
    """Odd terms of the law, and the sudden load of heat, set the higher modes in motion, which lose more a step.

    Hence the smaller step there, COUPLED of the others'. From rest in the first mode the bound is the isotropic one;
    the heat of 2 K is a blow to the flat panel, ten times as strong. That what is lost is the step's error and no force
    without its energy, the next test shows.
    """
    plant = warped(heat)
    assert len(plant.model.membrane.cubic)
    assert bool(plant.model.load.any()) == bool(heat)
    states = released(plant, 100)
    found = energy(plant, states)
    kinetic = (states[:, plant.size :] ** 2).sum(axis=1).max() / 2
    np.testing.assert_allclose(found, found[0], rtol=0, atol=loss * kinetic)


@pytest.mark.parametrize("heat", [0.0, 2.0])
def test_what_is_lost_goes_with_the_fifth_power_of_the_step(heat: float) -> None:
    plant = warped(heat)
    (lowest, highest), loop = plant.model.band, Loop.of(plant)
    start = first_mode_at_rest(plant, 0.2 * plant.design.panel.thickness)
    step = COUPLED * min(STEP_HIGHEST / highest, STEP_LOWEST / lowest) * (1 - 1e-12)  # one step a sample
    span, lost = 40 * np.pi / lowest, []  # twenty periods
    for parts in (1, 2):
        # by classical steps, which a page takes and a law with a delay or noise
        blank = Memory.blank(loop.law)
        states, _, _ = loop.advance(start, blank, step / parts, round(span / step) * parts, engaged=False)
        lost.append(energy(plant, start) - energy(plant, states[-1]))
    assert lost[0] > 0
    # 2⁵ = 32; what is next in the series is some (ωh)² of it
    assert lost[0] / lost[1] == pytest.approx(32, rel=0.1)


def test_the_energy_left_out_would_be_missed() -> None:
    """A check of the checks: without its odd terms or the load, the energy of these motions is far from constant."""
    plant = warped(2.0)
    states = released(plant, 3)
    whole = energy(plant, states)
    scale = (states[:, plant.size :] ** 2).sum(axis=1).max() / 2
    q = states[:, : plant.size]
    load = q @ plant.model.load
    odd = np.einsum("tp,pk,tk->t", pair_products(q), plant.model.membrane.cubic, q)
    assert np.ptp(whole) < 1e-4 * scale  # three periods of the loss above
    assert np.ptp(whole + load) > 0.1 * scale
    assert np.ptp(whole - odd) > 1e-3 * scale


@pytest.mark.parametrize("amplitude", [0.02, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("rate", [1.0, 30.0])
def test_with_damping_alone_energy_never_grows(amplitude: float, rate: float) -> None:
    plain = plant_of("patched", 12)
    # damping without a stream: that of the aerodynamic matrix, with no slope's stiffness beside it
    matrix = rate * plain.model.bare_mass / plain.model.bare_mass[0, 0]
    plant = dataclasses.replace(plain, damping=matrix)
    assert np.linalg.eigvalsh(matrix)[0] > 0
    found = energy(plant, released(plant, 60, amplitude))
    # as long as there is energy to lose; then rounding, of sums of a thousand products, is all that moves it
    assert np.diff(found).max() <= 1e-14 * found[0]
    # all modes of a bare panel lose exp(-c t) of their energy but for the potential's share, once linear
    time = 60 * 2 * np.pi / plant.model.omega[0]
    assert found[-1] < found[0] * max(np.exp(-0.8 * rate * time), 1e-12)


@pytest.mark.parametrize("heat", [0.0, 2.0])
def test_damping_lets_a_warped_panel_settle(heat: float) -> None:
    plain = warped(heat)
    plant = dataclasses.replace(plain, damping=100.0 * plain.model.bare_mass / plain.model.bare_mass[0, 0])
    states = released(plant, 60)
    found = energy(plant, states)
    scale = np.abs(found).max()
    assert np.diff(found).max() <= 1e-14 * scale  # rounding
    # at rest: where the forces balance, flat without heat
    assert np.abs(np.diff(states[-2:], axis=0)).max() < 1e-3 * np.abs(states).max()
    if heat:
        assert found[-1] < 0  # the load has done work
    else:
        assert found[-1] < 1e-6 * found[0]


@pytest.mark.parametrize("amplitude", [0.1, 0.5])
def test_a_loop_that_is_off_is_an_open_one(amplitude: float) -> None:
    """A controller that is not engaged does no work."""
    design = load_design("seed-840").with_dynamic_pressure(0.0).with_reduction("patched", 8)
    plant = Plant.of(design)
    found = energy(plant, released(plant, 20, amplitude))
    np.testing.assert_allclose(found, found[0], rtol=1e-6)  # as above
