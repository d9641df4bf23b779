"""The command line: its JSON contract, overrides, files, and what people are told."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from terminal import answer, complaint

import solver.check
from flutterviz.cli import COMMANDS, run
from solver import design_from_json, load_design, preset_names, save_design
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


@pytest.mark.parametrize("command", ["check", "bench"])
def test_one_table_has_one_form(capsys: pytest.CaptureFixture[str], command: str) -> None:
    assert "use one of them" in complaint(capsys, command, "--markdown", "--json")
