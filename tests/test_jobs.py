"""The search in another process: what it tells, how it ends, and that nothing of it is left."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import fakesearch
import pytest
from fakesearch import DESIGN
from launched import PATIENCE

from flutterviz.jobs import GRACE, NICER, Job, Run
from solver.task import Task

TASK = Task(elements=6)


@pytest.fixture
def job_of() -> Iterator[Callable[[Run], Job]]:
    jobs: list[Job] = []

    def make(run: Run) -> Job:
        jobs.append(Job(run))
        return jobs[-1]

    yield make
    for job in jobs:
        job.close()


def until(condition: Callable[[], bool], job: Job | None = None) -> None:
    end = time.perf_counter() + PATIENCE
    while not condition():
        assert time.perf_counter() < end, "it never came about"
        if job is not None:
            job.follow()
        time.sleep(0.02)


def gone(pid: int) -> bool:
    """Whether a process has ended; one that its parent has not taken note of yet has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def pid_of(job: Job) -> int:
    assert job._process is not None
    assert job._process.pid is not None
    return job._process.pid


def test_it_tells_what_it_finds_and_ends(job_of: Callable[[Run], Job]) -> None:
    job = job_of(fakesearch.quick)
    job.start(DESIGN, TASK)
    pid = pid_of(job)
    assert job.running
    until(lambda: not job.running, job)
    found = job.found
    assert found is not None
    assert not job.trouble
    assert found.complete
    assert (found.evaluated, found.known, found.passive_count) == (12, 12, 1)
    assert found.top[0].value == pytest.approx(0.12 - 0.005 * 11)
    assert len(found.top) == TASK.top  # of eleven
    assert [len(s.elements) for s in found.front] == [4]
    assert found.reference is not None
    until(lambda: gone(pid), job)
    until(lambda: not job._ending, job)


@pytest.mark.parametrize(
    ("run", "said"),
    [
        (fakesearch.refused, "control.kind = off: a search needs a controller"),
        (fakesearch.broken, "ArithmeticError: no such number"),
    ],
)
def test_an_error_is_told_in_one_line(job_of: Callable[[Run], Job], run: Run, said: str) -> None:
    job = job_of(run)
    job.start(DESIGN, TASK)
    until(lambda: not job.running, job)
    assert job.trouble == said
    assert (job.found is not None) == (run is fakesearch.broken)  # what was found before stands


def test_it_runs_behind_the_page_and_heeds_no_interrupt(job_of: Callable[[Run], Job]) -> None:
    job = job_of(fakesearch.endless)
    job.start(DESIGN, TASK)
    pid = pid_of(job)
    masks = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    bit = 1 << (signal.SIGINT - 1)
    assert int(masks["SigBlk"], 16) & bit or int(masks["SigIgn"], 16) & bit  # from the first moment on
    assert os.getpriority(os.PRIO_PROCESS, pid) == min(os.getpriority(os.PRIO_PROCESS, 0) + NICER, 19)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())  # the page itself does heed it
    until(lambda: job.found is not None, job)
    os.kill(pid, signal.SIGINT)
    evaluated = job.found.evaluated if job.found else 0
    until(lambda: job.found is not None and job.found.evaluated > evaluated + 3, job)
    assert os.getpgid(pid) == pid != os.getpgid(0)
    assert os.getsid(pid) == os.getsid(0)


@pytest.mark.parametrize("run", [fakesearch.endless, fakesearch.with_helper, fakesearch.pooled])
def test_what_is_cancelled_is_gone_with_all_it_started(job_of: Callable[[Run], Job], run: Run) -> None:
    job = job_of(run)
    job.start(DESIGN, TASK)
    pid = pid_of(job)
    until(lambda: job.found is not None, job)
    found = job.found
    assert found is not None
    start = time.perf_counter()
    job.cancel()
    assert time.perf_counter() - start < 0.05  # it does not wait
    assert not job.running
    until(lambda: gone(pid) and not job._ending, job)
    if run is not fakesearch.endless:
        assert gone(found.known)
    assert job.found is found
    assert not job.trouble


