"""Owns the rerun recording of a run: a sink of frames, states and events, and the blueprint that lays them out."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self
from uuid import uuid4

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

TIMELINE = "sim_time"
"""Name of the only timeline: simulated time, a duration [s]."""

# How long rows may wait in memory before they are written [s of wall time]: what a killed process loses at most.
_FLUSH_SECONDS = 0.25

_PROBE_COLOR = (76, 155, 232)
_LIMIT_COLOR = (214, 69, 65)
_PATCH_COLOR = (255, 214, 10)
_OUTLINE_COLOR = (150, 150, 150)
_GRID_COLOR = (60, 66, 78)
_FLOW_COLOR = (110, 190, 255)
# The first few modes and channels are told apart by hue, the many that follow are a grey background.
_SERIES_COLORS = (
    (76, 155, 232),
    (255, 159, 64),
    (92, 184, 92),
    (214, 93, 177),
    (150, 117, 222),
    (64, 191, 191),
    (222, 184, 80),
    (232, 120, 110),
)
_REST_COLOR = (110, 110, 110)


class Recording:
    """A rerun file being written; simulated time [s] must not go backwards between calls.

    A process that is killed leaves a file that is readable to within the last second of wall time.

    path: file to write, ending in .rrd; an existing one is replaced.
    x: (nvx,) coordinates of the mesh vertices, downstream [m].
    y: (nvy,) coordinates of the mesh vertices, spanwise [m].
    nx, ny: elements along x and y [-].
    voltage_limit: largest |voltage| of the drive, drawn in the voltage plot [V].
    exaggeration: factor on the displacement in the 3D view [-].
    playback: simulated seconds a second of wall time when the recording is replayed [-].
    """

    def __init__(
        self,
        path: Path,
        *,
        x: NDArray[np.floating],
        y: NDArray[np.floating],
        nx: int,
        ny: int,
        voltage_limit: float,
        exaggeration: float,
        playback: float = 0.01,
    ) -> None:
        """Begin the file; OSError with one line on what to do if it cannot be written."""
        refuse_unwritable(path)
        self._x, self._y, self._ny = np.asarray(x), np.asarray(y), ny
        self._limit = voltage_limit
        self._exaggeration = exaggeration
        # Mesh vertices nearest to the element borders, so that a patch's outline follows the drawn surface.
        self._border_x = np.abs(self._x[:, None] - np.linspace(self._x[0], self._x[-1], nx + 1)).argmin(axis=0)
        self._border_y = np.abs(self._y[:, None] - np.linspace(self._y[0], self._y[-1], ny + 1)).argmin(axis=0)
        self._loops = _stack([])
        # The surface is drawn unlit, its colours being data: lines on it give it shape.
        every = np.arange(self._x.size * self._y.size).reshape(self._x.size, self._y.size)
        self._grid = _stack([*every[self._border_x[:: max(1, nx // 8)]], *every.T[self._border_y]])
        self._series: dict[str, tuple[str, int]] = {}
        nvx, nvy = self._x.size, self._y.size
        self._positions = np.empty((nvx, nvy, 3), np.float32)
        self._positions[..., 0] = self._x[:, None]
        self._positions[..., 1] = self._y

        self._stream = rr.RecordingStream(
            "flutterviz",
            recording_id=uuid4(),
            batcher_config=rr.ChunkBatcherConfig(flush_tick=_FLUSH_SECONDS),
        )
        # Wall-clock timelines would offer a second, jerky order of the same frames.
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.save(path)
        self._stream.send_recording_name(path.stem)
        length, width = float(np.ptp(self._x)), float(np.ptp(self._y))
        self._stream.send_blueprint(_blueprint(length, width, exaggeration, playback))
        self._log_static(length, width)

    def __enter__(self) -> Self:
        """Give the recording itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file, also after an error."""
        self.close()

    def design(self, time: float, text: str) -> None:
        """Show the Design that holds from `time` [s] on; text: its JSON."""
        self._at(time)
        self._stream.log("design", rr.TextDocument(text, media_type="text/plain"))

    def patches(self, time: float, elements: tuple[int, ...]) -> None:
        """Outline the patched elements, ids i·ny + j, in the frames from `time` [s] on."""
        self._loops = _stack([self._loop(*divmod(element, self._ny)) for element in elements])
        if not elements:
            self._at(time)
            self._stream.log("panel/patches", rr.Clear(recursive=False))

    def frame(self, time: float, w: NDArray[np.floating], colors: NDArray[np.uint8]) -> None:
        """Show the deformed panel at `time` [s].

        w: (nvx, nvy) displacement, positive up [m].
        colors: (nvx·nvy, 3) sRGB colour of each vertex, y running fastest [-].
        """
        self._at(time)
        self._positions[..., 2] = self._exaggeration * w
        vertices = self._positions.reshape(-1, 3)
        # rerun keeps colours as 0xRRGGBBAA; packed here, they skip a slow conversion there.
        red, green, blue = colors.astype(np.uint32).T
        packed = (red << 24) | (green << 16) | (blue << 8) | 0xFF
        self._stream.log("panel/surface", rr.Mesh3D.from_fields(vertex_positions=vertices, vertex_colors=packed))
        self._stream.log("panel/grid", rr.LineStrips3D.from_fields(strips=vertices[self._grid]))
        if self._loops.size:
            self._stream.log("panel/patches", rr.LineStrips3D.from_fields(strips=vertices[self._loops]))

    def states(
        self,
        times: NDArray[np.floating],
        probe_over_h: NDArray[np.floating],
        modal_over_h: NDArray[np.floating],
        volts: NDArray[np.floating],
    ) -> None:
        """Add rows to the plots, at any rate; the numbers of modes and channels may change between calls.

        times: (n,) simulated times, increasing [s].
        probe_over_h: (n,) displacement at 0.75 of the length, over the thickness [-].
        modal_over_h: (n, modes) modal amplitudes over the thickness [-].
        volts: (n, channels) control voltages [V].
        """
        if len(times) == 0:
            return
        index = rr.TimeColumn(TIMELINE, duration=np.rint(np.asarray(times) * 1e9).astype("timedelta64[ns]"))
        self._send("probe/w_over_h", index, np.asarray(probe_over_h))
        self._send(self._entity("modes", "mode", modal_over_h.shape[1]), index, modal_over_h)
        self._send(self._entity("voltage", "channel", volts.shape[1]), index, volts)
        for time in (times[0], times[-1]):
            self._at(float(time))
            self._stream.log("voltage/limit", rr.Scalars([self._limit, -self._limit]))

    def event(self, time: float, text: str) -> None:
        """Note in the log what happened at `time` [s]."""
        self._at(time)
        self._stream.log("events", rr.TextLog(text))

    def close(self) -> None:
        """Write what is left and end the file; a second call does nothing."""
        self._stream.disconnect()

    def _at(self, time: float) -> None:
        self._stream.set_time(TIMELINE, duration=time)

    def _send(self, entity: str, index: rr.TimeColumn, values: NDArray[np.floating]) -> None:
        columns = rr.Scalars.columns(scalars=values.ravel())
        if values.ndim == 2:
            if values.shape[1] == 0:
                return
            columns = columns.partition(np.full(values.shape[0], values.shape[1]))
        self._stream.send_columns(entity, [index], columns)

    def _entity(self, group: str, noun: str, width: int) -> str:
        """The entity that takes rows of this width.

        The viewer takes the number of lines of an entity from its first row, so each change of width starts a new one.
        """
        entity, known = self._series.get(group, (f"{group}/0", 0))
        if width not in (0, known):
            entity = f"{group}/{int(entity.split('/')[1]) + 1}"
            self._series[group] = (entity, width)
            colors = [_SERIES_COLORS[k] if k < len(_SERIES_COLORS) else _REST_COLOR for k in range(width)]
            widths = [1.5 if k < len(_SERIES_COLORS) else 0.5 for k in range(width)]
            names = [f"{noun} {k + 1}" for k in range(width)]
            self._stream.log(entity, rr.SeriesLines(colors=colors, names=names, widths=widths), static=True)
        return entity

    def _loop(self, i: int, j: int) -> NDArray[np.intp]:
        """Indices of the vertices around element (i, j), closed."""
        i0, i1 = self._border_x[i], self._border_x[i + 1]
        j0, j1 = self._border_y[j], self._border_y[j + 1]
        along, across = np.arange(i0, i1), np.arange(j0, j1)
        columns = np.concatenate([along, np.full(across.size, i1), i1 - (along - i0), np.full(across.size + 1, i0)])
        rows = np.concatenate([np.full(along.size, j0), across, np.full(along.size, j1), j1 - (across - j0), [j0]])
        return columns * self._y.size + rows

    def _log_static(self, length: float, width: float) -> None:
        """What never changes: topology, the undeformed outline, the flow's direction, names and colours of lines."""
        stream, nvy = self._stream, self._y.size
        corner = (np.arange(self._x.size - 1)[:, None] * nvy + np.arange(nvy - 1)).reshape(-1, 1)
        triangles = np.concatenate([corner + np.array([0, nvy, nvy + 1]), corner + np.array([0, nvy + 1, 1])]).astype(
            np.uint32
        )
        stream.log("panel/surface", rr.Mesh3D.from_fields(triangle_indices=triangles), static=True)
        x0, y0 = float(self._x[0]), float(self._y[0])
        outline = [(x0, y0, 0), (x0 + length, y0, 0), (x0 + length, y0 + width, 0), (x0, y0 + width, 0), (x0, y0, 0)]
        edges = rr.LineStrips3D([outline], colors=_OUTLINE_COLOR, radii=_ui_points(0.7))
        stream.log("panel/undeformed", edges, static=True)
        stream.log(
            "panel/flow",
            rr.Arrows3D(
                origins=[(x0 - 0.28 * length, y0 + 0.5 * width, 0)],
                vectors=[(0.22 * length, 0, 0)],
                radii=0.006 * length,
                colors=_FLOW_COLOR,
                labels=["flow"],
            ),
            static=True,
        )
        for entity, color, radius in (("panel/patches", _PATCH_COLOR, 1.5), ("panel/grid", _GRID_COLOR, 0.4)):
            stream.log(entity, rr.LineStrips3D.from_fields(colors=[color], radii=_ui_points(radius)), static=True)
        probe = rr.SeriesLines(colors=_PROBE_COLOR, names="w/h at 0.75 a", widths=1.5)
        stream.log("probe/w_over_h", probe, static=True)
        limits = rr.SeriesLines(colors=[_LIMIT_COLOR] * 2, names=["+ limit", "- limit"], widths=[1.0] * 2)
        stream.log("voltage/limit", limits, static=True)


