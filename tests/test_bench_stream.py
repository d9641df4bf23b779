"""The benchmark of the page, for a moment of each thing: what it counts is plausible, and nothing of it is left."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from flutterviz.bench import served, stream
from flutterviz.bench.served import Arrival, Report, Stretch

SECONDS = 0.7


@pytest.fixture(scope="module")
def reports() -> tuple[Report, Report]:
    return stream._in_a_process(served.stream_report, SECONDS), stream._in_a_process(served.explorer_report, SECONDS)


def children() -> set[int]:
    """Processes under this one, however deep."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(status.parent.name)] = int(status.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended meanwhile
            continue
    found, deeper = set(), {os.getpid()}
    while deeper:
        deeper = {pid for pid, parent in parents.items() if parent in deeper} - found
        found |= deeper
    return found


def test_pictures_are_drawn_and_arrive_at_no_more_than_the_asked_rate(reports: tuple[Report, Report]) -> None:
    for report in reports:  # in all, since on a busy machine a picture may arrive in a later stretch than its own
        begin, end = report.stretches[0].begin, report.stretches[-1].end
        arrived = sum(arrival.picture and begin <= arrival.time <= end for arrival in report.arrivals)
        # each stretch, and what is drawn before it, may begin and end with a picture; 10 may be under way at the first
        assert arrived <= 30 * (end - begin) + 4 * len(report.stretches) + 10
    for report, names in (
        (reports[0], ("ours", "plain")),
        (reports[1], ("rest", "toggling", "toggling beside a search")),
    ):
        for name in names:
            stretches = report.named(name)
            drawn = sum(len(stretch.pictures) for stretch in stretches)
            seconds = sum(stretch.end - stretch.begin for stretch in stretches)
            arrived = sum(arrival.picture for stretch in stretches for arrival in report.arrived(stretch))
            assert 1 < drawn <= 30 * seconds + 2 * len(stretches)  # no more than asked; fewer on a busy machine
            assert arrived > 0
            assert all(0 < stretch.processor < 4 * (stretch.end - stretch.begin) for stretch in stretches)


def test_every_click_came_to_life(reports: tuple[Report, Report]) -> None:
    for name in ("toggling", "toggling beside a search"):
        (stretch,) = reports[1].named(name)
        # one at least and each answered; no two within a third of a second
        assert 1 <= len(stretch.clicks) <= SECONDS / served.TOGGLES[0] + 1
        assert all(0 < click <= stretch.end - stretch.begin for click in stretch.clicks)
    assert len(reports[1].in_place) >= 2


def test_figures_are_numbers_with_what_is_asked_of_them(
    reports: tuple[Report, Report], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = iter(reports)
    monkeypatch.setattr(stream, "_in_a_process", lambda report, seconds: next(seen))
    figures = stream.measured(SECONDS)
    assert [(figure.name, figure.unit, figure.target) for figure in figures] == [
        ("stream 97 x 49 surface at 30 a second", "% of a core", 12.0),
        ("explorer with plots at 30 a second", "% of a core", 25.0),
        ("bytes a frame", "kB", None),
        ("click to live model, 95th percentile", "ms", 100.0),
        ("longest frame gap, toggling at random", "ms", 100.0),
        ("longest frame gap, toggling beside a search", "ms", 150.0),
    ]
    for figure in figures:
        assert figure.baseline is not None
        assert math.isfinite(figure.value)
        assert figure.spread[0] <= figure.value <= figure.spread[1]
        assert 0 < figure.baseline.value < math.inf
    # 6,832 vertices and their colours, packed by viser; the same of the plain mesh, which has no grid and no frames
    assert 20 < figures[2].value < 80
    # the surface is a part of what the explorer sends; a moment of each is short, so by a wide margin
    assert figures[0].value < 2 * figures[1].value


def test_gaps_and_shares_are_what_they_are_called() -> None:
    moments = (0.0, 0.03, 0.15, 0.18)
    stretch = Stretch("rest", 0.0, 0.2, 0.05, moments)
    np.testing.assert_allclose(stream._gaps([stretch, stretch]), [30, 120, 30, 30, 120, 30])
    assert stream._share(stretch) == pytest.approx(25.0)
    arrivals = (
        Arrival(0.01, 40_000, True),
        Arrival(0.02, 2_000, False),
        Arrival(0.1, 42_000, True),
        Arrival(9.0, 1, True),
    )
    report = Report((stretch,), arrivals)
    assert stream._kilobytes(report, stretch) == pytest.approx(42.0)  # all that came, by pictures
    figure = stream._gap("toggling", [stretch], [stretch], report, 100.0)
    assert figure.value == pytest.approx(120.0)
    assert figure.met is False
    assert "1 over 100 ms" in figure.note


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks at processes in /proc")
def test_nothing_is_left_of_it(reports: tuple[Report, Report]) -> None:
    end = time.monotonic() + 20
    names = {"spawn_main", "flutterviz"}
    while left := [pid for pid in children() if any(name in _command(pid) for name in names)]:
        assert time.monotonic() < end, [_command(pid) for pid in left]
        time.sleep(0.1)


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks at processes in /proc")
def test_nothing_is_left_after_ctrl_c() -> None:
    code = "from flutterviz.bench.stream import measured; measured(60.0)"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, start_new_session=True) as bench:
        end, inside = time.monotonic() + 60, set()
        while len(inside) < 2 and time.monotonic() < end:  # the server, and the page that reads
            time.sleep(0.1)
            inside = {pid for pid in children() if "spawn_main" in _command(pid)}
        assert len(inside) >= 2
        os.killpg(bench.pid, signal.SIGINT)
        assert b"KeyboardInterrupt" in bench.communicate(timeout=60)[1]
    end = time.monotonic() + 20
    while left := [pid for pid in inside if "spawn_main" in _command(pid)]:
        assert time.monotonic() < end, left
        time.sleep(0.1)
