"""The regulator: python-control's gain, a stable loop, voltages within the limit, and where NFCG points."""

from functools import lru_cache
from typing import Literal

import control
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Control, Design, Loop, Plant, Regulator, load_design, nfcg
from solver.design import Patches
from solver.piezo import channels
from solver.regulator import lqr_gain

SAMPLE = 2e-4  # s: 28 in a period of the seed panel's flutter


@lru_cache
def plant_of(name: str) -> Plant:
    """The symmetric plant of a preset."""
    return Plant.of(load_design(name)).symmetric()


@pytest.mark.parametrize("name", ["seed-840", "seed-1200"])
def test_gain_is_that_of_python_control(name: str) -> None:
    plant = plant_of(name)
    n, weights = plant.size, plant.design.control
    a, b = plant.system_matrix, plant.input_matrix
    q = weights.state_weight * np.diag(np.concatenate([plant.model.omega**2, np.ones(n)]))
    gain, _, _ = control.lqr(a, b, q, weights.effort_weight * np.eye(b.shape[1]))
    ours = lqr_gain(plant, plant.force)
    # python-control solves the same equation without balancing, and ω² spans six decades
    assert np.linalg.norm(ours - gain) < 1e-6 * np.linalg.norm(gain)


@pytest.mark.parametrize("name", ["seed-840", "seed-1200"])
def test_closed_loop_is_stable(name: str) -> None:
    plant = plant_of(name)
    regulator = Regulator.of(plant)
    values = np.linalg.eigvals(plant.system_matrix - plant.input_matrix @ regulator.gain)
    assert plant.growth.real > 0
    assert values.real.max() < 0
    assert regulator.growth.real == pytest.approx(values.real.max(), rel=1e-6)  # the same matrix, taken in blocks


def test_without_patches_or_control_nothing_is_driven() -> None:
    bare = Regulator.of(plant_of("seed-bare"))
    assert bare.gain.shape[0] == 0
    off = msgspec.structs.replace(load_design("seed-840"), control=Control(kind="off"))
    regulator = Regulator.of(Plant.of(off).symmetric())
    assert not regulator.gain.any()
    assert regulator.growth.real > 0


def test_patches_without_force_drive_nothing() -> None:
    design = load_design("seed-840")
    dead = msgspec.structs.replace(design, patches=msgspec.structs.replace(design.patches, d31=0.0))
    assert not Regulator.of(Plant.of(dead)).gain.any()


@pytest.mark.parametrize("pressure", [840.0, 1200.0])
def test_nfcg_is_symmetric_and_points_to_the_leading_third(pressure: float) -> None:
    design = load_design("seed-bare").with_dynamic_pressure(pressure)
    norms = nfcg(design).reshape(design.mesh.nx, design.mesh.ny)
    # rounding in a Riccati equation of 48 states with 144 inputs
    np.testing.assert_allclose(norms, norms[:, ::-1], rtol=1e-6)
    assert np.all(norms > 0)
    i, _ = np.unravel_index(np.argmax(norms), norms.shape)
    assert i < design.mesh.nx // 3


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-3, 3.0), st.floats(0.5, 228.6), st.integers(0, 2**32 - 1))
def test_voltage_never_exceeds_the_limit(amplitude: float, limit: float, seed: int) -> None:
    plant = plant_of("seed-840")
    regulator = Regulator(Regulator.of(plant).gain, limit, 0j)
    q = np.random.default_rng(seed).standard_normal(plant.size) * amplitude * plant.design.panel.thickness
    start = np.concatenate([q / plant.model.peak, q * plant.model.omega[0] / plant.model.peak])
    _, volts = Loop.of(plant, regulator).stretch(start, SAMPLE, 50, engaged=True)
    assert np.all(np.abs(volts) <= limit)


@pytest.mark.parametrize(
    ("kind", "elements", "groups"),
    [
        ("connected", (20, 21, 26, 27, 32, 33), [(20, 21, 26, 27, 32, 33)]),
        ("connected", (0, 7), [(0,), (7,)]),  # diagonal neighbours share a corner, not an edge
        ("connected", (5, 6), [(5,), (6,)]),  # next in number, but at opposite ends of two rows
        ("connected", (0, 6, 7, 20), [(0, 6, 7), (20,)]),
        ("element", (27, 20, 21), [(20,), (21,), (27,)]),
        ("single", (0, 7, 143), [(0, 7, 143)]),
        ("single", (), []),
        ("connected", (), []),
    ],
)
def test_channels(
    kind: Literal["connected", "element", "single"], elements: tuple[int, ...], groups: list[tuple[int, ...]]
) -> None:
    assert channels(Design(patches=Patches(elements=elements, channels=kind))) == groups


def test_channel_forces_are_sums_of_element_forces() -> None:
    design = load_design("seed-840")
    apart = msgspec.structs.replace(design, patches=msgspec.structs.replace(design.patches, channels="element"))
    together, single = Plant.of(design).symmetric(), Plant.of(apart).symmetric()
    # symmetric modes alone: antisymmetric ones are made exactly unreachable for the set, not for its elements
    np.testing.assert_allclose(single.force.sum(axis=1), together.force[:, 0], atol=1e-9 * np.abs(together.force).max())


def test_state_space_is_the_plant() -> None:
    plant = plant_of("seed-1200")
    system = plant.state_space()
    assert system.ninputs == system.noutputs == len(plant.channels)
    one, other = (np.sort_complex(values) for values in (system.poles(), np.linalg.eigvals(plant.system_matrix)))
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())  # the same matrix: rounding
    # sensing is the reciprocal of driving: charge on a channel is its force a volt, mode by mode
    np.testing.assert_array_equal(np.asarray(system.C)[:, : plant.size], plant.force.T)
