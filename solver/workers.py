"""Owns the executors that a search runs on: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import ParamSpec, TypeVar

from solver.errors import DesignError

POLITE = 10  # niceness of a worker: a page, or whoever works at the machine, goes first
DASK = "dask://"
CONNECTING = 10  # s to wait for a cluster
MOST_WORKERS = 1024
LOUD = ("distributed", "distributed.client", "tornado.application")
"""Loggers of Dask's that print what goes wrong, which is raised here as well and said in one line."""

P = ParamSpec("P")
T = TypeVar("T")


class Serial(Executor):
    """An executor that does in the calling thread what it is asked to, at once."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call, and give the result as a future that is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Insistent(Executor):
    """Asks another executor, and again where a `TypeError` comes back: no score ends in one, but Dask's client does.

    It reads the state of a result after the result; if the worker that keeps it went away in between, the state is that
    of a failure whose error is not there (distributed.cfexecutor).
    """

    def __init__(self, executor: Executor) -> None:
        """Ask this one."""
        self._executor = executor

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """As the other executor's; a future that is cancelled is only no longer waited for."""
        outer: Future[T] = Future()

        def ask(last: bool) -> None:
            self._executor.submit(fn, *args, **kwargs).add_done_callback(lambda inner: tell(inner, last))

        def tell(inner: Future[T], last: bool) -> None:
            if inner.cancelled():
                outer.cancel()
            if outer.cancelled() or inner.cancelled():
                outer.set_running_or_notify_cancel()  # wakes who waits
                return
            error = inner.exception()
            if isinstance(error, TypeError) and not last:
                ask(last=True)
            elif error is not None:
                outer.set_exception(error)
            else:
                outer.set_result(inner.result())

        ask(last=False)
        return outer


@contextmanager
def workers(where: str, count: int | None = None) -> Iterator[Executor]:
    """The executor that a user names: `local`, or `dask://HOST:PORT` for the scheduler of a cluster.

    Raises:
        DesignError: no such executor, Dask is not installed, or the cluster does not answer.
    """
    if count is not None and where != "local":
        raise DesignError(f"workers = {count}: is not used with --executor {where}; leave it out")
    if count is not None and not 0 <= count <= MOST_WORKERS:
        raise DesignError(f"workers = {count}: use 0 (in this process) to {MOST_WORKERS}")
    if where == "local":
        with local_workers((os.cpu_count() or 1) if count is None else count) as executor:
            yield executor
    elif where.startswith(DASK):
        with dask_workers(where.removeprefix(DASK)) as executor:
            yield executor
    else:
        raise DesignError(f"executor = {where}: use local, or dask://HOST:PORT for the scheduler of a Dask cluster")


@contextmanager
def local_workers(count: int) -> Iterator[Executor]:
    """So many processes of their own; a count of 0 works in the calling thread. On leaving, they are ended at once."""
    if count < 1:
        yield Serial()
        return
    # their numpy reads it when it is imported: threads of the linear algebra would only wait for one another
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    context = multiprocessing.get_context("spawn")  # a fork would take locked locks of other threads along
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, context, initializer=_begin)
    with deaf_to({signal.SIGINT, signal.SIGTERM}):
        for _ in range(count):
            pool.submit(os.getpid)  # each begins a process, because none is idle yet
    try:
        yield pool
    finally:
        # Not by cancelling first: a pool that finds its processes gone fails on futures that are cancelled.
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        pool.shutdown(wait=True)


@contextmanager
def deaf_to(signals: set[signal.Signals]) -> Iterator[None]:
    """Keep signals to the whole group, as Ctrl-C on the terminal, from processes begun here: their parent ends them.

    The thread's signal mask is handed down, so this holds from the first moment on, when nothing of ours runs there.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which would otherwise be begun on the way, and takes the mask off
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """What a worker does first: it goes behind others, leaves signals to its parent, and does not outlive it."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(POLITE)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def dask_workers(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, whose scheduler is at HOST:PORT; they need this package installed.

    What a worker was at when it went away is done again by another.

    Raises:
        DesignError: Dask is not installed, or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise DesignError("executor: Dask is not installed; pip install 'flutterviz[dask]'") from None
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise DesignError(f"executor = {DASK}{address}: give the scheduler as {DASK}HOST:PORT, as {DASK}127.0.0.1:8786")
    for name in LOUD:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        socket.create_connection((host, int(port)), CONNECTING).close()  # or a client that fails leaves threads behind
        client = Client(f"tcp://{address}", timeout=CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:
        why = " ".join(str(error).split())
        raise DesignError(f"no Dask scheduler answers at {address} ({why}); start one with `dask scheduler`") from None
    try:
        client.wait_for_workers(1, timeout=CONNECTING)
    except TimeoutError:
        client.close()
        raise DesignError(f"the Dask scheduler at {address} has no workers; start one with `dask worker`") from None
    try:
        yield Insistent(client.get_executor(pure=False))
    finally:
        client.close()
