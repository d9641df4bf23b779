"""The methods on objectives that cost nothing: what they name is allowed, they end, and they find the best."""

from itertools import combinations, pairwise
from typing import get_args

import pytest
from fakescores import FEW, coarse, drawn, found, measuring, mirrored, plain, rough
from hypothesis import assume, given
from hypothesis import strategies as st

from solver import Design
from solver.layouts import Layout, patch_mass, union, units_of
from solver.mesh import Mesh
from solver.methods import ranked_units, reference_layout
from solver.piezo import channels
from solver.score import Score
from solver.scoring import element_nfcg
from solver.search import search
from solver.task import Method, Task, task_for

METHODS: tuple[Method, ...] = get_args(Method)
DESIGNS = (coarse(6, 4), coarse(5, 3), coarse(5, 4, wiring="element"))


def refused(design: Design, task: Task) -> bool:
    """Whether no unit of the task fits its limits, so that the search says so instead of beginning."""
    units = units_of(Mesh.of(design.panel, design.mesh), task)
    most = min(task.elements or 99, 99 if task.mass is None else int(task.mass / patch_mass(design) * (1 + 1e-9)))
    return not units or most < min(len(unit) for unit in units)


@st.composite
def tasks(draw: st.DrawFn, method: Method) -> tuple[Design, Task]:
    """A design and any limits on it, of which not all together allow anything."""
    design = draw(st.sampled_from(DESIGNS))
    count = design.mesh.nx * design.mesh.ny
    number = st.integers(1, 9)
    return design, Task(
        method=method,
        elements=draw(number if method != "exhaustive" else st.none() | number),
        channels=draw(st.none() | st.integers(1, 4)),
        mass=draw(st.none() | st.floats(0.5, 9.0).map(lambda share: share * patch_mass(design))),
        keep_out=tuple(draw(st.sets(st.integers(0, count - 1), max_size=count // 2))),
        symmetric=draw(st.booleans()),
        shapes=draw(st.sampled_from(("rectangles", "pairs", "both"))),
        seed=draw(st.integers(0, 99)),
        evaluations=draw(st.none() | st.integers(1, 60)),
        top=draw(st.integers(1, 12)),
    )


@pytest.mark.parametrize("method", METHODS)
@FEW
@given(data=st.data())
def test_every_layout_that_is_named_obeys_every_limit(method: Method, data: st.DataObject) -> None:
    design, task = data.draw(tasks(method))
    if refused(design, task):
        with pytest.raises(ValueError, match="no layout is allowed"):
            list(search(design, task))
        return
    with measuring(rough(task.seed), mixed=True) as asked:
        scores, ranking = found(search(design, task))  # and it ends
    assert len(asked.screens) == len(set(asked.screens)) == len(scores) == ranking.evaluated
    assert set(asked.runs) <= set(asked.screens)
    assert task.evaluations is None or ranking.evaluated <= task.evaluations
    for one in scores:
        assert one == tuple(sorted(set(one)))
        assert len(one) >= 1
        assert len(one) <= (task.elements or 99)
        assert task.mass is None or len(one) * patch_mass(design) <= task.mass * (1 + 1e-9)  # rounding of a product
        assert not set(task.keep_out) & set(one)
        assert not task.symmetric or mirrored(design, one)
        assert task.channels is None or len(channels(design.with_elements(one))) <= task.channels
    assert {score.elements for score in ranking.ranked} <= set(scores)


@pytest.mark.parametrize("method", METHODS)
def test_a_search_that_may_look_at_one_layout_looks_at_one(method: Method) -> None:
    with measuring() as asked:
        scores, ranking = found(search(coarse(6, 4), Task(method=method, elements=4, evaluations=1)))
    assert len(asked.screens) == len(scores) == 1
    assert ranking.best is not None


@pytest.mark.parametrize("wiring", ["connected", "element"])
@pytest.mark.parametrize("method", METHODS)
def test_the_layout_of_highest_nfcg_is_held_to_the_limits_too(method: Method, wiring: str) -> None:
    """One channel, where every element has its own: nothing is allowed but single elements, of which none is a pair."""
    design = coarse(6, 4, wiring=wiring)
    with measuring():
        _, ranking = found(search(design, Task(method=method, elements=4, channels=1, evaluations=60)))
    assert all(len(channels(design.with_elements(score.elements))) == 1 for score in ranking.ranked)
    assert bool(ranking.ranked) is (wiring == "connected")


@pytest.mark.parametrize("method", METHODS)
def test_where_only_pairs_are_left_and_one_element_is_allowed_nothing_is_named(method: Method) -> None:
    design, middle = coarse(6, 3), tuple(3 * i + 1 for i in range(6))
    with measuring() as asked, pytest.raises(ValueError, match="no layout is allowed"):
        list(search(design, Task(method=method, elements=1, keep_out=middle)))
    assert asked.screens == []


def weighed(salt: int, lowest: float = -1.0) -> dict[int, float]:
    """What each element of a 6 x 4 mesh adds to an objective."""
    return {e: lowest + (1.0 - lowest) * drawn((salt, e)) for e in range(24)}


def least(units: list[Layout], weights: dict[int, float], counts: range) -> float:
    """The least sum of weights over all sets of so many units, each tried."""
    sums = [sum(weights[e] for e in unit) for unit in units]
    return min(sum(some) for count in counts for some in combinations(sums, count))


@pytest.mark.parametrize("salt", [1, 2, 3])
@pytest.mark.parametrize("method", ["greedy", "genetic"])
def test_the_optimum_of_a_sum_over_elements_is_found(method: Method, salt: int) -> None:
    design, weights = coarse(6, 4), weighed(salt)
    task = Task(method=method, elements=8, seed=salt)
    with measuring(lambda one: 20 + sum(weights[e] for e in one)):
        _, ranking = found(search(design, task))
    units = units_of(Mesh.of(design.panel, design.mesh), task)
    assert ranking.best is not None
    # sums of the same numbers in another order
    assert ranking.best.value == pytest.approx(20 + least(units, weights, range(1, 5)), rel=1e-12)


@pytest.mark.parametrize("salt", [1, 2, 3])
def test_the_iterative_method_finds_it_where_every_element_helps(salt: int) -> None:
    """It uses all elements that it is allowed; with four pairs of twelve its focus is the panel."""
    design, weights = coarse(6, 4), weighed(salt)
    weights = {e: weight - 1.0 for e, weight in weights.items()}
    task = Task(elements=8, seed=salt)
    with measuring(lambda one: 60 + sum(weights[e] for e in one)):
        _, ranking = found(search(design, task))
    units = units_of(Mesh.of(design.panel, design.mesh), task)
    assert ranking.best is not None
    assert ranking.best.value == pytest.approx(60 + least(units, weights, range(4, 5)), rel=1e-12)


def test_exhaustive_names_every_shape_once_and_finds_the_least() -> None:
    with measuring(rough("shapes")) as asked:
        _, ranking = found(search(coarse(6, 4), Task(method="exhaustive", top=1000)))
    assert len(asked.screens) == len(asked.runs) == len(set(asked.runs)) == 42
    assert ranking.best is not None
    assert ranking.best.value == min(rough("shapes")(one) for one in asked.runs)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("elements", [4, 5, 6])
def test_iterative_is_never_worse_than_nfcg_with_as_many_elements(seed: int, symmetric: bool, elements: int) -> None:
    design = coarse(6, 4)
    tries: list[Task] = [Task(m, elements=elements, symmetric=symmetric, seed=seed) for m in ("nfcg", "iterative")]
    with measuring(rough(seed)):
        (_, by_nfcg), (_, ranking) = (found(search(design, task)) for task in tries)
    assert ranking.reference == by_nfcg.reference
    assert ranking.reference is not None
    assert ranking.reference.elements == reference_layout(design, tries[0])
    full = [score for score in by_nfcg.ranked if len(score.elements) == len(ranking.reference.elements)]
    assert len(full) in (1, 2)  # by rank, and grown from the highest; they may be one
    assert value_of(ranking.best) <= value_of(ranking.reference)
    assert value_of(ranking.best) <= min(value_of(score) for score in full)


@pytest.mark.parametrize("seed", range(6))
def test_iterative_is_never_worse_than_all_that_nfcg_finds_under_the_same_limits(seed: int) -> None:
    """Those too with fewer elements than the task allows: a user who asks for at most six gets the better of both."""
    with measuring(rough(("fewer", seed))):
        best = [found(search(coarse(6, 4), Task(m, elements=8, seed=seed)))[1].best for m in ("nfcg", "iterative")]
    assert value_of(best[1]) <= value_of(best[0])


def value_of(score: Score | None) -> float:
    assert score is not None
    assert score.value is not None
    return score.value


@pytest.mark.parametrize("symmetric", [True, False])
def test_nfcg_names_the_highest_of_every_number(symmetric: bool) -> None:
    design = coarse(6, 4)
    task = task_for(Task("nfcg", elements=6, symmetric=symmetric), design)
    gains, units = element_nfcg(design), ranked_units(design, task)
    means = [float(gains[list(unit)].mean()) for unit in units]
    # in order, but for what rounding makes of elements that are alike
    assert all(first >= second * (1 - 1e-5) for first, second in pairwise(means))
    with measuring(plain) as asked:
        found(search(design, task))
    size = 2 if symmetric else 1
    assert {len(one) for one in asked.screens} == set(range(size, 7, size))
    for count in range(size, 7, size):
        assert union(units[: count // size]) in asked.screens


def test_seeds_draw_differently_and_the_same_one_alike() -> None:
    for method in ("iterative", "genetic"):
        named: list[list[Layout]] = []
        for seed in (3, 3, 4):
            with measuring(rough("drawn")) as asked:
                found(search(coarse(6, 4), Task(method, elements=8, seed=seed, evaluations=60)))
            named.append(asked.screens)
        assert named[0] == named[1]
        assert named[0] != named[2]


@pytest.mark.parametrize("method", ["iterative", "genetic"])
def test_two_searches_side_by_side_do_not_disturb_each_other(method: Method) -> None:
    """Random numbers are each search's own: two that take turns find what each finds alone."""
    task = Task(method, elements=8, evaluations=80)
    with measuring(rough("side")) as asked:
        found(search(coarse(6, 4), task))
        alone, asked.screens[:] = list(asked.screens), []
        first, second = search(coarse(6, 4), task), search(coarse(6, 4), task)
        for _ in zip(first, second, strict=True):
            pass
    assert asked.screens[::2] == asked.screens[1::2] == alone


@FEW
@given(salt=st.integers(0, 10**6), count=st.integers(1, 10))
def test_greedy_stops_where_no_single_change_helps(salt: int, count: int) -> None:
    design, worth = coarse(5, 4), rough(salt)
    with measuring(worth):
        _, ranking = found(search(design, Task("greedy", elements=count, symmetric=False, top=1000)))
    best = ranking.best
    assert best is not None
    assume(best != ranking.reference)  # which every method is given; greedy does not go on from it
    patched = set(best.elements)
    bare = set(range(20)) - patched
    near = [patched - {e} for e in patched] + [patched | {e} for e in bare]
    near += [patched - {e} | {other} for e in patched for other in bare]
    values = [worth(tuple(sorted(one))) for one in near if 0 < len(one) <= count]
    assert value_of(best) == worth(best.elements)
    assert value_of(best) <= min(values)
