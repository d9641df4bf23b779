"""The command search: what it prints and keeps, Ctrl-C and worse, and every task that cannot be as one line."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from fakescores import coarse, measuring, plain
from launched import alive, content, ended, family, launched, lines_in, log_of, until
from terminal import answer, complaint

from flutterviz import searching
from flutterviz.cli import run
from solver.files import save_design
from solver.task import Task

LAYOUTS = 24  # the first of 42 symmetric rectangles: enough to be interrupted in, and to find some that damp
EXHAUSTIVE = ("--method", "exhaustive", "--top", "3", "--evaluations", str(LAYOUTS))


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The seed's panel on 6 x 4 elements, as a file."""
    path = tmp_path_factory.mktemp("design") / "coarse.json"
    save_design(coarse(6, 4), path)
    return str(path)


@pytest.fixture(scope="module")
def whole(design: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a search that nothing has interrupted, in this process."""
    path = tmp_path_factory.mktemp("whole") / "ranking.json"
    assert run(["search", design, *EXHAUSTIVE, "--workers", "0", "--save", str(path)]) == 0
    return path


def test_json_has_the_best_the_ranking_and_what_was_looked_at(capsys: pytest.CaptureFixture[str], design: str) -> None:
    with measuring():
        told = answer(capsys, "search", design, *EXHAUSTIVE, "--workers", "0")
    assert told["best"]["elements"] == [1, 2]  # the lowest ids, and the fewest
    assert told["best"]["damping_time_s"] is None  # of the seed's run, which was not measured here
    assert told["best"]["value"] == told["best"]["robust_damping_time_s"] == plain((1, 2))
    assert told["evaluated"] == LAYOUTS
    assert told["complete"] is True
    assert [place["rank"] for place in told["ranking"]] == [1, 2, 3]
    assert told["ranking"][0]["design"]["patches"]["elements"] == [1, 2]
    assert told["ranking"][0]["figures"] == told["best"]
    assert told["task"]["method"] == "exhaustive"
    assert told["passive"] == []
    assert "scores" not in told


def test_the_best_of_the_panel_itself_has_both_damping_times(whole: Path) -> None:
    file, scores = content(whole)
    best = file["ranking"][0]["figures"]
    assert best["state"] == "suppressed"
    assert 0 < best["damping_time_s"] < 0.4
    assert 0 < best["robust_damping_time_s"] < 0.4
    assert len(scores) == file["evaluated"] == LAYOUTS
    assert not log_of(whole).exists()


def test_any_place_of_a_ranking_is_a_design(capsys: pytest.CaptureFixture[str], whole: Path) -> None:
    places = content(whole)[0]["ranking"]
    for name, rank in ((str(whole), 1), (f"{whole}#2", 2)):
        facts = answer(capsys, "flutter", name)
        # a root of the same function by the same steps
        assert facts["lambda_cr_in_basis"] == pytest.approx(places[rank - 1]["figures"]["lambda_cr"], rel=1e-6)
    assert "there is no rank 99; the ranking has 3 layouts" in complaint(capsys, "flutter", f"{whole}#99")


def test_the_table_for_people(capsys: pytest.CaptureFixture[str], design: str) -> None:
    with measuring(mixed=True):
        assert run(["search", design, "--elements", "4", "--method", "greedy", "--workers", "0"]) == 0
    out, err = capsys.readouterr()
    assert "greedy by worst damping time over phases, λ = 840" in out
    assert "highest NFCG, 4 elements:" in out
    assert "looked at" in out
    assert err.strip() == ""  # the bar is gone


def test_finished_it_gives_the_same_again_without_measuring(
    capsys: pytest.CaptureFixture[str], design: str, whole: Path
) -> None:
    before = whole.read_bytes()
    with measuring() as asked:
        told = answer(capsys, "search", design, *EXHAUSTIVE, "--workers", "0", "--save", str(whole))
    assert asked.screens == asked.runs == []
    assert whole.read_bytes() == before
    assert told["best"] == content(whole)[0]["ranking"][0]["figures"]


def test_a_search_refused_leaves_no_file_behind(
    capsys: pytest.CaptureFixture[str], design: str, tmp_path: Path
) -> None:
    """Else the command put right would be told that the journal is of another search."""
    path = tmp_path / "ranking.json"
    words = ["search", design, "--elements", "4", "--workers", "0", "--save", str(path)]
    complaint(capsys, *words, "--flow.dynamic-pressure", "100")
    complaint(capsys, *words, "--executor", "nonsense")
    assert list(tmp_path.iterdir()) == []
    with measuring():
        answer(capsys, *words)


BAD: list[tuple[list[str], str]] = [
    (["seed-bare"], "needs the most elements to patch, as --elements 6"),
    (["DESIGN", "--elements", "0"], "elements = 0"),
    (["DESIGN", "--elements", "1"], "no layout is allowed"),
    (["DESIGN", "--elements", "4", "--channels", "0"], "channels = 0"),
    (["DESIGN", "--elements", "4", "--mass", "-1"], "mass = -1.0"),
    (["DESIGN", "--elements", "4", "--mass", "nan"], "mass = nan"),
    (["DESIGN", "--elements", "4", "--mass", "1e-9"], "no layout is allowed"),
    (["DESIGN", "--elements", "4", "--voltage-limit", "0"], "voltage_limit = 0"),
    (["DESIGN", "--elements", "4", "--voltage-limit", "inf"], "voltage_limit = inf"),
    (["DESIGN", "--elements", "4", "--voltage-limit", "1000"], "control.voltage_limit = 1000.0 V"),
    (["DESIGN", "--elements", "4", "--keep-out", "24"], "keep_out = 24: the mesh has elements 0 to 23"),
    (["DESIGN", "--elements", "4", "--keep-out", "-1"], "keep_out"),
    (["DESIGN", "--elements", "4", "--keep-out", *map(str, range(24))], "no layout is allowed"),
    (["DESIGN", "--elements", "4", "--flow.dynamic-pressure", "300"], "there is no flutter to suppress"),
    (["DESIGN", "--elements", "4", "--control.kind", "off"], "control.kind = off"),
    (["DESIGN", "--elements", "4", "--run.control-on", "0.5"], "no time for control"),
    (["DESIGN", "--elements", "4", "--reduction.modes", "all"], "reduction.modes = all"),
    (["DESIGN", "--elements", "4", "--objective", "range"], "go with the objective range"),
    (["DESIGN", "--elements", "4", "--pressures", "800", "900"], "go with the objective range"),
    (["DESIGN", "--elements", "4", "--objective", "range", "--pressures", "nan"], "pressures"),
    (["DESIGN", "--elements", "4", "--objective", "range", "--pressures", "300"], "no flutter to suppress"),
    (["DESIGN", "--elements", "4", "--objective", "speed"], "speed"),
    (["DESIGN", "--elements", "4", "--method", "magic"], "magic"),
    (["DESIGN", "--elements", "4", "--evaluations", "0"], "evaluations = 0"),
    (["DESIGN", "--elements", "4", "--seed", "-1"], "seed = -1"),
    (["DESIGN", "--elements", "4", "--top", "0"], "top = 0"),
    (["DESIGN", "--elements", "4", "--executor", "cloud"], "executor = cloud: use local, or dask://HOST:PORT"),
    (["DESIGN", "--elements", "4", "--workers", "-1"], "workers = -1"),
    (["DESIGN", "--elements", "4", "--workers", "100000"], "workers = 100000"),
    (["DESIGN", "--elements", "4", "--save", "nowhere/ranking.json"], "give a file in a folder that exists"),
    (["DESIGN", "--elements", "4", "--save", "."], "give a file in a folder that exists"),
    (["DESIGN", "--elements", "4", "--save", "mine.json"], "is not the ranking of a search"),
    (["nothing.json", "--elements", "4"], "no such preset or file"),
]


@pytest.mark.parametrize(("words", "said"), BAD, ids=[" ".join(words)[-30:] for words, _ in BAD])
def test_a_task_that_cannot_be_is_one_line(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    design: str,
    words: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text('{"schema_version": 1}')
    words = [design if word == "DESIGN" else word for word in words]
    local = [] if {"--workers", "--executor"} & set(words) else ["--workers", "0"]
    assert said in complaint(capsys, "search", *words, *local)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("mine.json", '{"schema_version": 1}')]


def begun(design: str, path: Path) -> tuple[str, ...]:
    return ("search", design, *EXHAUSTIVE, "--workers", "2", "--save", str(path))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_interrupted_it_shows_and_keeps_what_it_has_and_goes_on(
    number: signal.Signals, design: str, whole: Path, tmp_path: Path
) -> None:
    path = tmp_path / "ranking.json"
    with launched(*begun(design, path), "--json") as process:
        until(lambda: lines_in(log_of(path)) > LAYOUTS + 3)  # all linear figures, and the first runs
        theirs = family(process.pid)
        code, out, err = ended(process, number)
        assert len(theirs) >= 2
        until(lambda: not alive(theirs), 10.0)
    assert code == 130, err
    assert "Traceback" not in err
    assert "interrupted" in err
    told = json.loads(out)
    file, scores = content(path)
    assert told["complete"] is file["complete"] is False
    assert told["best"] is not None
    assert told["evaluated"] == len(scores) == LAYOUTS
    assert not log_of(path).exists()
    assert run([*begun(design, path)[:-4], "--workers", "0", "--save", str(path)]) == 0
    assert content(path) == content(whole)


def test_a_second_signal_does_not_cost_the_result(design: str, tmp_path: Path) -> None:
    """As of who presses Ctrl-C twice, or of a service that tells both a process and its group."""
    path = tmp_path / "ranking.json"
    with launched(*begun(design, path), "--json") as process:
        until(lambda: lines_in(log_of(path)) > 4)
        process.send_signal(signal.SIGTERM)
        time.sleep(0.002)
        os.killpg(process.pid, signal.SIGTERM)
        code, out, err = ended(process, signal.SIGINT)
    assert code == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err
    assert json.loads(out)["complete"] is False
    assert path.exists()


def test_two_signals_at_once_are_one_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second is due already where the first is acted on, which Python has an error for if it finds no handler."""
    printed: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", printed.append)
    both = {signal.SIGINT, signal.SIGTERM}
    with searching._stopped_once():
        signal.pthread_sigmask(signal.SIG_BLOCK, both)
        for number in both:
            signal.pthread_kill(threading.get_ident(), number)  # the process has other threads that would take it
        with pytest.raises(KeyboardInterrupt):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, both)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert printed == []


