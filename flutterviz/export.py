"""Owns runs as files: NPZ and CSV, which stay readable for good, rerun recordings for replay, GLB for pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flutterviz import colormap
from flutterviz.surface import DisplayGrid, to_trimesh
from solver import Trace, design_to_json
from solver.mesh import Floats

ENDINGS = (".npz", ".csv", ".rrd", ".glb")
EXAGGERATION = 20.0  # of the displacement in pictures
PLAYED_FRAMES = 5e-4  # s of simulated time from picture to picture of a recording: 11 in a cycle of seed flutter


def check_target(path: Path) -> None:
    """Refuse a file that `save_trace` could not write, before a run is spent on it.

    Raises:
        OSError: the ending is none of ours, or the folder is not there.
    """
    if path.suffix not in ENDINGS:
        raise OSError(f"{path}: a run is saved as {', '.join(ENDINGS)}; end the name so")
    if not path.parent.is_dir():
        raise OSError(f"{path}: there is no folder {path.parent}; make it first")


def save_trace(trace: Trace, path: Path) -> None:
    """Write a run, in the form that the file's ending asks for.

    NPZ holds `time` [s], `probe` and `largest` (w/h), `q`, `q_rate`, `volts` [V] and `design` (JSON). CSV has a row a
    sample: time, w/h at the probe, largest |w|/h, voltages, modal amplitudes. RRD is a recording for replay; GLB the
    surface at its largest deflection, drawn 20 times too high.

    Raises:
        OSError: the file cannot be written.
    """
    check_target(path)
    if path.suffix == ".rrd":
        _save_recording(trace, path)
        return
    if path.suffix == ".glb":
        _save_surface(trace, path)
        return
    n = trace.plant.size
    if path.suffix == ".npz":
        with path.open("wb") as file:
            np.savez_compressed(
                file,
                time=trace.times,
                probe=trace.probe,
                largest=trace.largest,
                q=trace.amplitudes,
                q_rate=trace.states[:, n:],
                volts=trace.volts,
                design=np.array(design_to_json(trace.plant.design)),
            )
        return
    names = ["time_s", "probe_w_over_h", "largest_w_over_h"]
    names += [f"volts_{k + 1}" for k in range(trace.volts.shape[1])] + [f"mode_{r + 1}_over_h" for r in range(n)]
    table = np.column_stack([trace.times, trace.probe, trace.largest, trace.volts, trace.modal])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")


def _display(trace: Trace) -> tuple[DisplayGrid, Floats]:
    """The display grid of a run, and the mode shapes (nvx·nvy, n) on it."""
    design, plant = trace.plant.design, trace.plant
    grid = DisplayGrid(design.panel.length, design.panel.width, design.mesh.nx, design.mesh.ny)
    return grid, plant.model.sampled(grid.per_x, grid.per_y).reshape(-1, plant.size)


def _save_surface(trace: Trace, path: Path) -> None:
    grid, shapes = _display(trace)
    w = (shapes @ trace.amplitudes[int(np.argmax(trace.largest))]).reshape(grid.shape)
    to_trimesh(grid, w * grid.scale * EXAGGERATION, w / np.abs(w).max()).export(path)


def _save_recording(trace: Trace, path: Path) -> None:
    from flutterviz.recording import Recording  # late: rerun is slow to import, and few runs are recorded

    design, plant = trace.plant.design, trace.plant
    grid, shapes = _display(trace)
    limit = 1.2 * float(trace.largest.max()) * design.panel.thickness
    with Recording(
        path,
        x=grid.x,
        y=grid.y,
        nx=grid.nx,
        ny=grid.ny,
        voltage_limit=design.control.voltage_limit,
        exaggeration=EXAGGERATION,
    ) as recording:
        recording.design(0.0, design_to_json(design))
        recording.patches(0.0, design.patches.elements)
        recording.event(0.0, "at rest in the first mode")
        if plant.channels:
            recording.event(design.run.control_on, "controller on")
        stride = max(1, round(PLAYED_FRAMES / (trace.times[1] - trace.times[0])))
        for k in range(0, len(trace.times), stride):
            w = (shapes @ trace.amplitudes[k]).reshape(grid.shape)
            recording.frame(float(trace.times[k]), w, colormap.display_rgb(w.ravel() / limit))
        recording.states(trace.times, trace.probe, trace.modal, trace.volts)
        if trace.damping_time is not None:
            recording.event(design.run.control_on + trace.damping_time, f"damped after {trace.damping_time:.4f} s")
