"""Take the pictures of README and docs from a running service; usage: make_pictures.py http://127.0.0.1:8000.

Needs Chromium on the PATH. The pictures show the bundled recording and a plan of a bundled scenario, which is computed
for them, so nobody's data get into them.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from stridelab.client import Client
from stridelab.schemas.plans import PlanMotionInput

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
SAMPLE = "sample-walk"
SCENARIO, CLIMBING_S = "six-stairs", 12.4


def viewer(browser: Browser, base: str, what: str, picture: str) -> None:
    """A scene at one instant, without the note on software rendering."""
    page = browser.new_page(viewport={"width": 1200, "height": 720})
    page.goto(f"{base}/view/?{what}")
    page.wait_for_selector("[data-player][data-ready=true]", timeout=120_000)
    scene = page.frame_locator("iframe")
    scene.locator("canvas").first.wait_for(timeout=120_000)
    for close in scene.locator(".mantine-Notification-closeButton").all():
        close.click()
    page.wait_for_timeout(6_000)  # nodes fade in, and software rendering draws few images a second
    page.screenshot(path=PICTURES / picture)
    page.close()


def editor(browser: Browser, base: str) -> None:
    """A scenario in the editor, with a phase chosen in which one foot and the hand hold the robot."""
    page = browser.new_page(viewport={"width": 1200, "height": 720})
    page.goto(f"{base}/view/?scenario=stairs-with-rail")
    page.wait_for_selector("[data-editor][data-judged=valid]", timeout=120_000)
    for close in page.frame_locator("iframe").locator(".mantine-Notification-closeButton").all():
        close.click()
    page.locator("[data-phases] button").nth(9).click()
    page.wait_for_timeout(6_000)
    page.screenshot(path=PICTURES / "editor.png")
    page.close()


def planned(base: str) -> str:
    """A finished plan of the climb."""
    with Client(base) as client:
        job = client.submit("plan-motion", PlanMotionInput(scenario_id=SCENARIO))
        return client.wait(job.id).id


def result(browser: Browser, base: str) -> None:
    """The result page from its numbers to its first curves."""
    page = browser.new_page(viewport={"width": 1200, "height": 1500})
    page.goto(f"{base}/jobs/{SAMPLE}-com")
    page.wait_for_selector(".plotly .main-svg", timeout=60_000)
    page.wait_for_timeout(1_000)
    page.screenshot(path=PICTURES / "result.png")
    page.close()


def main(base: str) -> None:
    """Take all pictures."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        viewer(browser, base, f"recording={SAMPLE}&t=2.3", "viewer.png")
        viewer(browser, base, f"plan={planned(base)}&t={CLIMBING_S}", "climb.png")
        editor(browser, base)
        result(browser, base)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1].rstrip("/"))
