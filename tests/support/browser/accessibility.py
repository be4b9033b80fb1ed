"""What axe-core has to say of a state of a page, at four sizes and in light and dark.

Pictures of each are stored in the folder that STRIDELAB_SCREENSHOTS names, for people to look at.
"""

import os
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from support.browser.page import TWO_PICTURES

SIZES = ((1400, 850), (2560, 1440), (800, 600), (390, 844))
COUNTED = ("serious", "critical")
FAULTS = """async ([options, counted]) => {
    const part = document.querySelector("dialog[open]") ?? document;
    const { violations } = await axe.run(part, options);
    const wide = document.documentElement.scrollWidth - innerWidth;
    return [
        ...wide > 0 ? [`${wide} pixels too wide`] : [],
        ...violations.filter(({ impact }) => counted.includes(impact))
            .flatMap(({ id, nodes }) => nodes.map((node) => `${id} at ${node.target}: ${node.failureSummary}`)),
    ];
}"""
"""What is wrong with the open dialog, or with the page."""
SHEET = """(open) => document.querySelectorAll("[data-sheet]").forEach((sheet) => {
    sheet.toggleAttribute("data-open", open);
})"""
EVERYTHING: dict[str, Any] = {"resultTypes": ["violations"], "iframes": False}
"""What is inside a frame is viser's client."""
COLOURS = {**EVERYTHING, "runOnly": ["color-contrast"]}
"""A dark page differs from a light one in its colours."""


def faults_at_every_size(page: Page, name: str) -> dict[str, list[str]]:
    """What is wrong with the page or its open dialog, by width and scheme; the window gets its first size again.

    The page is loaded once; its window is made larger and smaller. ``name`` is that of the state in its pictures.
    """
    folder = os.environ.get("STRIDELAB_SCREENSHOTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
    page.evaluate(Axe().axe_script)
    faults: dict[str, list[str]] = {}
    schemes = [("light", EVERYTHING), ("dark", COLOURS)]
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate(SHEET, width < 800)
        for scheme, options in schemes:
            page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
            page.evaluate(TWO_PICTURES)
            if wrong := page.evaluate(FAULTS, [options, COUNTED]):
                faults[f"{width}, {scheme}"] = wrong
            if folder:
                page.screenshot(path=Path(folder) / f"state-{name}-{width}-{scheme}.jpg", type="jpeg", quality=85)
        schemes.reverse()  # other colours cost as much as another size: the next one begins with these
    page.evaluate(SHEET, False)
    page.emulate_media(color_scheme="light")
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    return faults
