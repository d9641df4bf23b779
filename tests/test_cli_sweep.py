"""The command sweep, and the pictures that it and flutter draw."""

from pathlib import Path

import pytest
from terminal import BARE, COARSE, answer, complaint

from flutterviz.cli import run


def test_sweep_keeps_its_contract(capsys: pytest.CaptureFixture[str]) -> None:
    found = answer(capsys, "sweep", *BARE, *COARSE, "--over", "flow.dynamic-pressure=500:700:100")
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
    still = [*BARE, *COARSE, "--flow.dynamic-pressure", "100"]
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
    complaint(capsys, "sweep", *BARE, "--over", over)


def test_a_sweep_without_its_field_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--over" in complaint(capsys, "sweep", "seed-bare")


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ending", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_roots_are_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path, ending: str, magic: bytes) -> None:
    path = tmp_path / f"roots.{ending}"
    assert run(["flutter", *BARE, *COARSE, "--plot", str(path)]) == 0
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
        [*BARE, "--over", "flow.dynamic-pressure=500:600:100"],
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
    said = complaint(capsys, command[0], *BARE, *command[1:], "--plot", str(tmp_path / name))
    assert name in said
