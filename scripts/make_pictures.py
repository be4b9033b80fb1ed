"""Take the pictures of README and docs; usage: make_pictures.py [PORT], which starts a service of its own there (8490).

Needs Chromium on the PATH. The pictures show the bundled recording, uploaded as anybody would, and plans of bundled
scenarios, which are computed for them, so no user's data get into them. Few colours keep them small.
"""

import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from stridelab.client import Client
from stridelab.machine.models_folder import models_dir

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
SAMPLE = models_dir() / "recordings" / "sample-walk" / "recording.c3d"
SCENARIO, CLIMBING_S = "six-stairs", 12.4
COMPUTING_S = 900.0
COLOURS = 256


@contextmanager
def service(port: int) -> Iterator[str]:
    """A service with an empty data folder; its address."""
    with tempfile.TemporaryDirectory(prefix="pictures-") as folder:
        Path(folder).chmod(0o755)  # the database of root runs under another account
        environment = {**os.environ, "STRIDELAB_PORT": str(port), "STRIDELAB_DATA_DIR": f"{folder}/data"}
        process = subprocess.Popen([ROOT / "scripts" / "serve"], env=environment, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        try:
            if not any("is running on" in line for line in process.stdout):
                raise SystemExit("the service did not start")
            yield f"http://127.0.0.1:{port}"
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60)


def keep(page: Page, name: str) -> None:
    """Save a screenshot of the page with a reduced palette."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(PICTURES / f"{name}.png", optimize=True)
    page.close()


def scene(browser: Browser, address: str, name: str, ready: str, phase: int | None = None) -> None:
    """A scene at one instant."""
    page = browser.new_page(viewport={"width": 1200, "height": 720})
    page.goto(address)
    page.wait_for_selector(ready, timeout=120_000)
    page.frame_locator("iframe").locator("canvas").first.wait_for(timeout=120_000)
    if phase is not None:
        page.locator("[data-phases] button").nth(phase).click()
    page.wait_for_timeout(8_000)  # nodes fade in, and software rendering draws few images a second
    keep(page, name)


def document(browser: Browser, address: str, name: str, height: int, ready: str = "main") -> None:
    """The upper part of a page."""
    page = browser.new_page(viewport={"width": 1200, "height": height})
    page.goto(address)
    page.wait_for_selector(ready, timeout=60_000)
    page.wait_for_timeout(3_000)  # curves are drawn after the page
    keep(page, name)


def main(port: int) -> None:
    """Take all pictures."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with service(port) as base, Client(base) as client, sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        trial = client.upload(SAMPLE, filename="trial.c3d").id
        document(browser, f"{base}/recordings/{trial}", "recording", 800)

        estimate = client.wait(client.submit("estimate-com", {"recording_id": trial}).id, COMPUTING_S)
        document(browser, f"{base}/jobs/{estimate.id}", "result", 1500, ".plotly .main-svg")
        scene(browser, f"{base}/view/?recording={trial}&t=2.3", "viewer", "[data-player][data-ready=true]")

        wheel = client.wait(client.submit("fit-cycloid", {"recording_id": trial}).id, COMPUTING_S)
        document(browser, f"{base}/jobs/{wheel.id}", "wheel", 1250)

        plan = client.wait(client.submit("plan-motion", {"scenario_id": SCENARIO, "replay": True}).id, COMPUTING_S)
        document(browser, f"{base}/plans/{plan.id}", "certificate", 1000)
        scene(browser, f"{base}/view/?plan={plan.id}&t={CLIMBING_S}", "climb", "[data-player][data-ready=true]")

        # a phase in which one foot and the hand hold the robot
        scene(browser, f"{base}/view/?scenario=stairs-with-rail", "editor", "[data-editor][data-judged=valid]", phase=9)
        document(browser, base, "front", 960)
        browser.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8490)
