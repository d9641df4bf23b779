"""Owns the figures of integration: runs of the closed loop against physical time, DOP853 and a matrix product."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.integrate

from flutterviz.bench.figure import Baseline, Figure
from flutterviz.bench.timing import Times, taking_turns
from solver import Loop, Plant, limit_cycle, load_design
from solver.mesh import Floats
from solver.simulate import SAMPLES_A_PERIOD, Memory
from solver.vonkarman import LargeDeflection, index_pairs

SYMMETRIC_OF = 21  # modes of the seed's layout, of which 12 are symmetric
SPAN = 0.05  # s of the controlled phase
TOLERANCE = 1e-8  # DOP853's
A_TURN = 20  # runs of ours
PHASES = 8
CYCLES = 40  # periods of the limit cycle by which operations a second are counted
ORDER = 512  # of the matrices that are multiplied


def measure(quick: bool) -> Iterator[Figure]:
    """Time runs on one core, everything in turns with its baseline.

    Args:
        quick: few repeats.
    """
    repeats = 3 if quick else 9
    plant = Plant.of(load_design("seed-840").with_reduction("patched", SYMMETRIC_OF)).symmetric()
    loop = Loop.of(plant)
    cycle = limit_cycle(loop)
    assert cycle is not None
    sample = plant.period / SAMPLES_A_PERIOD
    count = round(SPAN / sample)

    def ours() -> Floats:
        return loop.stretch(cycle.state, sample, count, engaged=True)[0]

    def theirs() -> Floats:
        return by_dop853(loop, cycle.state, sample, count)

    # ours is so short that a turn is of several: what wakes a core up would else be all that is timed
    many, slow = taking_turns(lambda: [ours() for _ in range(A_TURN)], theirs, repeats=repeats)
    fast = Times(tuple(seconds / A_TURN for seconds in many.seconds))
    span, words = sample * count, f"{plant.size} symmetric modes, first {1e3 * sample * count:.0f} ms under control"
    yield _speed("closed loop against physical time", span, fast, 1.0, "physical time", 50.0, words)
    yield _speed(
        "closed loop against DOP853",
        slow.median,
        fast,
        1.0,
        "scipy's solve_ivp, DOP853, on numpy",
        200.0,
        f"{words}; rtol {TOLERANCE:g}, atol as much of the motion's size; a step's exponentials kept from run to run",
    )
    exact = by_dop853(loop, cycle.state, sample, count, 1e-3 * TOLERANCE)
    heights = plant.model.coarse.T / plant.design.panel.thickness
    deviation, other = (float(np.abs((run - exact)[:, : plant.size] @ heights).max()) for run in (ours(), theirs()))
    yield Figure(
        "largest deviation of w from an exact run",
        1e4 * deviation,
        "1e-4 h",
        (1e4 * deviation, 1e4 * deviation),
        target=1.0,
        baseline=Baseline("DOP853 at the same rtol as above", 1e4 * other),
        note=f"{words}, at every sample, against DOP853 at rtol {1e-3 * TOLERANCE:g}",
    )
    yield from _operations(loop, cycle.state, repeats)


def _operations(loop: Loop, start: Floats, repeats: int) -> Iterator[Figure]:
    """Operations a second along the limit cycle, where no step is parted, beside a matrix product's."""
    plant = loop.plant
    sample, count = plant.period / SAMPLES_A_PERIOD, CYCLES * SAMPLES_A_PERIOD
    blank = Memory.blank(loop.law)
    one = (start, blank)
    matrix = np.random.default_rng(0).standard_normal((ORDER, ORDER))
    alone, abreast, product = taking_turns(
        lambda: loop.run([one], sample, count, engaged=False),
        lambda: loop.run([one] * PHASES, sample, count, engaged=False),
        lambda: matrix @ matrix,
        repeats=2 * repeats,
    )
    yield _speed(
        "8 runs side by side against physical time",
        PHASES * sample * count,
        abreast,
        1.0,
        "physical time",
        None,
        f"{plant.size} symmetric modes, along the limit cycle",
    )
    rate = 2 * ORDER**3 / product.median / 1e9
    work = operations(plant.size) * loop.steps_of(sample) * count
    for name, times, runs in (("one run", alone, 1), ("8 runs side by side", abreast, PHASES)):
        yield _speed(
            f"operations of {name}",
            1e-9 * runs * work,
            times,
            rate,
            f"numpy's product of matrices of order {ORDER}",
            rate / 2,
            f"additions and multiplications of forces, exponentials and monomials; the target is half of what the "
            f"matrix product reached in the same turns, {rate:.0f} GFLOP/s",
            "GFLOP/s",
        )


def _speed(
    name: str,
    done: float,
    times: Times,
    rate: float,
    baseline: str,
    target: float | None,
    note: str,
    unit: str = "x",
) -> Figure:
    """So much done in each of some times."""
    shortest, longest = times.spread
    return Figure(
        name,
        done / times.median,
        unit,
        (done / longest, done / shortest),
        target,
        "at least",
        Baseline(baseline, rate),
        f"{note}; {len(times.seconds)} runs",
    )


def operations(modes: int) -> int:
    """Additions and multiplications in a step of one run of `solver.exponential`, but for the voltages."""
    cubes, pairs = modes * (modes + 1) * (modes + 2) // 6, modes * (modes + 1) // 2
    state = 2 * modes
    return 4 * (2 * modes * cubes + cubes + pairs) + 2 * (4 * state * state + 8 * modes * state)


def by_dop853(loop: Loop, start: Floats, sample: float, count: int, tolerance: float = TOLERANCE) -> Floats:
    """(count, 2n) states under control at each sample, by scipy's adaptive integrator on a right-hand side in numpy."""
    plant, n = loop.plant, loop.plant.size
    scale = np.concatenate([plant.model.omega, np.ones(n)])
    return scipy.integrate.solve_ivp(
        right_hand_side(loop, plant.model.membrane),
        (0.0, sample * count),
        start,
        "DOP853",
        t_eval=sample * np.arange(1, count + 1),
        rtol=tolerance,
        atol=tolerance * np.abs(scale * start).max() / scale,
    ).y.T


def right_hand_side(loop: Loop, law: LargeDeflection) -> Callable[[float, Floats], Floats]:
    """Ẋ of the closed loop, in numpy: the cubic law as one matrix-vector product on pairs of amplitudes."""
    plant, n = loop.plant, loop.plant.size
    r, s = index_pairs(n)
    twice, place = np.where(r == s, 1.0, 2.0), np.zeros((n, n), dtype=np.intp)
    place[r, s] = place[s, r] = np.arange(len(r))
    gain, limit, force, linear = loop.law.direct(plant.force), loop.law.limit, plant.force, loop.linear

    def rate(_: float, x: Floats) -> Floats:
        q = x[:n]
        stress = law.quartic @ (q[r] * q[s] * twice)
        volts = np.clip(-(gain @ x), -limit, limit)
        return np.concatenate([x[n:], force @ volts - linear @ x - 2 * (stress[place] @ q)])

    return rate
