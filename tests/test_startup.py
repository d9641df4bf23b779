"""Starting up: what a process imports before it has any use for it, and that the benchmark of it leaves nothing."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from launched import alive, ended, family, launched, until

import solver
from flutterviz.bench.startup import measure

HEAVY = {"viser", "rerun", "trimesh", "matplotlib", "control", "pymoo", "numba", "llvmlite", "ambiance", "distributed"}
ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
TOLD = "\nimport json, sys\nprint(json.dumps(sorted(sys.modules)), file=sys.stderr)"


def modules(code: str) -> set[str]:
    """What a fresh process has imported in the end."""
    command = [sys.executable, "-c", code + TOLD]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=120)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stderr.splitlines()[-1]))


def test_the_solver_brings_in_nothing_that_it_may_not_need() -> None:
    found = modules("import solver")
    assert "numpy" in found
    assert found & (HEAVY | {"scipy.optimize", "scipy.signal", "scipy.spatial", "scipy.sparse.linalg"}) == set()


def test_every_public_name_can_be_imported_at_once() -> None:
    """In one statement of a fresh process, where nothing else has loaded a module before."""
    found = modules(f"from solver import {', '.join(solver.__all__)}")
    assert found & HEAVY == set()


def test_flutter_is_computed_without_what_draws_or_integrates() -> None:
    found = modules(
        "from flutterviz.cli import run\nassert run(['flutter', 'seed-bare', '--json', '--reduction.modes', '6']) == 0"
    )
    assert "solver.flutter" in found
    assert found & HEAVY == set()


def test_kernels_are_loaded_when_something_moves() -> None:
    """Or the tests above would find no numba only because nobody uses it any more."""
    found = modules(
        "import solver\n"
        "plant = solver.Plant.of(solver.load_design('seed-bare').with_reduction('patched', 6))\n"
        "flow = solver.variational.FlowMap.of(plant)\n"
        "flow.moved(flow.weights, flow.step)"
    )
    assert "numba" in found


def test_the_figures_of_starting_up() -> None:
    before = family(os.getpid())
    figures = measure(True)
    assert [figure.name for figure in figures] == ["import solver", "flutter seed-bare --json", "view serving"]
    assert [figure.target for figure in figures] == [0.5, 2.0, 3.0]
    for figure in figures:
        low, high = figure.spread
        assert 0 < low <= figure.value <= high < math.inf
        assert figure.unit == "s"
        assert figure.baseline is not None
        assert 0 < figure.baseline.value < math.inf
        assert "import numpy, scipy.linalg, scipy.sparse" in figure.baseline.name
    # the bare process is measured from within and from without
    within, without = (figure.baseline for figure in figures[:2])
    assert within is not None
    assert without is not None
    assert within.value < without.value
    assert [one for one in alive(family(os.getpid())) if one not in before] == []


def explorers(pid: int) -> list[psutil.Process]:
    """The explorers that a process has started."""
    found = []
    for one in family(pid):
        try:
            if "view" in one.cmdline():
                found.append(one)
        except psutil.Error:  # it ended at this moment
            continue
    return found


@pytest.mark.skipif(sys.platform == "win32", reason="has no signals to send")
def test_interrupted_it_leaves_no_explorer_behind() -> None:
    """Also if the signal reaches the benchmark alone, and not the whole group as Ctrl-C does."""
    with launched("bench", "start", "--quick") as bench:
        until(lambda: explorers(bench.pid))
        theirs = family(bench.pid)
        assert theirs
        bench.send_signal(signal.SIGINT)
        code, _, said = ended(bench)
        assert code == 130
        assert "Traceback" not in said
        assert alive(theirs) == []
