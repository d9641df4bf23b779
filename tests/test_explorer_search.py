"""The search in a real browser: it runs beside the moving panel, fills the ranking, marks the best, and loads a row.

The tests are steps of one visit: each begins where the last one ended.
"""

import os
from collections.abc import Iterator

import pytest
from pages import served
from panels import COARSE
from playwright.sync_api import BrowserContext, Page, sync_playwright
from test_jobs import gone
from test_page import CHROMIUM, COLOUR_AT, FLAGS, PROJECT, opened, until, until_near
from test_page import pytestmark as browser_marks

from flutterviz import commands as do
from flutterviz.app import Explorer
from flutterviz.surface import MARK
from solver import load_design

pytestmark = browser_marks
SEARCHING = 180.0  # s: a search is polite, and gets little of a machine that draws and runs other tests as well

BROWSER_ROOM = 8  # of 255: the tone map, and the filters of the drawing


@pytest.fixture(scope="module")
def explorer() -> Iterator[Explorer]:
    """An explorer of a panel that is quick to search on, its loop in a thread."""
    with served(COARSE) as explorer:
        yield explorer


@pytest.fixture(scope="module")
def context() -> Iterator[BrowserContext]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        context = browser.new_context(viewport={"width": 1440, "height": 900})
        yield context
        browser.close()


@pytest.fixture(scope="module")
def complaints() -> list[str]:
    """What the pages said on their consoles as errors."""
    return []


@pytest.fixture(scope="module")
def page(context: BrowserContext, explorer: Explorer, complaints: list[str]) -> Page:
    page = opened(context, explorer, complaints)
    page.get_by_role("tab", name="Search").click()
    page.get_by_role("tab", name="Front").click()
    return page


def card(page: Page) -> str:
    return page.locator("#flutterviz-search").inner_text()


def rows(page: Page) -> list[str]:
    return page.get_by_role("button", name=" el. · ").all_inner_texts()


def found_some(explorer: Explorer) -> bool:
    """Whether the search under way has ranked a layout."""
    found = explorer.finder.found
    return found is not None and len(found.top) > 0


def mark_at(explorer: Explorer, page: Page, element: int) -> list[int]:
    """The colour on the window [0..255] in the middle of the bright frame of a marked element, on its downstream side.

    An element that is patched as well has its mark within the patch's frame.
    """
    i, j = divmod(element, COARSE.mesh.ny)
    grid, height = explorer.session.rig.grid, explorer.scene.height
    both = element in explorer.session.design.patches.elements
    inset = (0.34 if both else 0.18) * min(1.0 / COARSE.mesh.nx, 0.8 / COARSE.mesh.ny)
    x, y = (i + 1) / COARSE.mesh.nx - inset, grid.width * grid.scale * (j + 0.5) / COARSE.mesh.ny
    p, q = round(x * (grid.shape[0] - 1)), round((j + 0.5) / COARSE.mesh.ny * (grid.shape[1] - 1))
    return page.evaluate(COLOUR_AT, page.evaluate(PROJECT, [x, y, float(height[p, q])]))[:3]


def test_it_says_what_to_do_first(page: Page) -> None:
    until(page, lambda: "Press Search" in card(page))
    assert rows(page) == []
    assert page.get_by_text("objective over number of elements", exact=True).is_visible()
    assert not page.get_by_role("button", name="Cancel", exact=True).is_visible()


def test_a_search_runs_beside_the_moving_panel(page: Page, explorer: Explorer) -> None:
    page.get_by_role("button", name="All", exact=True).click()
    until(page, lambda: page.get_by_text("All rectangles").is_visible())
    page.get_by_role("button", name="Search", exact=True).click()
    until(page, lambda: "Searching" in card(page))
    until(page, lambda: len(rows(page)) > 0, SEARCHING)
    before = explorer.session.time
    until(page, lambda: explorer.session.time > before)
    until(page, lambda: explorer.finder.phase == "finished", SEARCHING)
    found = explorer.finder.found
    assert found is not None
    assert len(found.top) >= 8
    until(page, lambda: "Finished" in card(page))
    assert f"{found.evaluated} looked at" in card(page)
    assert f"{found.top[0].value:.4f} s" in card(page)
    until(page, lambda: len(rows(page)) == 8)
    assert rows(page)[0].startswith(f"1 · {len(found.top[0].elements)} el. · {found.top[0].value:.4f} s")
    assert page.get_by_text("worst damping time over phases [s]", exact=True).is_visible()


