"""The command line: its JSON contract, overrides, files, and every error of a user as one line."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from terminal import answer, complaint

import solver.check
from flutterviz.cli import COMMANDS, run
from solver import Design, design_from_json, load_design, preset_names, save_design
from solver.check import Case

SIX = ["20", "21", "26", "27", "32", "33"]  # i = 3..5, j = 2..3
QUICK = ["--reduction.modes", "12", "--run.duration", "0.45"]  # a run's length matters to nothing that is asked here


# --- flutter ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "expected", "tolerance"),
    [
        # independent codes agree on these; the tolerances are theirs
        (["seed-bare", "--flow.damping", "0"], 512.65, 2e-4),
        (["seed-bare"], 514.91, 5e-4),
        (["seed-bare", "--flow.damping", "0", "--reduction.basis", "family", "--reduction.modes", "4"], 505.13, 5e-4),
        (["seed-840"], 545.8, 3e-3),
        (["seed-840", "--reduction.modes", "all"], 545.8, 3e-3),
        (["seed-bare", "--patches.elements", *SIX], 545.8, 3e-3),
    ],
)
def test_critical_pressures(
    capsys: pytest.CaptureFixture[str], words: list[str], expected: float, tolerance: float
) -> None:
    assert answer(capsys, "flutter", *words)["lambda_cr"] == pytest.approx(expected, rel=tolerance)


def test_flutter_gives_frequencies_and_roots(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "flutter", "seed-bare")
    assert facts["frequencies_hz"][0] == pytest.approx(65.67, rel=1e-3)  # (1,1) of a simply supported plate
    assert len(facts["frequencies_hz"]) == 24
    assert facts["frequencies_hz"] == sorted(facts["frequencies_hz"])
    assert facts["frequencies_hz"][0] < facts["flutter_frequency_hz"] < facts["frequencies_hz"][-1]
    assert len(facts["dynamic_pressures"]) == len(facts["growth_rates"]) == len(facts["root_frequencies_hz"])


@pytest.mark.parametrize(
    "words",
    [
        ["seed-bare", "--flow.dynamic-pressure", "900"],
        ["--flow.dynamic-pressure", "900", "seed-bare"],
        ["--flow.dynamic-pressure=900", "seed-bare"],
    ],
)
def test_an_override_may_stand_before_the_name_and_after(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    # the sweep ends a quarter above the larger of λ and λ_cr
    assert answer(capsys, "flutter", *words)["dynamic_pressures"][-1] == pytest.approx(1.25 * 900)


def test_every_preset_and_a_file_can_be_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for name in preset_names():
        path = tmp_path / f"my {name}.json"
        save_design(load_design(name), path)
        assert answer(capsys, "flutter", str(path)) == answer(capsys, "flutter", name)


# --- simulate ---------------------------------------------------------------------------------------------------------


def test_simulate_keeps_its_contract(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "simulate", "seed-840")
    assert 0.05 < facts["damping_time_s"] < 0.2  # the paper has 0.072 and 0.0836 s; the phase at t_on moves it by 30 %
    assert facts["passive"] is False
    assert facts["lco_amplitude_over_h"] == pytest.approx(1.05, abs=0.15)  # bare 1.12; patches stiffen the panel
    assert facts["lco_frequency_hz"] > 65.67
    assert sum(facts["participation_percent"]) == pytest.approx(100, abs=1e-6)
    assert facts["peak_voltage_v"] == 228.6
    assert facts["lambda_cr"] == pytest.approx(545.8, rel=3e-3)


def test_a_passive_layout_has_no_damping_time(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "simulate", "seed-840", "--flow.dynamic-pressure", "530")
    assert facts["passive"] is True
    assert facts["damping_time_s"] is None


@pytest.mark.parametrize("ending", ["npz", "csv", "rrd", "glb"])
def test_a_run_is_saved_and_can_be_read_back(capsys: pytest.CaptureFixture[str], tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"run.{ending}"
    facts = answer(capsys, "simulate", "seed-840", *QUICK, "--save", str(path))
    if ending == "npz":
        with np.load(path) as run_data:
            samples = len(run_data["time"])
            assert np.abs(run_data["time"] - 0.2).min() < 1e-12  # the controller is switched on at a sample
            assert run_data["time"][-1] == pytest.approx(0.45, abs=3e-4)  # a sample's length
            assert run_data["time"].shape == run_data["probe"].shape == run_data["largest"].shape == (samples,)
            assert run_data["q"].shape == run_data["q_rate"].shape
            assert run_data["volts"].shape == (samples, 1)
            assert np.abs(run_data["volts"]).max() == facts["peak_voltage_v"]
            design = design_from_json(str(run_data["design"]))
        assert design.run.duration == 0.45
        assert design.with_reduction("patched", 24).patches == load_design("seed-840").patches
    elif ending == "csv":
        table = np.genfromtxt(path, delimiter=",", names=True)
        assert table["time_s"][-1] == pytest.approx(0.45, abs=3e-4)  # a sample's length
        assert table["largest_w_over_h"][0] == pytest.approx(0.1, rel=1e-6)  # printed to nine digits
        assert np.abs(table["volts_1"]).max() == facts["peak_voltage_v"]
    elif ending == "rrd":
        assert RrdReader(path).recordings()
    else:
        assert path.read_bytes().startswith(b"glTF")


# --- nfcg, check ------------------------------------------------------------------------------------------------------


def test_nfcg_has_a_number_for_every_element(capsys: pytest.CaptureFixture[str]) -> None:
    norms = np.array(answer(capsys, "nfcg", "seed-840")["nfcg"])
    assert norms.shape == (144,)
    assert (norms > 0).all()
    across = norms.reshape(24, 6)
    np.testing.assert_allclose(
        across, across[:, ::-1], rtol=1e-6
    )  # the panel's symmetry, to the Riccati solver's digits


def cases(ok: bool, value: float | None = 1.0) -> Iterator[Case]:
    yield Case("first", 2.0, 2.0, 1e-3, True, 1.9, "someone")
    yield Case("second", value, 1.0, 1e-3, ok, None, "someone else")


@pytest.mark.parametrize(("ok", "value", "code"), [(True, 1.0, 0), (False, 2.0, 1), (False, None, 1)])
@pytest.mark.parametrize("form", [["--json"], []])
def test_check_prints_its_table_and_exits_by_it(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    ok: bool,
    value: float | None,
    code: int,
    form: list[str],
) -> None:
    monkeypatch.setattr(solver.check, "run_checks", lambda: cases(ok, value))
    assert run(["check", *form]) == code
    out, _ = capsys.readouterr()
    if form:
        table = json.loads(out)["cases"]
        assert [case["ok"] for case in table] == [True, ok]
        assert {"name", "value", "reference", "tol", "ok"} <= set(table[0])
    else:
        assert f"{1 + ok} of 2 within tolerance" in out


# --- for people -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["flutter", "seed-bare"], "514.9"),
        (["simulate", "seed-840", *QUICK], "damping time"),
        (["nfcg", "seed-840"], "j = 5"),
        (["--help"], "simulate"),
        (["flutter", "--help"], "--flow.dynamic-pressure"),
        (["simulate", "seed-840", "--help"], "--save"),
    ],
)
def test_without_json_people_are_answered(capsys: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    assert run(words) == 0
    out, _ = capsys.readouterr()
    assert said in out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(capsys: pytest.CaptureFixture[str], command: str) -> None:
    assert run([command, "--help"]) == 0
    out, err = capsys.readouterr()
    assert f"flutterviz {command}" in out
    assert err == ""


# --- what cannot be used ----------------------------------------------------------------------------------------------


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


# --- as a process -----------------------------------------------------------------------------------------------------


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}


def process(*words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "flutterviz", *words]
    return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=120)


def test_a_process_answers_on_stdout_and_exits_with_0(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    save_design(Design(), path)
    done = process("flutter", str(path), "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["lambda_cr"] == pytest.approx(514.91, rel=5e-4)
    assert done.stderr == ""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_explorer_is_served_on_loopback_until_it_is_ended(number: int) -> None:
    command = [sys.executable, "-m", "flutterviz", "view", "--no-open", "--port", "0", "--reduction.modes", "6"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as server:
        try:
            assert server.stderr is not None
            said = next(found for line in server.stderr if (found := re.search(r"http://\S+", line)))
            assert said[0].startswith("http://127.0.0.1:")
            with urllib.request.urlopen(said[0], timeout=20) as answered:
                assert answered.status == 200
            server.send_signal(number)
            out, err = server.communicate(timeout=20)
        finally:
            server.kill()
    assert (server.returncode, out) == (0, "")
    assert "Traceback" not in err


def test_a_process_complains_on_stderr_and_exits_with_2() -> None:
    done = process("simulate", "seed-840", "--patches.elements", "999")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "999" in done.stderr


# --- sweep ------------------------------------------------------------------------------------------------------------

SWEPT = ["seed-bare", "--reduction.modes", "6"]
COARSE = ["--mesh.nx", "8", "--mesh.ny", "4"]


def test_sweep_keeps_its_contract(capsys: pytest.CaptureFixture[str]) -> None:
    found = answer(capsys, "sweep", *SWEPT, *COARSE, "--over", "flow.dynamic-pressure=500:700:100")
    assert found["over"] == "flow.dynamic-pressure"
    rows = found["rows"]
    assert [row["value"] for row in rows] == [500, 600, 700, 600, 500]
    assert [row["direction"] for row in rows] == ["up", "up", "up", "down", "down"]
    for row in rows:
        assert row["dynamic_pressure"] == row["value"]
        assert (row["growth_per_s"] > 0) == (row["lco_amplitude_over_h"] is not None)
        assert {"lambda_cr", "passive", "lco_frequency_hz", "floquet", "damping_time_s"} <= set(row)
    assert rows[0]["lco_amplitude_over_h"] is None
    assert rows[2]["lco_amplitude_over_h"] > rows[1]["lco_amplitude_over_h"] > 0


@pytest.mark.parametrize(
    ("over", "count"),
    [
        ("flow.dynamic_pressure=0.1:0.3:0.1", 5),  # the stop is reached but for rounding
        ("flow.dynamic-pressure=100:250:100", 3),  # or not at all
        ("flow.dynamic-pressure=100:100:1", 1),
        ("flow.dynamic-pressure=200:100:-100", 3),  # downwards first
        ("load.temperature=-1:0:1", 3),
    ],
)
def test_values_of_a_sweep(capsys: pytest.CaptureFixture[str], over: str, count: int) -> None:
    still = [*SWEPT, *COARSE, "--flow.dynamic-pressure", "100"]
    assert len(answer(capsys, "sweep", *still, "--over", over)["rows"]) == count


@pytest.mark.parametrize(
    "over",
    [
        "flow.dynamic-pressure",
        "flow.dynamic-pressure=800",
        "flow.dynamic-pressure=800:900",
        "flow.dynamic-pressure=a:b:c",
        "flow.dynamic-pressure=500:400:50",
        "flow.dynamic-pressure=500:600:0",
        "flow.dynamic-pressure=nan:600:1",
        "flow.dynamic-pressure=0:inf:1",
        "flow.dynamic-pressure=0:1:1e-9",
        "500:600:50",
        "",
        "=500:600:50",
        "flow.pressure=500:600:50",
        "panel.edges=1:2:1",
        "patches.elements=1:2:1",
        "mesh.nx=8:9:0.5",
        "panel.thickness=-1:1:1",
        "flow.mach=0.5:2:0.5",
    ],
)
def test_a_bad_sweep_is_refused_in_one_line(capsys: pytest.CaptureFixture[str], over: str) -> None:
    complaint(capsys, "sweep", *SWEPT, "--over", over)


def test_a_sweep_without_its_field_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--over" in complaint(capsys, "sweep", "seed-bare")


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ending", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_roots_are_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path, ending: str, magic: bytes) -> None:
    path = tmp_path / f"roots.{ending}"
    assert run(["flutter", *SWEPT, *COARSE, "--plot", str(path)]) == 0
    out, err = capsys.readouterr()
    assert "λ_cr" in out
    assert f"saved {path}" in err.replace("\n", "")  # a long path may be wrapped
    assert path.read_bytes().startswith(magic)


def test_a_panel_that_never_flutters_is_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "roots.png"
    words = ["--reduction.basis", "family", "--reduction.modes", "4", "--flow.yaw-deg", "90", "--plot", str(path)]
    assert answer(capsys, "flutter", "seed-bare", *COARSE, *words)["lambda_cr"] is None
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "words",
    [
        [*SWEPT, "--over", "flow.dynamic-pressure=500:600:100"],
        ["seed-840", "--reduction.modes", "8", "--patches.elements", "9", "10", "--over", "flow.yaw-deg=0:10:10"],
    ],
)
def test_a_sweep_is_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path, words: list[str]) -> None:
    path = tmp_path / "sweep.png"
    assert answer(capsys, "sweep", *words, *COARSE, "--plot", str(path))["rows"]
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("command", [["flutter"], ["sweep", "--over", "flow.dynamic-pressure=500:600:50"]])
@pytest.mark.parametrize("name", ["roots.txt", "roots", "nowhere/roots.png", ".png"])
def test_a_picture_that_cannot_be_drawn_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: list[str], name: str
) -> None:
    said = complaint(capsys, command[0], *SWEPT, *command[1:], "--plot", str(tmp_path / name))
    assert name in said


# --- loads, flights, edges, plies and bases ---------------------------------------------------------------------------


def test_simulate_says_how_sure_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["seed-840", *COARSE, "--patches.elements", "9", "10", "--reduction.modes", "8", "--run.duration", "0.5"]
    facts = answer(capsys, "simulate", *words, "--estimate-error")
    found = facts["estimate"]
    assert found["modes"] == 8
    assert found["richer_modes"] == 24
    assert found["finer_mesh"] == [16, 8]
    assert found["lambda_cr"]["value"] == pytest.approx(facts["lambda_cr"], rel=1e-9)  # computed twice: rounding
    assert found["lambda_cr"]["basis_error"] > 0
    assert found["lambda_cr"]["mesh_error"] > 0
    # rounding moves the samples on the cycle from which its peak is read
    assert found["lco_amplitude_over_h"]["value"] == pytest.approx(facts["lco_amplitude_over_h"], rel=1e-4)
    assert found["damping_time_s"]["value"] == pytest.approx(facts["damping_time_s"], abs=1e-3)  # a swing or none
    assert answer(capsys, "simulate", *words)["estimate"] is None


@pytest.mark.parametrize("command", ["flutter", "simulate"])
def test_a_flight_where_the_theory_fails_is_warned_of(capsys: pytest.CaptureFixture[str], command: str) -> None:
    words = [command, *SWEPT, *COARSE, "--flow.mach", "1.3", "--run.duration", "0.3", "--json"]
    assert run(words) == 0
    out, err = capsys.readouterr()
    assert err.count("warning: first-order piston theory") == 1
    assert "M = 1.3" in err
    (told,) = (line for line in json.loads(out)["warnings"] if "piston" in line)  # the coarse basis has its own
    assert told in err.replace("\n", " ")
    assert run([*words, "--flow.mach", "2.0"]) == 0
    out, err = capsys.readouterr()
    assert not any("piston" in line for line in json.loads(out)["warnings"])
    assert "piston" not in err


def test_a_flight_by_its_mach_number(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "flutter", *SWEPT, *COARSE, "--flow.mach", "2")
    # 2qa³/(βD) of the standard atmosphere at sea level, and ((M² - 2)/(M² - 1))² μ/β: to the digits given
    assert facts["dynamic_pressure"] == pytest.approx(717.24, abs=0.01)
    assert facts["aerodynamic_damping"] == pytest.approx(0.0279409, abs=1e-6)
    assert "above 1" in complaint(capsys, "flutter", *SWEPT, "--flow.mach", "0.9")
    assert "altitude" in complaint(capsys, "flutter", *SWEPT, "--flow.mach", "2", "--flow.altitude", "1e6")


@pytest.mark.parametrize(("heat", "buckles"), [("0.5", False), ("2", True)])
def test_heat(capsys: pytest.CaptureFixture[str], heat: str, buckles: bool) -> None:
    panel = [*SWEPT, "--mesh.nx", "12", "--flow.dynamic-pressure", "50"]
    facts = answer(capsys, "flutter", *panel, "--load.temperature", heat)
    # π² h²/(6 (1 + ν) α a²) = 0.9764 K of a square that cannot expand; six elements across: (π/6)⁴/720
    assert facts["buckling_factor"] * float(heat) == pytest.approx(0.9764, rel=2e-4)
    assert facts["buckled"] is buckles
    assert len(facts["static_states"]) == (3 if buckles else 1)
    assert (facts["frequencies_hz"][0] == 0) is buckles
    assert (facts["rests_up_to"] is not None) is buckles
    cold = answer(capsys, "flutter", *panel)
    assert facts["lambda_cr"] < cold["lambda_cr"]
    assert cold["buckling_factor"] is None


def test_heat_is_told_to_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["flutter", *SWEPT, *COARSE, "--load.temperature", "2"]) == 0
    out, _ = capsys.readouterr()
    assert "buckles in still air at" in out
    assert "static state" in out


def test_a_plate_clamped_at_its_leading_edge(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "flutter", *SWEPT, "--mesh.nx", "12", "--panel.edges", "cfff")
    # Leissa (1973) has ω a² √(ρh/D) = 3.492, 8.525 of a square cantilever with ν = 0.3: of ours, 20.905 rad/s
    expected = np.array([3.492, 8.525]) * 20.905 / (2 * np.pi)
    np.testing.assert_allclose(facts["frequencies_hz"][:2], expected, rtol=6e-3)  # his are Ritz values, some 0.5 % high
    assert "rigid body" in complaint(capsys, "flutter", *SWEPT, "--panel.edges", "sfff")
    assert "panel.edges" in complaint(capsys, "flutter", *SWEPT, "--panel.edges", "sss")


def test_plies_from_a_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "skin.json"
    plies = [{"material": "graphite-epoxy", "angle_deg": angle, "thickness": 0.0004} for angle in (0, 90)]
    path.write_text(json.dumps({"panel": {"thickness": 0.0008, "plies": plies}}))
    facts = answer(capsys, "flutter", str(path), *COARSE, "--reduction.modes", "6")
    assert facts["lambda_cr"] > 0
    plies[1]["material"] = "grafite-epoxy"
    path.write_text(json.dumps({"panel": {"thickness": 0.0008, "plies": plies}}))
    said = complaint(capsys, "flutter", str(path))
    assert "skin.json" in said
    assert "grafite-epoxy" in said
    assert said.index("graphite-epoxy") < said.index("aluminium")  # the likeliest first
    plies[1] = {"material": "graphite-epoxy", "thickness": 0.001}
    path.write_text(json.dumps({"panel": {"thickness": 0.0008, "plies": plies}}))
    assert "panel.thickness" in complaint(capsys, "flutter", str(path))


def test_a_basis_of_the_stream(capsys: pytest.CaptureFixture[str]) -> None:
    few = ["--reduction.basis", "aeroelastic", "--reduction.modes", "8"]
    facts = answer(capsys, "simulate", "seed-840", *few, "--run.duration", "0.45")
    assert len(facts["mode_frequencies_hz"]) == 4  # the symmetric ones
    assert facts["lco_amplitude_over_h"] == pytest.approx(1.027, rel=0.02)  # of 48 plain modes; see test_bases.py
    assert answer(capsys, "flutter", "seed-840", *few)["modes"] == 8
    assert "basis" in complaint(capsys, "flutter", "seed-840", "--reduction.basis", "modal")
