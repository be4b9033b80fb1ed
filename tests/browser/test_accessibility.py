"""No page keeps anybody out: axe-core finds nothing serious on any of them, wide or narrow, light or dark."""

from collections.abc import Callable
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from support.every_page import every_page
from support.fake_service import FakeService
from support.tab import Tab

pytestmark = pytest.mark.usefixtures("lab")

WITHOUT_FRAMES = {"resultTypes": ["violations"], "iframes": False}
"""What is inside a frame is viser's client."""
COUNTED = ("serious", "critical")


def found(page: Page) -> list[str]:
    violations: list[dict[str, Any]] = Axe().run(page, options=WITHOUT_FRAMES).response["violations"]
    return [
        f"{one['impact']}: {one['id']} at {node['target']}: {node['failureSummary']}"
        for one in violations
        if one["impact"] in COUNTED
        for node in one["nodes"]
    ]


@pytest.mark.parametrize("name", every_page(FakeService()))
def test_no_page_has_a_serious_finding(open_tab: Callable[..., Tab], addresses: dict[str, str], name: str) -> None:
    tab = open_tab(1400, 850)
    page = tab.go(addresses[name])
    page.wait_for_load_state("load")
    if page.locator("#plots").count():
        page.wait_for_selector("#plots[data-ready]")
    said = {}
    for width, height in ((1400, 850), (800, 600)):
        page.set_viewport_size({"width": width, "height": height})
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
            page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            if wrong := found(page):
                said[f"{width}x{height}, {scheme}"] = wrong
    assert said == {}
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, "scrolls sideways at 800 pixels"
    tab.missteps = [misstep for misstep in tab.missteps if "status of 404" not in misstep]
