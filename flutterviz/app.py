"""Owns the wiring of the explorer and its loop: the only file that knows session, scene, widgets and recording."""

from __future__ import annotations

import contextlib
import gc
import itertools
import queue
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from datetime import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Literal, ParamSpec

import numpy as np
import viser

from flutterviz import colormap, heatmap
from flutterviz import commands as do
from flutterviz.background import Background
from flutterviz.beside import Beside
from flutterviz.builder import Builder
from flutterviz.clock import FRAME, Clock, nearest_rate, next_rate
from flutterviz.controls import Controls, Wish
from flutterviz.finder import Finder, SearchWish
from flutterviz.frontplot import FrontPlot
from flutterviz.jobs import NICER, Job
from flutterviz.locusplot import LocusPlot
from flutterviz.outlook import Outlook
from flutterviz.plots import Plots
from flutterviz.scene import Ray, Scene, picked_element
from flutterviz.session import Rows, Session
from flutterviz.session import dragged as dragged_by
from solver import Design, Mesh, design_to_json
from solver.authority import CRITERIA

if TYPE_CHECKING:
    from flutterviz.recording import Recording

P = ParamSpec("P")
Wanted = do.Command | Wish | Ray | SearchWish | Literal["built"]
"""What comes into the inbox; of the builder, that a rig is ready."""

PLOT_EVERY = 3  # frames: ten times a second
SURFACE_EVERY = 2  # frames: a recorded surface is a hundred times as large as the row of numbers beside it
TEXT_EVERY = 8  # frames: about four times a second
PLOT_CYCLES = 8  # flutter periods that the plots show at slow motion
PLOT_SECONDS = 12.0  # wall time that the plots show where that is longer


