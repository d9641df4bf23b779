"""Owns the genetic search: pymoo's NSGA-II over the objective and the number of elements."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.evaluator import Evaluator
from pymoo.core.problem import Problem
from pymoo.core.repair import Repair
from pymoo.operators.crossover.pntx import TwoPointCrossover
from pymoo.operators.mutation.bitflip import BitflipMutation
from pymoo.problems.static import StaticProblem

from solver.design import Design
from solver.layouts import Layout, most_elements, union
from solver.mesh import Bools, Ints
from solver.methods import Proposals, random_sets, ranked_units, reference_layout
from solver.score import Score, merit
from solver.task import Task

POPULATION = 32
PATIENCE = 8  # generations without a better layout, after which it ends
WORSE = 1e12  # beyond any value of an objective: what has none comes after what has


def genetic(design: Design, task: Task) -> Proposals:
    """NSGA-II (Deb et al., IEEE Trans. Evol. Comput. 6, 2002) over the objective and the number of elements.

    A gene is an element, or where the task is symmetric a pair; genes stand from the leading edge downstream, so that
    the two-point crossover trades a stretch of the panel. It begins with the layout of highest NFCG and with random
    sets of all sizes around it.
    """
    rng = np.random.default_rng(task.seed)
    ranked = ranked_units(design, task)
    units = sorted(ranked)
    most, least = most_elements(design, task), min(map(len, units))
    first = [reference_layout(design, task)]
    while len(first) < POPULATION:
        size = int(rng.integers(least, most + 1))
        first.append(random_sets(design, rng, ranked[: max(size, len(ranked) // 2)], size) or first[0])
    problem = Problem(n_var=len(units), n_obj=2, xl=0, xu=1, vtype=bool)
    kind: Any = NSGA2  # annotated as if it took no other operators than its default ones
    algorithm = kind(
        pop_size=POPULATION,
        sampling=np.array([[set(unit) <= set(one) for unit in units] for one in first]),
        crossover=TwoPointCrossover(),
        mutation=BitflipMutation(),
        repair=_Fewer(np.array([len(unit) for unit in units]), most, rng),
    )
    algorithm.setup(problem, termination=("n_gen", 1_000_000), seed=task.seed, verbose=False)
    best: Score | None = None
    scores: dict[Layout, Score] = {}
    barren = 0
    while barren < PATIENCE:
        population = algorithm.ask()
        if population is None or not len(population):
            return  # every child was there before
        layouts = [_layout(units, genes) for genes in population.get("X")]
        for score in (yield layouts):
            scores[score.elements] = score
        found = [scores.get(one) for one in layouts]
        values = [[_fitness(task, score), len(one)] for one, score in zip(layouts, found, strict=True)]
        Evaluator().eval(StaticProblem(problem, F=np.array(values, dtype=float)), population)
        algorithm.tell(infills=population)
        here = min((score for score in found if score), key=lambda score: merit(task, score), default=None)
        better = here is not None and (best is None or merit(task, here) < merit(task, best))
        best, barren = (here, 0) if better else (best, barren + 1)


class _Fewer(Repair):
    """Leaves as many elements patched as a task allows, at random which, and never none."""

    def __init__(self, sizes: Ints, most: int, rng: np.random.Generator) -> None:
        super().__init__()
        self._sizes, self._most, self._rng = sizes, most, rng

    def _do(self, problem: Problem, X: Bools, **_: object) -> Bools:  # pymoo's own signature
        for genes in X:
            while self._sizes[genes].sum() > self._most:
                genes[self._rng.choice(np.flatnonzero(genes))] = False
            if not genes.any():
                genes[self._rng.choice(np.flatnonzero(self._sizes <= self._most))] = True
        return X


def _layout(units: list[Layout], genes: Bools) -> Layout:
    return union([unit for unit, on in zip(units, genes, strict=True) if on])


def _fitness(task: Task, score: Score | None) -> float:
    """The objective as a cost; for what has none, a number that keeps the order of `merit`."""
    if score is None:
        return 9 * WORSE  # not allowed
    if score.value is not None:
        return task.cost(score.value)
    if score.state in ("beyond", "screened"):
        return task.cost(score.bound) if score.bound is not None else (score.estimate or WORSE)
    growth = score.closed_loop_growth_per_s
    return merit(task, score)[0] * WORSE + (0.0 if growth is None else min(max(growth, 0.0), 0.5 * WORSE))
