"""Takes README's pictures: the explorer in flutter, controlled, with a map, searching; and a sweep. Needs Chromium."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--disable-background-networking", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


FOUR_MODES = ["seed-bare", "--reduction.basis", "family", "--reduction.modes", "4"]


def main() -> None:
    """Draw the sweep; serve the explorer, look at it, and end it."""
    over = ["--over", "flow.dynamic-pressure=500:1450:25", "--plot", str(HERE / "sweep.png")]
    subprocess.run([sys.executable, "-m", "flutterviz", "sweep", *FOUR_MODES, *over], check=True)
    command = [sys.executable, "-m", "flutterviz", "view", "seed-840", "--no-open", "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        try:
            url = next(found[1] for line in server.stderr if (found := re.search(r"serving on (\S+)", line)))
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
                page = browser.new_page(viewport={"width": 1440, "height": 900})
                page.goto(f"{url}/?fixedDpr=1")
                picture(page)
                browser.close()
        finally:
            server.terminate()


def picture(page: Page) -> None:
    """The panel in its limit cycle, some seconds into the control, the NFCG beside the Control tab, a search's end."""
    page.get_by_text("Limit cycle").wait_for(timeout=60_000)
    page.locator(".mantine-Notification-closeButton").first.click(timeout=10_000)
    page.wait_for_timeout(15_000)
    page.screenshot(path=HERE / "explorer.png")
    page.keyboard.press("c")
    page.get_by_text("Release controller").wait_for()
    page.wait_for_timeout(7_000)
    page.screenshot(path=HERE / "controlled.png")
    page.keyboard.press("c")
    page.get_by_role("button", name="NFCG", exact=True).click()
    page.get_by_role("tab", name="Control").click()
    page.get_by_role("tab", name="Root locus").click()
    page.get_by_text("dark: patches belong here").wait_for()
    page.mouse.move(700, 850)  # off the buttons, which explain themselves under the pointer
    page.wait_for_timeout(8_000)
    page.screenshot(path=HERE / "control.png")
    page.get_by_role("tab", name="Panel").click()
    page.get_by_role("button", name="w", exact=True).click()
    page.get_by_role("tab", name="Search").click()
    page.get_by_role("tab", name="Front").click()
    page.get_by_role("button", name="Search", exact=True).click()
    page.mouse.move(700, 850)
    page.get_by_text(" sooner").wait_for(timeout=300_000)  # it has found better than the highest NFCG
    page.wait_for_timeout(60_000)
    page.screenshot(path=HERE / "search.png")


if __name__ == "__main__":
    main()
