"""The processes beside the page: they answer, one thing at a time, come back when they were killed, and are ended."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest

from flutterviz.beside import Beside

SCRIPT = """
import os, sys, time
from flutterviz.beside import Beside

if __name__ == "__main__":
    beside = Beside()
    print(beside.submit(os.getpid).result(), flush=True)
    beside.submit(time.sleep, 60)
    time.sleep(float(sys.argv[1]))
"""


@pytest.fixture
def beside() -> Iterator[Beside]:
    beside = Beside()
    yield beside
    beside.shutdown()


def gone(pid: int) -> bool:
    """Whether a process ends within some seconds."""
    end = time.monotonic() + 20
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
            state = Path(f"/proc/{pid}/stat")
            if state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z":
                return True  # ended, and nobody has asked how
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_work_is_done_in_one_other_process(beside: Beside) -> None:
    first, second = beside.submit(os.getpid), beside.submit(os.getpid)
    assert first.result() == second.result() != os.getpid()
    with pytest.raises(ZeroDivisionError):
        beside.submit(divmod, 1, 0).result()


def test_it_is_as_nice_as_asked_and_deaf_to_the_terminal() -> None:
    beside = Beside(nicer=3)
    pid = beside.submit(os.getpid).result()
    assert beside.submit(os.getpriority, os.PRIO_PROCESS, 0).result() == os.getpriority(os.PRIO_PROCESS, 0) + 3
    os.kill(pid, signal.SIGINT)
    assert beside.submit(os.getpid).result() == pid
    beside.shutdown()
    assert gone(pid)


def test_a_process_that_was_killed_fails_its_work_and_is_followed_by_another(beside: Beside) -> None:
    pid = beside.submit(os.getpid).result()
    lost = beside.submit(time.sleep, 60)
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(BrokenExecutor):
        lost.result(timeout=30)
    assert beside.submit(os.getpid).result() != pid


def test_it_is_ended_in_the_middle_of_its_work(beside: Beside) -> None:
    pid = beside.submit(os.getpid).result()
    under_way, waiting = beside.submit(time.sleep, 60), beside.submit(os.getpid)
    while not under_way.running():
        time.sleep(0.01)
    begun = time.monotonic()
    beside.shutdown()
    assert isinstance(under_way.exception(), BrokenExecutor)
    assert waiting.cancelled()
    assert time.monotonic() - begun < 30  # of 60 that the work would take
    assert gone(pid)
    beside.shutdown()  # twice does no harm
    with pytest.raises(RuntimeError, match="after it was shut down"):
        beside.submit(os.getpid)


@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGTERM, None])
def test_it_does_not_outlive_the_page(tmp_path: Path, way: signal.Signals | None) -> None:
    """However the page ends: killed, told to, or by itself without a word."""
    script = tmp_path / "page.py"
    script.write_text(SCRIPT)
    lives = "60" if way else "0"
    with subprocess.Popen([sys.executable, str(script), lives], stdout=subprocess.PIPE, text=True) as page:
        assert page.stdout is not None
        pid = int(page.stdout.readline())
        if way is not None:
            page.send_signal(way)
        page.wait(30)  # of 60 that the work would take
    assert gone(pid)


def test_an_answer_that_cannot_travel_is_told(beside: Beside) -> None:
    with pytest.raises(TypeError, match="cannot be sent"):
        beside.submit(threading.Lock).result()
    assert beside.submit(os.getpid).result() != os.getpid()


def test_large_answers_come_whole(beside: Beside) -> None:
    assert beside.submit(bytes, 5_000_000).result() == bytes(5_000_000)


@pytest.mark.parametrize("after", [0.0, 1e-3, 5e-3, 2e-2, 5e-2])
def test_it_may_be_ended_while_it_is_begun(after: float) -> None:
    beside = Beside()
    future = beside.submit(os.getpid)
    time.sleep(after)
    beside.shutdown()
    assert future.done()  # by whichever came first
    with pytest.raises(RuntimeError):
        beside.submit(os.getpid)
