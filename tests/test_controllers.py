"""The controller in a design: what is refused and how that is said, its JSON, and what the full-order model takes."""

import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from panels import COARSE, plant, seed, small

from solver import (
    Control,
    ControlError,
    Design,
    DesignError,
    Loop,
    Reduction,
    design_from_json,
    design_to_json,
    full_run,
    full_seed_protocol,
    law_of,
    load_design,
)

NEW = {"weighting", "diagonal", "observer_weight", "rate_gain", "delay", "sensor_noise", "noise_seed"}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"weighting": "diagonal"}, "control.diagonal = empty: goes with control.weighting = diagonal"),
        ({"diagonal": (1.0,) * 48}, "goes with control.weighting = diagonal, and that with it"),
        (
            {"weighting": "diagonal", "diagonal": (1.0,) * 47},
            "control.diagonal = 47 numbers: reduction.modes = 24 takes 48",
        ),
        ({"weighting": "diagonal", "diagonal": (-1.0,) + (1.0,) * 47}, "control.diagonal[0] = -1.0"),
        ({"weighting": "diagonal", "diagonal": (1.0,) * 47 + (math.nan,)}, "control.diagonal[47] = nan"),
        ({"weighting": "diagonal", "diagonal": (1e13,) * 48}, "control.diagonal[0] = 1"),
        ({"observer_weight": 1.0}, "control.observer_weight = 1.0: must be from 1e3 to 1e15"),
        ({"observer_weight": 1e16}, "control.observer_weight"),
        ({"observer_weight": math.nan}, "control.observer_weight = nan"),
        ({"rate_gain": -1.0}, "control.rate_gain = -1.0: must be from 0 to 1e12 V/A"),
        ({"rate_gain": math.inf}, "control.rate_gain"),
        ({"delay": -1e-3}, "control.delay = -0.001 s: must be 0 or from 1e-05 to 0.01 s"),
        ({"delay": 1e-7}, "control.delay = 1e-07 s"),
        ({"delay": 0.02}, "control.delay = 0.02 s"),
        ({"delay": math.nan}, "control.delay = nan s"),
        ({"sensor_noise": -1e-9}, "control.sensor_noise = -1e-09: must be from 0 to 1"),
        ({"sensor_noise": 2.0}, "control.sensor_noise = 2.0"),
        ({"sensor_noise": math.nan}, "control.sensor_noise = nan"),
        ({"noise_seed": -1}, "control.noise_seed = -1: must be from 0 to 2^32 - 1"),
        ({"noise_seed": 2**32}, "control.noise_seed"),
        ({"state_weight": 1e20}, "control.state_weight / control.effort_weight"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(DesignError) as caught:
        Design(control=Control(**fields))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["pid", "LQR", ""])
def test_an_unknown_kind_is_refused_by_name(kind: str) -> None:
    text = json.dumps({"control": {"kind": kind}})
    with pytest.raises(DesignError, match=r"control\.kind"):
        design_from_json(text)
    with pytest.raises(DesignError, match=r"control\.weighting"):
        design_from_json(json.dumps({"control": {"weighting": kind}}))


@st.composite
def controls(draw: st.DrawFn) -> Control:
    by_hand = draw(st.booleans())
    return Control(
        kind=draw(st.sampled_from(["lqr", "lqg", "rate", "off"])),
        weighting="diagonal" if by_hand else draw(st.sampled_from(["energy", "identity"])),
        diagonal=tuple(draw(st.lists(st.floats(0, 1e12), min_size=8, max_size=8))) if by_hand else (),
        observer_weight=draw(st.floats(1e3, 1e15)),
        rate_gain=draw(st.floats(0, 1e12)),
        delay=draw(st.one_of(st.just(0.0), st.floats(1e-5, 0.01))),
        sensor_noise=draw(st.floats(0, 1)),
        noise_seed=draw(st.integers(0, 2**32 - 1)),
    )


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a busy machine is no failure
@given(controls())
def test_json_round_trip(control: Control) -> None:
    design = Design(control=control, reduction=Reduction("patched", 4))
    text = design_to_json(design)
    assert design_from_json(text) == design
    assert set(json.loads(text)["control"]) >= NEW


def test_files_from_before_still_load() -> None:
    data = json.loads(design_to_json(load_design("seed-840")))
    assert set(data["control"]) == NEW | {"kind", "state_weight", "effort_weight", "voltage_limit"}
    for name in NEW:
        del data["control"][name]
    assert design_from_json(json.dumps(data)) == load_design("seed-840")


def test_weights_by_hand_do_not_follow_into_another_number_of_modes() -> None:
    design = seed(modes=4, weighting="diagonal", diagonal=(1.0,) * 8)
    assert design.with_reduction("patched", 4) == design
    richer = design.with_reduction("patched", 8)
    assert (richer.control.weighting, richer.control.diagonal) == ("energy", ())
    assert design.with_reduction("patched", "all").control.diagonal == ()


@pytest.mark.parametrize("fields", [{"kind": "lqg"}, {"delay": 1e-4}, {"kind": "rate", "sensor_noise": 1e-9}])
def test_the_full_order_model_refuses_a_law_with_a_past(fields: dict[str, Any]) -> None:
    loop = Loop.of(plant(msgspec.structs.replace(COARSE, control=Control(**fields))))
    start = small(loop.plant, 1e-3)
    for run in (
        lambda: full_run(loop, start, 1e-4, 1, engaged=True),
        lambda: full_seed_protocol(loop),
    ):
        with pytest.raises(ControlError, match=r"control\.kind = lqr or rate with control\.delay = 0") as caught:
            run()
        assert "\n" not in str(caught.value)
    assert full_run(loop, start, 1e-4, 1, engaged=False).complete  # without it there is nothing to refuse


@pytest.mark.parametrize("fields", [{}, {"sensor_noise": 1e-9}, {"kind": "rate"}, {"kind": "off", "delay": 1e-3}])
def test_the_full_order_model_takes_what_acts_at_once(fields: dict[str, Any]) -> None:
    loop = Loop.of(plant(msgspec.structs.replace(COARSE, control=Control(**fields))))
    trace = full_run(loop, small(loop.plant, 1e-3), 1e-4, 2, engaged=True)
    assert trace.volts.any() == (loop.law is not None and loop.plant.design.control.kind != "off")


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate", "off"])
def test_without_patches_every_kind_asks_for_nothing(kind: str) -> None:
    bare = plant(
        msgspec.structs.replace(COARSE, control=msgspec.structs.replace(COARSE.control, kind=kind)).with_elements(())
    )
    law = law_of(bare)
    assert law.gain.shape == (0, 2 * bare.size)
    assert law.instant
    _, volts = Loop.of(bare).stretch(small(bare, 0.1), 1e-3, 3, engaged=True)
    assert volts.shape == (3, 0)
