"""Owns the measurement of starting up, in fresh processes: the import of solver, one command, and the page served."""

from __future__ import annotations

import contextlib
import http.client
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import flutterviz
from flutterviz.bench.figure import Baseline, Figure
from flutterviz.bench.timing import Times

REPEATS, QUICK = 7, 2
IMPORT, COMMAND, SERVING = 0.5, 2.0, 3.0  # s, asked at most
BARE = "import numpy, scipy.linalg, scipy.sparse"
FLUTTER = ("-m", "flutterviz", "flutter", "seed-bare", "--json")
VIEW = ("-m", "flutterviz", "view", "--no-open", "--port", "0")
FOLDER = Path(flutterviz.__file__).parents[1]
"""Where the packages lie, installed or not: children find them from there."""
LONGEST = 300.0  # s that a child may take; the first one may have to compile the kernels
GRACE = 20.0  # s that the explorer has to end by itself


@dataclass(frozen=True)
class _Timed:
    """What a process took."""

    whole: float
    """From its start to its end [s]."""
    inside: float
    """Its import statement, timed within [s]."""


def measure(quick: bool) -> list[Figure]:
    """Import of solver, `flutter seed-bare --json` and `view` until its page answers, in turns with a bare process.

    Every process is fresh, all are warm: each was run once before, so that files are in the page cache, modules are
    compiled to bytecode and kernels to machine code.

    Raises:
        RuntimeError: a process failed, or took too long.
    """
    with _environment() as environment:
        bare, solver, command, page = _in_turns(
            lambda: _timed_import(BARE, environment),
            lambda: _timed_import("import solver", environment),
            lambda: _timed(FLUTTER, environment),
            lambda: _served(environment),
            repeats=QUICK if quick else REPEATS,
        )
    imports, whole = Times(tuple(one.inside for one in bare)), Times(tuple(one.whole for one in bare))
    name = f'python -c "{BARE}"'
    inside, processes = Baseline(f"{name}, its import alone", imports.median), Baseline(name, whole.median)
    count = f"{len(bare)} fresh processes of each, in turns, warm"
    return [
        _figure(
            "import solver",
            Times(tuple(one.inside for one in solver)),
            IMPORT,
            inside,
            f"{count}; timed within the process, without the interpreter's own start; numpy and scipy are included",
        ),
        _figure(
            "flutter seed-bare --json",
            Times(tuple(command)),
            COMMAND,
            processes,
            f"{count}; the whole process, from its start to its end",
        ),
        _figure(
            "view serving",
            Times(tuple(page)),
            SERVING,
            processes,
            f"{count}; from the start of the process until it has said where it serves, and the page there has come",
        ),
    ]


def _figure(name: str, times: Times, target: float, baseline: Baseline, note: str) -> Figure:
    return Figure(name, times.median, "s", times.spread, target, baseline=baseline, note=note)


@contextlib.contextmanager
def _environment() -> Iterator[dict[str, str]]:
    """The environment of the children: as here, but that bytecode is kept, as where the package was installed."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    if not sys.dont_write_bytecode:
        yield environment
        return
    with tempfile.TemporaryDirectory(prefix="flutterviz-bytecode-", ignore_cleanup_errors=True) as folder:
        yield environment | {"PYTHONPYCACHEPREFIX": folder}  # nor is it left where it was not wanted


def _in_turns(
    bare: Callable[[], _Timed],
    solver: Callable[[], _Timed],
    command: Callable[[], float],
    page: Callable[[], float],
    repeats: int,
) -> tuple[list[_Timed], list[_Timed], list[float], list[float]]:
    """What each call gives, one after another and again; the first round is for warming up, and dropped."""
    rounds = [(bare(), solver(), command(), page()) for _ in range(repeats + 1)][1:]
    bares, solvers, commands, pages = zip(*rounds, strict=True)
    return list(bares), list(solvers), list(commands), list(pages)


def _timed_import(words: str, environment: dict[str, str]) -> _Timed:
    """Run an import statement in a process that says how long it took."""
    code = f"from time import perf_counter\nbegun = perf_counter()\n{words}\nprint(perf_counter() - begun)"
    begun = time.perf_counter()
    said = _run(("-c", code), environment)
    return _Timed(time.perf_counter() - begun, float(said))


def _timed(words: Sequence[str], environment: dict[str, str]) -> float:
    """How long a process takes [s]."""
    begun = time.perf_counter()
    _run(words, environment)
    return time.perf_counter() - begun


def _run(words: Sequence[str], environment: dict[str, str]) -> str:
    """What a process prints; it is ended with this one."""
    command = [sys.executable, *words]
    try:
        done = subprocess.run(command, env=environment, cwd=FOLDER, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{' '.join(words)} took more than {LONGEST:g} s") from None
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)} failed: {_last_line(done.stderr)}")
    return done.stdout


def _served(environment: dict[str, str]) -> float:
    """How long the explorer takes until a GET of its page is answered by 200 [s]; it is ended again."""
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *VIEW],
        env=environment,
        cwd=FOLDER,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    overdue = threading.Timer(LONGEST, process.kill)
    overdue.start()
    try:
        address = _address(process)
        page = http.client.HTTPConnection(address, timeout=GRACE)  # not urllib, which may know of a proxy
        with contextlib.closing(page):
            page.request("GET", "/")
            answer = page.getresponse()
            answer.read()
        if answer.status != 200:
            raise RuntimeError(f"the page answered {answer.status} {answer.reason}")
        return time.perf_counter() - begun
    finally:
        overdue.cancel()
        _end(process)


def _address(process: subprocess.Popen[str]) -> str:
    """HOST:PORT that the explorer says it serves on."""
    assert process.stderr is not None
    line = ""
    for line in process.stderr:
        said = re.search(r"serving on (http://\S+)", line)
        if said is not None:
            return urlsplit(said[1]).netloc
    raise RuntimeError(f"the explorer ended before it served: {_last_line(line)}")


def _end(process: subprocess.Popen[str]) -> None:
    """End the explorer as a user would, and by force if it hangs, or if this is interrupted in turn."""
    process.terminate()
    try:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GRACE)
    finally:
        process.kill()  # a formality, where it has ended
        process.wait()
        if process.stderr is not None:
            process.stderr.close()


def _last_line(said: str) -> str:
    lines = said.strip().splitlines()
    return lines[-1] if lines else "it said nothing"
