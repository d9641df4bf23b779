"""Owns the search in a process of its own: how it begins and ends, what it tells the page, and that nothing is left.

The process works, and imports, where it cannot hold up the page: Python runs one thread at a time. It is the head of a
process group, which its own workers belong to, so that one signal ends them all; of a session it is not, because some
systems share the processor among sessions first, whatever their niceness.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import FrameType

from flutterviz.found import Found, found_in
from solver.design import Design
from solver.errors import ControlError, DesignError
from solver.search import Progress, search
from solver.task import Task
from solver.workers import deaf_to, local_workers

Run = Callable[[Design, Task], Iterator[Progress]]
"""A search, as a function that another process can import."""

EVERY = 0.2  # s between what is told
GRACE = 1.0  # s that a job has to end by itself
NICER = 10  # than the page
MOST_WORKERS = 8


def run_search(design: Design, task: Task) -> Iterator[Progress]:
    """The placement search on as many processors as the page leaves free."""
    spare = min((os.cpu_count() or 1) - 1, MOST_WORKERS)
    if spare < 2:
        yield from search(design, task)
        return
    with local_workers(spare) as workers:
        yield from search(design, task, workers)


class Job:
    """One search at a time, in a process beside the page. Only `close` waits, and for a second or so at most."""

    def __init__(self, run: Run = run_search) -> None:
        """Begin with nothing to do; `run` is imported by name in the other process."""
        self._run = run
        self._process: SpawnProcess | None = None
        self._receiver: Connection | None = None
        self._ending: list[tuple[SpawnProcess, float]] = []  # jobs told to end, and when they are made to
        self.found: Found | None = None
        self.trouble = ""
        atexit.register(self.close)  # or Python, on its way out, would wait for the search to end

    @property
    def running(self) -> bool:
        """Whether a search is under way."""
        return self._process is not None

    def start(self, design: Design, task: Task) -> None:
        """Begin a search, in place of the one under way."""
        self.cancel()
        self.found, self.trouble = None, ""
        context = get_context("spawn")  # a fork would copy the locks of the page's threads, some of them held
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(sender, self._run, design, task), name="flutterviz search")
        try:
            with deaf_to({signal.SIGINT}):
                process.start()
        except OSError as error:
            receiver.close()
            self.trouble = f"the search could not be started: {error.strerror or error}"
            return
        finally:
            sender.close()
        if hasattr(os, "setpriority") and process.pid is not None:  # from outside: its imports are to be nice as well
            with contextlib.suppress(OSError):
                niceness = os.getpriority(os.PRIO_PROCESS, 0) + NICER
                os.setpriority(os.PRIO_PROCESS, process.pid, niceness)
        self._process, self._receiver = process, receiver

    def follow(self) -> None:
        """Take in what the job has told and see whether it lives; never waits."""
        self._bury()
        process = self._process
        if process is None:
            return
        ended = process.exitcode is not None  # asked first: what it told last is then in the pipe
        self._listen()
        if self.trouble or (self.found is not None and self.found.complete):
            self._dismiss()
        elif ended:
            self.trouble = _epitaph(process.exitcode or 0)
            self._dismiss()

    def cancel(self) -> None:
        """End the search under way; what it has found stays."""
        if self._process is not None:
            self._process.terminate()
            self._dismiss()

    def close(self) -> None:
        """End everything, and wait for it."""
        atexit.unregister(self.close)
        self.cancel()
        for process, deadline in self._ending:
            process.terminate()
            process.join(max(0.0, deadline - time.monotonic()))
            _sweep(process)
            process.join()
        self._bury()

    def _listen(self) -> None:
        """Take in what is in the pipe. A message is small: it is there whole, or the job writes it at this moment."""
        receiver = self._receiver
        try:
            while receiver is not None and receiver.poll():
                told = receiver.recv()
                if isinstance(told, Found):
                    self.found = told
                else:
                    self.trouble = str(told)
        except (EOFError, OSError):  # the job has closed its end; its exit code will tell why
            return

    def _dismiss(self) -> None:
        """Let go of the job: it has ended, or has a moment to."""
        if self._receiver is not None:
            self._receiver.close()
        if self._process is not None:
            self._ending.append((self._process, time.monotonic() + GRACE))
        self._process = self._receiver = None

    def _bury(self) -> None:
        late = time.monotonic()
        for process, deadline in list(self._ending):
            if process.exitcode is not None or late > deadline:
                _sweep(process)
            if process.exitcode is not None:
                process.close()
                self._ending.remove((process, deadline))


def _sweep(process: SpawnProcess) -> None:
    """End a job and what is left of its workers at once."""
    if process.pid is None:
        return
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):  # there is no such group: not yet, or no more
            os.killpg(process.pid, signal.SIGKILL)
    if process.exitcode is None:
        process.kill()


def _epitaph(code: int) -> str:
    """Why a job has ended that has not said so itself."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"the search was ended from outside, by {signal.Signals(-code).name}; what it had found stands"
    return f"the search ended without a word, with exit code {code}; what it had found stands"


# --- in the other process ---------------------------------------------------------------------------------------------


def _work(sender: Connection, run: Run, design: Design, task: Task) -> None:
    """Search, and tell what is found; an error is told as one line."""
    if hasattr(os, "setpgid"):
        os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    begun, told = time.perf_counter(), -EVERY
    progress, stage, stage_begun = None, (), 0.0
    try:
        for progress in run(design, task):
            now = time.perf_counter() - begun
            if stage != (progress.stage, progress.due):
                stage, stage_begun = (progress.stage, progress.due), now
            if progress.complete or now - told >= EVERY:
                told = now
                sender.send(found_in(progress, now, now - stage_begun))
        if progress is None or not progress.complete:
            sender.send("the search ended before it was complete")
    except (BrokenPipeError, ConnectionResetError):  # nobody listens any more
        return
    except Exception as error:  # whatever it is, the page says it
        text = " ".join(str(error).split())
        told_as = text if isinstance(error, (DesignError, ControlError)) else f"{type(error).__name__}: {text}"
        with contextlib.suppress(OSError):
            sender.send(told_as or type(error).__name__)


def _leave(number: int, frame: FrameType | None) -> None:
    """End by unwinding, so that workers are let go in an orderly way."""
    raise SystemExit(0)


def _end_with_the_page() -> None:
    """Wait for the page's process to end, however it does, and take the whole group along."""
    page = parent_process()
    if page is None:
        return
    connection.wait([page.sentinel])
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)