@pytest.mark.parametrize("wait", [0, 2])
def test_interrupted_as_it_begins_it_says_nothing_of_its_insides(wait: int, design: str, tmp_path: Path) -> None:
    """Before its workers are there, as they begin, and as they import: none of them may print what it was at."""
    path = tmp_path / "ranking.json"
    with launched(*begun(design, path)) as process:
        until(lambda: log_of(path).exists())
        until(lambda: len(family(process.pid)) > wait)
        theirs = family(process.pid)
        code, _, err = ended(process, signal.SIGINT)
        until(lambda: not alive(theirs), 10.0)
    assert code == 130, err
    assert "Traceback" not in err
    assert "KeyboardInterrupt" not in err


def test_killed_its_workers_go_too_and_its_journal_stays(design: str, whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "ranking.json"
    with launched(*begun(design, path)) as process:
        until(lambda: lines_in(log_of(path)) > 16)
        theirs = family(process.pid)
        assert len(theirs) >= 2
        process.kill()
        process.wait()
        until(lambda: not alive(theirs), 10.0)
    known = lines_in(log_of(path)) - 1
    assert not path.exists()
    assert known >= 16
    with measuring() as asked:  # what is still to be measured, by other means
        run(["search", design, *EXHAUSTIVE, "--workers", "0", "--save", str(tmp_path / "other.json")])
        everything = len(asked.screens)
        asked.screens.clear()
        log_of(tmp_path / "again.json").write_bytes(log_of(path).read_bytes())
        run(["search", design, *EXHAUSTIVE, "--workers", "0", "--save", str(tmp_path / "again.json")])
    assert len(asked.screens) == everything - min(known, everything)
    assert run(["search", design, *EXHAUSTIVE, "--workers", "0", "--save", str(path)]) == 0
    assert content(path) == content(whole)


def test_a_worker_that_dies_is_one_line_and_costs_nothing_found(design: str, whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "ranking.json"
    with launched(*begun(design, path)) as process:
        until(lambda: lines_in(log_of(path)) > 10)
        theirs = family(process.pid)
        worker = next(one for one in theirs if "spawn_main" in " ".join(one.cmdline()))
        worker.kill()
        code, out, err = ended(process)
        until(lambda: not alive(theirs), 10.0)
    assert code == 2
    assert out == ""
    assert "Traceback" not in err
    last = err.strip().rpartition("\n")[2]
    assert last.startswith("flutterviz: ")
    assert "worker" in last
    assert "fewer modes" not in last  # it is not the computation that failed
    assert lines_in(log_of(path)) > 10
    assert run(["search", design, *EXHAUSTIVE, "--workers", "0", "--save", str(path)]) == 0
    assert content(path) == content(whole)


def test_the_defaults_of_a_task_are_those_of_the_command(capsys: pytest.CaptureFixture[str], design: str) -> None:
    with measuring():
        told = answer(capsys, "search", design, "--elements", "4", "--evaluations", "5", "--workers", "0")
    assert told["task"] == json.loads(json.dumps(told["task"]))
    assert told["task"]["method"] == Task().method == "iterative"
    assert told["task"]["objective"] == Task().objective == "robust"
    assert told["task"]["symmetric"] is True
    assert told["evaluated"] == 5
    assert told["reference"]["elements"] == [1, 2, 5, 6]
