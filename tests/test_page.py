"""The page in a real browser: the panel moves, the first click works, keys work, nothing covers the plate."""

import shutil
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from pages import served
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from flutterviz import colormap
from flutterviz.app import Explorer
from solver import load_design

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--disable-background-networking", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 90.0  # s; the first shader takes 25 s where it is compiled without a graphics card, beside other tests more
DESIGN = load_design("seed-840")
ELEMENT = 12 * 6 + 3  # i = 12, j = 3: in the middle, where the panel moves by less than at 0.75 a

# viser's camera and canvas: the place on the window of a point of the scene [CSS pixels].
PROJECT = """(point) => {
  const state = window.__viserMutable, node = state.nodeRefFromName['/outline'];
  node.updateWorldMatrix(true, false); state.camera.updateMatrixWorld();
  const times = (e, v) => [0, 1, 2, 3].map(r => e[r]*v[0] + e[4 + r]*v[1] + e[8 + r]*v[2] + e[12 + r]*v[3]);
  let v = times(node.matrixWorld.elements, [...point, 1]);
  v = times(state.camera.projectionMatrix.elements, times(state.camera.matrixWorldInverse.elements, v));
  const box = state.canvas.getBoundingClientRect();
  return [box.left + box.width*(0.5 + 0.5*v[0]/v[3]), box.top + box.height*(0.5 - 0.5*v[1]/v[3])];
}"""
READY = "() => Boolean(window.__viserMutable?.nodeRefFromName?.['/panel'] && window.__viserMutable.camera)"
PIXELS = "() => window.__viserMutable.canvas.toDataURL()"
COLOUR_AT = """async ([x, y]) => {
  const canvas = window.__viserMutable.canvas, box = canvas.getBoundingClientRect(), image = new Image();
  image.src = canvas.toDataURL();
  await image.decode();
  const copy = Object.assign(document.createElement('canvas'), {width: canvas.width, height: canvas.height});
  const flat = copy.getContext('2d');
  flat.drawImage(image, 0, 0);
  const at = [(x - box.left) / box.width * canvas.width, (y - box.top) / box.height * canvas.height];
  return [...flat.getImageData(...at, 1, 1).data];
}"""
ON_CANVAS = "([x, y]) => document.elementFromPoint(x, y) === window.__viserMutable.canvas"

pytestmark = [
    pytest.mark.browser,
    pytest.mark.timeout(420),  # where two browsers draw by software, and other tests run as well
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium or chromium-browser on PATH"),
]


@pytest.fixture(scope="module")
def explorer() -> Iterator[Explorer]:
    """The explorer on a port of its own, its loop in a thread."""
    with served(DESIGN) as explorer:
        yield explorer


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    yield context
    context.close()


@pytest.fixture(scope="module")
def complaints() -> list[str]:
    """What the pages said on their consoles as errors."""
    return []


@pytest.fixture(scope="module")
def page(context: BrowserContext, explorer: Explorer, complaints: list[str]) -> Page:
    return opened(context, explorer, complaints)


def opened(context: BrowserContext, explorer: Explorer, complaints: list[str]) -> Page:
    """A page that shows the panel, with the notice about software rendering closed."""
    page = context.new_page()
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    pages = len(explorer.server.get_clients())
    page.goto(f"http://127.0.0.1:{explorer.server.get_port()}/?fixedDpr=1")
    page.wait_for_function(READY, timeout=1e3 * PATIENCE)
    until(page, lambda: len(explorer.server.get_clients()) > pages)
    page.wait_for_selector("#flutterviz-status", timeout=1e3 * PATIENCE)
    before = page.evaluate(PIXELS)
    until(page, lambda: page.evaluate(PIXELS) != before)
    notice = page.locator(".mantine-Notification-root", has_text="Software WebGL")
    if notice.count():
        notice.locator("button").click()
        notice.wait_for(state="detached")
    return page


def until(page: Page, condition: Callable[[], bool], patience: float = PATIENCE) -> None:
    """Wait until something holds, the page running on."""
    end = time.perf_counter() + patience
    while not condition():
        assert time.perf_counter() < end, "it never came about"
        page.wait_for_timeout(50)


def until_near(page: Page, colours: Callable[[], object], wanted: object, room: int) -> None:
    """Wait until colours [0..255] that are read off the page are the wanted ones: a picture takes its time there."""
    end = time.perf_counter() + PATIENCE
    while (apart := np.abs(np.array(colours()) - np.array(wanted)).max()) > room:
        assert time.perf_counter() < end, f"a colour is still {apart} of 255 off"
        page.wait_for_timeout(200)


def status(page: Page) -> str:
    return page.locator("#flutterviz-status").inner_text()


def place(page: Page, explorer: Explorer, element: int) -> list[float]:
    """Where the middle of an element is on the window at this moment, lifted as the panel is."""
    i, j = divmod(element, DESIGN.mesh.ny)
    grid, height = explorer.session.rig.grid, explorer.scene.height
    x, y = (i + 0.5) / DESIGN.mesh.nx, (j + 0.5) / DESIGN.mesh.ny
    p, q = round(x * (grid.shape[0] - 1)), round(y * (grid.shape[1] - 1))
    return page.evaluate(PROJECT, [x, y, float(height[p, q])])


def corners(page: Page) -> list[list[float]]:
    """The corners of the plate on the window, a hair inside."""
    return [page.evaluate(PROJECT, [x, y, 0.0]) for x in (0.02, 0.98) for y in (0.02, 0.98)]


