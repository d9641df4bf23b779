"""Owns the figures of integration: runs of the closed loop against physical time, DOP853 and a matrix product."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy.integrate

from flutterviz.bench.figure import Baseline, Figure
from flutterviz.bench.timing import Times, taking_turns
from solver import LimitCycle, Loop, Plant, limit_cycle, load_design
from solver.mesh import Floats
from solver.robust import on_the_cycle
from solver.simulate import SAMPLES_A_PERIOD
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
    words = f"{plant.size} symmetric modes, first {1e3 * sample * count:.0f} ms under control"
    ratios = [sample * count / ours for ours in fast.seconds]
    yield _speed("closed loop against physical time", ratios, 1.0, "physical time", 50.0, words)
    yield _speed(
        "closed loop against DOP853",
        [theirs / ours for theirs, ours in zip(slow.seconds, fast.seconds, strict=True)],  # turn by turn
        1.0,
        "scipy's solve_ivp, DOP853, on numpy",
        200.0,
        f"{words}; rtol {TOLERANCE:g}, atol as much of the motion's size; a step's exponentials kept from run to run",
    )
    yield _deviation(loop, cycle, sample, count, words)
    yield _operations(loop, cycle.state, repeats)


def _deviation(loop: Loop, cycle: LimitCycle, sample: float, count: int, words: str) -> Figure:
    """The largest distance of w to a run that is exact in comparison, of runs from phases of the limit cycle."""
    plant = loop.plant
    heights = plant.model.coarse.T / plant.design.panel.thickness
    double = dataclasses.replace(loop, precision=np.float64)
    found: list[list[float]] = []
    for start, _ in on_the_cycle(loop, cycle, PHASES):
        exact = by_dop853(loop, start, sample, count, 1e-3 * TOLERANCE)
        runs = [each.stretch(start, sample, count, engaged=True)[0] for each in (loop, double)]
        runs.append(by_dop853(loop, start, sample, count))
        found.append([1e4 * float(np.abs((run - exact)[:, : plant.size] @ heights).max()) for run in runs])
    ours, whole, theirs = np.array(found).T
    return Figure(
        "largest deviation of w from an exact run",
        float(ours.max()),
        "1e-4 h",
        (float(ours.min()), float(ours.max())),
        target=1.0,
        baseline=Baseline("DOP853 at the same rtol as above", float(theirs.max())),
        note=f"{words}, from {PHASES} phases, the largest of which stands in place of the median; at every sample, "
        f"against DOP853 at rtol {1e-3 * TOLERANCE:g}; the membrane's law is in single precision, in double the "
        f"deviation is {whole.max():.3g}",
    )


def _operations(loop: Loop, start: Floats, repeats: int) -> Figure:
    """Operations a second along the limit cycle, where no step is parted, beside a matrix product's."""
    plant = loop.plant
    sample, count = plant.period / SAMPLES_A_PERIOD, CYCLES * SAMPLES_A_PERIOD
    matrix = np.random.default_rng(0).standard_normal((ORDER, ORDER))
    alone, product = taking_turns(
        lambda: loop.stretch(start, sample, count, engaged=False),
        lambda: matrix @ matrix,
        repeats=2 * repeats,
    )
    rate = 2 * ORDER**3 / product.median / 1e9
    return _speed(
        "operations of a run",
        [1e-9 * operations(plant.size) * loop.steps_of(sample) * count / taken for taken in alone.seconds],
        rate,
        f"numpy's product of matrices of order {ORDER}",
        rate / 2,
        "additions and multiplications of forces and monomials, in single precision, and of exponentials; target: "
        f"half of what the matrix product, in double, reached in the same turns, {rate:.0f} GFLOP/s",
        "GFLOP/s",
    )


def _speed(
    name: str, values: Sequence[float], rate: float, baseline: str, target: float, note: str, unit: str = "x"
) -> Figure:
    """The median of what was reached in each turn, beside a rate."""
    note = f"{note}; {len(values)} runs"
    spread = (min(values), max(values))
    return Figure(name, float(np.median(values)), unit, spread, target, "at least", Baseline(baseline, rate), note)


def operations(modes: int) -> int:
    """Additions and multiplications in a step of one run of `solver.exponential`, but for the voltages."""
    cubes, pairs = modes * (modes + 1) * (modes + 2) // 6, modes * (modes + 1) // 2
    state = 2 * modes
    return 4 * (2 * modes * cubes + cubes + pairs) + 2 * (2 * state * state + 8 * modes * state)


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
