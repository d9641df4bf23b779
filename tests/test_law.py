"""The law as it is laid out, and saturation, whatever drives the patches."""

import dataclasses
from functools import lru_cache

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from panels import plant, seed, small

from solver import Law, Loop, Lqr, Plant
from solver.law import closed_loop, extended
from solver.simulate import Memory

KINDS = ("lqr", "lqg", "rate")


def random_law(of: Plant, memory: int) -> Law:
    """One with all its parts."""
    rng, c = np.random.default_rng(0), len(of.channels)
    return Law(
        gain=rng.standard_normal((c, 2 * of.size)),
        on_charge=rng.standard_normal((c, c)),
        on_current=rng.standard_normal((c, c)),
        reading=rng.standard_normal((c, memory)),
        own=rng.standard_normal((memory, memory)),
        sensed=rng.standard_normal((memory, c)),
        driven=rng.standard_normal((memory, c)),
        limit=100.0,
    )


def test_extended_system_is_what_the_law_says() -> None:
    """Row by row: q̈ = F V - K q - C q̇, ż = A z + L y + E V, U = -(G X + Γ_Q y + Γ_I ẏ + H z), and V = U closed."""
    of = plant(seed("seed-840", modes=8, channels="element"))
    n, m, rng = of.size, 3, np.random.default_rng(1)
    law = random_law(of, m)
    a, b, k = extended(of, law)
    x, z, volts = rng.standard_normal(2 * n), rng.standard_normal(m), rng.standard_normal(len(of.channels))
    q, v = np.split(x, 2)
    y, current = of.force.T @ q, of.force.T @ v
    asked = -(law.gain @ x + law.on_charge @ y + law.on_current @ current + law.reading @ z)
    np.testing.assert_allclose(-k @ np.concatenate([x, z]), asked)
    for given_volts, rate in (
        (volts, a @ np.concatenate([x, z]) + b @ volts),
        (asked, closed_loop(of, law) @ np.concatenate([x, z])),
    ):
        np.testing.assert_allclose(rate[:n], v)
        np.testing.assert_allclose(rate[n : 2 * n], of.force @ given_volts - of.stiffness @ q - of.damping @ v)
        np.testing.assert_allclose(rate[2 * n :], law.own @ z + law.sensed @ y + law.driven @ given_volts)


def test_growth_is_the_leading_pole() -> None:
    for kind in KINDS:
        loop = Loop.of(plant(seed("seed-840", kind=kind)))
        leading = loop.poles[np.argmax(loop.poles.real)]
        assert loop.growth.real == pytest.approx(leading.real, abs=1e-6)  # one matrix, whole and in blocks
        assert loop.growth.imag == pytest.approx(abs(leading.imag), abs=1e-3)
        assert loop.poles.size == 2 * loop.plant.size + loop.law.memory


def test_what_is_instant() -> None:
    laws = {
        (kind, delay, noise): Loop.of(plant(seed("seed-840", modes=8, kind=kind, delay=delay, sensor_noise=noise))).law
        for kind in (*KINDS, "off")
        for delay in (0.0, 1e-4)
        for noise in (0.0, 1e-9)
    }
    for (kind, delay, noise), law in laws.items():
        hears = noise > 0 and kind in ("lqg", "rate")  # lqr reads the state itself
        assert law.hears_noise == hears
        assert law.instant == (kind == "off" or (kind != "lqg" and not delay and not hears))


def test_a_law_on_a_richer_plant_sees_it_through_its_own_modes() -> None:
    """G Φᵀ M Φ_rich by hand; of a motion in its own modes it asks for what it asked for."""
    few = plant(seed("seed-840", modes=8))
    rich = plant(seed("seed-840", modes=24))
    law = Lqr.of(few).law(few)
    mass = few.model.plate.mass
    share = few.model.shapes.T @ (mass @ rich.model.shapes)
    wanted = np.hstack([law.gain[:, : few.size] @ share, law.gain[:, few.size :] @ share])
    seen = law.filtered(few, rich)
    np.testing.assert_allclose(seen.gain, wanted, atol=1e-9 * np.abs(wanted).max())
    # both bases hold the same lowest modes, so that the rest is not seen at all
    assert np.abs(seen.gain[:, few.size : rich.size]).max() < 1e-6 * np.abs(seen.gain).max()


@lru_cache
def loop_of(kind: str, delay: float, noise: float, random: int) -> Loop:
    design = seed("seed-840", modes=8, kind=kind, delay=delay, sensor_noise=noise, noise_seed=random)
    elements = msgspec.structs.replace(design.patches, channels="element" if random % 2 else "connected")
    return Loop.of(plant(msgspec.structs.replace(design, patches=elements)))


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(KINDS),
    st.floats(1e-3, 3.0),
    st.floats(0.5, 228.6),
    st.sampled_from([0.0, 1e-5, 3e-4]),
    st.sampled_from([0.0, 1e-9, 1e-5]),
    st.integers(0, 3),
)
def test_voltage_never_exceeds_the_limit(
    kind: str, amplitude: float, limit: float, delay: float, noise: float, random: int
) -> None:
    loop = loop_of(kind, delay, noise, random)
    law = dataclasses.replace(loop.law, limit=limit)
    start = small(loop.plant, amplitude, random)
    cut = Loop(loop.plant, law, loop.linear)
    states, volts, memory = cut.advance(start, Memory.blank(law), 2e-4, 30, engaged=True)
    assert len(states) == 30
    assert np.abs(volts).max() <= limit
    _, volts, _ = cut.advance(states[-1], memory, 2e-4, 30, engaged=True)
    assert np.abs(volts).max() <= limit
    _, volts, _ = cut.advance(states[-1], memory, 2e-4, 3, engaged=False)
    assert not volts.any()
