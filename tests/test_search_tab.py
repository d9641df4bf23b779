"""The Search tab and the finder behind it, on a real server, with searches in another process that measure nothing."""

import time
from collections.abc import Iterator
from itertools import product

import fakesearch
import msgspec
import numpy as np
import pytest
import viser
from pages import DESIGN, Page, explorer_on, rig, ticks, until

from flutterviz import commands as do
from flutterviz.app import Explorer
from flutterviz.finder import CancelSearch, ClearSearch, Finder, LoadFound, SetTask, StartSearch
from flutterviz.found import Found, found_in
from flutterviz.jobs import Job, Run
from flutterviz.searchtab import METHODS, OBJECTIVES, ROWS, SearchTab
from flutterviz.searchwords import (
    best_words,
    changed_words,
    clock_words,
    count_words,
    passive_words,
    row_words,
    stage_words,
)
from flutterviz.session import Session
from solver.score import Score
from solver.task import Objective, Task


def made(server: viser.ViserServer, run: Run) -> Explorer:
    return explorer_on(server, Job(run))


@pytest.fixture
def quick(server: viser.ViserServer) -> Iterator[tuple[Explorer, Page]]:
    """An explorer whose searches take a moment, and a page on it."""
    yield from opened(made(server, fakesearch.quick))


@pytest.fixture
def endless(server: viser.ViserServer) -> Iterator[tuple[Explorer, Page]]:
    """An explorer whose searches never end, and a page on it."""
    yield from opened(made(server, fakesearch.endless))


def opened(explorer: Explorer) -> Iterator[tuple[Explorer, Page]]:
    page = Page(explorer.server)
    until(explorer, lambda: len(explorer.server.get_clients()) == 1)
    yield explorer, page
    page.close()
    explorer.close()


def tab(explorer: Explorer) -> SearchTab:
    return explorer.controls._search


def rows(explorer: Explorer) -> list[str]:
    return [button.label for button in tab(explorer)._rows if button.visible]


def news(explorer: Explorer) -> str:
    ticks(explorer, 10)
    return tab(explorer)._news.content


def searched(explorer: Explorer, page: Page) -> Found:
    """Search, to the end."""
    page.update(tab(explorer)._start, True)
    until(explorer, lambda: explorer.finder.phase == "finished")
    ticks(explorer, 10)
    found = explorer.finder.found
    assert found is not None
    return found


# --- the tab ----------------------------------------------------------------------------------------------------------


def test_it_says_what_to_do_before_anything_is_searched(quick: tuple[Explorer, Page]) -> None:
    explorer, _ = quick
    assert "Press Search" in news(explorer)
    assert rows(explorer) == []
    assert not tab(explorer)._lightest.visible
    assert not tab(explorer)._end.visible


def test_the_widgets_set_the_task(quick: tuple[Explorer, Page]) -> None:
    explorer, page = quick
    widgets = tab(explorer)
    page.update(widgets._method, "Genetic")
    page.update(widgets._objective, "Energy")
    page.update(widgets._elements, 9)
    page.update(widgets._symmetric, False)
    wanted = Task(method="genetic", objective="energy", elements=9, symmetric=False)
    until(explorer, lambda: explorer.finder.task == wanted)
    ticks(explorer, 10)
    for said in ("Genetic", "least control energy", "9 elements", "symmetric or not"):
        assert said in widgets._task.content
    assert explorer.session.design == DESIGN
    assert not explorer.session.can_undo


def test_every_button_makes_a_task() -> None:
    session, finder = Session(DESIGN, rig()), Finder(DESIGN, Job(fakesearch.quick))
    assert finder.task.elements == len(DESIGN.patches.elements)
    for method, objective in product(METHODS.values(), OBJECTIVES.values()):
        finder.grant(SetTask("method", method), session)
        finder.grant(SetTask("objective", objective), session)
        assert (finder.task.method, finder.task.objective) == (method, objective)


def test_a_search_fills_the_ranking_and_marks_the_best(quick: tuple[Explorer, Page]) -> None:
    explorer, page = quick
    found = searched(explorer, page)
    assert len(rows(explorer)) == ROWS
    for place, text in enumerate(rows(explorer)):
        assert text == row_words(place + 1, found.top[place], found.task)
    assert explorer.scene._packer.marked == found.top[0].elements
    text = news(explorer)
    for said in ("Finished", "λ = 840", "12 looked at", "11 run", "Best: 4 elements, 0.0650 s", "36 % sooner"):
        assert said in text
    assert "1 layout ends the flutter passively" in text
    assert tab(explorer)._lightest.label == "Load the lightest: 6 elements"
    assert "elements 55, 56, 57, 58" in (tab(explorer)._rows[0].hint or "")