def _ui_points(radius: float) -> list[float]:
    return [-radius]  # rerun takes a negative radius for one on the screen, whatever the distance


def _stack(lines: list[NDArray[np.intp]]) -> NDArray[np.intp]:
    """(lines, longest) vertex indices; an array is logged much faster than a list, so short lines rest at their end."""
    longest = max((line.size for line in lines), default=0)
    return np.array([np.pad(line, (0, longest - line.size), mode="edge") for line in lines], np.intp)


def refuse_unwritable(path: Path) -> None:
    """Raise OSError, in one line, if a recording cannot be written to this path."""
    if path.suffix != ".rrd":
        raise OSError(f"cannot record to {path}: rerun opens a file only if its name ends in .rrd; rename it")
    try:
        path.open("ab").close()
    except OSError as error:
        raise type(error)(
            f"cannot record to {path}: {error.strerror}; name a file in a folder that exists and may be written to"
        ) from None


def _blueprint(length: float, width: float, exaggeration: float, playback: float) -> rrb.Blueprint:
    scale = max(length, width)
    panel = rrb.Spatial3DView(
        origin="panel",
        name=f"Panel, displacement x {exaggeration:g}",
        background=rrb.Background(color=(24, 26, 30)),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(0.5 * length - 0.65 * scale, 0.5 * width - 1.0 * scale, 0.7 * scale),
            look_target=(0.42 * length, 0.5 * width, 0.0),
            eye_up=(0, 0, 1),
        ),
    )
    shared, bare = rrb.TimeAxis(link="LinkToGlobal"), rrb.PlotLegend(visible=False)
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="probe", name="w/h at 0.75 a", axis_x=shared, plot_legend=bare),
        rrb.TimeSeriesView(origin="modes", name="Modal amplitudes / h", axis_x=shared, plot_legend=bare),
        rrb.TimeSeriesView(origin="voltage", name="Control voltage [V]", axis_x=shared),
    )
    texts = rrb.Horizontal(
        rrb.TextLogView(origin="events", name="Events", columns=rrb.TextLogColumns(text_log_columns=["Body"])),
        rrb.TextDocumentView(
            origin="design", name="Design", format_options=rrb.archetypes.TextDocumentFormat(monospace=True)
        ),
    )
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(panel, plots, column_shares=[3, 2]), texts, row_shares=[7, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline=TIMELINE, playback_speed=playback, play_state="playing", loop_mode="all"
        ),
    )
