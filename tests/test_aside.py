"""An iterator that is worked through aside: nothing that happens to the main thread happens to it."""

import signal
import threading
import time
from collections.abc import Iterator

import pytest

from flutterviz.aside import Aside


def counting(begun: list[int]) -> Iterator[int]:
    """0 to 4, each noted when it is asked for."""
    for k in range(5):
        begun.append(k)
        yield k


def test_items_come_in_order_and_each_only_when_it_is_asked_for() -> None:
    begun: list[int] = []
    with Aside[int]() as aside:
        for k in aside.steps(counting(begun)):
            assert begun == list(range(k + 1))
    assert begun == list(range(5))


def test_what_it_raises_is_raised_here_after_what_came_before() -> None:
    def items() -> Iterator[int]:
        yield 1
        raise ZeroDivisionError("here")

    found: list[int] = []
    with pytest.raises(ZeroDivisionError, match="here"), Aside[int]() as aside:
        found.extend(aside.steps(items()))
    assert found == [1]


def test_an_interrupt_meets_the_wait_alone() -> None:
    ended, let_go = threading.Event(), threading.Event()

    def items() -> Iterator[int]:
        yield 1
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        let_go.wait(30)
        ended.set()
        yield 2

    with Aside[int]() as aside:
        with pytest.raises(KeyboardInterrupt):
            list(aside.steps(items()))
        assert not ended.is_set()  # the iterator is where it was
        let_go.set()
    assert ended.is_set()  # and was waited for
    assert all(thread.name != "aside" for thread in threading.enumerate())


def test_left_before_the_end_it_asks_for_nothing_more() -> None:
    begun: list[int] = []
    with Aside[int]() as aside:
        for k in aside.steps(counting(begun)):
            if k == 1:
                break
    time.sleep(0.05)
    assert begun == [0, 1]
