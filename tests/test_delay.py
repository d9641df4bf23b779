"""Delay: eigenvalues by the characteristic equation, motion by its roots, and what is on its way between stretches."""

import numpy as np
import pytest
from panels import balance, plant, seed, small

from solver import Loop, Plant
from solver.law import extended
from solver.mesh import Floats
from solver.simulate import Memory, seed_protocol


def corrected(of: Loop, s: complex) -> complex:
    """A root of det(sI - A + B K exp(-sτ)) = 0 near s, by Newton's method on the smallest eigenvalue of the matrix.

    d/ds of the matrix is I - τ B K exp(-sτ); an eigenvalue μ of the pair says how far s is off, to first order.
    """
    a, b, k = extended(of.plant, of.law)
    one = np.eye(len(a))
    for _ in range(40):
        late = b @ k * np.exp(-s * of.law.delay)
        off = np.linalg.eigvals(np.linalg.solve(one - of.law.delay * late, s * one - a + late))
        step = off[np.argmin(np.abs(off))]
        s -= complex(step)
        if abs(step) < 1e-9 * abs(s):
            return s
    return complex(np.nan)


def rightmost(of: Loop) -> complex:
    """The root of largest real part that Newton's method finds from every natural frequency and pole without delay."""
    a, b, k = extended(of.plant, of.law)
    starts = [*np.linalg.eigvals(a), *np.linalg.eigvals(a - b @ k), of.growth]
    # not all on one line, for feedback moves the roots off it
    roots = [corrected(of, complex(s.real + aside, abs(s.imag))) for s in starts for aside in (0.0, 100.0)]
    found = [root for root in roots if np.isfinite(root)]
    return max(found, key=lambda root: root.real)


@pytest.mark.parametrize("delay", [1e-5, 1e-4, 5e-4, 1e-3, 3e-3])
@pytest.mark.parametrize(("kind", "pressure"), [("lqr", 840.0), ("lqr", 400.0), ("lqg", 600.0), ("rate", 400.0)])
def test_leading_pole_is_a_root_and_the_rightmost(kind: str, pressure: float, delay: float) -> None:
    loop = Loop.of(plant(seed("seed-840", pressure, modes=8, kind=kind, delay=delay, rate_gain=1e4)))
    root = corrected(loop, loop.growth)
    # collocation converges exponentially; with the fewest nodes 1e-6 of |s| is left
    assert abs(root - loop.growth) < 1e-5 * abs(root)
    assert rightmost(loop).real == pytest.approx(loop.growth.real, abs=1e-5 * abs(root))


@pytest.mark.parametrize(("kind", "pressure"), [("lqr", 400.0), ("rate", 400.0), ("lqr", 840.0)])
def test_leading_pole_of_the_longest_delay(kind: str, pressure: float) -> None:
    """On the way the highest of 24 modes turns by 76 rad, and it or its neighbours may be what grows."""
    loop = Loop.of(plant(seed("seed-840", pressure, kind=kind, delay=0.01)))
    assert loop.growth.real == pytest.approx(rightmost(loop).real, abs=0.01)


def test_a_short_delay_is_none() -> None:
    at_once = Loop.of(plant(seed("seed-840", modes=8))).growth
    gaps = [
        abs(Loop.of(plant(seed("seed-840", modes=8, delay=delay))).growth - at_once) for delay in (4e-5, 2e-5, 1e-5)
    ]
    # s(τ) = s(0) + s'τ + …: the gap halves with the delay
    assert gaps[0] / gaps[1] == pytest.approx(2.0, rel=0.05)
    assert gaps[1] / gaps[2] == pytest.approx(2.0, rel=0.05)
    assert gaps[2] < 1.0


def measured(states: Floats, sample: float) -> complex:
    """The root s of motion in one pair: x(t + 2T) - 2 Re(z) x(t + T) + |z|² x(t) = 0, z = exp(sT), by least squares."""
    now, then, last = states[:-2].ravel(), states[1:-1].ravel(), states[2:].ravel()
    (twice, square), *_ = np.linalg.lstsq(np.stack([then, -now], axis=1), last)
    return complex(np.log(complex(twice / 2, np.sqrt(square - (twice / 2) ** 2)))) / sample


@pytest.mark.parametrize(
    ("kind", "pressure", "modes", "delay", "grows"),
    [
        ("lqr", 840.0, 4, 3e-4, False),
        ("lqr", 840.0, 4, 5e-4, False),
        ("lqr", 840.0, 4, 1e-3, True),
        ("lqr", 840.0, 8, 1e-3, True),
        ("lqg", 600.0, 4, 2e-3, True),
        ("rate", 200.0, 8, 1e-3, True),
    ],
)
def test_motion_goes_as_the_leading_pole(kind: str, pressure: float, modes: int, delay: float, grows: bool) -> None:
    """Where one pair leads by far, so that in 25 of its e-foldings the others have died out beside it."""
    loop = Loop.of(plant(seed("seed-840", pressure, modes, kind=kind, delay=delay, rate_gain=1e4)))
    assert (loop.growth.real > 0) == grows
    sample = 2.5e-4
    # from a motion so small that what grows stays small
    states, volts = loop.stretch(small(loop.plant, 1e-14), sample, round(25 / abs(loop.growth.real) / sample), True)
    assert np.abs(volts).max() < loop.law.limit
    found = measured(states[-60:] * balance(loop.plant), sample)
    # a parabola between steps errs by (ωh)³/16 of U, 5e-4 at 2700 rad/s; 7e-5 of the root is measured
    assert abs(found - loop.growth) < 2e-4 * abs(loop.growth)


