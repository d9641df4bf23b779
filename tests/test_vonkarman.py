"""The cubic law of large deflection: its energy, its gradient, and the kernel that integrates it."""

import numpy as np
import pytest

from solver import Design, Loop, ModalModel, Plant, first_mode_at_rest, load_design
from solver.design import Patches, Reduction
from solver.kernel import integrate
from solver.mesh import Floats
from solver.vonkarman import LargeDeflection, condensed_energy, membrane_force, membrane_tangent, pair_products

SAMPLE = 2e-4  # s: 28 in a period of the seed panel's flutter

PATCHED = tuple(load_design("seed-840").patches.elements)


def model(modes: int, elements: tuple[int, ...] = (), basis: str = "patched") -> ModalModel:
    reduction = Reduction("family" if basis == "family" else "patched", modes)
    return ModalModel.of(Design(patches=Patches(elements=elements), reduction=reduction))


def quartic(energy: Floats, q: Floats) -> Floats:
    """U4 at amplitudes (…, modes)."""
    c = pair_products(q)
    return 0.5 * np.einsum("...p,pk,...k->...", c, energy, c)


@pytest.mark.parametrize("elements", [(), PATCHED, (0, 7)])
def test_energy_is_symmetric_and_positive(elements: tuple[int, ...]) -> None:
    energy = model(12, elements).membrane.quartic
    np.testing.assert_array_equal(energy, energy.T)
    values = np.linalg.eigvalsh(energy)
    assert values[0] >= -1e-12 * values[-1]  # a sum of squares, to rounding


def test_force_is_the_gradient_of_the_energy() -> None:
    chosen = model(10, PATCHED)
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = rng.standard_normal(10) / chosen.peak * 1e-3
        # along a line the energy is a quartic, whose slope the five-point formula gives without truncation
        step = 0.1 * np.abs(q).max() * np.eye(10)
        u = [quartic(chosen.membrane.quartic, q + k * step) for k in (-2, -1, 1, 2)]
        gradient = (u[0] - 8 * u[1] + 8 * u[2] - u[3]) / (12 * np.diag(step))
        force = membrane_force(chosen.membrane, q)
        np.testing.assert_allclose(gradient, force, rtol=1e-10, atol=1e-11 * np.abs(force).max())  # rounding alone


def test_force_and_tangent_derive_from_the_energy_of_an_unsymmetric_layup() -> None:
    rng = np.random.default_rng(3)
    n = 4
    pairs = n * (n + 1) // 2
    root = rng.standard_normal((pairs, pairs))
    law = LargeDeflection(root @ root.T, rng.standard_normal((pairs, n)))
    q = rng.standard_normal(n)

    def energy(q: Floats) -> float:
        c = pair_products(q)
        return float(0.5 * c @ law.quartic @ c + c @ law.cubic @ q)

    step = 1e-5  # central differences: an error of about step² of the third derivative
    axes = step * np.eye(n)
    force = np.array([energy(q + d) - energy(q - d) for d in axes]) / (2 * step)
    np.testing.assert_allclose(membrane_force(law, q), force, rtol=1e-7, atol=1e-7 * np.abs(force).max())
    tangent = np.array([membrane_force(law, q + d) - membrane_force(law, q - d) for d in axes]) / (2 * step)
    np.testing.assert_allclose(membrane_tangent(law, q), tangent, rtol=1e-7, atol=1e-7 * np.abs(tangent).max())


def test_gauss_points_are_enough() -> None:
    # full order is 7 points. For the modes (m,1), half a wave across six elements, 4 points are within 1e-6 of it
    family = model(4, PATCHED, "family")
    full = condensed_energy(family.plate, family.shapes, 7).quartic
    assert np.abs(family.membrane.quartic - full).max() < 1e-5 * np.abs(full).max()
    # the highest of the default 24 modes fold several half waves into six elements: their own energy is 0.2 % off
    default = model(24)
    full = condensed_energy(default.plate, default.shapes, 7).quartic
    error = np.abs(np.diag(condensed_energy(default.plate, default.shapes).quartic) / np.diag(full) - 1)
    assert error.max() < 3e-3
    assert error[0] < 1e-5


def reference_step(
    x: Floats,
    step: float,
    linear: Floats,
    quartic: Floats,
    cubic: Floats,
    load: Floats,
    force: Floats,
    gain: Floats,
    limit: float,
) -> Floats:
    """One classical Runge-Kutta step in plain numpy."""
    n = len(x) // 2
    law = LargeDeflection(quartic, cubic)

    def rate(x: Floats) -> Floats:
        volts = np.clip(-gain @ x, -limit, limit)
        return np.concatenate([x[n:], load - linear @ x - membrane_force(law, x[:n]) + force @ volts])

    k1 = rate(x)
    k2 = rate(x + step / 2 * k1)
    k3 = rate(x + step / 2 * k2)
    k4 = rate(x + step * k3)
    return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@pytest.mark.parametrize(("modes", "channels", "coupled"), [(1, 0, False), (3, 1, True), (6, 4, False), (5, 2, True)])
def test_kernel_is_runge_kutta(modes: int, channels: int, coupled: bool) -> None:
    rng = np.random.default_rng(modes)
    pairs = modes * (modes + 1) // 2
    root = rng.standard_normal((pairs, pairs))
    inputs = {
        "linear": rng.standard_normal((modes, 2 * modes)),
        "quartic": root @ root.T,
        "cubic": rng.standard_normal((pairs, modes)) if coupled else np.zeros((0, modes)),
        "load": rng.standard_normal(modes),
        "force": rng.standard_normal((modes, channels)),
        "gain": rng.standard_normal((channels, 2 * modes)),
        "limit": 0.3,  # about half the voltages are cut
    }
    start = rng.standard_normal(2 * modes) / 2
    states, volts = np.empty((4, 2 * modes)), np.empty((4, channels))
    finite = integrate(start, **inputs, step=0.01, substeps=3, states=states, volts=volts)
    assert finite == 4
    x = start
    for sample in range(4):
        for _ in range(3):
            x = reference_step(x, 0.01, **inputs)
        np.testing.assert_allclose(states[sample], x, rtol=1e-11, atol=1e-12)  # sums are reordered, no more
        np.testing.assert_allclose(volts[sample], np.clip(-inputs["gain"] @ x, -0.3, 0.3), rtol=1e-10, atol=1e-12)


def test_energy_is_conserved_without_flow() -> None:
    plant = Plant.of(load_design("seed-bare").with_dynamic_pressure(0.0)).symmetric()
    n = plant.size
    start = first_mode_at_rest(plant, 0.2 * plant.design.panel.thickness)
    samples = round(100 * 2 * np.pi / plant.model.omega[0] / SAMPLE)
    states, _ = Loop.of(plant).stretch(start, SAMPLE, samples, engaged=False)

    def energy(x: Floats) -> Floats:
        q, rate = x[..., :n], x[..., n:]
        linear = (rate**2).sum(axis=-1) + ((plant.model.omega * q) ** 2).sum(axis=-1)
        return linear / 2 + quartic(plant.model.membrane.quartic, q)

    assert not plant.damping.any()
    # Runge-Kutta loses (ωh)⁶/72 of a mode's energy a step; here that is some 5e-8 in 100 periods
    np.testing.assert_allclose(energy(states), energy(start), rtol=1e-6)
