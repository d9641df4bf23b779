"""Owns the validation table as it is shown: on the terminal, and as the Markdown that README carries."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from solver import DesignError
from solver.case import Case

BEGIN, END = "<!-- flutterviz check: begin -->", "<!-- flutterviz check: end -->"
ROUNDING = 1e-9
HEADS = ("case", "ours", "reference", "off by", "tolerance", "paper", "reference by")


def cells(case: Case) -> tuple[str, ...]:
    """The texts of a row, under `HEADS`."""
    return (
        case.name,
        "none" if case.value is None else f"{case.value:.6g}",
        f"{case.reference:.6g}",
        _off(case),
        f"{case.tol:.0e}",
        "" if case.seed is None else f"{case.seed:g}",
        case.source,
    )


def _off(case: Case) -> str:
    """Relative distance from the reference; what is rounding alone, and differs from machine to machine, is 0."""
    if case.value is None:
        return ""
    off = abs(case.value - case.reference) / abs(case.reference or 1)
    return f"{off:.0e}" if off > ROUNDING else "0"


def terminal_table(cases: list[Case]) -> Table:
    """The table for a terminal, misses in red."""
    table = Table(*HEADS[:-1], "", title="validation")
    for case in cases:
        table.add_row(*cells(case)[:-1], "ok" if case.ok else "MISS", style=None if case.ok else "bold red")
    return table


def markdown(cases: list[Case]) -> str:
    """The table in Markdown, under a line that counts."""
    met = sum(case.ok for case in cases)
    rows = [HEADS, ("---",) * len(HEADS), *(cells(case) for case in cases)]
    lines = ["| " + " | ".join(text.replace("|", "\\|") for text in row) + " |" for row in rows]
    return "\n".join([f"{met} of {len(cases)} within tolerance.", "", *lines, ""])


def write_into(path: Path, cases: list[Case]) -> None:
    """Put the table between the marks of a Markdown file, in place of what stood there.

    Raises:
        DesignError: the file cannot be read, or has no marks.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DesignError(f"{path}: cannot be read ({error})") from None
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DesignError(f"{path}: has no lines {BEGIN} and {END} to put the table between")
    path.write_text(f"{before}{BEGIN}\n{markdown(cases)}{END}{after}", encoding="utf-8")
