"""Owns the words on a search: how far it is, what it has found, and how much better that is than NFCG's layout."""

from __future__ import annotations

from flutterviz.found import Found
from solver import Design, Stream
from solver.score import Score
from solver.task import TITLES, UNITS, Method, Task

METHOD_WORDS: dict[Method, str] = {
    "nfcg": "NFCG",
    "iterative": "Iterative",
    "greedy": "Greedy",
    "exhaustive": "All rectangles",
    "genetic": "Genetic",
}
AT_ONCE: tuple[Method, ...] = ("nfcg", "exhaustive")  # name all their layouts at once, so that an end is in sight
TRUSTED = 5  # layouts after which the time left is worth telling
CONTROL_WORDS = {"lqr": "LQR", "lqg": "LQG", "rate": "rate feedback", "off": "no controller"}


def value_words(value: float, task: Task) -> str:
    """A value of a task's objective, with its unit."""
    if task.objective == "reach":
        return f"λ = {value:.0f}"
    if UNITS[task.objective] == "s":
        return f"{value:.4f} s"
    return f"{value:.0f} {UNITS[task.objective]}" if value >= 1000 else f"{value:.4g} {UNITS[task.objective]}"


def task_words(task: Task) -> str:
    """What is looked for."""
    wanted = "largest" if task.descending else "least"
    number = f"at most {_elements(task.elements or 1)}, {'symmetric' if task.symmetric else 'symmetric or not'}"
    return f"{METHOD_WORDS[task.method]}, for the {wanted} {TITLES[task.objective]}; {number}"


def layout_words(score: Score, task: Task) -> str:
    """A layout in a few words: how many elements, and what they give."""
    count = _elements(len(score.elements))
    return f"{count}, passive" if score.value is None else f"{count}, {value_words(score.value, task)}"


def row_words(place: int, score: Score, task: Task) -> str:
    """A row of the ranking: place, number of elements, objective, and the seed's run beside it."""
    assert score.value is not None
    words = [str(place), f"{len(score.elements)} el.", value_words(score.value, task)]
    if task.objective != "seed" and score.damping_time_s is not None:
        words.append(f"seed {score.damping_time_s:.3f} s")
    elif task.objective == "seed" and score.robust_damping_time_s is not None:
        words.append(f"worst {score.robust_damping_time_s:.3f} s")
    return " · ".join(words) + (" !" if score.state == "in part" else "")


def row_hint(score: Score) -> str:
    """What a row says when the mouse rests on it."""
    words = f"Load it: elements {', '.join(map(str, score.elements))}; {_channels(score.channels)}"
    if score.lambda_cr is not None:
        words += f"; λ_cr {score.lambda_cr:.0f}"
    if score.peak_voltage_v is not None:
        words += f"; peak {score.peak_voltage_v:.0f} V"
    return words + ("; ! a motion that the limit cycle does not excite grows" if score.state == "in part" else "")


def count_words(found: Found, seconds: float) -> str:
    """How much a search has done: layouts looked at and run, how fast, for how long [s]."""
    rate = found.evaluated / max(found.elapsed, 1e-3)
    return f"{found.evaluated} looked at · {found.measured} run · {rate:.1f} /s · {clock_words(seconds)}"


def stage_words(found: Found) -> str:
    """What a search is at, and how much longer that takes at most, where an end is in sight."""
    words = f"{'screening' if found.stage == 'screen' else 'running'} {found.done} of {found.due}"
    if found.task.method not in AT_ONCE or found.stage == "screen" or found.done < TRUSTED:
        return words
    left = (found.due - found.done) * found.in_stage / found.done
    return f"{words} · at most {clock_words(left)} left"


def clock_words(seconds: float) -> str:
    """A stretch of wall time in minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def best_words(found: Found) -> tuple[str, str]:
    """The best layout so far, and NFCG's beside it with what is gained."""
    task, reference = found.task, found.reference
    best = found.top[0] if found.top else None
    first = f"Best: {layout_words(best, task)}" if best is not None else "Nothing yet that ends the limit cycle"
    if best is None and found.complete:
        first = "No layout ends the limit cycle: allow more elements, or lower λ"
    if reference is None:
        return first, ""
    second = f"NFCG's {len(reference.elements)}: "
    if reference.value is None:
        return first, second + reference.state
    second += value_words(reference.value, task)
    return first, second + (f", {_gain(best.value, reference.value, task)}" if best and best.value else "")


def passive_words(found: Found) -> str:
    """What is said of the layouts that end the flutter by stiffness and mass alone; empty if there are none."""
    if not found.passive_count:
        return ""
    many = "1 layout ends" if found.passive_count == 1 else f"{found.passive_count} layouts end"
    lightest = _elements(len(found.passive[0].elements))
    return f"{many} the flutter passively, and {'is' if found.passive_count == 1 else 'are'} not ranked: {lightest}" + (
        " at the least" if found.passive_count > 1 else ""
    )


def result_words(found: Found | None) -> str:
    """A search that is over, for the log."""
    if found is None:
        return "nothing was looked at"
    return f"{found.evaluated} layouts looked at, {found.measured} run; {'; '.join(filter(None, best_words(found)))}"


def basis_words(design: Design) -> str:
    """What a search's figures hold for."""
    return f"λ = {Stream.of(design).dynamic_pressure:g}, {CONTROL_WORDS[design.control.kind]}"


def changed_words(searched: Design, present: Design) -> str:
    """What has changed since a search began, of what its figures depend on; empty if nothing has."""
    before, now = Stream.of(searched).dynamic_pressure, Stream.of(present).dynamic_pressure
    bare = present.with_elements(searched.patches.elements)  # which elements are patched is what is searched for
    parts = {
        "another panel": (searched.panel, searched.load) != (bare.panel, bare.load),
        "another mesh or basis": (searched.mesh, searched.reduction) != (bare.mesh, bare.reduction),
        f"λ = {now:g}": before != now,
        "another flow": before == now and searched.flow != bare.flow,
        "another controller": searched.control != bare.control,
        "other patches or wiring": searched.patches != bare.patches,
        "another protocol": searched.run != bare.run,
    }
    return ", ".join(what for what, changed in parts.items() if changed)


def _gain(value: float, reference: float, task: Task) -> str:
    share = 100 * (value / reference - 1)
    if task.descending:
        return f"the best goes {share:.1f} % further" if share > 0.05 else "and none goes further"
    if -share <= 0.05:
        return "and none is better"
    return f"the best is {-share:.0f} % {'less' if task.objective == 'energy' else 'sooner'}"


def _elements(count: int) -> str:
    return f"{count} element{'' if count == 1 else 's'}"


def _channels(count: int) -> str:
    return f"{count} channel{'' if count == 1 else 's'}"
