"""Owns the figures of the placement search: robust evaluations a second, and all symmetric rectangles."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from concurrent.futures import Executor

import numpy as np

from flutterviz.bench.figure import Baseline, Figure
from flutterviz.bench.plain import plain_chain
from solver import Design, Loop, Plant, Task, first_mode_at_rest, limit_cycle, load_design, robust_damping, search
from solver.limitcycle import WINDOW_PERIODS
from solver.simulate import SAMPLES_A_PERIOD, Memory
from solver.workers import local_workers

SYMMETRIC_OF = 21  # modes of which 12 are symmetric, whichever of the pairs below are patched
PAIRS = tuple((6 * i + 2, 6 * i + 3) for i in range(1, 7))  # of elements at y = b/2, where six damp in the run's time
CORES = 2
FEW = 6  # layouts that one process evaluates while the other rests
PHASES = 8
WINDOWS = 7  # after which a limit cycle is at rest at the earliest


def measure(quick: bool) -> Iterator[Figure]:
    """Time whole evaluations on two processes, the plain one in turns with them, and the search of all rectangles.

    Args:
        quick: fewer layouts.
    """
    design = load_design("seed-840")
    twelve = design.with_reduction("patched", SYMMETRIC_OF)
    layouts = [tuple(itertools.chain(*pairs)) for pairs in itertools.combinations(PAIRS, 3)]
    with local_workers(CORES) as executor:
        list(executor.map(evaluated, [twelve.with_elements(layout) for layout in layouts[:CORES]]))  # compiles, fills
        plainly_evaluated(twelve)  # compiles, here
        rates, lone, plain = [], [], []
        for turn in range(2 if quick else 5):
            start = time.perf_counter()
            done = list(executor.map(evaluated, [twelve.with_elements(layout) for layout in layouts]))
            rates.append(sum(done) / (time.perf_counter() - start))
            start = time.perf_counter()
            few = [twelve.with_elements(layout) for layout in layouts[:FEW]]
            lone.append(executor.submit(evaluated_together, few).result() / (time.perf_counter() - start))
            start = time.perf_counter()
            plainly_evaluated(twelve.with_elements(layouts[turn]))
            plain.append(1 / (time.perf_counter() - start))
        rate, alone, slow = (float(np.median(found)) for found in (rates, lone, plain))
        yield Figure(
            "robust evaluations a second, 12 symmetric modes",
            rate,
            "/s",
            (min(rates), max(rates)),
            40.0,
            "at least",
            Baseline("plain rebuild and classical steps, one process", slow),
            f"rebuild, gain, limit cycle and 8 phases of {len(layouts)} layouts of six elements, on {CORES} processes; "
            f"{len(rates)} turns; {alone:.1f} a second while one of them works alone",
        )
        yield _rectangles(design, executor, 120 if quick else None, slow)


def evaluated(design: Design) -> bool:
    """Rebuild, gain, limit cycle and eight phases of a symmetric layout; whether all of it had to be done."""
    loop = Loop.of(Plant.of(design).symmetric())
    cycle = limit_cycle(loop)
    robust = robust_damping(loop, cycle) if cycle else None
    return robust is not None and bool(len(robust.times) == PHASES)


def evaluated_together(designs: list[Design]) -> int:
    """How many of some layouts were evaluated to the end, one after the other."""
    return sum(evaluated(design) for design in designs)


def plainly_evaluated(design: Design) -> None:
    """The same work without what was done for speed: the plain chain, classical steps, one run after the other."""
    plain_chain(design, True)
    loop = Loop.of(Plant.of(design).symmetric())
    plant, run = loop.plant, design.run
    sample = plant.period / SAMPLES_A_PERIOD
    memory = Memory.blank(loop.law)
    start = first_mode_at_rest(plant, run.initial_amplitude * design.panel.thickness)
    count = WINDOWS * WINDOW_PERIODS * SAMPLES_A_PERIOD
    state = loop.advance(start, memory, sample, count, engaged=False)[0][-1]
    for _ in range(PHASES):
        loop.advance(state, memory, sample, math.ceil((run.duration - run.control_on) / sample), engaged=True)


def _rectangles(design: Design, executor: Executor, most: int | None, plain: float) -> Figure:
    """The search of all rectangles that are symmetric about y = b/2, or of the first so many."""
    count = 900
    start = time.perf_counter()
    *_, last = search(design, Task(method="exhaustive", evaluations=most), executor)
    taken = (time.perf_counter() - start) * (count / last.evaluated if most else 1.0)
    return Figure(
        "the 900 symmetric rectangles on 24 x 6",
        taken,
        "s",
        (taken, taken),
        60.0,
        "at most",
        Baseline("as many plain evaluations, one process", count / plain),
        f"exhaustive search at λ = 840 with the default modes, on {CORES} processes: {last.evaluated} layouts "
        f"screened, {last.measured} run" + (", the time scaled up to 900" if most else ""),
    )