def test_no_row_is_cut_off(page: Page) -> None:
    for button in page.get_by_role("button", name=" el. · ").all():
        label = button.locator(".mantine-Button-label")
        assert label.evaluate("e => e.scrollWidth - e.clientWidth") <= 0


def test_the_best_is_marked_on_the_panel(page: Page, explorer: Explorer) -> None:
    found = explorer.finder.found
    assert found is not None
    page.keyboard.press("Space")
    until(page, lambda: explorer.session.paused)
    best = found.top[0].elements
    until_near(page, lambda: [mark_at(explorer, page, element) for element in best], [MARK] * len(best), BROWSER_ROOM)
    page.keyboard.press("Space")
    until(page, lambda: not explorer.session.paused)


def test_a_click_on_a_row_loads_it_and_the_key_undoes_that(page: Page, explorer: Explorer) -> None:
    found = explorer.finder.found
    assert found is not None
    page.get_by_role("button", name="2 · ").first.click()
    until(page, lambda: explorer.session.rig.design == COARSE.with_elements(found.top[1].elements))
    until(page, lambda: explorer.scene._packer.marked == ())
    page.keyboard.press("u")  # which the row that has the focus does not keep to itself
    until(page, lambda: explorer.session.rig.design == COARSE)
    assert len(rows(page)) == 8


def test_cancel_ends_the_search_and_keeps_what_it_found(page: Page, explorer: Explorer) -> None:
    page.get_by_role("button", name="Search", exact=True).click()
    until(page, lambda: explorer.finder._job.running)
    process = explorer.finder._job._process
    assert process is not None
    pid = process.pid
    assert pid is not None
    until(page, lambda: found_some(explorer), SEARCHING)
    page.get_by_role("button", name="Cancel", exact=True).click()
    until(page, lambda: explorer.finder.phase == "cancelled")
    until(page, lambda: "Cancelled" in card(page) and len(rows(page)) > 0)
    until(page, lambda: gone(pid) and not explorer.finder._job._ending)
    with pytest.raises(ProcessLookupError):
        os.killpg(pid, 0)


def test_two_pages_show_the_same_search_and_one_may_close(
    page: Page, context: BrowserContext, explorer: Explorer, complaints: list[str]
) -> None:
    other = opened(context, explorer, complaints)
    other.get_by_role("tab", name="Search").click()
    until(other, lambda: "Cancelled" in card(other))
    assert rows(other) == rows(page)
    other.get_by_role("button", name="Search", exact=True).click()
    until(page, lambda: explorer.finder.phase == "running")
    other.close()
    until(page, lambda: found_some(explorer), SEARCHING)
    page.get_by_role("button", name="Cancel", exact=True).click()
    until(page, lambda: "Cancelled" in card(page) and len(rows(page)) > 0)


def test_another_mesh_during_a_search(page: Page, explorer: Explorer) -> None:
    """What is found stays, its marks do not fit and are not drawn, and a row brings the mesh back."""
    page.get_by_role("button", name="Search", exact=True).click()
    until(page, lambda: explorer.finder.phase == "running")
    until(page, lambda: found_some(explorer), SEARCHING)
    fine = load_design("seed-840").with_reduction("patched", 8)
    explorer._inbox.put(do.LoadDesign(fine, "another mesh"))
    until(page, lambda: explorer.session.rig.design == fine)
    until(page, lambda: explorer.scene._packer.marked == ())  # with the next picture
    until(page, lambda: "another mesh or basis" in card(page))
    page.get_by_role("button", name="Cancel", exact=True).click()
    until(page, lambda: explorer.finder.phase != "running")
    page.get_by_role("button", name="1 · ").first.click()
    until(page, lambda: explorer.session.rig.design.mesh == COARSE.mesh)
    assert not explorer.session.error
    before = explorer.session.time
    until(page, lambda: explorer.session.time > before)


def test_clear_forgets_it(page: Page, explorer: Explorer) -> None:
    page.get_by_role("button", name="Clear", exact=True).last.click()
    until(page, lambda: "Press Search" in card(page))
    assert rows(page) == []


def test_no_page_complained(complaints: list[str]) -> None:
    assert complaints == []
