"""Commands in processes of their own: started, watched by the files they write, ended with all theirs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil

PATIENCE = 90.0  # s; a process that imports the solver takes some, on a busy machine


def launch(*words: str | Path, module: str = "flutterviz") -> subprocess.Popen[str]:
    """Start a command in a group of its own, as a terminal does."""
    path = os.pathsep.join(filter(None, [str(Path(__file__).parents[1]), *sys.path]))
    return subprocess.Popen(
        [sys.executable, "-m", module, *map(str, words)],
        env=os.environ | {"PYTHONPATH": path, "PYTHONWARNINGS": ""},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@contextmanager
def launched(*words: str | Path, module: str = "flutterviz") -> Iterator[subprocess.Popen[str]]:
    """A command that is ended with all that it has started, whatever comes."""
    process = launch(*words, module=module)
    try:
        yield process
    finally:
        theirs = family(process.pid)
        for one in (process, *theirs):
            try:
                one.kill()
            except (psutil.NoSuchProcess, ProcessLookupError):
                continue
        psutil.wait_procs(theirs, timeout=PATIENCE)
        process.communicate(timeout=PATIENCE)


def family(pid: int) -> list[psutil.Process]:
    """What a process has started, and what that has."""
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that still run; one that nobody has taken note of does not."""
    return [one for one in processes if one.is_running() and status_of(one) != psutil.STATUS_ZOMBIE]


def status_of(process: psutil.Process) -> str:
    try:
        return process.status()
    except psutil.NoSuchProcess:
        return psutil.STATUS_ZOMBIE


def until(condition: Callable[[], object], patience: float = PATIENCE) -> None:
    """Wait for something to come about."""
    end = time.perf_counter() + patience
    while not condition():
        assert time.perf_counter() < end, "it never came about"
        time.sleep(0.02)


def lines_in(path: Path) -> int:
    """Lines of a file that may not be there yet."""
    try:
        return path.read_bytes().count(b"\n")
    except FileNotFoundError:
        return 0


def log_of(path: Path) -> Path:
    """The journal of a ranking."""
    return path.with_name(path.name + ".journal")


def ended(process: subprocess.Popen[str], number: int | None = None) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command: after Ctrl-C, which the whole group gets, another signal, or none."""
    if number == signal.SIGINT:
        os.killpg(process.pid, number)
    elif number is not None:
        process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


def content(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """A ranking's file without its scores, and those by their elements; in which order they came is the workers'."""
    file = json.loads(path.read_bytes())
    scores = {str(score["elements"]): score for score in file.pop("scores")}
    return file, scores
