"""Owns the control panel: widgets and keys that turn into commands, and the words and numbers that show the state."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Literal

import viser

from flutterviz import commands as do
from flutterviz.clock import Clock, rate_name
from flutterviz.controltab import ControlTab, held
from flutterviz.finder import Finder, SearchWish
from flutterviz.outlook import Outlook
from flutterviz.searchtab import SearchTab
from flutterviz.session import Session
from flutterviz.status import Status, status_of
from solver import Stream, load_design, preset_names

if TYPE_CHECKING:
    from viser._messages import HotkeyKey  # viser names its keys nowhere else

Wish = Literal["record", "fit colours", "aim"] | tuple[Literal["rate", "exaggeration", "dark", "map"], float]
"""What a user asks of the page rather than of the panel; rate and exaggeration by steps on their ladders,
a map by its place among the criteria from 1 on, 0 being the displacement."""

PRESSURE_END = 2000.0  # of the λ slider; a design beyond it draws it further, for good
PLUCK = (0.35, 0.37, 0.8)  # where the pluck button pushes (x/a, y/b), off every line of symmetry, and how hard [m/s]
TONES = {"calm": "#2f7fd1", "good": "#2e9e5b", "warn": "#c98a00", "bad": "#d0453e"}

HELP = "Click an element to patch it with PZT, press <b>C</b> to switch the controller on."


class Controls:
    """The docked control panel on the right."""

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        clock: Clock,
        legend: str,
        finder: Finder,
        send: Callable[[do.Command | Wish | SearchWish], None],
    ) -> None:
        """Add all widgets; `send` takes what the user does, from any thread."""
        self._send = send
        self._name = ""
        gui = server.gui
        gui.set_panel_label("flutterviz")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(300)
        gui.add_html(f'<div style="font-size:.85em;opacity:.8;padding:2px 6px">{HELP}</div>')
        self._status = gui.add_html("")
        self._engage = gui.add_button("Engage controller (C)", icon=viser.Icon.PLAYER_PLAY, hint=ENGAGE_HINT)
        self._pluck = gui.add_button("Pluck the panel (K)", color="gray", hint="Push it off its lines of symmetry")
        self._legend = gui.add_html(legend)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Panel", viser.Icon.WAVE_SINE):
            self._motion = gui.add_button_group("Motion", MOTIONS, hint="Keys: space, N, R")
            self._pressure = gui.add_slider(
                "λ",
                min=0.0,
                max=max(PRESSURE_END, session.rig.plant.stream.dynamic_pressure),
                step=5.0,
                initial_value=session.rig.plant.stream.dynamic_pressure,
                hint="Nondimensional dynamic pressure λ = 2qa³/(βD) of the stream",
            )
            # Button groups, not dropdowns: a dropdown keeps the focus, and keys then type into it instead of acting.
            self._rate = gui.add_button_group("Time", RATES, hint="Slow motion; auto: about 1.5 s a cycle")
            with gui.add_folder("Patches"):
                self._preset = gui.add_button_group("Preset", preset_names(), hint="Load a design")
                self._edit = gui.add_button_group("Change", EDITS, hint="Keys U and Y undo and redo")
                self._map = gui.add_button_group("Colours", tuple(MAPS), hint=MAP_HINT)
                self._facts = gui.add_html("")
            with gui.add_folder("View and recording", expand_by_default=False):
                self._height = gui.add_button_group("Height", HEIGHTS, hint="Exaggeration of the displacement w")
                self._view = gui.add_button_group("View", VIEWS, hint="Colour scale to the motion; camera to the panel")
                self._dark = gui.add_checkbox("Dark", False, hint="Dark or light page")
                self._record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD, hint="Write a recording (.rrd)")
                self._recording = gui.add_html("")
        with tabs.add_tab("Control", viser.Icon.ADJUSTMENTS):
            self._control = ControlTab(gui, session, send)
        with tabs.add_tab("Search", viser.Icon.SEARCH):
            self._search = SearchTab(gui, finder, send)
        self._connect(gui)
        self.follow(session)

    def _connect(self, gui: viser.GuiApi) -> None:
        """Let every widget and key send what it means. Callbacks are coroutines: these keep their order."""
        send = self._send

        @self._engage.on_click
        async def _(_: object) -> None:
            send(do.Engage())

        @self._pluck.on_click
        async def _(_: object) -> None:
            send(do.Pluck(*PLUCK))

        @self._motion.on_click
        async def _(_: object) -> None:
            send(motion_command(self._motion.value))

        @self._pressure.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:  # None: written by the server, as after an undo
                send(do.SetFlow(float(self._pressure.value)))

        @self._rate.on_click
        async def _(_: object) -> None:
            send(("rate", RATE_STEPS[self._rate.value]))

        @self._height.on_click
        async def _(_: object) -> None:
            send(("exaggeration", HEIGHT_STEPS[self._height.value]))

        @self._preset.on_click
        async def _(_: object) -> None:
            send(do.LoadDesign(load_design(self._preset.value), self._preset.value))

        @self._edit.on_click
        async def _(_: object) -> None:
            send({"Undo": do.Undo(), "Redo": do.Redo(), "Clear": do.ClearPatches()}[self._edit.value])

        @self._map.on_click
        async def _(_: object) -> None:
            send(("map", MAPS[self._map.value]))

        @self._view.on_click
        async def _(_: object) -> None:
            send(VIEW_WISHES[self._view.value])

        @self._dark.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                send(("dark", float(self._dark.value)))

        @self._record.on_click
        async def _(_: object) -> None:
            send("record")

        keys: tuple[tuple[str, HotkeyKey, do.Command], ...] = (
            ("Engage or release the controller", "C", do.Engage()),
            ("Pause or continue", "space", do.Pause()),
            ("Step one picture", "N", do.Step()),
            ("Pluck the panel", "K", do.Pluck(*PLUCK)),
            ("Reset the motion", "R", do.Reset()),
            ("Undo", "U", do.Undo()),
            ("Redo", "Y", do.Redo()),
        )
        for label, key, action in keys:
            self._add_key(gui, label, key, action)

    def _add_key(self, gui: viser.GuiApi, label: str, key: HotkeyKey, action: do.Command) -> None:
        handle = gui.add_command(label, hotkey=key)

        @handle.on_trigger
        async def _(_: object) -> None:
            self._send(action)

    def refresh(
        self,
        session: Session,
        clock: Clock,
        pages: int,
        recording: str | None,
        outlook: Outlook | None,
        finder: Finder,
    ) -> None:
        """Show the state; a widget is written only where it differs, so that a dragged slider is left alone."""
        status = status_of(session)
        _write(self._status, _status_card(status, session, clock, pages, outlook))
        self._control.refresh(session, outlook)
        self._search.refresh(finder, session.design)
        _write(self._facts, _patch_facts(session, self._name))
        engaged = session.engaged
        label = "Release controller (C)" if engaged else "Engage controller (C)"
        if self._engage.label != label:
            self._engage.label = label
            self._engage.color = "red" if engaged else None
            self._engage.icon = viser.Icon.PLAYER_STOP if engaged else viser.Icon.PLAYER_PLAY
        if recording is None:
            self._record.label = "Record"
            _write(self._recording, "")
        else:
            self._record.label = "Stop recording"
            _write(self._recording, f'<div style="{SMALL}">● recording to {escape(recording)}</div>')

    def follow(self, session: Session, dragged: str = "") -> None:
        """Take over a changed design, as after undo or a preset.

        A slider that is being dragged, λ's or that of a field of the controller, is ahead of the design, and is left
        alone: written, it would jump back.
        """
        pressure = Stream.of(session.design).dynamic_pressure
        self._name = next((name for name in preset_names() if load_design(name) == session.design), "as edited")
        self._control.follow(session.design, dragged)
        if dragged != "λ" and self._pressure.value != pressure:
            self._pressure.max = max(self._pressure.max, pressure)
            self._pressure.value = pressure

    def show_legend(self, legend: str) -> None:
        """Put in another legend."""
        _write(self._legend, legend)


ENGAGE_HINT = "Switch the controller on or off: it drives the patches, up to their voltage limit"
MOTIONS = ("Pause", "Step", "Reset")
RATE_STEPS = {"Slower": -1.0, "Auto": 0.0, "Faster": 1.0}
RATES = tuple(RATE_STEPS)
HEIGHT_STEPS = {"Lower": -1.0, "Higher": 1.0}
HEIGHTS = tuple(HEIGHT_STEPS)
MAPS = {"w": 0.0, "NFCG": 1.0, "NKFEG": 2.0, "Force": 3.0, "H2": 4.0, "Growth": 5.0}
MAP_HINT = (
    "What colours the panel: displacement; gain norm of actuators (NFCG) or sensors (NKFEG); force on the growing "
    "motion; H2 cost of one element alone; growth rate by one more patch, uncontrolled"
)
EDITS = ("Undo", "Redo", "Clear")
VIEWS = ("Fit colours", "Show all")
VIEW_WISHES: dict[str, Wish] = {"Fit colours": "fit colours", "Show all": "aim"}
NUMBER = "text-align:right;font-variant-numeric:tabular-nums"
TABLE = "display:grid;grid-template-columns:1fr auto;font-size:.85em;gap:1px 8px;margin-top:4px"
SMALL = "font-size:.8em;opacity:.85;padding:2px 6px"


def motion_command(name: str) -> do.Command:
    """The command behind a button of the motion group."""
    match name:
        case "Pause":
            return do.Pause()
        case "Step":
            return do.Step()
        case _:
            return do.Reset()


def _write(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content


def _status_card(status: Status, session: Session, clock: Clock, pages: int, outlook: Outlook | None) -> str:
    """The status line as a card: word, sentence, numbers. All text of ours is escaped: the page runs scripts in it."""
    colour = TONES[status.tone]
    ratio = f"{status.pressure_ratio:.3f}" if status.pressure_ratio is not None else "no flutter"
    tags = [f"{rate_name(clock.rate)} of real time"]
    if clock.capped:
        tags.append(f"capped at 1/{1 / max(clock.actual, 1e-9):.0f}")
    if clock.aliased(session.period):
        tags.append("aliased")
    if session.paused:
        tags.append("paused")
    if session.stale:
        tags.append("rebuilding")
    tags.append("1 page" if pages == 1 else f"{pages} pages")
    damping = f"{session.damping_time:.4f} s" if session.damping_time is not None else "–"
    driven = bool(session.rig.plant.channels) and session.rig.design.control.kind != "off"
    rows = (
        ("λ / λ_cr", ratio),
        ("stabilises up to", "–" if not driven else held(outlook.hold) if outlook else "…"),
        ("growth rate", f"{status.growth:+.1f} /s"),
        ("damping time", damping),
        ("largest |w| / h", f"{session.amplitude:.4f}"),
        ("time", f"{1e3 * session.time:.1f} ms"),
    )
    cells = "".join(
        f'<span style="opacity:.7">{escape(name)}</span><span style="{NUMBER}">{escape(value)}</span>'
        for name, value in rows
    )
    return (
        f'<div id="flutterviz-status" style="margin:2px 4px;padding:8px 10px;border-left:4px solid {colour};'
        'border-radius:4px;background:rgba(128,136,150,.10)">'
        f'<div style="font-weight:650;font-size:1.05em"><span style="color:{colour}">{status.icon}</span> '
        f"{escape(status.word)}</div>"
        f'<div style="font-size:.85em;opacity:.85;min-height:3em">{escape(status.detail)}</div>'
        f'<div style="{TABLE}">{cells}</div>'
        f'<div style="font-size:.75em;opacity:.65;margin-top:4px">{escape(" · ".join(tags))}</div></div>'
    )


def _patch_facts(session: Session, name: str) -> str:
    plant = session.rig.plant
    count = len(session.design.patches.elements)
    critical = f"{plant.critical[0]:.1f}" if plant.critical else "none"
    groups = len(plant.channels)
    text = f"{name}: {count} patched, {groups} channel{'' if groups == 1 else 's'} · λ_cr {critical}"
    closed = session.rig.loop.growth.real
    if groups and session.rig.refusal is None:
        text += f" · controlled growth {closed:+.1f} /s"
    return f'<div style="{SMALL}">{escape(text)}</div>'
