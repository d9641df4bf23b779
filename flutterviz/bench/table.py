"""Owns how figures are shown: on the terminal, in Markdown, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict

from rich.markup import escape
from rich.table import Table

from flutterviz.bench.figure import Figure
from flutterviz.bench.machine import Machine

HEADS = ("figure", "median", "lowest … highest", "target", "", "baseline", "times better")
MARKS = {True: "met", False: "MISSED", None: "–"}
NONE = "–"


def cells(figure: Figure) -> tuple[str, ...]:
    """The texts of a row, under `HEADS`."""
    low, high = figure.spread
    bound = "≤" if figure.sense == "at most" else "≥"
    baseline = figure.baseline
    known = math.isfinite(figure.value)
    return (
        figure.name,
        _number(figure.value, figure.unit) if known else "not measured",
        f"{_digits(low)} … {_digits(high)}" if known else NONE,
        NONE if figure.target is None else f"{bound} {_number(figure.target, figure.unit)}",
        MARKS[figure.met],
        NONE if baseline is None else _number(baseline.value, figure.unit),
        NONE if figure.ratio is None or not math.isfinite(figure.ratio) else _digits(figure.ratio),
    )


def terminal_table(figures: Sequence[Figure]) -> Table:
    """The table for a terminal; what is missed says so in words and is red as well."""
    table = Table(title="benchmark")
    for head in HEADS:
        table.add_column(head, justify="left" if head in ("figure", "") else "right", overflow="fold")
    for figure in figures:
        good = figure.met is not False and math.isfinite(figure.value)
        table.add_row(*(escape(text) for text in cells(figure)), style=None if good else "bold red")
    return table


def notes(figures: Sequence[Figure]) -> str:
    """Baseline and note of the figures, a line for all that share them, and how many targets are met."""
    shared: dict[str, list[str]] = {}
    for figure in figures:
        beside = "" if figure.baseline is None else f"baseline is {figure.baseline.name}"
        if beside or figure.note:
            shared.setdefault("; ".join(filter(None, [beside, figure.note])), []).append(figure.name)
    asked = [figure for figure in figures if figure.target is not None]
    met = sum(bool(figure.met) for figure in asked)
    lines = [f"{'; '.join(names)}: {note}" for note, names in shared.items()]
    return "\n".join([*lines, f"{met} of {len(asked)} targets met"])


def markdown(machine: Machine, figures: Sequence[Figure]) -> str:
    """The table in Markdown, under the machine's name and over the notes."""
    head = ("---", "--:", "--:", "--:", "---", "--:", "--:")
    rows = [HEADS, head, *(cells(figure) for figure in figures)]
    lines = ["| " + " | ".join(text.replace("|", "\\|") for text in row) + " |" for row in rows]
    told_below = [f"- {line}" for line in notes(figures).splitlines()]
    return "\n".join([f"Measured on {machine}.", "", *lines, "", *told_below, ""])


def told(machine: Machine, figures: Sequence[Figure]) -> dict[str, object]:
    """What `--json` prints; a number that is not known is null."""
    return {"machine": asdict(machine), "figures": [_plain(figure) for figure in figures]}


def _plain(figure: Figure) -> dict[str, object]:
    low, high = figure.spread
    baseline = figure.baseline
    return {
        "name": figure.name,
        "value": _finite(figure.value),
        "unit": figure.unit,
        "low": _finite(low),
        "high": _finite(high),
        "target": _finite(figure.target),
        "sense": figure.sense,
        "met": None if figure.met is None else bool(figure.met),
        "baseline": None if baseline is None else {"name": baseline.name, "value": _finite(baseline.value)},
        "ratio": _finite(figure.ratio),
        "note": figure.note,
    }


def _finite(value: float | None) -> float | None:
    """A plain float, or None for what is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def _number(value: float, unit: str) -> str:
    return _digits(value) if unit in ("", "-") else f"{_digits(value)} {unit}"


def _digits(value: float) -> str:
    """Three digits or so, and never a power of ten for milliseconds that are seconds."""
    return f"{value:.0f}" if 999.5 <= abs(value) < 1e6 else f"{value:.3g}"
