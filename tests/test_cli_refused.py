"""The command line: every error of a user as one line."""

import os
import socket
from pathlib import Path

import pytest
from terminal import complaint

QUICK = ["--reduction.modes", "12", "--run.duration", "0.45"]  # a run's length matters to nothing that is asked here


@pytest.mark.parametrize("command", ["flutter", "simulate", "nfcg", "view"])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["seed-840", "--patches.elements", "144"], "elements 0 to 143"),
        (["seed-840", "--patches.elements", "-1"], "elements 0 to 143"),
        (["seed-840", "--panel.thickness", "-0.001"], "panel.thickness"),
        (["seed-840", "--flow.dynamic-pressure", "nan"], "flow.dynamic_pressure"),
        (["seed-840", "--flow.dynamic-pressure", "inf"], "flow.dynamic_pressure"),
        (["seed-840", "--flow.dynamic-pressure", "much"], "--flow.dynamic-pressure"),
        (["seed-840", "--flow.dynamic-presure", "900"], "--flow.dynamic-pressure"),
        (["seed-840", "--reduction.modes", "several"], "--reduction.modes"),
        (["seed-840", "--control.kind", "pid"], "kind"),
        (["seed-841"], "seed-840"),
        (["seed-840", "seed-1200"], "seed-1200"),
        (["seed-840", "--json", "--flow.dynamic-pressure"], "dynamic-pressure"),
    ],
)
def test_a_bad_design_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], command: str, words: list[str], said: str
) -> None:
    assert said in complaint(capsys, command, *words)


@pytest.mark.parametrize("text", ["", '{"panel": {"length": 0.3', "[]", '{"panell": {}}', '{"schema_version": 99}'])
def test_a_bad_file_is_refused_by_its_name(capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.json"
    path.write_text(text)
    assert "mine.json" in complaint(capsys, "flutter", str(path))


def test_a_folder_is_no_design(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    complaint(capsys, "flutter", str(tmp_path))


def test_a_command_without_its_design_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "DESIGN" in complaint(capsys, "flutter").upper()


@pytest.mark.parametrize("words", [["fluter", "seed-bare"], ["--jsn"], ["seed-84"]])
def test_what_is_no_command_is_refused(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    complaint(capsys, *words)


@pytest.mark.parametrize("command", ["simulate", "nfcg", "view"])
@pytest.mark.parametrize("words", [["--reduction.modes", "all"], ["--reduction.modes", "100", "--mesh.nx", "3"]])
def test_a_reduction_that_cannot_run_is_refused(
    capsys: pytest.CaptureFixture[str], command: str, words: list[str]
) -> None:
    view = command == "view"
    options = ["--patches.elements", "0", *(["--no-open", "--port", "0"] if view else [])]
    assert "reduction.modes" in complaint(capsys, command, "seed-840", *words, *options, begun=view)


@pytest.mark.parametrize("name", ["nowhere/run.npz", "run.txt", "run", "folder.npz"])
def test_a_run_that_cannot_be_saved_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.npz").mkdir()
    assert name in complaint(capsys, "simulate", "seed-840", *QUICK, "--save", str(tmp_path / name))


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="permissions do not stop this user")
def test_a_folder_that_may_not_be_written_to_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    complaint(capsys, "simulate", "seed-840", *QUICK, "--save", str(tmp_path / "run.npz"))


def test_a_port_in_use_is_refused_with_a_remedy(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        said = complaint(capsys, "view", "--no-open", "--port", str(busy.getsockname()[1]))
    assert "--port" in said


@pytest.mark.parametrize(
    "words", [["--port", "70000"], ["--port", "-1"], ["--port", "eighty"], ["--host", "203.0.113.7"]]
)
def test_an_address_that_cannot_be_served_on_is_refused(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    complaint(capsys, "view", "--no-open", *words)  # the host is of a range kept for documentation: nobody has it


@pytest.mark.parametrize("name", ["nowhere/run.rrd", "run.txt"])
def test_a_recording_that_cannot_be_written_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    words = ["--no-open", "--port", "0", "--reduction.modes", "6", "--record", str(tmp_path / name)]
    assert "cannot record" in complaint(capsys, "view", *words, begun=True)


def test_replay_refuses_what_is_no_recording(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    complaint(capsys, "replay", str(tmp_path / "missing.rrd"))
