"""Owns the wiring of the explorer and its loop: the only file that knows session, scene, widgets and recording."""

from __future__ import annotations

import queue
import time
import traceback
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import datetime
from html import escape
from pathlib import Path

import numpy as np
import viser

from flutterviz import colormap, heatmap
from flutterviz import commands as do
from flutterviz.background import Background
from flutterviz.clock import FRAME, Clock, nearest_rate, next_rate
from flutterviz.controls import Controls, Wish
from flutterviz.finder import Finder, SearchWish
from flutterviz.frontplot import FrontPlot
from flutterviz.jobs import Job
from flutterviz.locusplot import LocusPlot
from flutterviz.plots import Plots
from flutterviz.recording import Recording
from flutterviz.rig import Rig, rig_of
from flutterviz.scene import Ray, Scene, picked_element
from flutterviz.session import Rows, Session, dragged
from solver import Design, Mesh, design_to_json
from solver.authority import CRITERIA

PLOT_EVERY = 3  # frames: ten times a second
SURFACE_EVERY = 2  # frames: a recorded surface is a hundred times as large as the row of numbers beside it
TEXT_EVERY = 8  # frames: about four times a second
PLOT_CYCLES = 8  # flutter periods that the plots show at slow motion
PLOT_SECONDS = 12.0  # wall time that the plots show where that is longer


class Explorer:
    """A page on a server, and the loop that feeds it. Callbacks only put into the inbox; the loop owns the session."""

    def __init__(
        self, session: Session, server: viser.ViserServer, record: Path | None = None, job: Job | None = None
    ) -> None:
        """Build the page; placements are searched for by a job.

        Raises:
            OSError: the recording cannot be written.
        """
        self.session = session
        self.server = server
        self.clock = Clock(nearest_rate(session.period))
        self.running = True
        self._inbox: queue.SimpleQueue[do.Command | Wish | Ray | SearchWish] = queue.SimpleQueue()
        self._builder = ThreadPoolExecutor(1, thread_name_prefix="rebuild")
        self._building: Future[Rig] | None = None
        self._background = Background()
        self.finder = Finder(session.design, job or Job())
        self._frame = 0
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
        self.controls = Controls(server, session, self.clock, legend, self.finder, self._inbox.put)
        server.scene.on_click()(self._clicked)
        if record is not None:
            self._start_recording(record)
        self._show()

    # --- callbacks: other threads ------------------------------------------------------------------------------------

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        self._inbox.put(Ray(event.ray_origin, event.ray_direction))

    # --- the loop ----------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Feed the page until `running` is taken away; at most 30 frames a second."""
        due = time.perf_counter()
        while self.running:
            try:
                self.tick()
            except Exception as error:  # a page that stands still and says why serves better than one that is gone
                traceback.print_exc()
                self.session.stop(f"{type(error).__name__}: {' '.join(str(error).split())}; reset to go on")
            due = max(due + FRAME, time.perf_counter() - FRAME)
            time.sleep(max(0.0, due - time.perf_counter()))

    def tick(self) -> None:
        """One turn of the loop: commands, rebuild, motion, picture, recording."""
        self._drain()
        self._rebuild()
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
        """End the recording and the threads beside the loop."""
        self._builder.shutdown(wait=True, cancel_futures=True)
        self._background.close()
        self.finder.close()
        self._stop_recording()

    def _drain(self) -> None:
        while True:
            try:
                wanted = self._inbox.get_nowait()
            except queue.Empty:
                return
            if isinstance(wanted, (str, tuple)):
                self._grant(wanted)
                continue
            if isinstance(wanted, Ray):
                design = self.session.rig.design
                element = picked_element(
                    Mesh.of(design.panel, design.mesh), self.session.rig.grid, self.scene.height, wanted
                )
                if element is None:
                    continue
                wanted = do.TogglePatch(element)
            if isinstance(wanted, SearchWish):
                self.finder.grant(wanted, self.session)
            else:
                self.session.apply(wanted)
            if self.session.design != self._shown_design or isinstance(wanted, do.SetControl):
                self._shown_design = self.session.design
                self.controls.follow(self.session, "" if isinstance(wanted, SearchWish) else dragged(wanted))

    def _grant(self, wish: Wish) -> None:
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
        """Build the wanted design's rig beside the loop and swap it in when ready; the panel moves on meanwhile."""
        session = self.session
        if self._building is not None and self._building.done():
            try:
                session.adopt(self._building.result())
                self.plots.forget_modes()
            except (ValueError, ArithmeticError, MemoryError) as error:  # DesignError, LinAlgError and their like
                session.refuse(f"the change was taken back: {' '.join(str(error).split())}")
                self._shown_design = session.design
                self.controls.follow(session)
            self._building = None
        if session.stale and self._building is None:
            self._building = self._builder.submit(rig_of, session.design, session.rig)

    def _show(self) -> None:
        session, rig = self.session, self.session.rig
        w = rig.displacement(session.state) / rig.thickness
        # patches are drawn as wanted, at once; the model follows within a few frames
        wanted = session.design if session.design.mesh == rig.design.mesh else rig.design
        with self.server.atomic():
            self.scene.rebuild(rig.grid, wanted.patches.elements, self.finder.marks_on(rig.design))
            self.scene.paint(self._background.map)
            self.scene.show(w, rig.thickness)
            if self._frame % PLOT_EVERY == 0:
                span = max(PLOT_CYCLES * session.period, min(PLOT_SECONDS * self.clock.rate, 0.5))
                self.plots.show(session.history, span, rig.design.control.voltage_limit)
            if self._frame % TEXT_EVERY == 0:
                self.scene.keep_framed(self.server.get_clients())
                self.locus.show(rig, self._background.outlook)
                self.front.show(self.finder.found)
                self._show_legend()
                self.controls.refresh(
                    session,
                    self.clock,
                    len(self.server.get_clients()),
                    self._recording_facts(),
                    self._background.outlook,
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
            self._start_recording(Path(datetime.now().strftime("flutterviz-%Y%m%d-%H%M%S.rrd")))
        except OSError as error:
            self.session.note(str(error))

    def _start_recording(self, path: Path) -> None:
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
        return f"{self._record_name}, {Path(self._record_name).stat().st_size / 1e6:.1f} MB"

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


def _round_up(value: float) -> float:
    """The next of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten, for the end of a scale."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-6)))
    return float(next(power * m for m in (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if power * m >= value * 0.999))
