"""Where a search runs: in this process, in others, on a Dask cluster that loses a worker; the result is one."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import psutil
import pytest
from fakescores import coarse, found
from launched import PATIENCE, alive, content, ended, launched, lines_in, log_of, until
from terminal import complaint

from flutterviz.cli import run
from solver import DesignError
from solver.files import save_design
from solver.search import search
from solver.task import Method, Task
from solver.workers import POLITE, Insistent, Serial, local_workers, workers

METHODS: tuple[Method, ...] = get_args(Method)
DESIGN = coarse(6, 4)


def task_of(method: Method) -> Task:
    """A few layouts of any method."""
    return Task(method, elements=None if method == "exhaustive" else 4, evaluations=7, top=2, seed=5)


@pytest.fixture(scope="module")
def alone() -> dict[Method, object]:
    """What each method finds in this process."""
    return {method: found(search(DESIGN, task_of(method))) for method in METHODS}


@pytest.mark.parametrize("count", [0, 1, 2])
def test_every_method_finds_the_same_with_any_number_of_workers(count: int, alone: dict[Method, object]) -> None:
    """To the last digit of every score; in worker processes the linear algebra has one thread, as it has here."""
    with local_workers(count) as executor:
        for method in METHODS:
            assert found(search(DESIGN, task_of(method), executor)) == alone[method]
            if count == 0:
                break  # it is what the others are held against
    scores = alone["exhaustive"]
    assert isinstance(scores, tuple)
    assert len(scores[0]) == 7


def test_workers_are_polite_and_gone_when_they_are_no_longer_needed() -> None:
    before = {one.pid for one in psutil.Process().children(recursive=True)}
    with local_workers(2) as executor:
        futures: list[Future[int]] = [executor.submit(os.getpid) for _ in range(8)]
        pids = {future.result(PATIENCE) for future in futures}
        assert os.getpid() not in pids
        own = [one for one in psutil.Process().children(recursive=True) if one.pid in pids]
        assert own
        assert all(one.nice() == min(psutil.Process().nice() + POLITE, 19) for one in own)
        executor.submit(_sleep)  # what is under way does not hold it up
    # but for the one that keeps count of semaphores, which Python keeps to the end
    until(
        lambda: (
            not [
                one
                for one in alive(psutil.Process().children(recursive=True))
                if one.pid not in before and "resource_tracker" not in words_of(one)
            ]
        ),
        10.0,
    )


def words_of(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""


def _sleep() -> None:
    import time

    time.sleep(600)


def test_no_worker_is_the_calling_thread() -> None:
    with workers("local", 0) as executor:
        assert executor.submit(os.getpid).result() == os.getpid()
        assert isinstance(executor.submit(int, "x").exception(), ValueError)


@pytest.mark.parametrize("count", [-1, 1025])
def test_no_such_number_of_workers(count: int) -> None:
    with pytest.raises(DesignError, match=f"workers = {count}"), workers("local", count):
        pass


def test_dask_that_is_not_installed_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, design: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    line = complaint(capsys, *words(design, "127.0.0.1:1"))
    assert "Dask is not installed; pip install" in line


def words(design: Path, address: str, save: Path | None = None) -> list[str]:
    kept = ["--save", str(save)] if save else []
    return [
        *(
            "search",
            str(design),
            "--method",
            "exhaustive",
            "--top",
            "3",
            "--evaluations",
            "14",
            "--executor",
            f"dask://{address}",
        ),
        *kept,
    ]


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("design") / "coarse.json"
    save_design(DESIGN, path)
    return path


@dataclass
class Cluster:
    """A scheduler and two workers, each a process."""

    address: str
    """HOST:PORT."""
    scheduler: psutil.Process
    """The one that all others talk to."""
    workers: list[psutil.Process]
    """Those that work."""


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="it is an extra: pip install flutterviz[dask]")
    address = f"127.0.0.1:{free_port()}"
    with ExitStack() as ending:
        port = address.partition(":")[2]
        start = ("--host", "127.0.0.1", "--port", port, "--no-dashboard")
        scheduler = ending.enter_context(launched("scheduler", *start, module="dask"))
        until(lambda: answers(address))
        works = ("worker", f"tcp://{address}", "--no-nanny", "--nthreads", "1", "--no-dashboard")
        both = [
            ending.enter_context(launched(*works, "--local-directory", tmp_path / name, module="dask"))
            for name in ("one", "two")
        ]
        yield Cluster(address, psutil.Process(scheduler.pid), [psutil.Process(one.pid) for one in both])


def answers(address: str) -> bool:
    host, _, port = address.partition(":")
    with socket.socket() as one:
        one.settimeout(1.0)
        return one.connect_ex((host, int(port))) == 0


def test_a_cluster_that_loses_a_worker_gives_the_same(cluster: Cluster, design: Path, tmp_path: Path) -> None:
    save, alone = tmp_path / "ranking.json", tmp_path / "alone.json"
    with launched(*words(design, cluster.address, save)) as process:
        until(lambda: lines_in(log_of(save)) > 4)
        assert len(alive(cluster.workers)) == 2
        cluster.workers[0].kill()
        code, out, err = ended(process)
    assert code == 0, err
    assert "looked at 14 layouts" in out
    assert "Traceback" not in err
    assert len(err.splitlines()) < 8  # Dask's own log does not flood
    assert run([*words(design, "", alone)[:-4], "--workers", "0", "--save", str(alone)]) == 0
    assert content(save) == content(alone)


def test_a_cluster_whose_scheduler_goes_away_is_one_line(cluster: Cluster, design: Path, tmp_path: Path) -> None:
    save = tmp_path / "ranking.json"
    with launched(*words(design, cluster.address, save)) as process:
        until(lambda: lines_in(log_of(save)) > 4)
        cluster.scheduler.kill()
        code, out, err = ended(process)
    assert code == 2, err
    assert out == ""
    assert "Traceback" not in err
    assert err.strip().rpartition("\n")[2].startswith("flutterviz: ")
    assert lines_in(log_of(save)) > 4


def test_where_no_scheduler_answers_it_is_one_line(design: Path) -> None:
    pytest.importorskip("distributed", reason="it is an extra: pip install flutterviz[dask]")
    address = f"127.0.0.1:{free_port()}"
    with launched(*words(design, address)) as process:
        code, out, err = ended(process)
    assert code == 2
    assert out == ""
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith(f"flutterviz: no Dask scheduler answers at {address}")


@pytest.mark.parametrize("address", ["nowhere", "127.0.0.1:port"])
def test_an_address_that_is_none_is_one_line(address: str, design: Path) -> None:
    pytest.importorskip("distributed", reason="it is an extra: pip install flutterviz[dask]")
    with launched(*words(design, address)) as process:
        code, out, err = ended(process)
    assert code == 2, err
    assert out == ""
    assert len(err.strip().splitlines()) == 1, err
    assert err.startswith("flutterviz: ")


class Losing(Serial):
    """Loses what it is first asked for, as Dask's client may."""

    def __init__(self, losses: int) -> None:
        self.losses = losses

    def submit(self, fn, /, *args, **kwargs):  # noqa: ANN001, ANN002, ANN003, ANN201 - as Executor's
        self.losses -= 1
        if self.losses >= 0:
            future: Future = Future()
            future.set_exception(TypeError("cannot unpack non-iterable Score object"))
            return future
        return super().submit(fn, *args, **kwargs)


def test_what_a_cluster_loses_is_asked_for_once_more() -> None:
    assert Insistent(Losing(1)).submit(pow, 2, 3).result() == 8
    with pytest.raises(TypeError, match="unpack"):
        Insistent(Losing(2)).submit(pow, 2, 3).result()
    with pytest.raises(ZeroDivisionError):
        Insistent(Losing(0)).submit(divmod, 1, 0).result()


def test_what_a_cluster_cancels_is_cancelled() -> None:
    class Gone(Serial):
        def submit(self, fn, /, *args, **kwargs):  # noqa: ANN001, ANN002, ANN003, ANN202 - as Executor's
            future: Future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    future = Insistent(Gone()).submit(pow, 2, 3)
    assert wait([future], timeout=5).not_done == set()
    with pytest.raises(CancelledError):
        future.result()
