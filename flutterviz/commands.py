"""Owns what a user can do to a running panel, as plain data: callbacks make these, the session carries them out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from solver import Design
from solver.parts import Channels


@dataclass(frozen=True)
class TogglePatch:
    """Put a pair of PZT layers on an element, or take them off."""

    element: int
    """Element id."""


@dataclass(frozen=True)
class ClearPatches:
    """Take all patches off."""


@dataclass(frozen=True)
class SetFlow:
    """Set the dynamic pressure."""

    dynamic_pressure: float
    """λ [-]."""


ControlField = Literal[
    "kind",
    "weighting",
    "state_weight",
    "effort_weight",
    "voltage_limit",
    "observer_weight",
    "rate_gain",
    "delay",
    "sensor_noise",
]
"""Fields of the controller that the page offers."""


@dataclass(frozen=True)
class SetControl:
    """Set a field of the controller."""

    field: ControlField
    """Which, as in a design's `control`."""
    value: float | str
    """To what [its own unit]."""


@dataclass(frozen=True)
class SetChannels:
    """Wire the patches anew."""

    channels: Channels
    """Each edge-connected group, each element alone, or all on one voltage."""


@dataclass(frozen=True)
class LoadDesign:
    """Replace the design, as by a preset; the motion carries over where the mesh stays the same."""

    design: Design
    """The new design."""
    name: str
    """What to call it in the events."""


@dataclass(frozen=True)
class Undo:
    """Go back to the design before the last change."""


@dataclass(frozen=True)
class Redo:
    """Go forward again after an undo."""


@dataclass(frozen=True)
class Engage:
    """Switch the controller on or off; None turns it over."""

    on: bool | None = None
    """On, off, or the other of the two."""


@dataclass(frozen=True)
class Pause:
    """Stop or continue the motion; None turns it over."""

    on: bool | None = None
    """Paused, running, or the other of the two."""


@dataclass(frozen=True)
class Step:
    """Pause, and move on by one picture."""


@dataclass(frozen=True)
class Reset:
    """Start over: at rest in the first mode, controller off; simulated time runs on."""


@dataclass(frozen=True)
class Pluck:
    """Push the panel at a point, as with a finger: an impulse that gives a velocity there, or less next to an edge."""

    x: float
    """Downstream position over the length [-]."""
    y: float
    """Spanwise position over the width [-]."""
    velocity: float
    """Velocity given at the point [m/s]."""


Command = (
    TogglePatch
    | ClearPatches
    | SetFlow
    | SetControl
    | SetChannels
    | LoadDesign
    | Undo
    | Redo
    | Engage
    | Pause
    | Step
    | Reset
    | Pluck
)
"""Everything that a session carries out."""