def test_a_row_loads_its_layout_and_undo_goes_back(quick: tuple[Explorer, Page]) -> None:
    explorer, page = quick
    found = searched(explorer, page)
    page.update(tab(explorer)._rows[2], True)
    wanted = DESIGN.with_elements(found.top[2].elements)
    until(explorer, lambda: explorer.session.design == wanted)
    ticks(explorer, 10)
    assert explorer.scene._packer.marked == ()  # what is loaded is there to be seen
    assert tab(explorer)._rows[2].icon is not None
    assert tab(explorer)._rows[0].icon is None
    until(explorer, lambda: not explorer.session.stale)
    page.key("Undo")
    until(explorer, lambda: explorer.session.design == DESIGN)
    ticks(explorer, 10)
    assert tab(explorer)._rows[2].icon is None
    assert len(rows(explorer)) == ROWS  # the results stay


def test_the_lightest_passive_layout_can_be_loaded(quick: tuple[Explorer, Page]) -> None:
    explorer, page = quick
    found = searched(explorer, page)
    page.update(tab(explorer)._lightest, True)
    until(explorer, lambda: explorer.session.design.patches.elements == found.passive[0].elements)


def test_results_say_what_they_hold_for_when_the_flow_or_the_controller_changes(
    quick: tuple[Explorer, Page], server: viser.ViserServer
) -> None:
    explorer, page = quick
    searched(explorer, page)
    assert "do not hold" not in news(explorer)
    explorer._inbox.put(do.TogglePatch(3))  # which elements are patched is what is searched for
    assert "do not hold" not in news(explorer)
    explorer._inbox.put(do.SetFlow(900.0))
    explorer._inbox.put(do.SetControl("kind", "lqg"))
    text = news(explorer)
    assert "λ = 900, another controller" in text
    assert "λ = 840, LQR" in text
    page.update(tab(explorer)._rows[0], True)  # as it was searched, not as the panel is now
    until(explorer, lambda: explorer.session.design.flow.dynamic_pressure == 840)
    assert explorer.session.design.control.kind == "lqr"
    assert "do not hold" not in news(explorer)


def test_cancel_keeps_what_was_found_and_clear_forgets_it(endless: tuple[Explorer, Page]) -> None:
    explorer, page = endless
    page.update(tab(explorer)._start, True)
    until(explorer, lambda: explorer.finder.found is not None)
    ticks(explorer, 10)
    assert tab(explorer)._start.disabled
    page.update(tab(explorer)._end, "Cancel")
    until(explorer, lambda: explorer.finder.phase == "cancelled")
    assert "Cancelled" in news(explorer)
    assert len(rows(explorer)) >= 1
    assert explorer.scene._packer.marked
    assert not tab(explorer)._start.disabled
    seconds = explorer.finder.seconds
    page.update(tab(explorer)._end, "Clear")
    until(explorer, lambda: explorer.finder.phase == "idle")
    assert explorer.finder.seconds == seconds  # the clock has stood still since
    assert "Press Search" in news(explorer)
    assert rows(explorer) == []
    assert explorer.scene._packer.marked == ()
    assert np.isnan(explorer.front._plot.data[1]).all()


def test_two_quick_clicks_begin_one_search(endless: tuple[Explorer, Page]) -> None:
    explorer, page = endless
    page.update(tab(explorer)._start, True)
    page.update(tab(explorer)._start, True)
    until(explorer, lambda: explorer.finder.phase == "running")
    process = explorer.finder._job._process
    ticks(explorer, 5)
    assert explorer.finder._job._process is process
    assert not explorer.finder._job._ending
    explorer._inbox.put(SetTask("elements", 3))
    explorer._inbox.put(StartSearch())  # for something else: in place of the first
    until(explorer, lambda: explorer.finder._job._process is not process)
    until(explorer, lambda: explorer.finder.found is not None and not explorer.finder._job._ending)
    assert explorer.finder.found is not None
    assert explorer.finder.found.task.elements == 3


