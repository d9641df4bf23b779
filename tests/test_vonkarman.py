"""The cubic law of large deflection: its energy, its gradient, and the kernel that integrates it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from solver import Design, Loop, ModalModel, Plant, first_mode_at_rest, load_design
from solver.condensation import condensed_energy
from solver.design import Patches, Reduction
from solver.kernel import integrate
from solver.mesh import Floats
from solver.polynomial import force_table
from solver.vonkarman import LargeDeflection, membrane_force, membrane_tangent, pair_products

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


@dataclass(frozen=True)
class Inputs:
    """What the kernel is given, random."""

    linear: Floats
    quartic: Floats
    cubic: Floats
    load: Floats
    force: Floats
    gain: Floats
    own: Floats
    driven: Floats
    limit: float
    jitter: Floats
    delay: float

    @staticmethod
    def random(modes: int, channels: int, memory: int, coupled: bool, noisy: bool, delay: float, steps: int) -> Inputs:
        rng = np.random.default_rng(modes)
        pairs = modes * (modes + 1) // 2
        root = rng.standard_normal((pairs, pairs))
        size = 2 * modes + memory
        return Inputs(
            linear=rng.standard_normal((modes, 2 * modes)),
            quartic=root @ root.T,
            cubic=rng.standard_normal((pairs, modes)) if coupled else np.zeros((0, modes)),
            load=rng.standard_normal(modes),
            force=rng.standard_normal((modes, channels)),
            gain=rng.standard_normal((channels, size)),
            own=rng.standard_normal((memory, size)),
            driven=rng.standard_normal((memory, channels)),
            limit=0.3,  # about half the voltages are cut
            jitter=rng.standard_normal((steps if noisy else 0, channels + memory)),
            delay=delay,
        )

    def noise(self, done: int) -> tuple[Floats, Floats]:
        """Of a step: on U and on ż."""
        channels = self.force.shape[1]
        row = self.jitter[done] if len(self.jitter) else np.zeros(channels + len(self.own))
        return row[:channels], row[channels:]

    def asked(self, x: Floats, done: int) -> Floats:
        """U at a state."""
        return -self.gain @ x + self.noise(done)[0]


def reference_step(given: Inputs, x: Floats, step: float, done: int, record: list[tuple[float, Floats]]) -> Floats:
    """One classical Runge-Kutta step in plain numpy; where delayed, U of the instant is added to the record first."""
    n = len(given.linear)
    law = LargeDeflection(given.quartic, given.cubic)
    if given.delay:
        record.append((done * step, given.asked(x, done)))

    def rate(x: Floats, ahead: float) -> Floats:
        delayed = given.delay > 0
        volts = recalled(record, (done + ahead) * step - given.delay) if delayed else given.asked(x, done)
        volts = np.clip(volts, -given.limit, given.limit)
        force = membrane_force(law, x[:n])
        acceleration = given.load - given.linear @ x[: 2 * n] - force + given.force @ volts
        own = given.own @ x + given.driven @ volts + given.noise(done)[1]
        return np.concatenate([x[n : 2 * n], acceleration, own])

    k1 = rate(x, 0.0)
    k2 = rate(x + step / 2 * k1, 0.5)
    k3 = rate(x + step / 2 * k2, 0.5)
    k4 = rate(x + step * k3, 1.0)
    return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def recalled(record: list[tuple[float, Floats]], time: float) -> Floats:
    """U at an instant: Lagrange's parabola through the two records about it and the one before; 0 before the first."""
    times = [t for t, _ in record]
    place = int(np.searchsorted(times, time, side="right")) - 1
    if place < 0:
        return np.zeros_like(record[0][1])
    used = record[max(place - 1, 0) : place + 2] if place + 1 < len(record) else record[place:]
    weights = [np.prod([(time - t) / (own - t) for t, _ in used if t != own]) for own, _ in used]
    return np.sum([weight * u for weight, (_, u) in zip(weights, used, strict=True)], axis=0)


@pytest.mark.parametrize(
    ("modes", "channels", "memory", "coupled", "noisy", "delay", "past"),
    [
        (1, 0, 0, False, False, 0.0, ()),
        (3, 1, 0, True, False, 0.0, ()),
        (6, 4, 0, False, False, 0.0, ()),
        (5, 2, 0, True, False, 0.0, ()),
        (3, 2, 4, False, False, 0.0, ()),  # an estimator
        (4, 1, 3, True, True, 0.0, ()),  # that hears noise
        (2, 3, 0, False, True, 0.0, ()),
        (3, 2, 0, False, False, 0.01, ()),  # a delay of just a step
        (3, 2, 0, False, False, 0.037, ()),  # between steps, nothing asked for before
        (4, 2, 3, True, True, 0.037, (1.3, 0.95, 0.92, 0.4, 0.1)),  # with a past, in parts of the delay
        (2, 1, 2, False, False, 1.0, (0.97, 0.92, 0.1)),  # longer than the run: nothing, then the past
    ],
)
def test_kernel_is_runge_kutta(
    modes: int, channels: int, memory: int, coupled: bool, noisy: bool, delay: float, past: tuple[float, ...]
) -> None:
    samples, substeps, step = 4, 3, 0.01
    steps = samples * substeps
    given = Inputs.random(modes, channels, memory, coupled, noisy, delay, steps)
    rng = np.random.default_rng(7)
    start = rng.standard_normal(2 * modes + memory) / 2
    known = len(past)
    when, asked = np.empty(known + steps + 1), np.empty((known + steps + 1, channels))
    when[:known], asked[:known] = -delay * np.array(past), rng.standard_normal((known, channels))
    record = [(float(when[k]), asked[k].copy()) for k in range(known)]
    states, volts = np.empty((samples, len(start))), np.empty((samples, channels))
    before = start.copy()
    finite = integrate(
        start,
        given.linear,
        force_table(LargeDeflection(given.quartic, given.cubic)),
        given.load,
        given.force,
        given.gain,
        given.own,
        given.driven,
        given.limit,
        given.jitter,
        given.delay,
        when,
        asked,
        known,
        step,
        substeps,
        states,
        volts,
    )
    assert finite == samples
    np.testing.assert_array_equal(start, before)
    x, done = start, 0
    for sample in range(samples):
        for _ in range(substeps):
            x = reference_step(given, x, step, done, record)
            done += 1
        wanted = recalled(record, done * step - delay) if delay else given.asked(x, done - 1)
        np.testing.assert_allclose(states[sample], x, rtol=1e-11, atol=1e-12)  # sums are reordered, no more
        np.testing.assert_allclose(volts[sample], np.clip(wanted, -0.3, 0.3), rtol=1e-10, atol=1e-12)
    if delay:  # the record that the next stretch goes on from
        np.testing.assert_allclose(when[: known + steps], [t for t, _ in record], rtol=1e-12)
        np.testing.assert_allclose(asked[: known + steps], [u for _, u in record], rtol=1e-10, atol=1e-12)


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
