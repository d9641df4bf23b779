"""Collocated rate feedback: what it may do, which is to take energy out, and the balance of that energy."""

import dataclasses

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from panels import COARSE, Wiring, plant, seed, small, whole

from solver import Control, Design, Flow, Loop, Patches, Plant, RateFeedback, Reduction, Trace
from solver.fullrun import full_run
from solver.law import closed_loop
from solver.mesh import Floats
from solver.trace import probe_shapes
from solver.vonkarman import pair_products

STILL = Flow(dynamic_pressure=0.0, damping=0.0)


def still(elements: tuple[int, ...], channels: Wiring, gain: float) -> Design:
    """The coarse panel in still air without any damping of its own."""
    return msgspec.structs.replace(
        COARSE,
        flow=STILL,
        patches=Patches(elements=elements, channels=channels),
        control=Control(kind="rate", rate_gain=gain),
    )


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.integers(0, 47), min_size=1, max_size=10),
    st.sampled_from(["connected", "element", "single"]),
    st.floats(0.0, 6.0),
)
def test_no_pole_grows_whatever_the_layout(elements: list[int], channels: Wiring, power: float) -> None:
    """d/dt (½ q̇² + ½ qᵀKq) = q̇ᵀ F V = -g |Fᵀ q̇|² ≤ 0 with K positive definite, so that no motion grows."""
    of = Plant.of(still(tuple(elements), channels, 10.0**power))
    roots = np.linalg.eigvals(closed_loop(of, RateFeedback.of(of).law(of)))
    size = np.abs(roots).max()
    assert not of.damping.any()
    assert roots.real.max() < 1e-10 * size  # rounding
    # their sum is the trace, -g |F|²: what is not reached does not decay, and the rest does
    assert np.isclose(roots.real.sum(), -(10.0**power) * (of.force**2).sum(), rtol=1e-6, atol=1e-8 * size)


def energy(of: Plant, states: Floats) -> Floats:
    """(samples,) ½ q̇² + ½ qᵀ Ω² q and what stretching stores [J]."""
    q, v = states[:, : of.size], states[:, of.size :]
    pairs = pair_products(q)
    stretching = 0.5 * np.einsum("kp,pr,kr->k", pairs, of.model.membrane.quartic, pairs)
    return 0.5 * (v**2).sum(axis=1) + 0.5 * ((of.model.omega * q) ** 2).sum(axis=1) + stretching


def trace_of(loop: Loop, start: Floats, samples: int) -> Trace:
    """A run under control from its start, sampled 60 times in a period of the highest mode."""
    sample = 2 * np.pi / loop.plant.model.omega[-1] / 60
    states, volts = loop.stretch(start, sample, samples, engaged=True)
    law = loop.law
    first = np.clip(-law.direct(loop.plant.force) @ start, -law.limit, law.limit)
    return Trace(loop.plant, sample * np.arange(samples + 1), np.vstack([start, states]), np.vstack([first, volts]))


def test_the_drives_work_is_the_change_of_energy() -> None:
    """Without flow M q̈ + ∂U/∂q = F V, so that d/dt (kinetic + U) = Vᵀ Fᵀ q̇ = Vᵀ ẏ, however large and however cut."""
    for control in (
        Control(kind="rate", voltage_limit=200.0),
        Control(kind="rate", voltage_limit=5.0),
        Control(kind="lqr", voltage_limit=20.0),
    ):
        design = msgspec.structs.replace(still((5, 6, 9, 10), "element", 0.0), control=control)
        run = msgspec.structs.replace(design.run, control_on=0.0)
        loop = Loop.of(plant(msgspec.structs.replace(design, run=run)))
        trace = trace_of(loop, small(loop.plant, 0.3), 2000)
        lost = energy(loop.plant, trace.states[[0, -1]])
        # the trapezoidal rule at (2π/60)²/12 of an integrand that swings twice as fast: 0.4 %, and kinks at the limit
        assert np.isclose(trace.drive_work, lost[1] - lost[0], rtol=1e-2)
        assert trace.drive_work < -0.01 * lost[0]
        assert np.isclose(trace.control_energy, (trace.volts**2).sum() * trace.times[1], rtol=1e-2)
        assert trace.control_energy <= 4 * control.voltage_limit**2 * trace.times[-1]


@settings(max_examples=10, deadline=None)
@given(st.floats(0.01, 1.0), st.floats(1.0, 200.0), st.integers(0, 100))
def test_energy_never_rises(amplitude: float, limit: float, random: int) -> None:
    """V = -min(g |ẏ|, limit) sign(ẏ) on every channel: Vᵀ ẏ ≤ 0 at the limit as well."""
    loop = Loop.of(plant(still((5, 6, 9, 10), "element", 1e5)))
    cut = Loop(loop.plant, dataclasses.replace(loop.law, limit=limit), loop.linear)
    start = small(loop.plant, amplitude, random)
    states, _ = cut.stretch(start, 1e-4, 100, engaged=True)
    stored = energy(loop.plant, np.vstack([start, states]))
    # where 1 V takes out next to nothing, Runge-Kutta shows: from 1 h it moves the energy by up to 2.6e-6 in a sample
    assert np.diff(stored).max() < 1e-5 * stored[0]


def test_rate_feedback_of_the_full_order_model_is_that_of_many_modes() -> None:
    """At small amplitude, where control takes 8 % off the motion. A patch's edge bends the panel as no few modes do,
    so that few feel too much of it: 1.3 % of the motion is measured with 24 of them, 0.35 % with 80."""
    gaps = []
    for modes in (24, 80):
        design = msgspec.structs.replace(
            COARSE,
            flow=Flow(dynamic_pressure=300.0),
            reduction=Reduction("patched", modes),
            control=Control(kind="rate", rate_gain=3e3),
        )
        loop = Loop.of(plant(design))
        start, sample, n = np.zeros(2 * loop.plant.size), 2e-4, loop.plant.size
        start[0] = 1e-4 * loop.plant.design.panel.thickness / loop.plant.model.peak[0]
        full = full_run(loop, start, sample, 64, True, steps=8)  # two turns of the first mode
        states, volts = loop.stretch(start, sample, 64, engaged=True)
        free, _ = loop.stretch(start, sample, 64, engaged=False)
        driven, undriven = (run[:, :n] @ probe_shapes(loop.plant) for run in (states, free))
        w = full.probe[1:] * loop.plant.design.panel.thickness
        assert 0 < np.abs(volts).max() < loop.law.limit
        assert np.abs(undriven - driven).max() > 0.07 * np.abs(driven).max()
        gaps.append(np.abs(w - driven).max() / np.abs(driven).max())
    assert gaps[1] < 0.4 * gaps[0]
    assert gaps[1] < 0.006


def test_in_all_modes_it_cannot_touch_what_it_cannot_drive() -> None:
    of = whole(seed("seed-840", 400.0, kind="rate"))
    odd = np.flatnonzero(of.model.parity == -1)
    closed = closed_loop(of, RateFeedback.of(of).law(of))
    part = np.concatenate([odd, of.size + odd])
    np.testing.assert_array_equal(closed[part], of.system_matrix[part])
