"""The command bench: what figures say, how they are timed and shown, and what becomes of parts that fail."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import platform
import signal
from collections.abc import Callable
from pathlib import Path

import fakebench
import numpy as np
import pytest
from launched import ended, launched, until
from terminal import answer, complaint
from test_startup import HEAVY, modules

from flutterviz.bench import machine as machines
from flutterviz.bench import rebuild, run
from flutterviz.bench.figure import Figure, Part
from flutterviz.bench.machine import Machine
from flutterviz.bench.timing import Times, taking_turns
from flutterviz.cli import run as command
from solver import Mesh, Plant, load_design

SHOWN = {"name", "value", "unit", "low", "high", "target", "sense", "met", "baseline", "ratio", "note"}
AT_REST = dataclasses.replace(Machine.present(), cores=2, load=0.1)


@pytest.fixture(autouse=True)
def _quiet_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that has no reason to warn."""
    monkeypatch.setattr(Machine, "present", staticmethod(lambda: AT_REST))


def measuring(monkeypatch: pytest.MonkeyPatch, *parts: Part) -> None:
    monkeypatch.setattr(run, "PARTS", parts)


# --- figures and times -----------------------------------------------------------------------------------------------


def test_a_figure_is_judged_by_its_target_and_told_by_its_ratio() -> None:
    little, much, told, gap = fakebench.FIGURES
    assert (little.met, much.met, told.met, gap.met) == (True, False, None, False)
    assert little.ratio == pytest.approx(4.0)  # a quarter of the baseline's time
    assert much.ratio == pytest.approx(4.0)  # four times its pace
    assert told.ratio is None
    assert gap.ratio is None
    slower = dataclasses.replace(little, value=160.0)
    assert slower.met is False
    assert slower.ratio == pytest.approx(0.5)
    exact = dataclasses.replace(little, value=25.0), dataclasses.replace(much, value=50.0)
    assert [figure.met for figure in exact] == [True, True]
    lost = dataclasses.replace(little, value=math.nan)
    assert lost.ratio is not None
    assert math.isnan(lost.ratio)


def test_calls_take_turns() -> None:
    said: list[str] = []
    first, second = taking_turns(lambda: said.append("a"), lambda: said.append("b"), repeats=3, warm=2)
    assert "".join(said) == "aabb" + "ababab"
    assert len(first.seconds) == len(second.seconds) == 3
    assert all(seconds >= 0 for seconds in (*first.seconds, *second.seconds))


def test_times_are_told_by_median_and_extremes() -> None:
    times = Times((3.0, 1.0, 10.0))
    assert times.median == 3.0
    assert times.spread == (1.0, 10.0)


# --- the machine -----------------------------------------------------------------------------------------------------


def present(monkeypatch: pytest.MonkeyPatch) -> Machine:
    """The machine as it is found, without the one that tests put in its place."""
    monkeypatch.undo()
    return Machine.present()


def test_the_machine_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = present(monkeypatch)
    assert machine.cpu
    assert 1 <= machine.cores <= (os.cpu_count() or 1)
    assert machine.python == platform.python_version()
    assert machine.numpy == np.__version__
    assert machine.scipy[0].isdecimal()
    assert machine.numba[0].isdecimal()
    assert machine.viser.startswith("1.")
    assert machine.blas != "unknown BLAS"
    assert all(str(part) in str(machine) for part in (machine.cpu, machine.blas, machine.numpy, machine.viser))


@pytest.mark.parametrize("system", ["Linux", "Darwin", "Windows", ""])
def test_a_machine_that_tells_little_is_named_all_the_same(monkeypatch: pytest.MonkeyPatch, system: str) -> None:
    monkeypatch.undo()

    def refused(*words: object, **options: object) -> str:
        raise FileNotFoundError

    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setattr(platform, "processor", lambda: "")
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    monkeypatch.setattr(Path, "read_text", refused)
    monkeypatch.setattr(machines.subprocess, "run", refused)
    monkeypatch.setattr(machines, "version", lambda name: (_ for _ in ()).throw(machines.PackageNotFoundError(name)))
    monkeypatch.setattr(machines.np, "show_config", lambda mode: {})
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.delattr(os, "getloadavg", raising=False)
    machine = Machine.present()
    assert machine.cpu == "riscv64"
    assert machine.cores >= 1
    assert machine.viser == "absent"
    assert (machine.blas, machine.blas_threads) == ("unknown BLAS", None)
    assert machine.load is None
    assert machine.warnings == []
    assert "load" not in str(machine)


