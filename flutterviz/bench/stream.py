"""Owns the figures of the page: what it costs to draw, how soon a click is live, how long a picture is waited for."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from flutterviz.bench.figure import Baseline, Figure
from flutterviz.bench.served import Report, Stretch, explorer_report, stream_report
from flutterviz.beside import Beside

SECONDS = 30.0  # of each thing that is measured
QUICK = 5.0
PLAIN = "viser's mesh, added anew for each picture"
LATE = 100.0  # ms without a picture, which the eye notices


def measure(quick: bool) -> list[Figure]:
    """Serve the panel alone, then the explorer, to a page that reads and draws nothing.

    Args:
        quick: 5 s of each thing instead of 30.
    """
    return measured(QUICK if quick else SECONDS)


def measured(seconds: float) -> list[Figure]:
    """The figures, from so many seconds of each thing."""
    stream, explorer = _in_a_process(stream_report, seconds), _in_a_process(explorer_report, seconds)
    ours, plain = stream.named("ours"), stream.named("plain")
    share = Baseline(PLAIN, _median(map(_share, plain)))
    reader = "the page is a client that unpacks all and draws nothing: drawn by software, it would take both cores"
    return [
        _costs("stream 97 x 49 surface at 30 a second", ours, 12.0, share, reader),
        _costs("explorer with plots at 30 a second", explorer.named("rest"), 25.0, share, reader),
        _bytes(stream),
        _latency(explorer),
        _gap("toggling at random", explorer.named("toggling"), explorer.named("rest"), explorer, 100.0),
        _gap(
            "toggling beside a search",
            explorer.named("toggling beside a search"),
            explorer.named("rest beside a search"),
            explorer,
            150.0,
        ),
    ]


def _in_a_process(report: Callable[[float], Report], seconds: float) -> Report:
    """A report from a process of its own, which is gone in the end, with all that it has begun."""
    beside = Beside()
    try:
        return beside.submit(report, seconds).result()
    finally:
        beside.shutdown()


def _costs(name: str, stretches: list[Stretch], target: float, baseline: Baseline, note: str) -> Figure:
    shares = [_share(stretch) for stretch in stretches]
    rate = _median(len(stretch.pictures) / (stretch.end - stretch.begin) for stretch in stretches)
    return Figure(
        name,
        _median(shares),
        "% of a core",
        (min(shares), max(shares)),
        target,
        baseline=baseline,
        note=f"{rate:.1f} pictures a second, the server's process alone; {note}",
    )


def _share(stretch: Stretch) -> float:
    return 100 * stretch.processor / (stretch.end - stretch.begin)


def _bytes(stream: Report) -> Figure:
    sizes, plain = ([_kilobytes(stream, s) for s in stream.named(name)] for name in ("ours", "plain"))
    note = "on the wire, with six elements patched"
    return Figure(
        "bytes a frame",
        _median(sizes),
        "kB",
        (min(sizes), max(sizes)),
        None,
        baseline=Baseline(PLAIN, _median(plain)),
        note=note,
    )


def _kilobytes(stream: Report, stretch: Stretch) -> float:
    arrived = stream.arrived(stretch)
    return sum(arrival.size for arrival in arrived) / 1e3 / max(sum(arrival.picture for arrival in arrived), 1)


def _latency(explorer: Report) -> Figure:
    clicks = 1e3 * np.array([click for stretch in explorer.named("toggling") for click in stretch.clicks])
    searching = [click for stretch in explorer.named("toggling beside a search") for click in stretch.clicks]
    in_place = 1e3 * np.percentile(explorer.in_place, 95)
    note = f"{len(clicks)} clicks, median {np.median(clicks):.0f} ms"
    note += f"; beside a search {1e3 * np.percentile(searching, 95):.0f} ms"
    return Figure(
        "click to live model, 95th percentile",
        float(np.percentile(clicks, 95)),
        "ms",
        (float(clicks.min()), float(clicks.max())),
        100.0,
        baseline=Baseline("the rig alone, built in place while the panel stands still", float(in_place)),
        note=note,
    )


def _gap(name: str, toggling: list[Stretch], rest: list[Stretch], explorer: Report, target: float) -> Figure:
    gaps, still = _gaps(toggling), _gaps(rest)
    arrivals = [[a.time for a in explorer.arrived(stretch) if a.picture] for stretch in toggling]
    seen = max(1e3 * float(np.diff(times).max()) for times in arrivals)
    late = int((gaps > LATE).sum())
    note = f"of {len(gaps)}, median {np.median(gaps):.0f} ms, {late} over {LATE:.0f} ms; at the page {seen:.0f} ms"
    return Figure(
        f"longest frame gap, {name}",
        float(gaps.max()),
        "ms",
        (float(gaps.min()), float(gaps.max())),
        target,
        baseline=Baseline("the longest while nobody clicks", float(still.max())),
        note=note,
    )


def _gaps(stretches: list[Stretch]) -> np.ndarray:
    """Times between pictures that follow each other [ms]."""
    return 1e3 * np.concatenate([np.diff(stretch.pictures) for stretch in stretches])


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))
