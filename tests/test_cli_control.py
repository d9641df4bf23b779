"""Control on the command line: closed-loop facts, a layout over λ, authority maps, and settings that cannot be."""

import pytest
from terminal import answer, complaint

from flutterviz.cli import run
from solver.authority import CRITERIA

QUICK = ["--reduction.modes", "12", "--run.duration", "0.45"]
COARSE = ["--mesh.nx", "12", "--mesh.ny", "4", "--patches.elements", "5", "6", "9", "10", "--reduction.modes", "8"]


def test_control_gives_the_facts_of_the_closed_loop(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "control", "seed-840", *QUICK)
    assert facts["controller"] == "lqr"
    assert facts["closed_loop_growth_per_s"] < 0 < facts["open_loop_growth_per_s"]
    # the same matrix, taken in blocks
    assert facts["closed_loop_growth_per_s"] == pytest.approx(max(facts["pole_growth_per_s"]), rel=1e-9)
    assert facts["stands_model_error"] is (max(facts["growth_at_lower_per_s"], facts["growth_at_higher_per_s"]) <= 0)
    times = facts["phase_damping_times_s"]
    assert len(times) == 8
    assert facts["robust_damping_time_s"] == max(times)
    assert facts["mean_damping_time_s"] == pytest.approx(sum(times) / 8)
    assert facts["lambda_cr"] < facts["suppresses_up_to"] <= facts["stabilises_up_to"]
    assert facts["control_energy_v2s"] > 0
    assert 0 <= facts["saturated_share"] <= 1
    assert any("antisymmetric about y = b/2" in line for line in facts["warnings"])
    assert facts["rows"] == []


def test_a_layout_is_held_against_a_range_by_one_command(capsys: pytest.CaptureFixture[str]) -> None:
    rows = answer(capsys, "control", "seed-840", *COARSE, "--over", "500:900:200")["rows"]
    assert [row["dynamic_pressure"] for row in rows] == [500, 700, 900]
    assert rows[0]["state"] == "passive"
    assert {row["state"] for row in rows[1:]} <= {"suppressed", "suppressed in part", "not suppressed"}
    for row in rows[1:]:
        assert row["open_loop_growth_per_s"] > 0
        assert (row["robust_damping_time_s"] is None) is (row["state"] == "not suppressed")


def test_the_range_is_summed_up_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["control", "seed-840", *COARSE, "--over", "500:700:200"]) == 0
    out, _ = capsys.readouterr()
    assert "of the 1 λ with a limit cycle" in out
    assert "ends the limit cycle up to λ" in out


def test_control_without_patches_says_what_nothing_drives(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "control", "seed-bare", *QUICK)
    assert facts["robust_damping_time_s"] is None
    assert any(line.startswith("there is no patch, and nothing drives the motion") for line in facts["warnings"])


def test_patches_in_the_middle_far_above_name_what_they_cannot_reach(capsys: pytest.CaptureFixture[str]) -> None:
    middle = ["--patches.elements", *(str(i * 6 + j) for i in (11, 12) for j in (2, 3))]
    facts = answer(capsys, "control", "seed-840", *QUICK, *middle, "--flow.dynamic-pressure", "1500")
    assert facts["robust_damping_time_s"] is None
    assert any("cannot reach the motion growing at" in line for line in facts["warnings"])


@pytest.mark.parametrize("criterion", CRITERIA)
def test_every_criterion_has_a_number_for_every_element(capsys: pytest.CaptureFixture[str], criterion: str) -> None:
    told = answer(capsys, "nfcg", "seed-840", *COARSE, "--criterion", criterion)
    assert told["criterion"] == criterion
    values = told["values"]
    assert len(values) == 48
    assert [e for e, value in enumerate(values) if value is None] == ([5, 6, 9, 10] if criterion == "growth" else [])
    known = [value for value in values if value is not None]
    assert values[told["best"][0]] == pytest.approx((max if told["better"] == "larger" else min)(known))
    assert ("nfcg" in told) is (criterion == "nfcg")
    assert run(["nfcg", "seed-840", *COARSE, "--criterion", criterion]) == 0
    assert told["unit"] in capsys.readouterr()[0]


