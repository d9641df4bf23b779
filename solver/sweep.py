"""Owns sweeps: what a design does along one of its parameters, upwards and back, each point from the one before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from solver.aerodynamics import design_at_pressure
from solver.design import Design
from solver.errors import DesignError
from solver.law import Law
from solver.mesh import Floats
from solver.outcome import Outcome, outcome_of
from solver.plant import Plant
from solver.simulate import Loop, loop_if_any, seed_protocol

NUMBERS = {("flow", "mach"), ("reduction", "modes")}  # that may hold something else than a number at present
WHOLE = {("reduction", "modes")}


@dataclass(frozen=True)
class SweepRow:
    """A design at one value of the parameter; every field is plain and goes into JSON as it is."""

    value: float
    """Value of the parameter [its own unit]."""
    direction: Literal["up", "down"]
    """Whether the limit cycle was reached from the value below or above: where they differ, two coexist."""
    dynamic_pressure: float
    """λ [-]."""
    lambda_cr: float | None
    """λ_cr in the modes of the reduction, patches on [-]."""
    passive: bool
    """Whether the patches end the flutter by mass and stiffness alone."""
    growth_per_s: float
    """Growth rate of the flat panel without control [1/s]."""
    frequency_hz: float
    """Frequency of that root [Hz]."""
    closed_loop_growth_per_s: float | None
    """Growth rate with the controller [1/s]; None where none exists."""
    motion: str | None
    """What it settles into: flat, buckled, deflected, limit cycle, periodic, quasi-periodic or chaotic."""
    snap_through: bool
    """Whether, buckled in still air, it goes over from side to side again and again."""
    lco_amplitude_over_h: float | None
    """Peak of w at the 0.75 a point on the limit cycle, over h [-]; None if there is none."""
    lco_frequency_hz: float | None
    """Its frequency [Hz]."""
    lco_converged: bool
    """Whether it is a stable periodic orbit; if not, the figures are those of its last window."""
    floquet: float | None
    """Largest modulus of its Floquet multipliers but the trivial one [-]; None where no periodic orbit was found."""
    damping_time_s: float | None
    """Damping time of the seed protocol [s], in upward rows; None if never, passive or without patches."""


def set_field(design: Design, name: str, value: float) -> Design:
    """The design with one numeric field, named as flow.dynamic_pressure, set to a value.

    Raises:
        DesignError: there is no such field, it holds no number, or the value is out of range.
    """
    part, _, field = name.replace("-", "_").partition(".")
    tree: dict[str, Any] = msgspec.to_builtins(design)
    present = tree[part].get(field, ...) if isinstance(tree.get(part), dict) else ...
    number = (part, field) in NUMBERS or (isinstance(present, (int, float)) and not isinstance(present, bool))
    if not number:
        raise DesignError(f"{name or 'no name'}: a design has no such number; use one as flow.dynamic-pressure")
    _refuse_without_effect(design, part, field)
    if (part, field) == ("flow", "dynamic_pressure"):
        return design_at_pressure(design, float(value))
    whole = float(value).is_integer() and ((part, field) in WHOLE or isinstance(present, int))
    tree[part][field] = int(value) if whole else float(value)
    try:
        return msgspec.convert(tree, Design)
    except msgspec.ValidationError as error:
        said = str(error).partition(" - at `")[0]
        raise DesignError(said if said.startswith(f"{part}.{field}") else f"{name} = {value:g}: {said}") from None


def _refuse_without_effect(design: Design, part: str, field: str) -> None:
    """Refuse a field that the design does not use, or that would change another thing than it says."""
    if part == "flow" and field == "damping" and design.flow.mach is not None:
        raise DesignError("flow.damping: is not used where the flow is given by flow.mach; sweep flow.altitude")
    if part == "flow" and field == "altitude" and design.flow.mach is None:
        raise DesignError("flow.altitude: is not used unless flow.mach is given; give one, as --flow.mach 2")
    if part == "mesh" and design.patches.elements:
        raise DesignError(f"mesh.{field}: the patches would move, which stand on elements; sweep it without patches")


def sweep(design: Design, name: str, values: Sequence[float]) -> Iterator[SweepRow]:
    """What the design does at each value, first upwards from the seed protocol's start, then back down.

    Each limit cycle starts from the one before it, carried over as a motion of the panel, so that where two coexist
    the way up and the way down part. Rows come as they are computed.

    Raises:
        DesignError: the field or a value is not usable.
    """
    return _rows([(value, set_field(design, name, value)) for value in values])


def _rows(points: list[tuple[float, Design]]) -> Iterator[SweepRow]:
    last: tuple[Plant, Floats] | None = None
    for k in range(2 * len(points) - 1):
        rising = k < len(points)
        value, point = points[k] if rising else points[2 * len(points) - 2 - k]
        whole = Plant.of(point)
        plant = whole.symmetric()
        loop = loop_if_any(plant) or Loop.of(plant, Law.idle(plant))
        outcome = outcome_of(loop, _carried(last, plant))
        last = (plant, outcome.cycle.state) if outcome.cycle else None
        yield _row(value, "up" if rising else "down", whole, loop, outcome)


def _row(value: float, direction: Literal["up", "down"], whole: Plant, loop: Loop, outcome: Outcome) -> SweepRow:
    plant, motion, orbit, cycle = loop.plant, outcome.motion, outcome.orbit, outcome.cycle
    controlled = loop_if_any(whole)
    timed = direction == "up" and plant.channels and controlled is not None
    return SweepRow(
        value=value,
        direction=direction,
        dynamic_pressure=plant.stream.dynamic_pressure,
        lambda_cr=whole.critical[0] if whole.critical else None,
        passive=whole.passive,
        growth_per_s=whole.growth.real,
        frequency_hz=whole.growth.imag / (2 * np.pi),
        closed_loop_growth_per_s=controlled.growth.real if controlled else None,
        motion=motion.kind if motion else None,
        snap_through=bool(motion and motion.snap_through),
        lco_amplitude_over_h=cycle.amplitude if cycle else None,
        lco_frequency_hz=cycle.frequency if cycle else None,
        lco_converged=bool(cycle and cycle.converged),
        floquet=float(np.abs(orbit.others[0])) if orbit else None,
        damping_time_s=seed_protocol(loop).damping_time if timed else None,
    )


def _carried(last: tuple[Plant, Floats] | None, plant: Plant) -> Floats | None:
    """The last point's motion in this one's modes; None where there is none, or it was on another mesh."""
    if last is None or last[0].model.plate.space.mesh != plant.model.plate.space.mesh:
        return None
    return plant.model.project(last[0].model, last[1].reshape(2, -1)).ravel()
