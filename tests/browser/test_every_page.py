"""Every page fits at three sizes, and axe-core has nothing serious to say of it, wide or on a phone, light or dark.

Pictures of each, light and dark at four sizes, are stored in the folder that STRIDELAB_SCREENSHOTS names, for people to
look at.
"""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, ViewportSize

from support.browser.every_page import every_page
from support.browser.page import TWO_PICTURES, Tab
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab", "drawn")

SIZES: tuple[ViewportSize, ...] = (
    {"width": 1400, "height": 850},
    {"width": 800, "height": 600},
    {"width": 390, "height": 844},
)
"""Each has to fit; the pictures for people are also as wide as a large screen."""
Scheme = Literal["light", "dark"]
CHECKED_BY_AXE: dict[int, tuple[Scheme, ...]] = {
    1400: ("light", "dark"),
    800: ("light",),
    390: ("light",),
}
"""Schemes in which axe-core looks at a page, by the width."""
LARGE: ViewportSize = {"width": 2560, "height": 1440}
LEAST_BYTES = 4_000
"""The picture of an empty page is smaller."""
WITHOUT_FRAMES = {"resultTypes": ["violations"], "iframes": False}
"""What is inside a frame is viser's client."""
COLOURS_ALONE = {**WITHOUT_FRAMES, "runOnly": ["color-contrast"]}
"""A dark page differs from a light one in its colours, which are the same at every size."""
COUNTED = ("serious", "critical")
AS_BEFORE = "(open) => document.querySelectorAll('main details').forEach((one, k) => { one.open = open[k]; })"
UNFOLDED = "() => [...document.querySelectorAll('main details')].slice(0, 8).forEach((one) => { one.open = true; })"
"""Also what is folded is looked at; of the many cards of a page that are alike, the first ones."""
WITH_DIALOGS = ("recording", "failed", "view-recording", "view-scenario")
DIALOGS = """async ([options, counted]) => {
    const wrong = [];
    for (const dialog of document.querySelectorAll("dialog")) {
        dialog.showModal();
        const { violations } = await axe.run(dialog, options);
        wrong.push(...violations.filter(({ impact }) => counted.includes(impact))
            .map(({ id, nodes }) => `in a dialog, ${id} at ${nodes[0].target}`));
        if (dialog.scrollWidth > innerWidth) wrong.push("a dialog is wider than the page");
        dialog.close();
    }
    return [document.querySelectorAll("dialog").length, wrong];
}"""


@pytest.fixture
def pictures() -> Path | None:
    """Folder of the pictures, light and dark at four sizes; None where they are not looked at."""
    named = os.environ.get("STRIDELAB_SCREENSHOTS")
    if not named:
        return None
    Path(named).mkdir(parents=True, exist_ok=True)
    return Path(named)


@pytest.mark.timeout(1500)
def test_every_page_fits_and_is_accessible(open_tab: Callable[..., Tab], lab: Lab, pictures: Path | None) -> None:
    """Each page is loaded once, at the first size, and then its window is made smaller, and large for its pictures.

    At every size the colours of the size before are looked at first: other colours cost as much as another size.
    """
    tab = open_tab(SIZES[0]["width"], SIZES[0]["height"])
    result = {}
    for name, address in every_page(lab.fake).items():
        tab.page.goto("about:blank")  # the page before is not laid out and coloured again
        tab.page.set_viewport_size(SIZES[0])
        tab.page.emulate_media(color_scheme="light")
        page = tab.go(address)
        _complete(page, name)
        page.evaluate(Axe().axe_script)
        schemes: list[Scheme] = ["light", "dark"]
        for size in (*SIZES, LARGE) if pictures else SIZES:
            page.set_viewport_size(size)
            checked = CHECKED_BY_AXE.get(size["width"], ())
            for scheme in schemes:
                if not pictures and scheme not in checked:
                    continue
                page.emulate_media(color_scheme=scheme)
                page.evaluate(TWO_PICTURES)
                if pictures:
                    _store_picture(page, name, pictures / f"{name}-{size['width']}-{scheme}.jpg")
                if scheme in checked and (wrong := [*_faults_unfolded(page, name, size, scheme)]):
                    result[f"{name} at {size['width']}, {scheme}"] = wrong
            schemes.reverse()
    assert result == {}
    tab.missteps = [misstep for misstep in tab.missteps if "status of 404" not in misstep]


def _faults_unfolded(page: Page, name: str, size: ViewportSize, scheme: Scheme) -> list[str]:
    """What is wrong with the page; in the last of the sizes also with its dialogs, and with the page as it was."""
    was_open = page.evaluate("[...document.querySelectorAll('main details')].map((one) => one.open)")
    page.evaluate(UNFOLDED)
    page.evaluate(TWO_PICTURES)
    faults = [*_page_faults(page, scheme)]
    if size == SIZES[-1] and name in WITH_DIALOGS:
        number, wrong = page.evaluate(DIALOGS, [WITHOUT_FRAMES, COUNTED])
        assert number, name
        faults += wrong
    page.evaluate(AS_BEFORE, was_open)
    if size == SIZES[-1] and len(page.screenshot(type="png")) <= LEAST_BYTES:
        faults.append("empty")
    return faults


def _store_picture(page: Page, name: str, path: Path) -> None:
    page.screenshot(path=path, type="jpeg", quality=85, full_page=not name.startswith("view-"))


PHONE = (390, 844)
ON_A_PHONE = ("home", "recordings", "recording", "scenario", "jobs", "population", "plan")
"""One page of each layout; most have a table that is wider than the screen of a phone."""
LANGUAGES = {"home": "de", "recordings": "fr", "recording": "de", "jobs": "ja"}
"""Pages that are translated are loaded in a language with long words, or with none that a line can be broken at."""


@pytest.mark.timeout(300)
def test_no_page_scrolls_sideways_on_a_phone(open_tab: Callable[..., Tab], addresses: dict[str, str]) -> None:
    tab = open_tab(*PHONE)
    widths = {}
    for name in ON_A_PHONE:
        language = LANGUAGES.get(name, "en")
        page = tab.go(f"{addresses[name]}{'&' if '?' in addresses[name] else '?'}language={language}")
        _complete(page, name)
        assert page.locator("html").get_attribute("lang") == language
        widths[name] = page.evaluate("document.documentElement.scrollWidth")
    assert widths == dict.fromkeys(ON_A_PHONE, PHONE[0])


def _complete(page: Page, name: str) -> None:
    if name.startswith("view-"):
        page.wait_for_selector("[data-ready]", timeout=90_000)
    elif page.locator("#plots").count():
        page.wait_for_selector("#plots[data-ready]")


def _excess_width(page: Page) -> int:
    return max(0, int(page.evaluate("document.documentElement.scrollWidth - innerWidth")))


def _page_faults(page: Page, scheme: Scheme) -> Iterator[str]:
    """Widths, and what axe-core, which is in the page, has to say."""
    for _ in range(50):  # curves take their new width a moment later
        if not _excess_width(page):
            break
        page.wait_for_timeout(100)
    if wide := _excess_width(page):
        yield f"{wide} pixels too wide"
    options = WITHOUT_FRAMES if scheme == "light" else COLOURS_ALONE
    violations: list[dict[str, Any]] = page.evaluate(
        f"axe.run({json.dumps(options)}).then((found) => found.violations)"
    )
    for one in violations:
        if one["impact"] in COUNTED:
            for node in one["nodes"]:
                yield f"{one['impact']}: {one['id']} at {node['target']}: {node['failureSummary']}"
