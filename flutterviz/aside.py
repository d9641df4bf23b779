"""Owns a thread that works through an iterator, so that Ctrl-C meets only the wait for what comes next.

Python raises KeyboardInterrupt in the main thread wherever it is; within `concurrent.futures.wait` that leaves locks of
futures taken, for which the executor's own thread then waits for ever.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Generic, Self, TypeVar

T = TypeVar("T")

LOOK = 0.1  # s between looks for a signal: one that comes just before a wait begins does not end it
LEAVING = 10.0  # s to wait for the thread in the end; what it waits for should be gone by then


class Aside(Generic[T]):
    """A context in which one iterator can be worked through; an executor that it waits for is best entered inside."""

    def __init__(self) -> None:
        """Begin with no thread."""
        self._asked: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[T | BaseException] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        """Nothing is begun yet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the thread end with what it is at."""
        self._asked.put(False)
        if self._thread is not None:
            self._thread.join(LEAVING)

    def steps(self, items: Iterator[T]) -> Iterator[T]:
        """The iterator's items, each worked out when it is asked for; what it raises is raised here."""
        self._thread = threading.Thread(target=self._work, args=(items,), name="aside", daemon=True)
        self._thread.start()
        while True:
            self._asked.put(True)
            answer = self._next()
            if isinstance(answer, StopIteration):
                return
            if isinstance(answer, BaseException):
                raise answer
            yield answer

    def _next(self) -> T | BaseException:
        while True:
            with contextlib.suppress(queue.Empty):
                return self._answers.get(timeout=LOOK)

    def _work(self, items: Iterator[T]) -> None:
        while self._asked.get():
            try:
                self._answers.put(next(items))
            except BaseException as error:  # the one who asked is told, and of the end as well
                self._answers.put(error)
