"""The viewer on a phone: the scene is not covered, what moves is in sight, and the controls are a sheet to pull up."""

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from support.browser.page import Tab, opened

pytestmark = pytest.mark.usefixtures("lab")

PHONE, TABLET, DESKTOP = (390, 844), (800, 600), (1400, 850)
SCENES = ("view-plan", "view-recording", "view-scenario", "view-robot")
COVERED = """() => {
    const frame = document.querySelector("[data-stage] iframe"), box = frame.getBoundingClientRect();
    const inside = frame.contentDocument, found = new Set();
    for (let i = 1; i < 40; i += 1) for (let j = 1; j < 40; j += 1) {
        const x = box.width * i / 40, y = box.height * j / 40;
        const above = document.elementFromPoint(box.left + x, box.top + y);
        if (above !== frame) found.add(above?.outerHTML.slice(0, 80));
        const within = inside.elementFromPoint(x, y);
        if (within?.tagName !== "CANVAS") found.add(within?.outerHTML.slice(0, 80));
    }
    return [...found];
}"""
"""What a pointer meets in place of the scene."""
IN_SIGHT = """(prefix) => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable, { camera } = viser;
    camera.updateMatrixWorld();
    const nodes = Object.entries(viser.nodeRefFromName).filter(([name, node]) => node && name.startsWith(prefix));
    const origin = () => camera.position.clone().set(0, 0, 0);
    const seen = nodes.map(([, node]) => node.localToWorld(origin()).project(camera));
    return [seen.length, seen.filter(({ x, y }) => Math.abs(x) < 1 && Math.abs(y) < 1).length];
}"""
"""How many nodes of a name there are, and how many of them are within the picture."""
WITHIN = {"view-plan": "/robot/", "view-recording": "/markers/", "view-scenario": "/contacts/", "view-robot": "/robot"}


@pytest.fixture
def phone(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab(*PHONE, has_touch=True, is_mobile=True)


def box(page: Page, selector: str) -> dict[str, float]:
    result: Any = page.locator(selector).bounding_box()
    assert result is not None
    return dict(result)


CONTROLS = {"view-plan": "Speed", "view-recording": "Follow", "view-scenario": "lasts", "view-robot": "Measure"}


@pytest.mark.parametrize("name", SCENES)
def test_a_phone_shows_what_the_scene_is_about_and_controls_are_a_sheet_to_pull_up(
    phone: Tab, addresses: dict[str, str], name: str
) -> None:
    page = opened(phone, addresses[name])
    assert page.evaluate(COVERED) == []
    nodes, seen = page.evaluate(IN_SIGHT, WITHIN[name])
    assert nodes > 0
    assert seen == nodes
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    assert box(page, "[data-stage]")["height"] > PHONE[1] / 2
    pull_up_the_sheet(page, CONTROLS[name])


@pytest.mark.parametrize("name", SCENES)
def test_nothing_lies_over_the_scene(open_tab: Callable[..., Tab], addresses: dict[str, str], name: str) -> None:
    page = opened(open_tab(*DESKTOP), addresses[name])
    for width, height in (DESKTOP, TABLET):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(f"() => innerWidth === {width}")
        assert page.evaluate(COVERED) == []
        expect(page.locator("[data-sheet-handle]")).to_be_hidden()


def pull_up_the_sheet(page: Page, control: str) -> None:
    """The controls are a closed sheet, which opens and closes by a tap, by a finger that pulls, and by keys."""
    handle, inner = page.get_by_role("button", name="Controls"), page.get_by_label(control)
    stage, sheet = box(page, "[data-stage]"), box(page, "[data-sheet]")
    expect(handle).to_have_attribute("aria-expanded", "false")
    expect(inner).to_be_hidden()
    assert stage["y"] + stage["height"] <= sheet["y"] + 1, "a closed sheet leaves the scene free"

    handle.tap()
    expect(handle).to_have_attribute("aria-expanded", "true")
    expect(inner).to_be_visible()
    opened_sheet = box(page, "[data-sheet]")
    assert opened_sheet["y"] < stage["y"] + stage["height"] - 100, "it lies over the lower part of the scene"
    assert opened_sheet["y"] > stage["y"] + 150, "and leaves the upper one"
    assert box(page, "[data-stage]") == stage, "a scene of another size would be drawn anew"

    pull(page, handle_y=opened_sheet["y"] + 20, by=120)
    expect(handle).to_have_attribute("aria-expanded", "false")
    expect(inner).to_be_hidden()
    pull(page, handle_y=sheet["y"] + 20, by=-120)
    expect(handle).to_have_attribute("aria-expanded", "true")

    page.keyboard.press("Tab")
    handle.focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Escape")
    expect(handle).to_have_attribute("aria-expanded", "false")
    expect(handle).to_be_focused()
    page.keyboard.press("Enter")
    expect(inner).to_be_visible()
    page.keyboard.press("Space")
    expect(inner).to_be_hidden()


def pull(page: Page, handle_y: float, by: float) -> None:
    """A finger on the handle that moves up or down."""
    touch = page.context.new_cdp_session(page)

    def finger(kind: str, *y: float) -> None:
        points = [{"x": PHONE[0] / 2, "y": each} for each in y]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    finger("touchStart", handle_y)
    for part in range(1, 6):
        finger("touchMove", handle_y + by * part / 5)
    finger("touchEnd")


def test_the_view_follows_the_body_on_a_phone(phone: Tab, addresses: dict[str, str]) -> None:
    page = opened(phone, f"{addresses['view-plan']}&t=0")
    page.get_by_role("slider", name="Time").fill("200")
    page.wait_for_timeout(500)
    nodes, seen = page.evaluate(IN_SIGHT, "/robot/")
    assert seen == nodes
    page.get_by_role("button", name="Controls").tap()
    expect(page.get_by_label("Follow")).to_be_checked()
