"""The command line on designs of all kinds: loads, flights, edges, plies and bases."""

import json
from pathlib import Path

import numpy as np
import pytest
from terminal import BARE, COARSE, answer, complaint

from flutterviz.cli import run


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
    words = [command, *BARE, *COARSE, "--flow.mach", "1.3", "--run.duration", "0.3", "--json"]
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
    facts = answer(capsys, "flutter", *BARE, *COARSE, "--flow.mach", "2")
    # 2qa³/(βD) of the standard atmosphere at sea level, and ((M² - 2)/(M² - 1))² μ/β: to the digits given
    assert facts["dynamic_pressure"] == pytest.approx(717.24, abs=0.01)
    assert facts["aerodynamic_damping"] == pytest.approx(0.0279409, abs=1e-6)
    assert "above 1" in complaint(capsys, "flutter", *BARE, "--flow.mach", "0.9")
    assert "altitude" in complaint(capsys, "flutter", *BARE, "--flow.mach", "2", "--flow.altitude", "1e6")


@pytest.mark.parametrize(("heat", "buckles"), [("0.5", False), ("2", True)])
def test_heat(capsys: pytest.CaptureFixture[str], heat: str, buckles: bool) -> None:
    panel = [*BARE, "--mesh.nx", "12", "--flow.dynamic-pressure", "50"]
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
    assert run(["flutter", *BARE, *COARSE, "--load.temperature", "2"]) == 0
    out, _ = capsys.readouterr()
    assert "buckles in still air at" in out
    assert "static state" in out


def test_a_plate_clamped_at_its_leading_edge(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "flutter", *BARE, "--mesh.nx", "12", "--panel.edges", "cfff")
    # Leissa (1973) has ω a² √(ρh/D) = 3.492, 8.525 of a square cantilever with ν = 0.3: of ours, 20.905 rad/s
    expected = np.array([3.492, 8.525]) * 20.905 / (2 * np.pi)
    np.testing.assert_allclose(facts["frequencies_hz"][:2], expected, rtol=6e-3)  # his are Ritz values, some 0.5 % high
    assert "rigid body" in complaint(capsys, "flutter", *BARE, "--panel.edges", "sfff")
    assert "panel.edges" in complaint(capsys, "flutter", *BARE, "--panel.edges", "sss")


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
