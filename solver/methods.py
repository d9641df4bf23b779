"""Owns the search methods: generators that name layouts, are sent their scores, and name the next ones."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

import numpy as np

from solver.design import Design
from solver.layouts import Layout, allowed, most_elements, shapes_of, union, units_of
from solver.mesh import Floats, Mesh
from solver.score import Score, merit
from solver.scoring import element_nfcg
from solver.task import Task

Proposals = Generator[list[Layout], list[Score], None]
"""Names layouts, and is sent a score for each of them that the task allows, in the same order."""

BATCH = 16  # random layouts at a time
FOCUS = 4  # times the elements of a layout: how many of the highest NFCG are the focus of the iterative method
PATIENCE = 10  # batches without a better layout, after which it ends


def by_nfcg(design: Design, task: Task) -> Proposals:
    """The elements of highest NFCG (the seed's 4.2), and sets grown from the highest by the highest beside them.

    Of every number of elements that the task allows.
    """
    yield _highest(design, task)


def reference_layout(design: Design, task: Task) -> Layout:
    """As many elements of highest NFCG as the task allows."""
    return _as_many(ranked_units(design, task), most_elements(design, task))


def iterative(design: Design, task: Task) -> Proposals:
    """The seed's ad-hoc method: random placements around the focus that NFCG gives, as long as they improve.

    It starts from all that `by_nfcg` names, and so never does worse. Of every batch one half is drawn anew, as one to
    three sets grown within the focus; the other half changes the best layout so far: a few of its elements go elsewhere
    in the focus, or beside the others.
    """
    rng = np.random.default_rng(task.seed)
    most = most_elements(design, task)
    focus: list[Layout] = []
    for unit in ranked_units(design, task):
        if sum(map(len, focus)) < FOCUS * most:
            focus.append(unit)
    first = _highest(design, task)
    seen = set(first)
    best = min((yield first), key=_by(task), default=None)
    barren = 0
    while barren < PATIENCE:
        batch: list[Layout] = []
        for _ in range(20 * BATCH):  # where few are left to find, not many tries turn up a new one
            if len(batch) == BATCH:
                break
            if best is None or rng.random() < 0.5:
                trial = random_sets(design, rng, focus, most)
            else:
                trial = _changed(design, rng, focus, best.elements, most)
            if trial not in seen and allowed(design, task, trial):
                seen.add(trial)
                batch.append(trial)
        if not batch:
            return
        challenger = min((yield batch), key=_by(task))
        better = best is None or merit(task, challenger) < merit(task, best)
        best, barren = (challenger, 0) if better else (best, barren + 1)


def greedy(design: Design, task: Task) -> Proposals:
    """Add the best element until the task's number is reached, then swap, remove and add while that is better."""
    units = ranked_units(design, task)
    most = most_elements(design, task)
    chosen: list[Layout] = []
    best = min((yield [reference_layout(design, task)]), key=_by(task), default=None)
    while True:
        trials = [union([*chosen, unit]) for unit in units if unit not in chosen]
        found = yield [trial for trial in trials if len(trial) <= most]
        if not found:
            break
        step = min(found, key=_by(task))
        chosen = _units_in(units, step.elements)
        best = step if best is None or merit(task, step) < merit(task, best) else best
    while best is not None:
        chosen = _units_in(units, best.elements)
        others = [unit for unit in units if unit not in chosen]
        without = [[unit for unit in chosen if unit != gone] for gone in chosen]
        trials = [union(rest) for rest in without if rest]
        trials += [union([*rest, unit]) for rest in without for unit in others]
        trials += [union([*chosen, unit]) for unit in others]
        found = yield [trial for trial in trials if len(trial) <= most]
        step = min(found, key=_by(task), default=best)
        if not merit(task, step) < merit(task, best):
            return
        best = step


def exhaustive(design: Design, task: Task) -> Proposals:
    """Every shape that the task allows, at once."""
    most = most_elements(design, task)
    yield [shape for shape in shapes_of(Mesh.of(design.panel, design.mesh), task) if len(shape) <= most]


def ranked_units(design: Design, task: Task) -> list[Layout]:
    """What the task patches as one, by the mean NFCG of its elements, the highest first."""
    gains: Floats = element_nfcg(design)
    units = units_of(Mesh.of(design.panel, design.mesh), task)
    # rounding must not choose among elements that are alike
    return sorted(units, key=lambda unit: (-float(f"{gains[list(unit)].mean():.6e}"), unit))


def connected(design: Design, units: Sequence[Layout]) -> list[Layout]:
    """Units in the order in which a set grows: from the first on, always the earliest that touches it."""
    mesh = Mesh.of(design.panel, design.mesh)
    left, order = list(units[1:]), list(units[:1])
    around = {e for unit in order for e in _beside(mesh, unit)}
    while left:
        unit = next((unit for unit in left if around & set(unit)), left[0])
        left.remove(unit)
        order.append(unit)
        around |= {e for e in _beside(mesh, unit)}
    return order


def _by(task: Task) -> Callable[[Score], tuple[float, ...]]:
    return lambda score: merit(task, score)


def _units_in(units: Sequence[Layout], elements: Layout) -> list[Layout]:
    """The units that a layout consists of."""
    patched = set(elements)
    return [unit for unit in units if patched.issuperset(unit)]


def _beside(mesh: Mesh, elements: Layout) -> list[int]:
    """Elements that share an edge with some of these."""
    found = []
    for e in elements:
        i, j = divmod(e, mesh.ny)
        steps = ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1))
        found += [p * mesh.ny + q for p, q in steps if 0 <= p < mesh.nx and 0 <= q < mesh.ny]
    return found