class Explorer:
    """A page on a server, and the loop that feeds it. Callbacks only put into the inbox; the loop owns the session."""

    def __init__(
        self,
        session: Session,
        server: viser.ViserServer,
        record: Path | None = None,
        job: Job | None = None,
        builder: Executor | None = None,
        looker: Executor | None = None,
    ) -> None:
        """Build the page. A script that does must do it under `if __name__ == "__main__"`: other processes import it.

        Args:
            session: what it shows.
            server: where.
            record: a file to record to from the start.
            job: by which placements are searched for.
            builder: by which rigs are built, by default in another process.
            looker: by which outlooks and maps are computed, by default in another process that is nicer.

        Raises:
            OSError: the recording cannot be written.
        """
        self.session = session
        self.server = server
        self.clock = Clock(nearest_rate(session.period))
        self.running = True
        self._inbox: queue.SimpleQueue[Wanted] = queue.SimpleQueue()
        self._builder = Builder(builder or Beside(), lambda: self.ask("built"))
        self._background = Background(looker or Beside(NICER))
        self.finder = Finder(session.design, job or Job())
        self._frame = self._text_due = 0
        self._shown_design = session.design
        self._recording: Recording | None = None
        self._record_name: str | None = None
        self._recorded_design: Design | None = None
        self._theme(dark=False)
        server.gui.set_panel_label("flutterviz")
        self.scene = Scene(server, session.rig, session.design.patches.elements)
        panel = server.gui.add_panel()
        with panel.add_tab("Live plots", viser.Icon.CHART_LINE):
            self.plots = Plots(server, session.design.control.voltage_limit)
        with panel.add_tab("Root locus", viser.Icon.CHART_DOTS):
            self.locus = LocusPlot(server)
        with panel.add_tab("Front", viser.Icon.CHART_DOTS_2):
            self.front = FrontPlot(server)
        panel.dock_left()
        panel.set_width(288)
        legend = self.scene.legend(session.rig.thickness)
        self.controls = Controls(server, session, self.clock, legend, self.finder, self.ask)
        server.scene.on_click()(self._clicked)
        if record is not None:
            self._start_recording(record)
        self._show()

    def ask(self, wanted: Wanted) -> None:
        """Put something into the inbox, from any thread."""
        self._inbox.put(wanted)

    @property
    def outlook(self) -> Outlook | None:
        """What is known beyond this moment of the rig that runs, if it is by now."""
        return self._background.outlook

    # --- callbacks: other threads ------------------------------------------------------------------------------------

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        self.ask(Ray(event.ray_origin, event.ray_direction))

    # --- the loop ----------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Feed the page until `running` is taken away; at most 30 frames a second, and what is asked for at once."""
        with contextlib.suppress(OSError):  # of which the first change will tell
            self._builder.prepare(self.session.design)
        gc.freeze()  # what is there by now lives on; to look through all of it would hold up a picture now and then
        due = time.perf_counter()
        while self.running:
            self._guarded(self.tick)
            due = max(due + FRAME, time.perf_counter() - FRAME)
            while (rest := due - time.perf_counter()) > 0:
                try:
                    wanted = self._inbox.get(timeout=rest)
                except queue.Empty:
                    break
                self._guarded(self._react, wanted)
        gc.unfreeze()

    def _guarded(self, step: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> None:
        try:
            step(*args, **kwargs)
        except Exception as error:  # a page that stands still and says why serves better than one that is gone
            traceback.print_exc()
            self.session.stop(f"{type(error).__name__}: {' '.join(str(error).split())}; reset to go on")

    def tick(self) -> None:
        """One turn of the loop: commands, rebuild, motion, picture, recording."""
        self._react()
        self._background.follow(self.session.rig)
        self.finder.follow(self.session)
        watched = bool(self.server.get_clients()) or self._recording is not None
        if not watched:
            self.clock.due(time.perf_counter())  # nobody looks: time stands still, and is not made up for
            return
        start = time.perf_counter()
        seconds = self.clock.due(start)
        rows = self.session.advance(seconds)
        if rows is not None:
            self.clock.took(seconds, time.perf_counter() - start)
        self._frame += 1
        self._show()
        self._record(rows)

    def close(self) -> None:
        """End the recording and what works beside the loop."""
        with contextlib.ExitStack() as ending:  # all of it, whatever fails; the recording first
            for close in (self.finder.close, self._background.close, self._builder.close, self._stop_recording):
                ending.callback(close)

    def _react(self, first: Wanted | None = None) -> None:
        """Carry out what has come in, and have the rig built that it takes."""
        dragged = None
        for wanted in self._come_in(first):
            told = self._carry_out(wanted)
            dragged = dragged if told is None else told
        self._rebuild()  # before the widgets are written: the other process can begin
        if dragged is not None:
            self.controls.follow(self.session, dragged)

    def _come_in(self, first: Wanted | None) -> Iterator[Wanted]:
        if first is not None:
            yield first
        with contextlib.suppress(queue.Empty):
            while True:
                yield self._inbox.get_nowait()

    def _carry_out(self, wanted: Wanted) -> str | None:
        """Do what is wanted; where it changes the design, tells what is being dragged by it, if anything is."""
        if isinstance(wanted, (str, tuple)):
            self._grant(wanted)
            return None
        if isinstance(wanted, Ray):
            design = self.session.design  # of the wanted one, whichever is drawn: it is what a click changes
            element = picked_element(Mesh.of(design.panel, design.mesh), self.scene.grid, self.scene.height, wanted)
            if element is None:
                return None
            wanted = do.TogglePatch(element)
        if isinstance(wanted, SearchWish):
            self.finder.grant(wanted, self.session)
        else:
            self.session.apply(wanted)
        if self.session.design == self._shown_design and not isinstance(wanted, do.SetControl):
            return None
        self._shown_design = self.session.design
        return "" if isinstance(wanted, SearchWish) else dragged_by(wanted)

    def _grant(self, wish: Wish | Literal["built"]) -> None:
        """Do what concerns the page and not the panel."""
        match wish:
            case ("rate", steps):
                rate = self.clock.rate
                self.clock.rate = next_rate(rate, int(steps)) if steps else nearest_rate(self.session.period)
            case ("dark", on):
                self._theme(dark=bool(on))
            case ("exaggeration", steps):
                self.scene.step_exaggeration(int(steps))
            case "fit colours":
                recent = self.session.history.since(self.session.time - 2 * self.session.period)
                if len(recent):
                    self.scene.limit = _round_up(float(recent.largest.max()))
            case ("map", place):
                self._background.ask(CRITERIA[int(place) - 1] if place else None)
            case "aim":
                for client in self.server.get_clients().values():
                    self.scene.aim(client)
            case "record":
                self._toggle_recording()

    def _rebuild(self) -> None:
        """Swap in the rig that is ready, and have the wanted one built; the panel moves on meanwhile."""
        session, builder = self.session, self._builder
        try:
            built = builder.taken()
            if built is not None:
                session.adopt(built.rig, built.start)
                self.plots.forget_modes()
            if session.stale and not builder.busy:
                builder.begin(session.design, session.rig)
        # DesignError, LinAlgError, and what sparse factors and eigensolvers raise
        except (ValueError, ArithmeticError, MemoryError, OSError, RuntimeError) as error:
            if session.design != builder.design:
                return  # it has been changed since, and may do now
            session.refuse(f"the change was taken back: {' '.join(str(error).split())}")
            self._shown_design = session.design
            self.controls.follow(session)

    def _show(self) -> None:
        session, rig = self.session, self.session.rig
        w = rig.displacement(session.state) / rig.thickness
        # patches are drawn as wanted, at once; the model follows within a few frames
        wanted = session.design if session.design.mesh == rig.design.mesh else rig.design
        with self.server.atomic():
            self.scene.rebuild(rig.grid, wanted.patches.elements, self.finder.marks_on(rig.design))
            self.scene.paint(self._background.map)
            self.scene.show(w, rig.thickness)
            self.scene.surround(rig.design)
            if self._frame % PLOT_EVERY == 0:
                span = max(PLOT_CYCLES * session.period, min(PLOT_SECONDS * self.clock.rate, 0.5))
                self.plots.show(session.history, span, rig.design.control.voltage_limit)
            if self._frame >= self._text_due and not self._builder.completing:
                self._text_due = self._frame + TEXT_EVERY
                self.scene.keep_framed(self.server.get_clients())
                self.locus.show(rig, self.outlook)
                self.front.show(self.finder.found)
                self._show_legend()
                self.controls.refresh(
                    session,
                    self.clock,
                    len(self.server.get_clients()),
                    self._recording_facts(),
                    self.outlook,
                    self.finder,
                )

    def _show_legend(self) -> None:
        """The legend of what the colours mean now."""
        back, scale = self._background, self.scene.legend(self.session.rig.thickness)
        if back.criterion is None:
            self.controls.show_legend(scale)
        elif back.map is not None:
            self.controls.show_legend(heatmap.legend(back.map))
        else:
            said = f"no map: {back.trouble}" if back.trouble else "computing the map …"
            self.controls.show_legend(scale + f'<div style="text-align:center;font-size:.8em">{escape(said)}</div>')

    def _theme(self, dark: bool) -> None:
        self.server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=(47, 127, 209)
        )

    # --- recording ---------------------------------------------------------------------------------------------------

    def _toggle_recording(self) -> None:
        if self._recording is not None:
            self._stop_recording()
            return
        try:
            self._start_recording(_unused(datetime.now().strftime("flutterviz-%Y%m%d-%H%M%S")))
        except OSError as error:
            self.session.note(str(error))

    def _start_recording(self, path: Path) -> None:
        from flutterviz.recording import Recording  # here, because rerun is slow to import, and few record

        session, grid = self.session, self.session.rig.grid
        self._recording = Recording(
            path,
            x=grid.x,
            y=grid.y,
            nx=grid.nx,
            ny=grid.ny,
            voltage_limit=session.design.control.voltage_limit,
            exaggeration=self.scene.exaggeration,
            playback=self.clock.rate,
        )
        self._record_name = str(path)
        self._recorded_design = None
        session.note(f"recording to {path.name}")

    def _stop_recording(self) -> None:
        if self._recording is not None:
            self._recording.close()
        self._recording = self._record_name = None

    def _recording_facts(self) -> str | None:
        if self._record_name is None:
            return None
        try:
            return f"{self._record_name}, {Path(self._record_name).stat().st_size / 1e6:.1f} MB"
        except OSError:  # it was moved or deleted; what is written goes with it
            return f"{self._record_name}, which is no longer there"

    def _record(self, rows: Rows | None) -> None:
        """Pass on what happened and what moved; a disk that fills ends the recording, not the run."""
        events = self.session.take_events()
        for event in events:
            print(f"{1e3 * event.time:9.1f} ms  {event.text}", flush=True)
        if self._recording is None:
            return
        session, rig = self.session, self.session.rig
        try:
            for event in events:
                self._recording.event(event.time, event.text)
            if rig.design != self._recorded_design:
                self._recorded_design = rig.design
                self._recording.design(session.time, design_to_json(rig.design))
                self._recording.patches(session.time, rig.design.patches.elements)
            if rows is not None:
                self._recording.states(rows.times, rows.probe, rows.modal, rows.volts)
            if rows is not None and self._frame % SURFACE_EVERY == 0:
                w = rig.displacement(session.state)
                colours = colormap.display_rgb(w.ravel() / (rig.thickness * self.scene.limit))
                self._recording.frame(session.time, w, colours)
        except (OSError, RuntimeError) as error:
            self._stop_recording()
            session.note(f"recording stopped: {' '.join(str(error).split())}")


def _unused(stem: str) -> Path:
    """A recording's name that no file has yet, in this folder."""
    marks = itertools.chain([""], (f"-{k}" for k in itertools.count(2)))
    return next(path for path in (Path(f"{stem}{mark}.rrd") for mark in marks) if not path.exists())


def _round_up(value: float) -> float:
    """The next of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten, for the end of a scale."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-6)))
    return float(next(power * m for m in (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if power * m >= value * 0.999))
