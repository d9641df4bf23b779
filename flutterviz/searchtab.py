"""Owns the Search tab: what is to be looked for, how far the search is, and the ranking, a button a layout."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

import viser

from flutterviz.finder import (
    MOST_ELEMENTS,
    CancelSearch,
    ClearSearch,
    Finder,
    LoadFound,
    SearchWish,
    SetTask,
    StartSearch,
)
from flutterviz.searchwords import (
    basis_words,
    best_words,
    changed_words,
    clock_words,
    count_words,
    passive_words,
    row_hint,
    row_words,
    stage_words,
    task_words,
)
from flutterviz.surface import MARK
from solver import Design
from solver.score import Score
from solver.task import Method, Objective

# Button groups, not dropdowns: a dropdown keeps the focus, and keys then type into it instead of acting.
METHODS: dict[str, Method] = {
    "Iterative": "iterative",
    "NFCG": "nfcg",
    "Greedy": "greedy",
    "All": "exhaustive",
    "Genetic": "genetic",
}
OBJECTIVES: dict[str, Objective] = {"Worst": "robust", "Seed run": "seed", "Energy": "energy", "Reach": "reach"}
METHOD_HINT = (
    "Iterative: the paper's, at random around the highest NFCG; NFCG: elements of the highest gain, and sets grown of "
    "them; Greedy: add, remove, swap; All: every rectangle; Genetic: NSGA-II over objective and number"
)
OBJECTIVE_HINT = (
    "Worst: damping time, the worst over phases; Seed run: its damping time; Energy: ∫V² dt until damped; "
    "Reach: λ up to which the limit cycle is ended"
)
ROWS = 8
EMPTY = "Nothing searched yet. Press Search: the best layout so far is marked on the panel, beside what moves."
SMALL = "font-size:.8em;opacity:.85;padding:2px 6px"
COLOUR = "#{:02x}{:02x}{:02x}".format(*MARK)


class SearchTab:
    """Widgets of the search, in a tab that the caller has opened."""

    def __init__(self, gui: viser.GuiApi, finder: Finder, send: Callable[[SearchWish], None]) -> None:
        """Add all widgets; `send` takes what the user does, from any thread."""
        self._send = send
        self._shown: tuple[Score, ...] = ()  # what the rows say at this moment
        self._passive: Score | None = None
        # What is watched comes first, and what is set once below it: a laptop shows but a few rows of the tab.
        self._task = gui.add_html("")
        self._start = gui.add_button("Search", icon=viser.Icon.SEARCH, hint="Search on the design as it is now")
        self._end = gui.add_button_group("Stop", ("Cancel", "Clear"), hint="Clear also forgets what was found")
        self._news = gui.add_html("")
        self._rows = [gui.add_button(str(k + 1), color="gray", visible=False) for k in range(ROWS)]
        self._lightest = gui.add_button("Load the lightest", color="gray", visible=False)
        with gui.add_folder("What to look for"):
            self._method = gui.add_button_group("Method", tuple(METHODS), hint=METHOD_HINT)
            self._objective = gui.add_button_group("By", tuple(OBJECTIVES), hint=OBJECTIVE_HINT)
            self._elements = gui.add_slider(
                "elements", 1, MOST_ELEMENTS, 1, finder.task.elements or 1, hint="Most elements that a layout patches"
            )
            self._symmetric = gui.add_checkbox(
                "symmetric", finder.task.symmetric, hint="Only layouts symmetric about y = b/2: a fraction of the time"
            )
        self._connect()

    def _connect(self) -> None:
        send = self._send

        @self._method.on_click
        async def _(_: object) -> None:
            send(SetTask("method", METHODS[self._method.value]))

        @self._objective.on_click
        async def _(_: object) -> None:
            send(SetTask("objective", OBJECTIVES[self._objective.value]))

        @self._elements.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                send(SetTask("elements", int(self._elements.value)))

        @self._symmetric.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                send(SetTask("symmetric", bool(self._symmetric.value)))

        @self._start.on_click
        async def _(_: object) -> None:
            send(StartSearch())

        @self._end.on_click
        async def _(_: object) -> None:
            send(CancelSearch() if self._end.value == "Cancel" else ClearSearch())

        @self._lightest.on_click
        async def _(_: object) -> None:
            if self._passive is not None:
                send(LoadFound(self._passive))

        for place, button in enumerate(self._rows):
            self._load_on_click(place, button)

    def _load_on_click(self, place: int, button: viser.GuiButtonHandle) -> None:
        @button.on_click
        async def _(_: object) -> None:
            if place < len(self._shown):  # what the row says now, not what the search has found since
                self._send(LoadFound(self._shown[place]))

    def refresh(self, finder: Finder, present: Design) -> None:
        """Show the task, how far the search is, and what it has found; a widget is written only where it differs."""
        task = f'<div style="{SMALL};padding-right:14px">{escape(task_words(finder.task))}</div>'
        news = _news(finder, present)
        for handle, text in ((self._task, task), (self._news, news)):
            if handle.content != text:
                handle.content = text
        running = finder.phase == "running"
        if self._start.disabled != running:
            self._start.disabled = running
            self._start.label = "Searching …" if running else "Search"
        idle = finder.phase == "idle"
        if self._end.visible == idle:
            self._end.visible = not idle
        self._show_rows(finder, present)

    def _show_rows(self, finder: Finder, present: Design) -> None:
        found = finder.found
        self._shown = found.top[:ROWS] if found is not None else ()
        self._passive = found.passive[0] if found is not None and found.passive else None
        for place, button in enumerate(self._rows):
            score = self._shown[place] if place < len(self._shown) else None
            if score is None or found is None:
                _write(button, button.label, button.hint, visible=False, here=False)
                continue
            here = finder.design_of(score) == present
            _write(button, row_words(place + 1, score, found.task), row_hint(score), visible=True, here=here)
        if self._passive is None:
            _write(self._lightest, self._lightest.label, self._lightest.hint, visible=False, here=False)
        else:
            here = finder.design_of(self._passive) == present
            label = f"Load the lightest: {len(self._passive.elements)} elements"
            _write(self._lightest, label, row_hint(self._passive), visible=True, here=here)


def _write(button: viser.GuiButtonHandle, label: str, hint: str | None, visible: bool, here: bool) -> None:
    """Show a layout on a button, with a tick if it is on the panel now; only what differs is sent."""
    icon = viser.Icon.CHECK if here else None
    if button.label != label:
        button.label = label
    if button.hint != hint:
        button.hint = hint
    if button.icon != icon:
        button.icon = icon
    if button.visible != visible:
        button.visible = visible


def _news(finder: Finder, present: Design) -> str:
    """How the search stands, as a card."""
    found, searched = finder.found, finder.design
    if finder.phase == "idle" or searched is None:
        return f'<div id="flutterviz-search" style="{SMALL}">{escape(EMPTY)}</div>'
    word = {"running": "Searching", "finished": "Finished", "cancelled": "Cancelled", "failed": "Ended"}[finder.phase]
    lines = [f"<b>{word}</b> at {escape(basis_words(searched))}"]
    if finder.trouble:
        lines.append(f"! {escape(finder.trouble)}")
    if found is not None:
        lines.append(escape(count_words(found, finder.seconds)))
        if finder.phase == "running":
            lines.append(escape(stage_words(found)))
        best, reference = best_words(found)
        swatch = f'<span style="color:{COLOUR}">▣</span> ' if finder.marks_on(present) else ""
        lines.append(f"{swatch}<b>{escape(best)}</b>")
        lines += [escape(line) for line in (reference, passive_words(found)) if line]
    elif finder.phase == "running":
        lines.append(f"starting … {clock_words(finder.seconds)}")
    changed = changed_words(searched, present)
    if changed:
        lines.append(f"! the panel has {escape(changed)} now: these figures do not hold for it")
    return (
        f'<div id="flutterviz-search" style="margin:2px 4px;padding:6px 10px;border-left:4px solid {COLOUR};'
        f'border-radius:4px;background:rgba(128,136,150,.10);font-size:.82em">{"<br>".join(lines)}</div>'
    )
