"""Owns the session: the one mutable object, a design with undo and a panel in motion; no viewer, no clock, no file."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from flutterviz import commands as do
from flutterviz.history import History
from flutterviz.rig import Rig, in_flutter, rig_of, same_panel
from solver import Control, Design, DesignError, Memory, Stream
from solver.aerodynamics import design_at_pressure
from solver.simulate import SAMPLES_A_PERIOD, first_mode_at_rest

Floats = NDArray[np.floating]

DRAG = 45  # pictures (a second and a half) within which the next change of a slider is one more of the same drag
LONG = 60  # flutter periods after which a controller at its limit counts as not suppressing the flutter
JUDGED_PERIODS = 8  # of motion that a session begins with in its history
CHANNEL_WORDS = {
    "connected": "each connected set of patches on one voltage",
    "element": "each element on a voltage of its own",
    "single": "all patches on one voltage",
}
ELSEWHERE = 4.0  # times a pluck's velocity, at most, another point gets: an edge moves only with the rest of the panel
DIVERGED = 50.0  # largest |w|/h at which a run is stopped: far beyond what plate theory means anything for


@dataclass(frozen=True)
class Event:
    """Something that happened, for the log and the recording."""

    time: float
    """Simulated time [s]."""
    text: str
    """What happened, in words."""


@dataclass(frozen=True)
class Rows:
    """What a stretch of motion adds to plots and recordings."""

    times: Floats
    """(rows,) simulated time [s]."""
    probe: Floats
    """(rows,) w at the 0.75 a point over h [-]."""
    modal: Floats
    """(rows, n) modal deflections over h [-]."""
    volts: Floats
    """(rows, channels) voltages [V]."""


class Session:
    """A design that can be changed and undone, and the panel that moves by it.

    `design` is what the user wants; `rig` is what runs. They differ while a rig is being built, which a caller may do
    elsewhere: `stale` tells, `adopt` swaps the new rig in and carries the motion over. `settle` does both at once.
    """

    def __init__(self, design: Design, rig: Rig | None = None) -> None:
        """Begin in full flutter, controller off.

        Raises:
            DesignError: the design cannot be simulated.
        """
        self.design = design
        self.rig = rig or rig_of(design)
        self.time = 0.0
        self.state = in_flutter(self.rig)
        self.volts = np.zeros(len(self.rig.plant.channels))
        self.engaged = False
        self.paused = False
        self.error: str | None = None
        self.engaged_at = 0.0
        self.damping_time: float | None = None
        self.history = History(self.rig.plant.size)
        self._last_loud = 0.0
        self._past: list[Design] = []
        self._future: list[Design] = []
        self._events: list[Event] = []
        self._steps = 0
        self.memory = Memory.blank(self.rig.loop.law)
        self._drag = ""  # what is being dragged: λ, or a field of the controller
        self._since_drag = 0  # calls of `advance` since it was last set: few, while a slider is dragged
        self.disturbed_by = "switching on"
        if self.rig.plant.flutters:  # a past to judge the motion by, before time zero
            lead = JUDGED_PERIODS * self.period
            self.time = -lead
            self.advance(lead)
            self.time = 0.0

    # --- what a user does -------------------------------------------------------------------------------------------

    def apply(self, command: do.Command) -> None:
        """Carry out a command; one that makes no sense now is told as an event and changes nothing."""
        if self._drag and self._drag != dragged(command):
            self._end_drag()
        try:
            self._carry_out(command)
        except (DesignError, msgspec.ValidationError) as error:
            self.note(str(error))

    def _carry_out(self, command: do.Command) -> None:
        match command:
            case do.TogglePatch(element):
                self._toggle(element)
            case do.ClearPatches():
                self._change(self.design.with_elements(()), "all patches taken off")
            case do.SetFlow(value):
                self._set_flow(value)
            case do.SetControl(field, value):
                self._set_control(field, value)
            case do.SetChannels(channels):
                patches = msgspec.structs.replace(self.design.patches, channels=channels)
                changed = msgspec.structs.replace(self.design, patches=patches)
                self._change(changed, f"channels: {CHANNEL_WORDS[channels]}")
            case do.LoadDesign(design, name):
                self._change(design, f"{name} loaded")
            case do.Undo():
                self._travel(self._past, self._future, "undo")
            case do.Redo():
                self._travel(self._future, self._past, "redo")
            case do.Engage(on):
                self._engage(not self.engaged if on is None else on)
            case do.Pause(on):
                self.paused = not self.paused if on is None else on
                self._steps = 0
                if not self.paused:
                    self.error = None
            case do.Step():
                self.paused = True
                self._steps += 1
            case do.Reset():
                self._reset()
            case do.Pluck(x, y, velocity):
                self._pluck(x, y, velocity)

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to take back."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether there is an undone change to make again."""
        return bool(self._future)

    def take_events(self) -> list[Event]:
        """What has happened since the last call."""
        events, self._events = self._events, []
        return events

    def note(self, text: str) -> None:
        """Add an event at the present simulated time."""
        self._events.append(Event(self.time, text))

    def _toggle(self, element: int) -> None:
        count = self.design.mesh.nx * self.design.mesh.ny
        if not 0 <= element < count:
            self.note(f"there is no element {element}: the mesh has 0 to {count - 1}")
            return
        on = element not in self.design.patches.elements
        i, j = divmod(element, self.design.mesh.ny)
        changed = set(self.design.patches.elements) ^ {element}
        text = f"element {element} (i = {i}, j = {j}) {'patched' if on else 'bare'}"
        self._change(self.design.with_elements(tuple(changed)), text)

    def _set_flow(self, pressure: float) -> None:
        """Change λ; the many changes of a slider that is dragged undo as one."""
        self._dragged_to(design_at_pressure(self.design, pressure), "λ")

    def _set_control(self, field: do.ControlField, value: float | str) -> None:
        """Change a field of the controller; weights by hand are left behind for those that Q is given by."""
        changes: dict[str, object] = {field: value}
        if field == "weighting":
            changes["diagonal"] = ()
        control = msgspec.convert(msgspec.to_builtins(self.design.control) | changes, Control)
        design = self.design.with_control(control)
        if isinstance(value, str):
            self._change(design, f"control.{field}: {value}")
        else:
            self._dragged_to(design, field)

    def _dragged_to(self, design: Design, what: str) -> None:
        """Make a design the wanted one, as the next step of a drag if it is one; told when the drag has ended."""
        if self._drag == what and self._past and not self._future:
            self.design = self._past.pop()
        self._drag = ""
        if design != self.design:
            self._drag, self._since_drag = what, 0
            self._change(design, None)

    def _end_drag(self) -> None:
        control, what = self.design.control, self._drag
        value = Stream.of(self.design).dynamic_pressure if what == "λ" else getattr(control, what)
        self._drag = ""
        self.note(f"{what if what == 'λ' else f'control.{what}'} set to {value:g}")

    def _change(self, design: Design, text: str | None) -> None:
        """Make a new design the wanted one, and the present one what undo goes back to."""
        if design == self.design:
            return
        self._past.append(self.design)
        self._future.clear()
        self.design = design
        if text is not None:
            self.note(text)

    def _travel(self, source: list[Design], target: list[Design], word: str) -> None:
        if not source:
            self.note(f"nothing to {word}")
            return
        target.append(self.design)
        self.design = source.pop()
        self.note(word)

    def _engage(self, on: bool) -> None:
        if on == self.engaged:
            return
        self.engaged = on
        self._measure_anew("switching on")
        self.note("controller on" if on else "controller off")
        if on and self.rig.refusal:
            self.note(self.rig.refusal)

    def _reset(self) -> None:
        self.state = first_mode_at_rest(self.rig.plant, self.design.run.initial_amplitude * self.rig.thickness)
        self.volts = np.zeros_like(self.volts)
        self.memory = Memory.blank(self.rig.loop.law)
        self.engaged = self.paused = False
        self.error = None
        self.damping_time = None
        self._steps = 0
        self.history.clear()
        self.note("reset: at rest in the first mode, controller off")

    def _pluck(self, x: float, y: float, velocity: float) -> None:
        if not (0 < x < 1 and 0 < y < 1 and np.isfinite(velocity)):
            self.note("a pluck must be inside the panel")
            return
        panel = self.design.panel
        shape = self.rig.plant.model.at(x * panel.length, y * panel.width)
        n = self.rig.plant.size
        push = shape / max(float(np.abs(shape).max()), 1e-300)  # a square of what is next to an edge would underflow
        here, elsewhere = float(shape @ push), float(np.abs(self.rig.coarse @ push).max())
        self.state = self.state.copy()
        self.state[n:] += push * (velocity / max(here, elsewhere / ELSEWHERE, 1e-300))
        self._measure_anew("the pluck")
        self.note(f"plucked at x = {x:.2f} a, y = {y:.2f} b")

    def _measure_anew(self, disturbed_by: str) -> None:
        """Count the damping time from here: it belongs to one layout, one flow and one disturbance."""
        self.engaged_at = self._last_loud = self.time
        self.damping_time = None
        self.disturbed_by = disturbed_by

    # --- the rig ----------------------------------------------------------------------------------------------------

    @property
    def stale(self) -> bool:
        """Whether the rig was built for another design than the one wanted now."""
        return self.rig.design != self.design

    def adopt(self, rig: Rig, start: Floats | None = None) -> None:
        """Swap in a rig; the motion carries over as its mass-weighted projection on the new modes.

        On another mesh or panel there is nothing to project on, and the panel starts in flutter anew: at `start`, the
        state (2n,) that `in_flutter` gives, which takes some time to compute.
        """
        old = self.rig
        if same_panel(rig.design, old.design):
            if old.plant.model is not rig.plant.model:
                halves = self.state.reshape(2, -1)
                self.state = rig.plant.model.project(old.plant.model, halves).ravel()
            if rig.plant.size != old.plant.size:
                self.history = History(rig.plant.size)
        else:
            self.state = in_flutter(rig) if start is None else start
            self.history = History(rig.plant.size)
        if self.engaged and rig.refusal:
            self.note(rig.refusal)
        if rig.design != old.design:
            self._measure_anew("the change")
        if old.plant.model is not rig.plant.model or not self.memory.fits(rig.loop.law):
            self.memory = Memory.blank(rig.loop.law)
        self.volts = np.zeros(len(rig.plant.channels))
        self.rig = rig

    def settle(self) -> None:
        """Build and adopt the rig of the wanted design, if it is another; a design that cannot run is taken back."""
        if not self.stale:
            return
        try:
            self.adopt(rig_of(self.design, self.rig))
        except DesignError as error:
            self.refuse(str(error))

    def refuse(self, reason: str) -> None:
        """Go back to the design that runs, because the wanted one cannot."""
        self._drag = ""  # what a slider brings next is a change of its own
        self.design = self.rig.design
        while self._past and self._past[-1] == self.design:
            self._past.pop()
        self.note(reason)

    # --- motion -----------------------------------------------------------------------------------------------------

    def advance(self, seconds: float) -> Rows | None:
        """Move on by a stretch of simulated time; gives what it adds to the plots, or None if time stands still."""
        self._since_drag += 1
        if self._drag and self._since_drag >= DRAG:
            self._end_drag()
        if self.paused:
            if not self._steps or self.error:
                self._steps = 0
                return None
            self._steps -= 1
        if not seconds > 0:
            return None
        samples = max(1, round(seconds * SAMPLES_A_PERIOD / self.period))
        sample = seconds / samples
        states, volts, memory = self.rig.loop.advance(self.state, self.memory, sample, samples, self.engaged)
        rig, h, n = self.rig, self.rig.thickness, self.rig.plant.size
        q = states[:, :n]
        largest = np.abs(q @ rig.coarse.T).max(axis=1) / h if len(q) else np.empty(0)
        if len(states) < samples or largest[-1] > DIVERGED:
            self.stop("the motion diverged and was stopped; lower λ or release the controller, then reset")
            return None
        times = self.time + sample * np.arange(1, samples + 1)
        rows = Rows(times, q @ rig.probe / h, q * rig.plant.model.peak / h, volts)
        self.state, self.time, self.volts, self.memory = states[-1].copy(), float(times[-1]), volts[-1].copy(), memory
        self.history.append(times, rows.probe, largest, volts, rows.modal)
        self._watch(times, largest)
        return rows

    def stop(self, reason: str) -> None:
        """Pause because of an error, which is shown until the motion is continued or reset."""
        self.paused = True
        self.error = reason
        self.note(reason)

    def _watch(self, times: Floats, largest: Floats) -> None:
        """Follow the time at which the panel was last loud, and settle the damping time once it has been quiet."""
        loud = np.flatnonzero(largest >= self.design.run.settled)
        if len(loud):
            self._last_loud = float(times[loud[-1]])
            self.damping_time = None
            return
        measured = self.damping_time is not None or self._last_loud <= self.engaged_at
        by_control = self.engaged and bool(self.rig.plant.channels) and not self.rig.plant.passive
        if by_control and not measured and self.time - self._last_loud > self.period:
            self.damping_time = self._last_loud - self.engaged_at
            self.note(f"damped {self.damping_time:.4f} s after {self.disturbed_by}")

    @property
    def period(self) -> float:
        """Period of the flat panel's leading root [s]: the time scale of its flutter."""
        return self.rig.plant.period

    @property
    def amplitude(self) -> float:
        """Largest |w| on the panel in the last flutter period, over h [-]."""
        recent = self.history.since(self.time - self.period).largest
        now = np.abs(self.rig.coarse @ self.state[: self.rig.plant.size]).max() / self.rig.thickness
        return float(max(recent.max(initial=0.0), now))

    @property
    def outlasts(self) -> bool:
        """Whether flutter has gone on for long although the controller is at work and makes small motions stable."""
        return self.engaged and self.time - self.engaged_at > LONG * self.period and self.damping_time is None


def dragged(command: do.Command) -> str:
    """What a command that a slider sends is dragging: λ, or a field of the controller; empty for other commands."""
    match command:
        case do.SetFlow():
            return "λ"
        case do.SetControl(field):
            return field
        case _:
            return ""