@pytest.mark.parametrize(
    ("given", "threads"), [({}, None), ({"OPENBLAS_NUM_THREADS": "1"}, 1), ({"OMP_NUM_THREADS": "3"}, 3)]
)
def test_threads_are_those_that_were_set(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], threads: int | None
) -> None:
    monkeypatch.undo()
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    blas = {"Build Dependencies": {"blas": {"name": "scipy-openblas", "version": "0.3"}}}
    monkeypatch.setattr(machines.np, "show_config", lambda mode: blas)
    assert (Machine.present().blas, Machine.present().blas_threads) == ("scipy-openblas 0.3", threads)


def test_a_busy_machine_is_said_to_be() -> None:
    assert AT_REST.warnings == []
    (line,) = dataclasses.replace(AT_REST, load=1.6).warnings
    assert "load average 1.6 on 2 cores" in line


# --- the command -----------------------------------------------------------------------------------------------------


def test_json_has_the_machine_and_every_figure(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("rebuild", "good", fakebench.good))
    told = answer(capsys, "bench")
    assert told["machine"] == dataclasses.asdict(AT_REST)
    assert [figure["name"] for figure in told["figures"]] == ["a | thing", "a pace", "a number"]
    thing, pace, number = told["figures"]
    assert set(thing) == SHOWN
    assert (thing["value"], thing["low"], thing["high"], thing["target"]) == (20.0, 19.0, 2345.6, 25.0)
    assert thing["baseline"] == {"name": "done slowly", "value": 80.0}
    assert (thing["met"], thing["ratio"], thing["sense"]) == (True, 4.0, "at most")
    assert (pace["met"], pace["ratio"], pace["sense"]) == (False, 4.0, "at least")  # missed, and exit 0
    assert (number["target"], number["met"], number["baseline"], number["ratio"]) == (None, None, None, None)


