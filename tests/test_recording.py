"""The recording: what is written is read back, also after a kill; a file that cannot be written is refused."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from flutterviz.recording import TIMELINE, Recording

NVX, NVY, NX, NY = 25, 13, 6, 3


def open_recording(path: Path) -> Recording:
    x, y = np.linspace(0, 0.3, NVX), np.linspace(0, 0.2, NVY)
    return Recording(path, x=x, y=y, nx=NX, ny=NY, voltage_limit=228.6, exaggeration=20)


def write_states(recording: Recording, start: float, rows: int, modes: int, channels: int) -> np.ndarray:
    times = start + 1e-3 * np.arange(1, rows + 1)
    modal, volts = np.outer(times, np.arange(1, modes + 1)), np.outer(100 * times, np.ones(channels))
    recording.states(times, np.sin(times), modal, volts)
    return times


def read(path: Path) -> tuple[dict[str, int], dict[str, float], dict[str, list[np.ndarray]]]:
    """Rows, last time [s] and scalar rows of every entity."""
    rows: dict[str, int] = defaultdict(int)
    last: dict[str, float] = {}
    scalars: dict[str, list[np.ndarray]] = defaultdict(list)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a killed run has no footer, and rerun says so
        chunks = list(RrdReader(path).stream())
    for chunk in chunks:
        rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
        batch = chunk.to_record_batch()
        if not chunk.is_static:
            assert chunk.timeline_names == [TIMELINE]
            time = batch.column(TIMELINE).cast("int64").to_numpy().max() * 1e-9
            last[chunk.entity_path] = max(time, last.get(chunk.entity_path, 0.0))
        if "Scalars:scalars" in batch.schema.names:
            scalars[chunk.entity_path] += [np.array(row) for row in batch.column("Scalars:scalars").to_pylist()]
    return dict(rows), last, dict(scalars)


def test_everything_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    with open_recording(path) as recording:
        recording.design(0.0, '{"schema": 1}')
        recording.patches(0.0, (4, 7))
        recording.event(0.0, "started")
        for k in range(10):
            times = write_states(recording, 0.05 * k, 50, modes=12, channels=2)
            recording.frame(times[-1], np.full((NVX, NVY), 1e-3), np.zeros((NVX * NVY, 3), np.uint8))
        recording.event(0.5, "controller on")
        recording.design(0.5, '{"schema": 2}')
    rows, last, scalars = read(path)
    assert rows["/probe/w_over_h"] == rows["/modes/1"] == rows["/voltage/1"] == 500
    assert rows["/panel/surface"] == rows["/panel/patches"] == 10
    assert rows["/events"] == rows["/design"] == 2
    assert last["/probe/w_over_h"] == last["/panel/surface"] == pytest.approx(0.5, abs=1e-9)  # whole nanoseconds
    times = 1e-3 * np.arange(1, 501)
    np.testing.assert_allclose(np.ravel(scalars["/probe/w_over_h"]), np.sin(times), rtol=1e-12)  # stored as float64
    np.testing.assert_allclose(np.stack(scalars["/modes/1"])[:, 11], 12 * times, rtol=1e-12)
    np.testing.assert_array_equal(scalars["/voltage/limit"][0], [228.6, -228.6])
    assert RrdReader(path).blueprints()


def test_surface_and_outlines_follow_the_displacement(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    w = 1e-3 * np.arange(NVX * NVY).reshape(NVX, NVY)
    colors = np.tile(np.array([1, 2, 3], np.uint8), (NVX * NVY, 1))
    with open_recording(path) as recording:
        recording.patches(0.0, (4,))
        recording.frame(0.0, w, colors)
        recording.patches(0.1, ())
    found: dict[str, list[Any]] = defaultdict(list)
    for chunk in RrdReader(path).stream():
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                found[name] += [row for row in batch.column(name).to_pylist() if row is not None]
    heights = np.array(found["Mesh3D:vertex_positions"][0])[:, 2]
    np.testing.assert_allclose(heights, 20 * w.ravel(), rtol=1e-6)  # stored as float32
    assert set(found["Mesh3D:vertex_colors"][0]) == {0x010203FF}
    (loop,) = (np.array(strips[0]) for strips in found["LineStrips3D:strips"] if len(strips) == 1)  # the grid has more
    np.testing.assert_allclose(loop[0], loop[-1])
    # element 4 of a 6 x 3 mesh is i = 1, j = 1
    np.testing.assert_allclose([loop[:, 0].min(), loop[:, 0].max()], [0.05, 0.1], rtol=1e-6)
    np.testing.assert_allclose([loop[:, 1].min(), loop[:, 1].max()], [0.2 / 3, 0.4 / 3], rtol=1e-6)
    assert found["Clear:is_recursive"] == [[False]]


def test_numbers_of_modes_and_channels_may_change(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    with open_recording(path) as recording:
        for k, (modes, channels) in enumerate([(12, 1), (12, 3), (12, 0), (24, 3)]):
            write_states(recording, 0.01 * k, 10, modes, channels)
    rows, _, scalars = read(path)
    assert rows["/probe/w_over_h"] == 40
    assert {name: len(scalars[name][0]) for name in scalars if name.startswith(("/modes", "/voltage"))} == {
        "/modes/1": 12,
        "/modes/2": 24,
        "/voltage/1": 1,
        "/voltage/2": 3,
        "/voltage/limit": 2,
    }
    assert rows["/modes/1"] == 30
    assert rows["/voltage/2"] == 20


def test_killed_run_can_be_read_to_its_last_second(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    # Simulated time is wall time here, so that what is missing at the end is what the kill has cost.
    child = textwrap.dedent("""
        import sys, time
        from pathlib import Path
        import numpy as np
        sys.path.insert(0, sys.argv[2])
        from test_recording import NVX, NVY, open_recording, write_states
        recording = open_recording(Path(sys.argv[1]))
        start = time.monotonic()
        while True:
            now = time.monotonic() - start
            write_states(recording, now, 20, 12, 1)
            recording.frame(now, np.zeros((NVX, NVY)), np.zeros((NVX * NVY, 3), np.uint8))
            print(now, flush=True)
            time.sleep(0.03)
    """)
    root = Path(__file__).parents[1]
    process = subprocess.Popen(
        [sys.executable, "-c", child, str(path), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(root)},
    )
    with process:
        assert process.stdout is not None
        while float(process.stdout.readline()) < 2.5:
            pass
        process.send_signal(signal.SIGKILL)
        written = [float(line) for line in process.stdout.read().split("\n")[:-1]] or [2.5]
    _, last, _ = read(path)
    for entity in ("/panel/surface", "/probe/w_over_h", "/modes/1", "/voltage/1"):
        assert last[entity] > written[-1] - 1.0, f"{entity} lost more than a second"


@pytest.mark.parametrize(
    ("name", "error"),
    [("missing/run.rrd", FileNotFoundError), ("folder.rrd", IsADirectoryError), ("design.json", OSError)],
)
def test_a_file_that_cannot_be_written_is_refused(tmp_path: Path, name: str, error: type[OSError]) -> None:
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / "design.json").write_text(json.dumps({"schema": 1}))
    with pytest.raises(error, match="cannot record to") as caught:
        open_recording(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert json.loads((tmp_path / "design.json").read_text()) == {"schema": 1}


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match="cannot record to"):
        open_recording(tmp_path / "run.rrd")


def test_closing_twice_is_harmless(tmp_path: Path) -> None:
    recording = open_recording(tmp_path / "run.rrd")
    recording.close()
    recording.close()