def test_start_and_cancel_at_once(endless: tuple[Explorer, Page]) -> None:
    explorer, _ = endless
    for wish in (StartSearch(), CancelSearch(), StartSearch(), ClearSearch(), CancelSearch()):
        explorer._inbox.put(wish)
    ticks(explorer, 2)
    assert explorer.finder.phase == "idle"
    until(explorer, lambda: not explorer.finder._job._ending)
    assert explorer.finder.found is None


@pytest.mark.parametrize(
    ("run", "said"),
    [(fakesearch.refused, "a search needs a controller"), (fakesearch.marked_up, "&lt;b onload=&quot;no&quot;&gt;")],
)
def test_an_error_is_said_and_escaped(server: viser.ViserServer, run: Run, said: str) -> None:
    for explorer, page in opened(made(server, run)):
        page.update(tab(explorer)._start, True)
        until(explorer, lambda explorer=explorer: explorer.finder.phase == "failed")
        text = news(explorer)
        assert said in text
        assert not explorer.session.error
        before = explorer.session.time
        ticks(explorer, 3)
        assert explorer.session.time > before


def test_the_search_goes_on_while_nobody_looks(endless: tuple[Explorer, Page]) -> None:
    explorer, page = endless
    explorer._inbox.put(StartSearch())
    until(explorer, lambda: explorer.finder.found is not None)
    page.close()
    until(explorer, lambda: not explorer.server.get_clients())
    assert explorer.finder.found is not None
    evaluated = explorer.finder.found.evaluated
    until(explorer, lambda: explorer.finder.found is not None and explorer.finder.found.evaluated > evaluated + 5)


def test_marks_stay_off_another_mesh_and_come_back(quick: tuple[Explorer, Page]) -> None:
    explorer, page = quick
    found = searched(explorer, page)
    coarse = msgspec.structs.replace(DESIGN.with_elements((5, 6)), mesh=type(DESIGN.mesh)(12, 4))
    explorer._inbox.put(do.LoadDesign(coarse, "a coarser mesh"))
    until(explorer, lambda: explorer.session.rig.design == coarse)
    ticks(explorer, 3)
    assert explorer.scene._packer.grid.nx == 12
    assert explorer.scene._packer.marked == ()
    assert "another mesh or basis" in news(explorer)
    explorer._inbox.put(do.Undo())
    until(explorer, lambda: explorer.session.rig.design == DESIGN)
    ticks(explorer, 3)
    assert explorer.scene._packer.marked == found.top[0].elements
    assert not explorer.session.error


def test_a_mesh_change_during_a_search_loads_the_layout_on_its_own_mesh(endless: tuple[Explorer, Page]) -> None:
    explorer, page = endless
    explorer._inbox.put(StartSearch())
    coarse = msgspec.structs.replace(DESIGN.with_elements(()), mesh=type(DESIGN.mesh)(12, 4))
    explorer._inbox.put(do.LoadDesign(coarse, "a coarser mesh"))
    until(explorer, lambda: bool(rows(explorer)) and explorer.session.rig.design == coarse)
    ticks(explorer, 3)
    assert explorer.scene._packer.marked == ()
    page.update(tab(explorer)._rows[0], True)
    until(explorer, lambda: explorer.session.rig.design == DESIGN.with_elements((0, 1, 2, 3, 4, 5)))
    assert not explorer.session.error


# --- the plot ---------------------------------------------------------------------------------------------------------


def test_the_front_is_drawn_and_only_when_it_changes(quick: tuple[Explorer, Page]) -> None:
    explorer, page = quick
    assert np.isnan(explorer.front._plot.data[1]).all()
    found = searched(explorer, page)
    x, ranked, front, reference, best = explorer.front._plot.data
    assert (np.diff(x) >= 0).all()
    drawn = {(count, value) for count, value in zip(x, ranked, strict=True) if not np.isnan(value)}
    assert drawn == {(float(len(s.elements)), s.value) for s in found.top}
    shown = ~np.isnan(front)
    np.testing.assert_array_equal(front[shown], [s.value for s in found.front])
    assert reference[~np.isnan(reference)].tolist() == [0.1021]
    assert best[~np.isnan(best)].tolist() == [found.top[0].value]
    scales = explorer.front._plot.scales
    assert scales is not None
    low, high = scales["y"]["range"]  # pyright: ignore[reportTypedDictNotRequiredAccess]
    assert isinstance(low, float)
    assert isinstance(high, float)
    assert low < np.nanmin(front)
    assert high > np.nanmax(ranked)
    page.received()
    ticks(explorer, 20)
    uuid = explorer.front._plot._impl.uuid
    assert not [m for m in page.received() if m["type"] == "GuiUpdateMessage" and m["uuid"] == uuid]


