"""Owns the pictures that commands draw into files: V-g diagram and root locus, and bifurcation diagrams."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from solver import DesignError, FlutterFacts, SweepRow
from solver.mesh import Floats

ENDINGS = (".png", ".svg", ".pdf")
UP, DOWN, QUIET = "#2f7fd1", "#d0453e", "#8a8f98"


def check_picture(path: Path) -> None:
    """Refuse a file that could not be drawn to, before anything is computed for it.

    Raises:
        DesignError: the ending is none that is drawn, or the folder does not exist.
    """
    if path.suffix.lower() not in ENDINGS:
        raise DesignError(f"{path}: a picture ends in {', '.join(ENDINGS)}")
    if path.is_dir():
        raise DesignError(f"{path}: is a folder")
    if not path.absolute().parent.is_dir():
        raise DesignError(f"{path}: there is no folder {path.parent}")


def draw_roots(facts: FlutterFacts, path: Path) -> None:
    """Draw damping g and frequency of every root over λ, and the roots in the complex plane."""
    from matplotlib.figure import Figure  # here, because few runs draw

    pressures = np.array(facts.dynamic_pressures)
    growth, hertz, g = (np.array(part) for part in (facts.growth_rates, facts.root_frequencies_hz, facts.damping_g))
    figure = Figure(figsize=(11, 6.2), layout="constrained")
    axes = figure.subplot_mosaic([["g", "plane"], ["f", "plane"]])
    # what flutters lies low; the highest roots would only squeeze it
    shown = hertz[0] <= 4 * max(facts.flutter_frequency_hz or 0.0, hertz[0].min() * 4)
    for k in np.flatnonzero(shown):
        axes["g"].plot(pressures, g[:, k], lw=1.4)
        axes["f"].plot(pressures, hertz[:, k], lw=1.4)
        (line,) = axes["plane"].plot(growth[:, k], hertz[:, k], lw=1.2)
        axes["plane"].plot(growth[0, k], hertz[0, k], "o", ms=4, color=line.get_color())
    for name in ("g", "f"):
        if facts.lambda_cr is not None:
            axes[name].axvline(facts.lambda_cr, color=QUIET, ls="--", lw=1)
        axes[name].set_xlabel("dynamic pressure λ")
    if facts.lambda_cr is not None:
        axes["g"].set_title(f"λ_cr = {facts.lambda_cr:.2f}", fontsize=10)
    axes["g"].axhline(0, color=QUIET, lw=0.8)
    axes["plane"].axvline(0, color=QUIET, lw=0.8)
    axes["g"].set_ylabel("damping g = 2 Re s / |s|")
    axes["f"].set_ylabel("frequency [Hz]")
    axes["plane"].set(xlabel="growth rate [1/s]", ylabel="frequency [Hz]", title="root locus, from λ = 0 (dots)")
    figure.savefig(path, dpi=150)


def draw_sweep(rows: list[SweepRow], field: str, path: Path) -> None:
    """Draw limit-cycle amplitude, growth and damping time over the parameter, up and down apart."""
    from matplotlib.figure import Figure

    driven = any(row.closed_loop_growth_per_s not in (None, row.growth_per_s) for row in rows)
    timed = any(row.damping_time_s is not None for row in rows)
    figure = Figure(figsize=(8, 8.5 if timed else 6), layout="constrained")
    plots = figure.subplots(3 if timed else 2, sharex=True)
    cycle, growth = plots[0], plots[1]
    for direction, marker, colour in (("up", "^", UP), ("down", "v", DOWN)):
        own = sorted((row for row in rows if row.direction == direction), key=lambda row: row.value)
        amplitudes = _drawn([row.lco_amplitude_over_h for row in own])
        cycle.plot([row.value for row in own], amplitudes, marker=marker, ms=5, lw=1, color=colour, label=direction)
    upward = [row for row in rows if row.direction == "up"]
    values = [row.value for row in upward]
    growth.plot(values, [row.growth_per_s for row in upward], color=UP, label="uncontrolled")
    if driven:
        closed = _drawn([row.closed_loop_growth_per_s for row in upward])
        growth.plot(values, closed, color=DOWN, label="controlled")
        growth.legend(frameon=False)
    growth.axhline(0, color=QUIET, lw=0.8)
    growth.set_ylabel("growth rate [1/s]")
    if timed:
        times = 1e3 * _drawn([row.damping_time_s for row in upward])
        plots[2].plot(values, times, marker="o", ms=4, lw=1, color=UP)
        plots[2].set_ylabel("damping time [ms]")
    cycle.set_ylabel("limit cycle, w/h at 0.75 a")
    cycle.legend(frameon=False)
    plots[-1].set_xlabel(field)
    figure.savefig(path, dpi=150)


def _drawn(values: Sequence[float | None]) -> Floats:
    """Values to draw, with a gap where there is none."""
    return np.array([np.nan if value is None else value for value in values])