def random_sets(design: Design, rng: np.random.Generator, focus: Sequence[Layout], most: int) -> Layout:
    """One to three sets of units of the focus, together of as many elements as allowed."""
    count = int(rng.integers(1, 4))
    seeds = [focus[k] for k in rng.permutation(len(focus))[:count]]
    chosen: list[Layout] = []
    for unit in seeds:
        if len(union([*chosen, unit])) <= most:
            chosen.append(unit)
    return _grown(design, rng, focus, chosen, most, near=1.0)


def _changed(design: Design, rng: np.random.Generator, focus: Sequence[Layout], elements: Layout, most: int) -> Layout:
    """A layout of which one to three units have gone elsewhere in the focus, or beside the others."""
    units = _units_in(focus, elements)
    gone = {int(k) for k in rng.permutation(len(units))[: int(rng.integers(1, 4))]}
    kept = [unit for k, unit in enumerate(units) if k not in gone]
    return _grown(design, rng, focus, kept, min(most, len(elements)), near=0.5)


def _grown(
    design: Design, rng: np.random.Generator, focus: Sequence[Layout], kept: list[Layout], most: int, near: float
) -> Layout:
    """Units with others of the focus added as long as they fit, with a likelihood such as touch them."""
    mesh = Mesh.of(design.panel, design.mesh)
    while True:
        room = most - len(union(kept))
        free = [unit for unit in focus if unit not in kept and len(unit) <= room]
        if not free:
            return union(kept)
        beside = {e for unit in kept for e in _beside(mesh, unit)}
        touching = [unit for unit in free if beside & set(unit)]
        pool = touching if touching and rng.random() < near else free
        kept = [*kept, pool[int(rng.integers(len(pool)))]]


def _highest(design: Design, task: Task) -> list[Layout]:
    """What NFCG alone names: of every number, the highest and those that hang together, the most elements first."""
    units, most = ranked_units(design, task), most_elements(design, task)
    orders = (units, connected(design, units))
    return list(dict.fromkeys(_as_many(order, number) for number in range(most, 0, -1) for order in orders))


def _as_many(units: Sequence[Layout], most: int) -> Layout:
    """The first units that fit into a number of elements."""
    chosen: list[Layout] = []
    for unit in units:
        if sum(map(len, chosen)) + len(unit) <= most:
            chosen.append(unit)
    return union(chosen)