# --- words ------------------------------------------------------------------------------------------------------------


def found(task: Task, *scores: Score, complete: bool = False) -> Found:
    return found_in(fakesearch.progress(list(scores), 60, complete, task=task), 10.0, 4.0)


def test_time_left_is_told_only_where_an_end_is_in_sight() -> None:
    scores = [fakesearch.score(k, 0.2) for k in range(12)]
    known = found(Task(method="exhaustive", elements=6), *scores)
    assert count_words(known, 71.0) == "12 looked at · 12 run · 1.2 /s · 1:11"
    assert stage_words(known) == "running 12 of 60 · at most 0:16 left"  # 48 of them, a third of a second each
    assert stage_words(found(Task(method="genetic", elements=6), *scores)) == "running 12 of 60"
    assert stage_words(found(Task(method="exhaustive", elements=6), scores[0])) == "running 1 of 60"


@pytest.mark.parametrize(
    ("objective", "value", "said"),
    [
        ("robust", 0.08168, "20 % sooner"),
        ("robust", 0.12, "none is better"),
        ("energy", 0.05105, "50 % less"),
        ("reach", 0.11231, "10.0 % further"),
        ("reach", 0.09, "none goes further"),
    ],
)
def test_the_gain_over_nfcg_is_said_as_the_objective_goes(objective: Objective, value: float, said: str) -> None:
    best, reference = best_words(found(Task(objective=objective, elements=6), fakesearch.score(0, value)))
    assert "Best: 6 elements" in best
    assert said in reference


def test_words_where_nothing_is_found() -> None:
    passive = fakesearch.score(0, None, 7)
    assert "yet" in best_words(found(Task(elements=6), passive))[0]
    assert "allow more elements" in best_words(found(Task(elements=6), passive, complete=True))[0]
    assert passive_words(found(Task(elements=6), passive)).endswith("is not ranked: 7 elements")
    two = found(Task(elements=6), passive, fakesearch.score(9, None, 1))
    assert passive_words(two).endswith("are not ranked: 1 element at the least")
    assert passive_words(found(Task(elements=6), fakesearch.score(0, 0.1))) == ""


def test_rows_fit_a_narrow_panel() -> None:
    values: dict[Objective, float] = {"robust": 12.3456, "seed": 12.3456, "energy": 1.2345e6, "reach": 12345.0}
    assert set(values) == set(OBJECTIVES.values())
    for objective, value in values.items():
        one = msgspec.structs.replace(
            fakesearch.score(0, value, 24), state="in part", damping_time_s=12.3456, robust_damping_time_s=12.3456
        )
        text = row_words(8, one, Task(objective=objective))
        assert len(text) <= 44
        assert text.endswith(" !")


def test_what_has_changed_is_named() -> None:
    assert changed_words(DESIGN, DESIGN.with_elements((1, 2))) == ""
    assert changed_words(DESIGN, DESIGN.with_dynamic_pressure(900.0)) == "λ = 900"
    wired = msgspec.structs.replace(DESIGN, patches=msgspec.structs.replace(DESIGN.patches, channels="single"))
    assert changed_words(DESIGN, wired) == "other patches or wiring"
    assert clock_words(59.6) == "1:00"


# --- the finder alone -------------------------------------------------------------------------------------------------


def test_nothing_is_loaded_of_a_search_that_is_forgotten() -> None:
    session, finder = Session(DESIGN, rig()), Finder(DESIGN, Job(fakesearch.quick))
    finder.grant(LoadFound(fakesearch.score(0, 0.1)), session)
    assert session.design == DESIGN
    finder.close()


def test_following_takes_no_time() -> None:
    session, finder = Session(DESIGN, rig()), Finder(DESIGN, Job(fakesearch.chatty))
    finder.grant(StartSearch(), session)
    longest, end = 0.0, time.perf_counter() + 60
    while finder.phase == "running":
        assert time.perf_counter() < end
        begun = time.perf_counter()
        finder.follow(session)
        longest = max(longest, time.perf_counter() - begun)
        time.sleep(0.03)
    finder.close()
    assert longest < 0.1  # three pictures; what a busy machine takes for itself comes on top of a millisecond
