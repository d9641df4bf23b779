"""Owns a process beside the page: what would hold up the picture is worked out there, one thing after the other.

Python runs one thread at a time, so that work in a thread of the page's own process costs it pictures.
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, TypeVar

from solver.workers import deaf_to

P = ParamSpec("P")
T = TypeVar("T")

ROOM = 1 << 20  # bytes that a pipe holds, where that can be chosen: a rig then comes in three pieces and not in forty


@dataclass(frozen=True)
class _Wish:
    """A call that is to be made."""

    future: Future[Any]
    fn: Callable[..., Any]
    args: tuple[object, ...]
    kwargs: dict[str, object]


class Beside(Executor):
    """An executor of one process, begun when it is first needed, and again after it was ended from outside.

    A thread hands over what is to be done and waits for the answer, so that nobody else has to.
    """

    def __init__(self, nicer: int = 0) -> None:
        """Begin with no process; the one to come is to be so much nicer than this one."""
        self._nicer = nicer
        self._wishes: queue.SimpleQueue[_Wish | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name="beside", daemon=True)
        self._process: BaseProcess | None = None
        self._requests: Connection | None = None
        self._answers: Connection | None = None
        self._closed = False

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have a function called that the other process can import.

        The future fails with `BrokenExecutor` where the process was ended before it was done, and with an `OSError`
        where none can be begun.

        Raises:
            RuntimeError: it was shut down.
        """
        if self._closed:
            raise RuntimeError("nothing can be asked of it after it was shut down")
        if not self._thread.is_alive():
            atexit.register(self.shutdown)  # or Python, on its way out, would wait for the process to end
            self._thread.start()
        future: Future[T] = Future()
        self._wishes.put(_Wish(future, fn, args, kwargs))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """End the process at once, whatever it is at: it has nothing to put away. What waits for it is never done."""
        atexit.unregister(self.shutdown)
        self._closed = True
        self._wishes.put(None)
        process = self._process  # which the thread may let go of at any moment
        if process is not None:
            process.kill()  # of which the thread hears as the end of the pipe
        if wait and self._thread.is_alive():
            self._thread.join()

    def _serve(self) -> None:
        while (wish := self._wishes.get()) is not None:
            if self._closed:
                wish.future.cancel()
            if not wish.future.set_running_or_notify_cancel():
                continue
            try:
                wish.future.set_result(self._call(wish.fn, wish.args, wish.kwargs))
            except BaseException as error:  # who asked is told, whatever it is
                wish.future.set_exception(error)
        self._let_go()
        with contextlib.suppress(queue.Empty):
            while (wish := self._wishes.get_nowait()) is not None:  # asked for while it was shut down
                wish.future.cancel()

    def _call(self, fn: Callable[..., T], args: tuple[object, ...], kwargs: dict[str, object]) -> T:
        if self._process is None or not self._process.is_alive():
            self._begin()
        assert self._requests is not None
        assert self._answers is not None
        try:
            self._requests.send((fn, args, kwargs))
            done, answer = self._answers.recv()
        except (EOFError, ConnectionError):
            self._let_go()
            raise BrokenExecutor("the process was ended from outside") from None
        if done:
            return answer
        raise answer

    def _begin(self) -> None:
        self._let_go()
        # its numpy reads it when it is imported: threads of the linear algebra would only wait for one another
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        context = multiprocessing.get_context("spawn")  # a fork would take locked locks of other threads along
        (requests, self._requests), (self._answers, answers) = context.Pipe(duplex=False), context.Pipe(duplex=False)
        for pipe in (self._requests, answers):
            _widen(pipe)
        process = context.Process(target=_work, args=(requests, answers, self._nicer), name="flutterviz beside")
        try:
            with deaf_to({signal.SIGINT, signal.SIGTERM}):
                process.start()
            self._process = process  # from now on it can be ended
            if self._closed:  # meanwhile: whoever closed it has seen no process to end
                process.kill()
        finally:
            requests.close()
            answers.close()

    def _let_go(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        for pipe in (self._requests, self._answers):
            if pipe is not None:
                pipe.close()
        self._process = self._requests = self._answers = None


def _widen(pipe: Connection) -> None:
    """Let a pipe hold more at once, where the system lets one choose."""
    with contextlib.suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, ROOM)


# --- in the other process ---------------------------------------------------------------------------------------------


def _work(requests: Connection, answers: Connection, nicer: int) -> None:
    """Do what is asked for until the page ends; signals are left to the page's process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(nicer)
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            answer = _answer(*requests.recv())
            try:
                answers.send(answer)
            except (TypeError, AttributeError) as error:  # of pickle's, for what cannot travel
                answers.send((False, TypeError(f"an answer that cannot be sent: {error}")))


def _answer(fn: Callable[..., Any], args: tuple[object, ...], kwargs: dict[str, object]) -> tuple[bool, Any]:
    try:
        return True, fn(*args, **kwargs)
    except Exception as error:  # whatever it is, who asked is told
        return False, error


def _end_with_the_page() -> None:
    """A process whose page was killed would go on with its work for nobody."""
    page = multiprocessing.parent_process()
    if page is not None:
        page.join()
        os._exit(1)
