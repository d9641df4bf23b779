"""Owns how a ranking is shown on the terminal: the best layouts, the front, the passive ones, NFCG beside."""

from __future__ import annotations

from collections import Counter

from rich.table import Table

from flutterviz.tables import OUT, number
from solver import Stream
from solver.ranking import Ranking
from solver.score import Score
from solver.task import TITLES, UNITS, Task

WORDS = {
    "no controller": "without a controller",
    "unstable": "unstable under control",
    "no limit cycle": "without a limit cycle",
    "failed": "that could not be computed",
    "run failed": "whose run could not be computed",
}
REMEDIES = {
    "passive": "the patches end the flutter without control: raise λ, or allow fewer elements",
    "unstable": "look with `flutterviz control` at what grows; take another controller, or --patches.channels element",
    "no controller": "a motion is out of the patches' reach: --patches.channels element, or --no-symmetric",
}


def objective_value(task: Task, score: Score) -> str:
    """The objective of a layout with its unit."""
    if score.value is None:
        return score.state
    unit = UNITS[task.objective]
    form = ".4f" if unit == "s" else ".1f" if unit == "-" else ".4g"
    return number(score.value, f"{form} {unit}".removesuffix(" -"), "–")


def print_ranking(ranking: Ranking) -> None:
    """Show the best layouts, the front, the passive ones, and what NFCG gives beside."""
    task = ranking.task
    if ranking.ranked:
        OUT.print(_table(ranking))
    else:
        OUT.print(_nothing(ranking), highlight=False)
    if len(ranking.front) > 1:
        steps = "  ".join(f"{len(s.elements)}: {objective_value(task, s)}" for s in ranking.front)
        OUT.print(f"best by number of elements   {steps}", highlight=False)
    if ranking.reference is not None and task.method != "nfcg":
        nfcg, best = ranking.reference, ranking.best
        OUT.print(
            f"highest NFCG, {len(nfcg.elements)} elements: {objective_value(task, nfcg)}"
            + (f" · {task.method}, {len(best.elements)}: {objective_value(task, best)}" if best else ""),
            highlight=False,
        )
    if ranking.passive:
        count, shown = len(ranking.passive), min(len(ranking.passive), task.top)
        OUT.print(
            f"passive, not ranked: {_layouts(count)} in which nothing flutters without control"
            + (f"; the lightest {shown}" if shown < count else ""),
            highlight=False,
        )
        OUT.print(_passive_table(ranking))
    how = "" if ranking.complete else ", not to the end"
    OUT.print(f"looked at {_layouts(ranking.evaluated)}, {ranking.measured} of them run{how}", highlight=False)


def _layouts(count: int) -> str:
    return f"{count} layout{'' if count == 1 else 's'}"


def _nothing(ranking: Ranking) -> str:
    """Why there is no ranking, by what was found of the layouts, and what to do."""
    counts = Counter(score.state for score in ranking.scores)
    found = ", ".join(f"{count} {WORDS.get(state, state)}" for state, count in counts.most_common())
    most = counts.most_common(1)[0][0] if counts else ""
    remedy = REMEDIES.get(most, "allow more elements, or lower λ")
    return f"no layout looked at is ranked: {found or 'none was looked at'}; {remedy}"


def _passive_table(ranking: Ranking) -> Table:
    table = Table()
    for head in ("elements", "λ_cr"):
        table.add_column(head, justify="right")
    table.add_column("layout")
    for score in ranking.passive[: ranking.task.top]:
        layout = shape(score.elements, ranking.design.mesh.ny)
        table.add_row(str(len(score.elements)), number(score.lambda_cr, ".1f", "none"), layout)
    return table


def _table(ranking: Ranking) -> Table:
    task, mesh = ranking.task, ranking.design.mesh
    table = Table(title=f"{task.method} by {TITLES[task.objective]}, λ = {_pressures(ranking)}")
    heads = ["", "elements", "channels", "worst phase [s]", "mean [s]", "seed run [s]", "peak [V]", "λ_cr"]
    heads.append("growth, controlled [1/s]")
    other = task.objective in ("reach", "energy")
    if other:
        heads.insert(3, {"reach": "up to λ", "energy": "∫V² dt [V²·s]"}[task.objective])
    for head in heads:
        table.add_column(head, justify="right")
    table.add_column("layout")
    for rank, score in enumerate(ranking.ranked[: task.top], 1):
        growth = number(score.closed_loop_growth_per_s, "+.1f", "–")
        cells = [
            number(score.robust_damping_time_s, ".4f", "–"),
            number(score.mean_damping_time_s, ".4f", "–"),
            number(score.damping_time_s, ".4f", "–"),
            number(score.peak_voltage_v, ".0f", "–"),
            number(score.lambda_cr, ".1f", "none"),
            f"{growth}, in part" if score.state == "in part" else growth,
            shape(score.elements, mesh.ny),
        ]
        first = [str(rank), str(len(score.elements)), str(score.channels)]
        value = [number(score.value, ".1f" if task.objective == "reach" else ".4g", "–")] if other else []
        table.add_row(*first, *value, *cells)
    return table


def _pressures(ranking: Ranking) -> str:
    task = ranking.task
    if task.pressures:
        return ", ".join(f"{value:g}" for value in task.pressures)
    return f"{Stream.of(ranking.design).dynamic_pressure:g}"


def shape(elements: tuple[int, ...], ny: int) -> str:
    """A layout in few characters: as a rectangle if it is one, i 3-5 j 2-3, or else by element ids."""
    rows, columns = sorted({e // ny for e in elements}), sorted({e % ny for e in elements})
    whole = len(elements) == len(rows) * len(columns)
    if whole and rows[-1] - rows[0] == len(rows) - 1 and columns[-1] - columns[0] == len(columns) - 1:
        return f"i {_span(rows)} j {_span(columns)}"
    return " ".join(str(e) for e in elements)


def _span(values: list[int]) -> str:
    return f"{values[0]}" if len(values) == 1 else f"{values[0]}-{values[-1]}"