@pytest.mark.parametrize("criterion", CRITERIA)
def test_patches_that_move_nothing_have_maps_or_one_line(capsys: pytest.CaptureFixture[str], criterion: str) -> None:
    words = ["nfcg", "seed-840", *COARSE, "--patches.d31", "0", "--criterion", criterion]
    told = answer(capsys, *words)
    if criterion != "growth":
        assert all(value in (0, None) for value in told["values"])


def test_a_delay_that_excites_the_panel_holds_at_no_pressure(capsys: pytest.CaptureFixture[str]) -> None:
    facts = answer(capsys, "control", "seed-840", *COARSE, "--control.delay", "1e-3", "--over", "300:300:1")
    assert facts["stabilises_up_to"] == facts["suppresses_up_to"] == 0
    assert any("holds at no λ: already at λ =" in line for line in facts["warnings"])
    assert facts["rows"][0]["state"] == "destabilised"


def test_a_sweep_goes_on_where_a_controller_is_too_fast(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--control.kind", "rate", "--over", "control.rate-gain=0:1e9:1e9"]
    rows = answer(capsys, "sweep", "seed-840", *COARSE, *words)["rows"]
    assert [row["closed_loop_growth_per_s"] is None for row in rows] == [False, True, False]


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate", "off"])
@pytest.mark.parametrize("wiring", ["connected", "element", "single"])
def test_every_controller_on_every_wiring_simulates(capsys: pytest.CaptureFixture[str], kind: str, wiring: str) -> None:
    drive = ["--control.kind", kind, "--patches.channels", wiring, "--control.delay", "1e-4"]
    facts = answer(capsys, "simulate", "seed-840", *COARSE, *drive, "--control.sensor-noise", "1e-12")
    assert facts["diverged"] is False
    assert (facts["peak_voltage_v"] > 0) is (kind != "off")
    assert any("sensor_noise is not used" in line for line in facts["warnings"]) is (kind == "lqr")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["control", "seed-840", "--over", "1200:512:10"], "--over 1200:512:10: use START:STOP:STEP"),
        (["control", "seed-840", "--over", "nonsense"], "as 512:1200:43"),
        (["control", "seed-840", "--over", "500:600:50", "--reduction.modes", "all"], "reduction.modes"),
        (["control", "seed-840", "--over", "100:1e9:1e8"], "flow.dynamic_pressure"),
        (["control", "seed-840", "--over", "-100:100:100"], "flow.dynamic_pressure"),
        (["nfcg", "seed-840", "--criterion", "magic"], "magic"),
        (["simulate", "seed-840", "--control.kind", "pid"], "pid"),
        (["simulate", "seed-840", "--control.delay", "-1"], "control.delay = -1.0 s: must be 0 or from"),
        (["simulate", "seed-840", "--control.delay", "nan"], "control.delay"),
        (["simulate", "seed-840", "--control.delay", "3"], "control.delay"),
        (["simulate", "seed-840", "--control.sensor-noise", "inf"], "control.sensor_noise"),
        (["simulate", "seed-840", "--control.noise-seed", "-1"], "control.noise_seed"),
        (["simulate", "seed-840", "--control.observer-weight", "0"], "control.observer_weight"),
        (["simulate", "seed-840", "--control.rate-gain", "nan"], "control.rate_gain"),
        (["simulate", "seed-840", "--control.weighting", "diagonal"], "control.diagonal"),
        (["simulate", "seed-840", "--control.diagonal", "1", "2"], "goes with control.weighting = diagonal"),
        (
            ["simulate", "seed-840", "--control.weighting", "diagonal", "--control.diagonal", "1", "2"],
            "reduction.modes = 24 takes 48",
        ),
    ],
)
def test_settings_that_cannot_be_are_one_line(capsys: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    assert said in complaint(capsys, *words)


def test_a_controller_too_fast_to_integrate_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "seed-840", *COARSE, "--control.kind", "rate", "--control.rate-gain", "1e12"]
    assert "smaller control.rate_gain" in complaint(capsys, *words, begun=True)


def test_the_full_order_model_refuses_what_it_has_no_place_for(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "seed-840", *COARSE, "--control.kind", "lqg", "--full-order"]
    assert "the full-order model takes controllers that act at once" in complaint(capsys, *words, begun=True)
