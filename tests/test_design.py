"""The Design and its JSON: what is written is read back, and what cannot be is refused in one line that names it."""

import contextlib
import json
import math
from pathlib import Path
from typing import Any, Literal, get_args

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from solver import (
    Control,
    Design,
    DesignError,
    Flow,
    MeshSize,
    Panel,
    Patches,
    Reduction,
    Run,
    design_from_json,
    design_to_json,
    load_design,
    preset_names,
    save_design,
)
from solver.design import SCHEMA_VERSION


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


def counts() -> st.SearchStrategy[int | Literal["all"]]:
    return st.one_of(st.integers(2, 120), st.sampled_from(get_args(Literal["all"])))


@st.composite
def designs(draw: st.DrawFn) -> Design:
    nx, ny = draw(st.integers(2, 40)), draw(st.integers(2, 40))
    thickness, duration, layer = draw(between(1e-4, 5e-3)), draw(between(0.01, 5)), draw(between(1e-5, 1e-3))
    return Design(
        panel=Panel(
            length=draw(between(0.1, 2)),
            width=draw(between(0.1, 2)),
            thickness=thickness,
            edges=draw(st.text("sc", min_size=4, max_size=4)),
            young=draw(between(1e9, 4e11)),
            poisson=draw(between(-0.5, 0.49)),
            density=draw(between(500, 2e4)),
        ),
        mesh=MeshSize(nx, ny),
        flow=Flow(draw(between(0, 5000)), draw(between(0, 1)), draw(between(-360, 360))),
        patches=Patches(
            elements=tuple(draw(st.lists(st.integers(0, nx * ny - 1), max_size=10))),
            channels=draw(st.sampled_from(["connected", "element", "single"])),
            thickness=layer,
            d31=draw(between(-1e-9, 1e-9)),
        ),
        control=Control(
            kind=draw(st.sampled_from(["lqr", "off"])),
            state_weight=draw(between(1, 1e9)),
            effort_weight=draw(between(1e-3, 1e3)),
            voltage_limit=draw(between(0.01, 1)) * layer * 600e3,
        ),
        reduction=Reduction(draw(st.sampled_from(["patched", "family"])), draw(counts())),
        run=Run(draw(between(0.001, 10)), draw(between(0, 1)) * duration, duration, draw(between(1e-6, 0.1))),
    )


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # a busy machine is no failure
@given(designs())
def test_json_round_trip(design: Design) -> None:
    text = design_to_json(design)
    assert design_from_json(text) == design
    assert design_to_json(design_from_json(text)) == text
    assert json.loads(text)["schema_version"] == SCHEMA_VERSION


def test_elements_are_sorted_and_single() -> None:
    assert Patches(elements=(5, 3, 5)).elements == (3, 5)
    assert Design().with_elements((9, 1)).patches.elements == (1, 9)


def test_absent_fields_take_their_defaults() -> None:
    assert design_from_json("{}") == Design()
    assert design_from_json('{"flow": {"dynamic_pressure": 900}}') == Design(flow=Flow(900.0))


