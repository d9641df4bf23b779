"""The replay: bad files are refused at once; the page comes up on loopback; nothing outlives the command."""

import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import psutil
import pytest
from launched import PATIENCE, family

from flutterviz.recording import Recording
from flutterviz.replay import replay


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "run.rrd"
    x = np.linspace(0, 0.3, 5)
    with Recording(path, x=x, y=x, nx=4, ny=4, voltage_limit=228.6, exaggeration=20) as run:
        for time in (0.0, 0.1):
            run.frame(time, np.zeros((5, 5)), np.zeros((25, 3), np.uint8))
            run.states(np.array([time]), np.zeros(1), np.zeros((1, 4)), np.zeros((1, 1)))
    return path


@pytest.mark.parametrize(
    ("name", "error", "text"),
    [
        ("missing.rrd", FileNotFoundError, "there is no recording"),
        ("folder.rrd", ValueError, "is not a file"),
        ("empty.rrd", ValueError, "is empty"),
        ("garbage.rrd", ValueError, "is not a rerun recording"),
        ("damaged.rrd", ValueError, "cannot be read"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(
    tmp_path: Path, recording: Path, name: str, error: type[Exception], text: str
) -> None:
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / "empty.rrd").touch()
    (tmp_path / "garbage.rrd").write_bytes(b"no recording " * 100)
    (tmp_path / "damaged.rrd").write_bytes(recording.read_bytes()[:200])
    with pytest.raises(error, match=text) as caught:
        replay(tmp_path / name)
    assert "\n" not in str(caught.value)


def start(path: Path) -> tuple["subprocess.Popen[str]", str]:
    """The command in a process of its own, without a display, and the URL it tells."""
    code = "import sys, pathlib; from flutterviz.replay import replay; sys.exit(replay(pathlib.Path(sys.argv[1])))"
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment["PYTHONPATH"] = str(Path(__file__).parents[1])
    command = [sys.executable, "-c", code, str(path)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"http\S+", line):
            return process, found[0]
    raise AssertionError(f"no URL; exit code {process.wait()}")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGINT, 0)])
def test_the_page_is_served_on_loopback_until_the_command_ends(recording: Path, number: int, code: int) -> None:
    process, url = start(recording)
    try:
        assert url.startswith("http://127.0.0.1:")
        assert "renderer=webgl" in url
        with urllib.request.urlopen(url, timeout=PATIENCE) as answer:
            assert answer.status == 200
        tree = psutil.Process(process.pid).children(recursive=True)
        assert tree
        listening = [c.laddr.ip for p in tree for c in p.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
        assert set(listening) == {"127.0.0.1"}
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE) == code
        _, alive = psutil.wait_procs(tree, timeout=PATIENCE)
        assert not alive
    finally:
        for one in (*family(process.pid), process):  # the viewer as well, should the command not have ended it
            one.kill()
        process.communicate()


def test_a_torn_end_is_cut_off_and_the_rest_shown(recording: Path) -> None:
    # What a kill in the middle of a write leaves: a last message that is shorter than it says.
    torn = recording.read_bytes()
    recording.write_bytes(torn[: int(0.6 * len(torn))])
    process, url = start(recording)
    try:
        with urllib.request.urlopen(url, timeout=PATIENCE) as answer:
            assert answer.status == 200
    finally:
        process.terminate()
        process.communicate()