def test_delay_turns_damping_into_growth_and_the_run_shows_it() -> None:
    late, soon = (Loop.of(plant(seed("seed-840", modes=8, delay=delay))) for delay in (1e-3, 5e-5))
    assert late.growth.real > 0 > soon.growth.real
    assert seed_protocol(late).damping_time is None
    assert seed_protocol(soon).damping_time is not None


def cut(of: Loop, start: Floats, sample: float, parts: list[int]) -> tuple[Floats, Floats]:
    """States and voltages over parts of so many samples, one after the other."""
    state, memory, states, volts = start, Memory.blank(of.law), [], []
    for samples in parts:
        some, driven, memory = of.advance(state, memory, sample, samples, engaged=True)
        state = some[-1]
        states.append(some)
        volts.append(driven)
    return np.concatenate(states), np.concatenate(volts)


def controlled(kind: str, delay: float) -> Plant:
    return plant(seed("seed-840", 600.0, modes=8, kind=kind, delay=delay, rate_gain=1e4))


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate"])
@pytest.mark.parametrize("delay", [0.0, 1e-5, 3.3e-4, 5e-3, 0.01])
def test_one_stretch_is_the_same_as_many(kind: str, delay: float) -> None:
    loop = Loop.of(controlled(kind, delay))
    start = small(loop.plant, 0.05)
    parts = [1, 1, 7, 1, 40, 13, 1, 36]
    one, many = (cut(loop, start, 1e-3, counts) for counts in ([sum(parts)], parts))
    # the same steps: instants are counted from another one, and rounded differently
    scale = balance(loop.plant)
    np.testing.assert_allclose(many[0] * scale, one[0] * scale, atol=1e-9 * np.abs(one[0] * scale).max())
    np.testing.assert_allclose(many[1], one[1], atol=1e-7 * loop.law.limit)


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate"])
def test_pieces_with_steps_of_another_length(kind: str) -> None:
    """Then U is known at other instants: a parabola errs by (ωh)³/16 of it, of the slow modes less than 1e-3."""
    loop = Loop.of(controlled(kind, 1e-4))
    start, state, memory = small(loop.plant, 1e-3), small(loop.plant, 1e-3), Memory.blank(loop.law)
    times = np.array([0.7, 1.1, 0.3, 1.9, 3.0, 0.05, 2.95]) * 1e-3
    for time in times:
        states, _, memory = loop.advance(state, memory, time, 1, engaged=True)
        state = states[-1]
    whole, _ = loop.stretch(start, float(times.sum()), 1, engaged=True)
    scale = balance(loop.plant)
    assert np.abs(scale * (state - whole[-1])).max() < 5e-3 * np.abs(scale * whole[-1]).max()


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate"])
def test_nothing_acts_before_its_time(kind: str) -> None:
    delay, sample = 4.03e-3, 1e-3
    loop = Loop.of(controlled(kind, delay))
    start = small(loop.plant, 0.05)
    # it listens at first, and asks for nothing meanwhile
    free, silent, memory = loop.advance(start, Memory.blank(loop.law), sample, 20, engaged=False)
    after, volts, _ = loop.advance(free[-1], memory, sample, 8, engaged=True)
    on, _, _ = loop.advance(free[-1], memory, sample, 8, engaged=False)
    assert not silent.any()
    assert not volts[:4].any()
    assert volts[4:].all()
    np.testing.assert_array_equal(after[:4], on[:4])
    assert np.abs(after[4:] - on[4:]).max() > 0


def test_the_first_voltage_is_what_was_asked_for_at_the_start() -> None:
    loop = Loop.of(controlled("lqr", 2e-3))
    start = small(loop.plant, 0.01)
    _, volts = loop.stretch(start, 2e-3, 2, engaged=True)
    states, _ = loop.stretch(start, 2e-3, 2, engaged=False)
    asked = -loop.law.gain @ np.stack([start, states[0]], axis=1)  # nothing acted in the meantime
    assert np.abs(asked).max() < loop.law.limit
    assert volts[0] == pytest.approx(asked[:, 0], rel=1e-9)  # instants fall on steps, to rounding
    # the step that ends at τ puts a sixth of its weight on that instant, when the voltage jumps: 2 % here
    assert volts[1] == pytest.approx(asked[:, 1], rel=0.04)
