"""The benchmark of runs: its baselines compute the same as what they are timed against."""

import math

import numpy as np
import pytest

from flutterviz.bench.integration import by_dop853, measure, operations, right_hand_side
from flutterviz.bench.placement import PAIRS, evaluated
from solver import Loop, Plant, first_mode_at_rest, load_design
from solver.vonkarman import membrane_force

DESIGN = load_design("seed-840").with_reduction("patched", 9)


def test_its_right_hand_side_is_the_plants() -> None:
    loop = Loop.of(Plant.of(DESIGN).symmetric())
    plant, n = loop.plant, loop.plant.size
    x = np.random.default_rng(0).standard_normal(2 * n) * np.repeat([1e-3, 1.0], n)
    volts = np.clip(-loop.law.gain @ x, -loop.law.limit, loop.law.limit)
    force = plant.force @ volts - loop.linear @ x - membrane_force(plant.model.membrane, x[:n])
    found = right_hand_side(loop, plant.model.membrane)(0.0, x)
    np.testing.assert_allclose(found, np.concatenate([x[n:], force]), rtol=1e-10, atol=1e-10 * np.abs(force).max())


def test_its_adaptive_run_is_ours() -> None:
    loop = Loop.of(Plant.of(DESIGN).symmetric())
    start = first_mode_at_rest(loop.plant, 0.5 * loop.plant.design.panel.thickness)
    ours, _ = loop.stretch(start, 1e-4, 100, engaged=True)
    theirs = by_dop853(loop, start, 1e-4, 100)
    n = loop.plant.size
    heights = loop.plant.model.coarse.T / loop.plant.design.panel.thickness
    assert np.abs((ours - theirs)[:, :n] @ heights).max() < 1e-4


def test_operations_are_counted_by_loops() -> None:
    n, counted = 3, 0
    for _ in range(4):
        pairs = sum(1 for s in range(n) for _ in range(s + 1))
        cubes = sum((t + 1) * (t + 2) // 2 for t in range(n))
        counted += pairs + cubes + 2 * n * cubes
    counted += 2 * (2 * n) * (2 * 2 * n)  # of the state on two results, of which the others are copies
    counted += 2 * n * (3 + 2 + 2 + 1) * 2 * n  # of the four forces on eight
    assert operations(n) == counted


def test_a_quick_look_gives_every_figure() -> None:
    figures = list(measure(True))
    assert [figure.unit for figure in figures] == ["x", "x", "1e-4 h", "GFLOP/s"]
    assert all(math.isfinite(figure.value) and figure.value > 0 for figure in figures)
    assert figures[2].met  # the one that does not depend on the machine


@pytest.mark.parametrize("pairs", [PAIRS[:3], PAIRS[-3:]])
def test_its_layouts_are_evaluated_to_the_end(pairs: tuple[tuple[int, int], ...]) -> None:
    assert evaluated(DESIGN.with_elements(tuple(element for pair in pairs for element in pair)))