def test_the_first_click_after_opening_patches_the_element_under_it(page: Page, explorer: Explorer) -> None:
    assert explorer.session.design == DESIGN
    page.mouse.click(*place(page, explorer, ELEMENT))
    until(page, lambda: explorer.session.design != DESIGN)
    assert set(explorer.session.design.patches.elements) ^ set(DESIGN.patches.elements) == {ELEMENT}
    until(page, lambda: not explorer.session.stale)
    until(page, lambda: page.get_by_text("7 patched").count() == 1)


def test_it_opens_alive_in_a_limit_cycle(page: Page, explorer: Explorer) -> None:
    pictures = [page.evaluate(PIXELS)]
    for _ in range(2):
        until(page, lambda: page.evaluate(PIXELS) not in pictures)
        pictures.append(page.evaluate(PIXELS))
    until(page, lambda: "Limit cycle" in status(page))
    assert "1 page" in status(page)
    assert explorer.session.time > 0


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (1024, 700)])
def test_no_panel_covers_the_plate(page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    until(page, lambda: all(page.evaluate(ON_CANVAS, corner) for corner in corners(page)), 15)  # the camera follows
    across = np.ptp(np.array(corners(page)), axis=0)
    assert across[0] > 0.25 * width  # and it is large: the docked panels take 600 pixels of the width
    page.set_viewport_size({"width": 1440, "height": 900})


def test_the_key_engages_the_controller_and_the_motion_falls(page: Page, explorer: Explorer) -> None:
    explorer._inbox.put(("rate", 1 / 50))
    before = explorer.session.amplitude
    page.keyboard.press("c")
    until(page, lambda: explorer.session.engaged)
    until(page, lambda: "Controlled" in status(page))
    assert page.get_by_role("button", name="Release controller").count() == 1
    until(page, lambda: explorer.session.amplitude < 0.2 * before)
    page.keyboard.press("c")
    until(page, lambda: not explorer.session.engaged)


def test_space_holds_the_panel_still(page: Page, explorer: Explorer) -> None:
    page.keyboard.press("Space")
    until(page, lambda: "Paused" in status(page))
    page.wait_for_timeout(500)
    before = explorer.session.time
    page.wait_for_timeout(300)
    assert explorer.session.time == before
    page.keyboard.press("Space")
    until(page, lambda: explorer.session.time > before)


def test_the_control_tab_changes_the_controller_and_the_poles_are_drawn(page: Page, explorer: Explorer) -> None:
    page.get_by_role("tab", name="Control").click()
    page.get_by_role("button", name="LQG", exact=True).click()
    until(page, lambda: explorer.session.rig.design.control.kind == "lqg")
    until(page, lambda: "LQG" in page.locator("#flutterviz-control").inner_text())
    page.get_by_role("tab", name="Root locus").click()
    until(page, lambda: page.get_by_text("frequency [Hz] over growth rate").is_visible())
    until(page, lambda: "λ = " in status(page) or "λ > " in status(page))  # stabilises up to
    page.get_by_role("tab", name="Live plots").click()
    page.get_by_role("tab", name="Panel").click()


def test_a_map_stands_still_on_the_moving_panel(page: Page, explorer: Explorer) -> None:
    """The colour in the middle of an element is the map's, give or take the filters of the drawing."""
    page.get_by_role("button", name="NFCG", exact=True).click()
    until(page, lambda: page.get_by_text("dark: patches belong here").count() == 1)
    shown = explorer._background.map
    assert shown is not None
    low, high = shown.values.min(), shown.values.max()
    element = 18 * 6 + 2
    wanted = colormap.sequential_rgb([(shown.values[element] - low) / (high - low)])[0].astype(int)
    page.keyboard.press("Space")
    until(page, lambda: "Paused" in status(page))
    until_near(page, lambda: page.evaluate(COLOUR_AT, place(page, explorer, element))[:3], wanted, 6)
    page.keyboard.press("Space")
    page.get_by_role("button", name="w", exact=True).click()
    until(page, lambda: page.get_by_text("dark: patches belong here").count() == 0)


def test_two_tabs_share_the_panel_and_one_may_close(
    page: Page, context: BrowserContext, explorer: Explorer, complaints: list[str]
) -> None:
    other = opened(context, explorer, complaints)
    until(page, lambda: "2 pages" in status(page) and "2 pages" in status(other))
    other.keyboard.press("Space")
    until(page, lambda: "Paused" in status(page))
    page.wait_for_timeout(300)  # the last frame is drawn
    before, element = set(explorer.session.design.patches.elements), 20 * 6 + 2
    other.mouse.click(*place(other, explorer, element))
    until(page, lambda: set(explorer.session.design.patches.elements) ^ before == {element})
    for each in (page, other):
        until(page, lambda each=each: each.get_by_text(f"{len(before) + 1} patched").count() == 1)
    other.keyboard.press("Space")
    until(page, lambda: "Paused" not in status(page))
    other.close()
    until(page, lambda: "1 page\n" in status(page) + "\n")
    moving = explorer.session.time
    until(page, lambda: explorer.session.time > moving)


def test_the_undo_key_goes_back(page: Page, explorer: Explorer) -> None:
    while explorer.session.can_undo:
        steps = len(explorer.session._past)
        page.keyboard.press("u")
        until(page, lambda steps=steps: len(explorer.session._past) < steps)
    assert explorer.session.design == DESIGN


def test_no_page_complained(complaints: list[str]) -> None:
    assert complaints == []
