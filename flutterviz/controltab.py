"""Owns the Control tab: the controller's kind, weights, limit, wiring, delay and noise, and what it amounts to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from html import escape

import viser

from flutterviz import commands as do
from flutterviz.outlook import Outlook
from flutterviz.session import CHANNEL_WORDS, Session
from solver import Control, Design
from solver.holding import Hold
from solver.parts import Channels

KINDS = {"LQR": "lqr", "LQG": "lqg", "Rate": "rate", "Off": "off"}
KIND_WORDS = {
    "lqr": "LQR: the whole state is known",
    "lqg": "LQG: the state is estimated from the patches' charges",
    "rate": "rate feedback: each channel against its own current",
    "off": "off: nothing is driven",
}
WEIGHTINGS = {"Energy": "energy", "Identity": "identity"}
WEIGHTING_WORDS = {"energy": "Q by energy", "identity": "Q = s·I", "diagonal": "Q by hand"}
CHANNELS: dict[str, Channels] = {"Sets": "connected", "Elements": "element", "One": "single"}
SMALL = "font-size:.8em;opacity:.85;padding:2px 6px"
MILLI = 1e-3


@dataclass(frozen=True)
class Dial:
    """A slider and the field of the controller that it sets."""

    field: do.ControlField
    """The field."""
    label: str
    """What stands before the slider."""
    low: float
    """Its left end [its own scale]."""
    high: float
    """Its right end [its own scale]."""
    step: float
    """Its step [its own scale]."""
    unit: float
    """What a linear slider is multiplied by [the field's unit]; 0 for one that shows the power of ten."""
    kinds: tuple[str, ...]
    """Kinds of controller that use it."""
    hint: str
    """What it is."""

    def value(self, place: float) -> float:
        """The field's value at a place of the slider; the left end of a power that may be none is 0."""
        if self.unit:
            return place * self.unit
        return 0.0 if self.field == "sensor_noise" and place <= self.low else 10.0**place

    def place(self, control: Control) -> float:
        """Where the slider stands for a controller."""
        value = float(getattr(control, self.field))
        place = value / self.unit if self.unit else math.log10(value) if value > 0 else self.low
        return min(max(place, self.low), self.high)


MODEL_BASED, DRIVEN, SENSED = ("lqr", "lqg"), ("lqr", "lqg", "rate"), ("lqg", "rate")
DIALS = (
    Dial("state_weight", "log s", 2.0, 9.0, 0.1, 0.0, MODEL_BASED, "Weight s on the state, a power of ten"),
    Dial("effort_weight", "log R", -2.0, 4.0, 0.1, 0.0, MODEL_BASED, "Weight R on the squared voltage, a power of ten"),
    Dial("observer_weight", "log w/v", 4.0, 10.5, 0.1, 0.0, ("lqg",), "Disturbance over noise that the filter assumes"),
    Dial("rate_gain", "log gain", 2.0, 6.0, 0.1, 0.0, ("rate",), "Voltage a unit current, a power of ten [V/A]"),
    Dial("voltage_limit", "limit [V]", 1.0, 228.6, 1.0, 1.0, DRIVEN, "Largest voltage, up to the coercive field"),
    Dial("delay", "delay [ms]", 0.0, 2.0, 0.02, MILLI, DRIVEN, "From what is asked for to what the drive gives"),
    Dial(
        "sensor_noise", "log noise", -13.0, -5.0, 0.2, 0.0, SENSED, "White noise [C/√Hz; rate: A/√Hz]; left end: none"
    ),
)


class ControlTab:
    """Widgets of the controller, in a tab that the caller has opened."""

    def __init__(self, gui: viser.GuiApi, session: Session, send: Callable[[do.Command], None]) -> None:
        """Add all widgets; `send` takes what the user does, from any thread."""
        self._send = send
        self._chosen = gui.add_html("")
        # Button groups, not dropdowns: a dropdown keeps the focus, and keys then type into it instead of acting.
        self._kind = gui.add_button_group("Controller", tuple(KINDS), hint="LQR, LQG, collocated rate feedback, or off")
        self._weighting = gui.add_button_group("Weights", tuple(WEIGHTINGS), hint="What Q weighs: energy or states")
        self._channels = gui.add_button_group("Channels", tuple(CHANNELS), hint="Which patches share a voltage")
        control = session.design.control
        self._dials = [
            (dial, gui.add_slider(dial.label, dial.low, dial.high, dial.step, dial.place(control), hint=dial.hint))
            for dial in DIALS
        ]
        self._facts = gui.add_html("")
        self._connect()
        self.follow(session.design)

    def _connect(self) -> None:
        send = self._send

        @self._kind.on_click
        async def _(_: object) -> None:
            send(do.SetControl("kind", KINDS[self._kind.value]))

        @self._weighting.on_click
        async def _(_: object) -> None:
            send(do.SetControl("weighting", WEIGHTINGS[self._weighting.value]))

        @self._channels.on_click
        async def _(_: object) -> None:
            send(do.SetChannels(CHANNELS[self._channels.value]))

        for dial, slider in self._dials:
            self._follow_slider(dial, slider)

    def _follow_slider(self, dial: Dial, slider: viser.GuiSliderHandle[float]) -> None:
        @slider.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:  # None: written by the server, as after an undo
                self._send(do.SetControl(dial.field, dial.value(float(slider.value))))

    def follow(self, design: Design, dragged: str = "") -> None:
        """Take over a changed design; a slider that is being dragged is ahead of it, and is left alone."""
        control = design.control
        for dial, slider in self._dials:
            if dial.field == "voltage_limit":
                slider.max = design.patches.ceramic.max_field * design.patches.thickness
                slider.min = min(dial.low, 0.1 * slider.max)
            slider.visible = control.kind in dial.kinds
            place = dial.place(control) if dial.field != "voltage_limit" else control.voltage_limit
            if dragged != dial.field and abs(slider.value - place) > 1e-9:
                slider.value = place
        self._weighting.visible = control.kind in MODEL_BASED

    def refresh(self, session: Session, outlook: Outlook | None) -> None:
        """Show what is chosen, and what it amounts to."""
        for handle, text in ((self._chosen, _chosen(session.design)), (self._facts, _facts(session, outlook))):
            if handle.content != text:
                handle.content = text


def held(hold: Hold | None) -> str:
    """How far in λ a controller stabilises, as a number."""
    if hold is None or not hold.dynamic_pressure:
        return "–" if hold is None else "none"
    return f"λ > {hold.dynamic_pressure:.0f}" if hold.open_ended else f"λ = {hold.dynamic_pressure:.0f}"


def _chosen(design: Design) -> str:
    """The controller in words: the groups of buttons do not show which of them was pressed."""
    control = design.control
    lines = [f"<b>{escape(KIND_WORDS[control.kind])}</b>", escape(CHANNEL_WORDS[design.patches.channels])]
    if control.kind in MODEL_BASED:
        weights = f"s = {control.state_weight:.3g}, R = {control.effort_weight:.3g}"
        lines.append(f"{escape(WEIGHTING_WORDS[control.weighting])}, {weights}")
    if control.kind != "off":
        noise = f"{control.sensor_noise:.2g} /√Hz" if control.sensor_noise and control.kind in SENSED else "none"
        lines.append(f"limit {control.voltage_limit:.4g} V, delay {1e3 * control.delay:.3g} ms, noise {noise}")
    return f'<div id="flutterviz-control" style="{SMALL}">{"<br>".join(lines)}</div>'


def _facts(session: Session, outlook: Outlook | None) -> str:
    rig, lines = session.rig, []
    count = len(rig.plant.channels)
    if not count:
        lines.append("no patch yet: nothing can be driven")
    elif rig.design.control.kind != "off":
        lines.append(f"{count} channel{'' if count == 1 else 's'}, growth under control {rig.loop.growth.real:+.1f} /s")
    if rig.shortfall and count:
        lines.append(f"! {escape(rig.shortfall)}")
    elif outlook is not None and outlook.hold is not None and outlook.hold.reason:
        beyond = f"beyond {held(outlook.hold)}: " if outlook.hold.dynamic_pressure else ""
        lines.append(beyond + escape(outlook.hold.reason))
    return f'<div style="{SMALL};padding-right:14px">{"<br>".join(lines)}</div>'
