"""The scene has the pixels of the screen at rest, and fewer while its pictures come slowly."""

from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from support.browser.page import Tab, opened, until
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab", "drawn")

RATIO = """() => {
    const { canvas } = document.querySelector("iframe").contentWindow.__viserMutable;
    return canvas.width / canvas.clientWidth;
}"""


def ratio(page: Page) -> float:
    result: float = page.evaluate(RATIO)
    return result


@pytest.mark.parametrize("screen", [1, 2])
def test_the_scene_has_the_pixels_of_the_screen(open_tab: Callable[..., Tab], lab: Lab, screen: int) -> None:
    """In the tests a picture takes a tenth of a second: slow, when they follow each other."""
    tab = open_tab(480, 420, device_scale_factor=screen)
    page = opened(tab, f"/view/?plan={lab.fake.add_plan().id}&t=1")
    assert ratio(page) == pytest.approx(screen, abs=0.01)
    page.locator("body").press(" ")
    until(page, lambda: ratio(page) < 0.8 * screen)
    page.locator("body").press(" ")
    until(page, lambda: ratio(page) == pytest.approx(screen, abs=0.01))


def test_the_editor_and_the_robot_have_them_too(open_tab: Callable[..., Tab], addresses: dict[str, str]) -> None:
    for name in ("view-scenario", "view-robot"):
        page = opened(open_tab(800, 600, device_scale_factor=2), addresses[name])
        assert ratio(page) == pytest.approx(2, abs=0.01), name


def test_the_ratio_follows_the_time_that_pictures_take(tab: Tab) -> None:
    page = tab.go("/jobs")
    result = page.evaluate("""async () => {
        const { nextLevel, pixelRatios } = await import("/static/js/viewer/adaptive_resolution.js");
        const all = pixelRatios(2);
        return {
            ratios: [0.5, 1, 2, 3].map(pixelRatios),
            slow: [60, 100, 1000].map((ms) => all[nextLevel(all, 0, ms)]),
            between: all[nextLevel(all, 1, 40)],
            fast: [[1, 16], [2, 12], [2, 20]].map(([k, ms]) => all[nextLevel(all, k, ms)]),
        };
    }""")
    assert result["ratios"] == [[0.5], [1, 0.75, 0.5], [2, 1.5, 1], [3, 2.25, 1.5]]
    assert result["slow"] == [1.5, 1, 1], "the finest with which a picture takes 50 ms at most, else the coarsest"
    assert result["between"] == 1.5
    assert result["fast"] == [2, 1.5, 1], "a finer one where that stays below 33 ms"
