"""Owns what a user can do to a running panel, as plain data: callbacks make these, the session carries them out."""

from __future__ import annotations

from dataclasses import dataclass

from solver import Design


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
    """Push the panel at a point, as with a finger: an impulse that gives a velocity there."""

    x: float
    """Downstream position over the length [-]."""
    y: float
    """Spanwise position over the width [-]."""
    velocity: float
    """Velocity given at the point [m/s]."""


Command = TogglePatch | ClearPatches | SetFlow | LoadDesign | Undo | Redo | Engage | Pause | Step | Reset | Pluck
"""Everything that a session carries out."""
