"""Owns the replay of a recording: checks the file, then runs rerun's own viewer on it, on this machine only."""

import contextlib
import importlib.util
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import IO

from rerun.chunk import RrdReader

_MEMORY = "25%"  # of the machine's; rerun's own default takes three quarters, then drops the oldest data


def replay(path: Path) -> int:
    """Show a recording until its viewer is closed, or until Ctrl-C or SIGTERM; gives the exit code.

    With a display rerun's native viewer opens; without one its web viewer is served on 127.0.0.1 and the URL printed on
    stderr. A file that is no recording raises FileNotFoundError or ValueError before any viewer starts.
    """
    _refuse_foreign(path)
    with tempfile.TemporaryDirectory(prefix="flutterviz-") as folder, _ended_by_sigterm():
        copy = Path(folder) / path.name
        _tidy(path, copy)
        command = [_viewer(), str(copy), "--bind", "127.0.0.1", "--port", "auto", "--memory-limit", _MEMORY]
        if not _has_display():
            command += ["--serve-web", "--web-viewer-port", "0", "--server-memory-limit", _MEMORY]
        # The viewer itself is run, not the `rerun` script around it: ended, that script leaves the viewer behind.
        process = subprocess.Popen(
            [*command, "--hide-welcome-screen"],
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        try:
            assert process.stderr is not None
            threading.Thread(target=_relay, args=(process.stderr, path), daemon=True).start()
            return process.wait()
        except KeyboardInterrupt:
            return 0  # the usual way to leave a server
        finally:
            _end(process)


def _refuse_foreign(path: Path) -> None:
    if not path.exists():
        raise FileNotFoundError(f"there is no recording {path}; make one with --record FILE.rrd")
    if not path.is_file():
        raise ValueError(f"{path} is not a file; name a recording (FILE.rrd)")
    with path.open("rb") as file:
        start = file.read(4)
    if not start:
        raise ValueError(f"{path} is empty: nothing was recorded; make another with --record FILE.rrd")
    if not start.startswith(b"RRF"):
        raise ValueError(f"{path} is not a rerun recording; name a file written with --record FILE.rrd")


def _tidy(path: Path, copy: Path) -> None:
    """Write a copy in few large chunks, which opens faster, and without the torn end that a killed run may leave."""
    command = [_viewer(), "rrd", "optimize", str(path), "-o", str(copy)]
    done = subprocess.run(command, env=_environment(), capture_output=True, text=True, errors="replace")
    try:
        recordings = RrdReader(copy).recordings() if done.returncode == 0 else []
    except (RuntimeError, ValueError):
        recordings = []
    if not recordings:
        raise ValueError(
            f"{path} cannot be read by this version of rerun: it is damaged, or written by another version; "
            "record the run again from its Design"
        )


def _relay(lines: IO[str], path: Path) -> None:
    """Pass on the viewer's warnings and tell the URL; reading to the end keeps the viewer from blocking."""
    for line in lines:
        if found := re.search(r"connect at (http\S+)", line):
            # WebGPU is still missing in many browsers.
            print(f"{path} is shown at {found[1]}&renderer=webgl (Ctrl-C ends it)", file=sys.stderr)
            print("The page, like all of rerun's, reports anonymous usage to tel.rerun.io", file=sys.stderr, flush=True)
        elif " WARN " in line or " ERROR " in line or "Error" in line:
            print(line.rstrip(), file=sys.stderr, flush=True)


def _viewer() -> str:
    """The viewer's executable in the installed wheel."""
    spec = importlib.util.find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("rerun's viewer is not installed; run: pip install rerun-sdk")
    folder = Path(spec.origin).parent
    names = ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun")
    for name in names:
        if (folder / name).is_file():
            return str(folder / name)
    raise FileNotFoundError(f"rerun's viewer is not in {folder}; run: pip install --force-reinstall rerun-sdk")


def _environment() -> dict[str, str]:
    # With CI set rerun neither sends usage data nor writes its settings; there is no other switch for one process.
    return {**os.environ, "CI": "1", "NO_COLOR": "1"}


def _has_display() -> bool:
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@contextlib.contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Inside, SIGTERM raises SystemExit, so that the viewer is ended and the copy removed on the way out."""

    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():  # only the main thread may set a handler
        yield
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(timeout=3)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