def changed(path: str, value: Any) -> str:  # noqa: ANN401 - wrong types are what this is for
    data = json.loads(design_to_json(load_design("seed-840")))
    *parents, last = path.split(".")
    part = data
    for name in parents:
        part = part[name]
    part[last] = value
    return json.dumps(data)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("panel.thickness", -0.001, "panel.thickness"),
        ("panel.thickness", 0.1, "panel.thickness"),
        ("panel.length", 0, "panel.length"),
        ("panel.young", 1e300, "panel.young"),
        ("panel.poisson", 0.5, "panel.poisson"),
        ("panel.edges", "sfff", "panel.edges"),
        ("panel.edges", "sss", "panel.edges"),
        ("panel.colour", "red", "colour"),
        ("wings", 2, "wings"),
        ("mesh.nx", 1, "mesh.nx"),
        ("mesh.nx", 24.5, "mesh.nx"),
        ("mesh.ny", 100000, "mesh.ny"),
        ("flow.dynamic_pressure", -1, "flow.dynamic_pressure"),
        ("flow.dynamic_pressure", "fast", "flow.dynamic_pressure"),
        ("flow.damping", -0.1, "flow.damping"),
        ("flow.yaw_deg", 1000, "flow.yaw_deg"),
        ("patches.elements", [144], "patches.elements"),
        ("patches.elements", [-1], "patches.elements"),
        ("patches.elements", ["a"], "patches.elements"),
        ("patches.channels", "some", "patches.channels"),
        ("patches.thickness", -1e-4, "patches.thickness"),
        ("control.kind", "magic", "control.kind"),
        ("control.effort_weight", 0, "control.effort_weight"),
        ("control.voltage_limit", 500, "control.voltage_limit"),
        ("reduction.modes", 1, "reduction.modes"),
        ("reduction.modes", "every", "reduction.modes"),
        ("reduction.basis", "bare", "reduction.basis"),
        ("run.control_on", 2.0, "run.control_on"),
        ("run.duration", 1e9, "run.duration"),
        ("schema_version", 99, "schema_version"),
        ("panel", None, "panel"),
    ],
)
def test_what_cannot_be_is_refused_by_name(path: str, value: Any, named: str) -> None:  # noqa: ANN401 - any wrong type
    with pytest.raises(DesignError) as caught:
        design_from_json(changed(path, value), "mine.json")
    message = str(caught.value)
    assert named in message
    assert "\n" not in message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("part", "field"),
    [
        (Panel, "panel.length"),
        (Panel, "panel.poisson"),
        (Flow, "flow.dynamic_pressure"),
        (Flow, "flow.damping"),
        (Flow, "flow.yaw_deg"),
        (Patches, "patches.d31"),
        (Control, "control.state_weight"),
        (Run, "run.duration"),
        (Run, "run.control_on"),
    ],
)
def test_numbers_that_are_none_are_refused(part: type, field: str, value: float) -> None:
    with pytest.raises(DesignError, match=field.replace(".", r"\.")) as caught:
        Design(**{field.split(".")[0]: part(**{field.split(".")[1]: value})})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    ["", "{", '{"panel": {"length": 0.3', "[]", "null", "\x00", b"\xff\xfe", '{"panel": {"length": NaN}}', "}" * 9],
)
def test_what_is_no_design_is_refused_with_its_source(text: str | bytes) -> None:
    with pytest.raises(DesignError, match=r"^mine\.json: ") as caught:
        design_from_json(text, "mine.json")
    assert "\n" not in str(caught.value)


@settings(deadline=None)
@given(st.integers(0, 900))
def test_every_truncation_is_refused(length: int) -> None:
    text = design_to_json(load_design("seed-840")).rstrip()
    with pytest.raises(DesignError):
        design_from_json(text[: min(length, len(text) - 1)])


@settings(deadline=None)
@given(st.binary(max_size=60))
def test_no_bytes_raise_anything_else(data: bytes) -> None:
    with contextlib.suppress(DesignError):
        design_from_json(data)


def test_presets_load() -> None:
    assert {"seed-bare", "seed-840", "seed-1200"} <= set(preset_names())
    expected = {
        "seed-bare": (840.0, ()),
        "seed-840": (840.0, tuple(i * 6 + j for i in (3, 4, 5) for j in (2, 3))),
        "seed-1200": (1200.0, tuple(i * 6 + j for i in (2, 3, 4, 5, 6) for j in (2, 3))),
    }
    for name, (pressure, elements) in expected.items():
        design = load_design(name)
        assert design.flow == Flow(pressure, 0.01, 0.0)
        assert design.patches.elements == elements
        assert design.reduction == Reduction()
        assert design.schema_version == SCHEMA_VERSION


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    design = load_design("seed-1200").with_dynamic_pressure(777.0)
    save_design(design, path)
    assert load_design(str(path)) == design
    assert [found.name for found in tmp_path.iterdir()] == ["mine.json"]  # no draft is left behind
    with pytest.raises(DesignError, match=r"no such preset or file; presets are .*seed-840"):
        load_design(str(tmp_path / "none.json"))
    with pytest.raises(DesignError, match="cannot be read"):
        load_design(str(tmp_path))
