"""Owns the figures of a rebuild: what it costs that a patch is toggled, on three meshes, and how that grows."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import msgspec
import numpy as np

from flutterviz.bench.figure import Baseline, Figure
from flutterviz.bench.machine import Machine, threads_in_words
from flutterviz.bench.plain import plain_chain
from flutterviz.bench.timing import Times, taking_turns
from solver import Design, Loop, MeshSize, Plant, load_design

SYMMETRIC_OF = 21  # modes of which 12 are symmetric, whichever of the toggled pairs are patched
FINER = (1, 2, 4)  # elements a side of each mesh in one of the seed's 24 x 6
MOST_GROWTH = 1.3  # exponent of the time in the number of elements
TOGGLED = (6, 8, 10, 12, 14)  # i of the seed's elements downstream of its patch, where elements are toggled
BASELINE = "the chain in plain numpy and scipy"


def measure(quick: bool) -> Iterator[Figure]:
    """Time rebuilds, the solver's and plain ones in turns.

    Args:
        quick: few repeats.
    """
    seed = load_design("seed-840")
    pairs = [(6 * i + 2, 6 * i + 3) for i in TOGGLED]
    symmetric = _pair_of_calls(seed.with_reduction("patched", SYMMETRIC_OF), pairs, symmetric=True)
    chain, plain = taking_turns(*symmetric, repeats=5 if quick else 15, warm=0)
    yield _figure("rebuild 24 x 6, 12 symmetric modes", chain, plain, 25.0)

    meshes = [_pair_of_calls(*_lopsided(seed, finer), symmetric=False) for finer in FINER]
    chain, plain = taking_turns(*meshes[0], repeats=5 if quick else 15, warm=0)
    yield _figure("rebuild 24 x 6, 24 modes", chain, plain, 60.0)

    # the meshes take turns with each other as well: a busy spell then bends the exponent little
    times = taking_turns(*itertools.chain(*meshes), repeats=2 if quick else 5, warm=0)
    chains, plains = times[::2], times[1::2]
    yield _figure("rebuild 48 x 12, 24 modes", chains[1], plains[1], 250.0)
    yield _figure("rebuild 96 x 24, 24 modes", chains[2], plains[2], 1500.0)
    yield _growth(chains, plains)


def rebuilt(design: Design, symmetric: bool) -> Loop:
    """What the solver makes of a layout before the panel can move by it: matrices, modes, cubic law, plant, gain."""
    plant = Plant.of(design)
    if symmetric:
        plant = plant.symmetric()
    _ = plant.model.membrane
    return Loop.of(plant)


def layouts(design: Design, toggled: list[tuple[int, ...]]) -> Iterator[Design]:
    """Layouts without end, each with one group of elements toggled since the last: all subsets, by a Gray code."""
    elements = set(design.patches.elements)
    for count in itertools.count(1):
        lowest = (count & -count).bit_length() - 1
        elements ^= set(toggled[min(lowest, len(toggled) - 1)])
        yield design.with_elements(tuple(elements))


def _pair_of_calls(
    design: Design, toggled: list[tuple[int, ...]], symmetric: bool
) -> tuple[Callable[[], object], Callable[[], object]]:
    """A toggle by the solver, with what it keeps of a mesh already there, and the same toggle written plainly."""
    ours, theirs = layouts(design, toggled), layouts(design, toggled)
    rebuilt(design, symmetric)
    return lambda: rebuilt(next(ours), symmetric), lambda: plain_chain(next(theirs), symmetric)


def _lopsided(seed: Design, finer: int) -> tuple[Design, list[tuple[int, ...]]]:
    """The seed's patch on a finer mesh with one element more on one side, and elements to toggle on the other."""
    ny = 6 * finer
    patch = [
        (i * finer + di) * ny + j * finer + dj
        for i, j in (divmod(element, 6) for element in seed.patches.elements)
        for di in range(finer)
        for dj in range(finer)
    ]
    one_more = 2 * finer * ny + 2 * finer
    patches = msgspec.structs.replace(seed.patches, elements=(*patch, one_more))
    design = msgspec.structs.replace(seed, mesh=MeshSize(24 * finer, ny), patches=patches)
    return design, [(i * finer * ny + 3 * finer,) for i in TOGGLED]


def _figure(name: str, chain: Times, plain: Times, target: float) -> Figure:
    """The figure of a mesh, in ms."""
    low, high = chain.spread
    threads = threads_in_words(Machine.present().blas_threads)
    return Figure(
        name=name,
        value=1e3 * chain.median,
        unit="ms",
        spread=(1e3 * low, 1e3 * high),
        target=target,
        baseline=Baseline(BASELINE, 1e3 * plain.median),
        note=f"{len(chain.seconds)} toggles of each, on a walk over layouts; linear algebra on {threads}, as in the "
        "explorer",
    )


def _growth(chains: list[Times], plains: list[Times]) -> Figure:
    """The slope of log time over log elements, of each turn."""
    elements = np.log([144 * finer**2 for finer in FINER])
    ours, theirs = (
        np.polyfit(elements, np.log([times.seconds for times in found]), 1)[0] for found in (chains, plains)
    )
    return Figure(
        name="growth exponent in the number of elements",
        value=float(np.median(ours)),
        unit="-",
        spread=(float(ours.min()), float(ours.max())),
        target=MOST_GROWTH,
        baseline=Baseline(BASELINE, float(np.median(theirs))),
        note=f"least-squares slope of log time over log elements, 24 modes, {len(ours)} turns of the three meshes",
    )
