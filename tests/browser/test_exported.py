"""An exported recording in viser's own player, without a service: its markers go where the recording's do."""

from importlib.resources import files
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route

from stridelab_web.scene.documents import Document
from support.browser.page import prepare_pictures, read_frames, until
from support.fakes.web_app import Lab

NOWHERE = "http://nowhere.invalid"
"""No such host: what the page asks for is answered by the test or by nobody."""
MARKERS = """(names) => {
    const viser = window.__viserMutable;
    if (!viser || names.some((name) => !viser.nodeRefFromName[name])) return null;
    return names.map((name) => viser.nodeRefFromName[name].position.toArray());
}"""
NEAR_M = 1e-4


@pytest.fixture
def exported(lab: Lab, tmp_path: Path) -> tuple[Path, list[str], np.ndarray]:
    """A folder with both files of a recording, its markers, and where these are ``(frames, markers, 3)``."""
    address = f"{lab.url}{Document('recording', lab.fake.add_recording().id).address}"
    with httpx.Client(trust_env=False, timeout=120.0) as http:
        layout, values = read_frames(http.get(f"{address}/frames.bin").content)
        for name in ("motion.viser", "motion.html"):
            (tmp_path / name).write_bytes(http.get(f"{address}/{name}").raise_for_status().content)
    there = {name: at for name, at, *_ in layout["points"] if np.isfinite(values[:, at : at + 3]).all()}
    assert len(there) > 5
    return tmp_path, list(there), np.stack([values[:, at : at + 3] for at in there.values()], axis=1)


@pytest.fixture
def page(chromium: Browser, exported: tuple[Path, list[str], np.ndarray]) -> Page:
    """A page for which the only address is ``NOWHERE``, with viser's own page and the exported file."""
    opened = chromium.new_page()
    prepare_pictures(opened, drawn=False)
    client = files("viser").joinpath("client", "build", "index.html").read_bytes()

    def answer(route: Route) -> None:
        if urlsplit(route.request.url).path == "/motion.viser":
            route.fulfill(body=(exported[0] / "motion.viser").read_bytes())
        else:
            route.fulfill(body=client, content_type="text/html")

    opened.route(f"{NOWHERE}/**", answer)
    return opened


@pytest.mark.parametrize("form", ["viser", "html"])
def test_a_recording_plays_in_the_player_of_viser(
    page: Page, exported: tuple[Path, list[str], np.ndarray], form: str
) -> None:
    """By itself and in a loop: at any time the markers are those of one frame, and not always of the same one."""
    folder, names, places_m = exported
    page.goto(f"{NOWHERE}/?playbackPath=/motion.viser" if form == "viser" else (folder / "motion.html").as_uri())
    page.wait_for_function(f"(names) => ({MARKERS})(names) !== null", arg=names, timeout=90_000)
    seen: set[int] = set()

    def plays() -> bool:
        off_m = np.linalg.norm(places_m - np.array(page.evaluate(MARKERS, names)), axis=2).max(axis=1)
        if off_m.min() < NEAR_M:
            seen.add(int(off_m.argmin()))
        return len(seen) > 2

    until(page, plays)
    page.close()