def test_quick_is_passed_on(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    measuring(monkeypatch, Part("rebuild", "good", fakebench.good))
    assert [figure["name"] for figure in answer(capsys, "bench", "--quick")["figures"]] == ["a | thing"]


def test_parts_are_chosen_by_name(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    measuring(
        monkeypatch,
        Part("rebuild", "broken", fakebench.broken),
        Part("stream", "good", fakebench.good),
        Part("start", "good", fakebench.good),
    )
    assert len(answer(capsys, "bench", "stream")["figures"]) == 3
    assert len(answer(capsys, "bench", "start", "stream")["figures"]) == 6
    assert "'nonsense'" in complaint(capsys, "bench", "nonsense")


def test_every_part_is_there_and_none_is_loaded_before_it_is_asked_for() -> None:
    assert [part.name for part in run.PARTS] == ["rebuild", "integration", "search", "stream", "start"]
    loaded = modules("import flutterviz.bench.run")
    parts = {
        f"flutterviz.bench.{name}" for name in ("integration", "placement", "plain", "served", "startup", "stream")
    }
    assert loaded & (HEAVY | parts) == set()


def test_a_part_that_fails_is_one_line_and_the_rest_goes_on(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("search", "broken", fakebench.broken), Part("start", "good", fakebench.good))
    assert command(["bench", "--json"]) == 1
    out, err = capsys.readouterr()
    assert err.splitlines() == ["flutterviz: bench: search could not be measured: No module named 'there'"]
    failed, *rest = json.loads(out)["figures"]
    assert len(rest) == 3
    assert failed["name"] == "search"
    assert failed["value"] is failed["low"] is failed["high"] is failed["ratio"] is None
    assert failed["note"] == "No module named 'there'"


def test_what_a_part_has_measured_before_it_fails_is_kept(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("rebuild", "broken halfway", fakebench.broken_halfway))
    assert command(["bench", "--json"]) == 1
    out, _ = capsys.readouterr()
    assert [figure["name"] for figure in json.loads(out)["figures"]] == ["a | thing", "rebuild"]


def test_a_figure_that_is_missing_is_no_success(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("stream", "with a gap", fakebench.with_a_gap))
    assert command(["bench"]) == 1
    row = next(line for line in capsys.readouterr().out.splitlines() if "a gap" in line)
    assert "not measured" in row
    assert "MISSED" in row


def test_people_get_a_table_with_marks_in_words(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("rebuild", "good", fakebench.good))
    assert command(["bench"]) == 0
    out, err = capsys.readouterr()
    assert err.strip() == ""  # the bar is gone
    assert AT_REST.cpu in out
    rows = {name: next(line for line in out.splitlines() if name in line) for name in ("a | thing", "a pace")}
    assert all(text in rows["a | thing"] for text in ("20 ms", "≤ 25 ms", " met ", "19 … 2346", " 80 ms "))
    assert all(text in rows["a pace"] for text in ("40 /s", "≥ 50 /s", "MISSED"))
    assert "a | thing; a pace: baseline is done slowly; of 3" in out
    assert "1 of 2 targets met" in out


def test_markdown_is_a_table_under_the_machine(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("rebuild", "good", fakebench.good))
    assert command(["bench", "--markdown"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"Measured on {AT_REST}."
    rows = [line for line in lines if line.startswith("|")]
    assert len(rows) == 2 + 3
    assert "a \\| thing" in rows[2]  # a bar within a name would be one more column
    assert {line.replace("\\|", "").count("|") for line in rows} == {8}
    assert lines[-1] == "- 1 of 2 targets met"


@pytest.mark.parametrize("json_asked", [True, False])
def test_interrupted_it_shows_what_it_has(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, json_asked: bool
) -> None:
    measuring(
        monkeypatch,
        Part("rebuild", "good", fakebench.good),
        Part("search", "interrupted", fakebench.interrupted),
        Part("start", "good", fakebench.good),
    )
    assert command(["bench", *(["--json"] if json_asked else [])]) == 130
    out, err = capsys.readouterr()
    assert err.splitlines() == ["interrupted: what was measured so far follows"]
    if json_asked:
        assert len(json.loads(out)["figures"]) == 3
    else:
        assert "a pace" in out


def test_interrupted_at_once_it_has_nothing_to_show(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    measuring(monkeypatch, Part("search", "interrupted", fakebench.interrupted))
    assert command(["bench", "--json"]) == 130
    out, err = capsys.readouterr()
    assert err.splitlines() == ["interrupted before anything was measured"]
    assert json.loads(out)["figures"] == []


def test_ctrl_c_ends_the_process_itself(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    with launched(begun, "bench", "--json", module="fakebench") as process:
        until(begun.exists)
        code, out, err = ended(process, signal.SIGINT)
    assert code == 130, err
    assert "interrupted: what was measured so far follows" in err
    assert "Traceback" not in err
    assert len(json.loads(out)["figures"]) == 3


# --- the rebuild -----------------------------------------------------------------------------------------------------


def test_every_layout_is_a_toggle_from_the_last_and_none_comes_twice() -> None:
    seed = load_design("seed-840")
    pairs = [(36, 39), (48,), (60, 61)]
    first = set(seed.patches.elements)
    walk = [set(design.patches.elements) for design in itertools.islice(rebuild.layouts(seed, pairs), 16)]
    assert [before ^ after for before, after in itertools.pairwise([first, *walk])] == [
        set(pairs[k]) for k in (0, 1, 0, 2, 0, 1, 0, 2, 0, 1, 0, 2, 0, 1, 0, 2)
    ]
    assert len({tuple(sorted(elements)) for elements in walk[:8]}) == 8
    assert walk[7] == first  # a round


def calls_of(monkeypatch: pytest.MonkeyPatch) -> tuple[list[Figure], list[list[Callable[[], object]]]]:
    """The figures of times that grow as the 1.2th power of the elements (plainly: as the 1.5th), and what was timed."""
    asked = []

    def timed(*calls: Callable[[], object], repeats: int, warm: int) -> list[Times]:
        asked.append(list(calls))
        sizes = [1] if len(calls) == 2 else [1, 4, 16]
        return [
            Times(tuple(scale * size**power * (1 + 0.1 * turn) for turn in range(repeats)))
            for size in sizes
            for scale, power in ((0.01, 1.2), (0.05, 1.5))
        ]

    with monkeypatch.context() as patch:
        patch.setattr(rebuild, "taking_turns", timed)
        patch.setattr(rebuild, "rebuilt", lambda design, symmetric: None)
        return list(rebuild.measure(quick=True)), asked


def test_the_figures_of_a_rebuild(monkeypatch: pytest.MonkeyPatch) -> None:
    figures, asked = calls_of(monkeypatch)
    assert [(figure.name, figure.target, figure.unit) for figure in figures] == [
        ("rebuild 24 x 6, 12 symmetric modes", 25.0, "ms"),
        ("rebuild 24 x 6, 24 modes", 60.0, "ms"),
        ("rebuild 48 x 12, 24 modes", 250.0, "ms"),
        ("rebuild 96 x 24, 24 modes", 1500.0, "ms"),
        ("growth exponent in the number of elements", 1.3, "-"),
    ]
    assert [len(calls) for calls in asked] == [2, 2, 6]
    small, fine, growth = figures[1], figures[3], figures[4]
    turns = np.array([1.0, 1.1])
    fine_median = 1e3 * 0.01 * 16**1.2 * np.median(turns)
    assert fine.value == pytest.approx(fine_median)
    assert fine.spread == pytest.approx((fine_median / 1.05, 1.1 * fine_median / 1.05))
    assert fine.ratio == pytest.approx(5 * 16**0.3)
    assert small.ratio == pytest.approx(5.0)
    assert growth.value == pytest.approx(1.2)
    assert growth.ratio is None  # a multiple of an exponent says nothing
    assert growth.met is True
    assert "linear algebra on" in small.note


def test_what_is_toggled_has_twelve_symmetric_modes_and_a_regulator() -> None:
    seed = load_design("seed-840").with_reduction("patched", rebuild.SYMMETRIC_OF)
    pairs = [(6 * i + 2, 6 * i + 3) for i in rebuild.TOGGLED]
    for design in itertools.islice(rebuild.layouts(seed, pairs), 0, 32, 5):
        loop = rebuild.rebuilt(design, symmetric=True)
        assert loop.plant.size == 12
        assert loop.law.gain.any()


@pytest.mark.parametrize("finer", rebuild.FINER)
def test_finer_meshes_carry_the_same_patch(finer: int) -> None:
    seed = load_design("seed-840")
    design, toggled = rebuild._lopsided(seed, finer)
    mesh, coarse = Mesh.of(design.panel, design.mesh), Mesh.of(seed.panel, seed.mesh)
    assert (mesh.nx, mesh.ny) == (24 * finer, 6 * finer)

    def place(element: int) -> int | None:
        i, j = divmod(element, mesh.ny)
        return coarse.element_at((i + 0.5) * mesh.hx, (j + 0.5) * mesh.hy)

    elements = [place(element) for element in design.patches.elements]
    assert {e: elements.count(e) for e in seed.patches.elements} == dict.fromkeys(seed.patches.elements, finer**2)
    assert [e for e in elements if e not in seed.patches.elements] == [2 * 6 + 2]
    assert [place(element) for (element,) in toggled] == [6 * i + 3 for i in rebuild.TOGGLED]
    for one in itertools.islice(rebuild.layouts(design, toggled), 32):
        assert mesh.mirror_image(one.patches.elements) != one.patches.elements


def test_lopsided_layouts_have_a_regulator_in_all_modes() -> None:
    design, toggled = rebuild._lopsided(load_design("seed-840"), 1)
    for one in itertools.islice(rebuild.layouts(design, toggled), 0, 32, 10):
        loop = rebuild.rebuilt(one, symmetric=False)
        assert loop.plant.size == 24
        assert not Plant.of(one).model.plate.mirrored
        assert loop.law.gain.any()