def test_one_that_will_not_end_is_made_to(job_of: Callable[[Run], Job]) -> None:
    job = job_of(fakesearch.stubborn)
    job.start(DESIGN, TASK)
    pid = pid_of(job)
    until(lambda: job.found is not None, job)
    job.cancel()
    start = time.perf_counter()
    until(lambda: gone(pid), job)
    assert 0.5 * GRACE < time.perf_counter() - start < 5 * GRACE


def test_cancelled_before_it_has_begun(job_of: Callable[[Run], Job]) -> None:
    job = job_of(fakesearch.endless)
    job.start(DESIGN, TASK)
    pid = pid_of(job)
    job.cancel()
    until(lambda: gone(pid) and not job._ending, job)
    assert job.found is None
    assert not job.trouble


def test_of_several_starts_the_last_one_counts(job_of: Callable[[Run], Job]) -> None:
    job = job_of(fakesearch.quick)
    pids = []
    for elements in (4, 5, 6):
        job.start(DESIGN, Task(elements=elements))
        pids.append(pid_of(job))
    until(lambda: not job.running, job)
    assert job.found is not None
    assert job.found.task.elements == 6
    until(lambda: all(gone(pid) for pid in pids) and not job._ending, job)


@pytest.mark.parametrize(
    ("run", "number"),
    [
        (fakesearch.with_helper, signal.SIGKILL),
        (fakesearch.with_helper, signal.SIGSEGV),
        (fakesearch.pooled, signal.SIGKILL),
    ],
)
def test_one_that_is_killed_is_told_and_takes_its_workers_along(
    job_of: Callable[[Run], Job], run: Run, number: signal.Signals
) -> None:
    job = job_of(run)
    job.start(DESIGN, TASK)
    until(lambda: job.found is not None, job)
    assert job.found is not None
    os.kill(pid_of(job), number)
    until(lambda: not job.running, job)
    assert number.name in job.trouble
    assert len(job.found.top) == 1
    until(lambda: gone(job.found.known) if job.found else False, job)
    job.start(DESIGN, TASK)  # and the next one runs
    until(lambda: job.found is not None, job)
    assert not job.trouble


def test_following_never_waits_and_a_page_that_does_not_listen_does_no_harm(job_of: Callable[[Run], Job]) -> None:
    job = job_of(fakesearch.chatty)
    job.start(DESIGN, TASK)
    longest, end = 0.0, time.perf_counter() + PATIENCE
    while job.running:
        assert time.perf_counter() < end
        begun = time.perf_counter()
        job.follow()
        longest = max(longest, time.perf_counter() - begun)
        time.sleep(0.02)
    assert longest < 0.1  # a message is read in a millisecond; the rest is what a busy machine takes for itself
    assert job.found is not None
    assert job.found.complete


def test_it_does_not_outlive_a_page_that_is_killed(tmp_path: Path) -> None:
    note = tmp_path / "pids"
    path = os.pathsep.join(filter(None, sys.path))
    page = subprocess.Popen([sys.executable, fakesearch.__file__, str(note)], env=os.environ | {"PYTHONPATH": path})
    try:
        until(lambda: note.exists() and len(note.read_text().split()) == 3)
        job, helper, _ = map(int, note.read_text().split())
        assert not gone(job)
        assert not gone(helper)
    finally:
        page.kill()
        page.wait()
    until(lambda: gone(job) and gone(helper))


def test_a_page_that_forgets_to_close_does_not_hang() -> None:
    path = os.pathsep.join(filter(None, sys.path))
    code = (
        "if __name__ == '__main__':\n"
        "    import fakesearch, time\n"
        "    from flutterviz.jobs import Job\n"
        "    job = Job(fakesearch.endless)\n"
        "    job.start(fakesearch.DESIGN, fakesearch.Task(elements=6))\n"
        "    while job.found is None:\n"
        "        job.follow()\n"
        "        time.sleep(0.02)\n"
        "    print(job._process.pid)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=True,
    )
    until(lambda: gone(int(done.stdout)))
    assert not done.stderr
