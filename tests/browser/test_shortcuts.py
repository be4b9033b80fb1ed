"""Shortcuts work whatever has the focus but text fields, and one list tells them all."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Locator, Page, expect

from support.browser.page import Tab, opened

pytestmark = pytest.mark.usefixtures("lab")


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab(900, 640)


@pytest.fixture
def page(tab: Tab, addresses: dict[str, str]) -> Page:
    return opened(tab, f"{addresses['view-plan']}&t=2")


def frame(page: Page) -> int:
    return int(page.get_by_role("slider", name="Time").input_value())


def play(page: Page) -> Locator:
    return page.locator("[data-do=play]")


def test_a_click_on_a_box_leaves_the_shortcuts(page: Page) -> None:
    for clicked, key, view in (("Loop", "2", "front"), ("Robot", "1", "side"), ("Follow", "2", "front")):
        page.get_by_role("slider", name="Time").fill("100")
        box = page.get_by_label(clicked, exact=True)
        box.click()
        was = box.is_checked()
        page.keyboard.press(key)
        expect(page.get_by_label("View")).to_have_value(view)
        page.keyboard.press("Home")
        assert frame(page) == 0, clicked
        page.keyboard.press("Space")
        expect(play(page)).to_have_attribute("aria-pressed", "true")
        page.keyboard.press("Space")
        expect(play(page)).to_have_attribute("aria-pressed", "false")
        assert box.is_checked() is was, clicked


def test_a_click_on_a_button_leaves_space_to_playing(page: Page) -> None:
    page.get_by_role("button", name="One frame back (comma)").click()
    assert frame(page) == 99
    page.keyboard.press("Space")
    expect(play(page)).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Space")
    page.keyboard.press("Home")
    assert frame(page) == 0, "space has not pressed the button again"


def test_what_was_reached_by_tab_is_pressed_by_space(page: Page) -> None:
    page.get_by_label("Speed").focus()
    page.keyboard.press("Tab")
    loop = page.get_by_label("Loop", exact=True)
    expect(loop).to_be_focused()
    page.keyboard.press("Space")
    expect(loop).not_to_be_checked()
    expect(play(page)).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("3")
    expect(page.get_by_label("View")).to_have_value("above")
    page.keyboard.press("End")
    assert frame(page) == 290


def test_a_list_and_a_slider_keep_their_arrow_keys(page: Page) -> None:
    speed = page.get_by_label("Speed")
    speed.focus()
    page.keyboard.press("ArrowDown")
    expect(speed).to_have_value("2")
    assert frame(page) == 100
    page.keyboard.press("2")
    expect(page.get_by_label("View")).to_have_value("front")
    page.get_by_role("slider", name="Time").focus()
    page.keyboard.press("ArrowRight")
    assert frame(page) == 101, "one frame, not two"
    page.keyboard.press("Space")
    expect(play(page)).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Space")
    before = page.get_by_role("slider", name="Start of the played range")
    before.focus()
    page.keyboard.press("ArrowRight")
    expect(before).to_have_attribute("aria-valuenow", "1")


def test_text_fields_keep_every_key(page: Page) -> None:
    for field in (
        "<input>",
        "<input type=search>",
        "<input type=number>",
        "<textarea></textarea>",
        "<p contenteditable>",
    ):
        page.evaluate(
            "(field) => { document.querySelector('#field')?.remove();"
            " document.querySelector('h1').insertAdjacentHTML('afterend', field);"
            " document.querySelector('h1').nextElementSibling.id = 'field'; }",
            field,
        )
        page.locator("#field").focus()
        for key in ("2", "Home", "Space", "?", "p", "."):
            page.keyboard.press(key)
        expect(page.get_by_label("View")).to_have_value("")
        assert frame(page) == 100, field
        expect(play(page)).to_have_attribute("aria-pressed", "false")
        expect(page.get_by_role("dialog")).to_have_count(0)


def test_shortcuts_work_in_the_scene_where_arrows_turn_the_view(page: Page) -> None:
    page.locator("iframe").click(position={"x": 60, "y": 60})
    page.keyboard.press("Home")
    assert frame(page) == 0
    page.keyboard.press(".")
    assert frame(page) == 1
    page.keyboard.press("ArrowRight")
    assert frame(page) == 1
    page.keyboard.press("Space")
    expect(play(page)).to_have_attribute("aria-pressed", "true")


def listed(page: Page) -> dict[str, str]:
    """Keys and what they do, in the open list."""
    rows: list[list[str]] = page.evaluate(
        "() => [...document.querySelectorAll('dialog[open] dt')]"
        ".map((dt) => [dt.innerText.trim(), dt.nextElementSibling.innerText])"
    )
    return dict(rows)


def test_a_question_mark_lists_them_all(page: Page) -> None:
    loop = page.get_by_label("Loop", exact=True)
    loop.focus()
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog", name="Keyboard shortcuts")
    expect(dialog).to_be_visible()
    rows = listed(page)
    assert rows["Space"] == "Play, pause"
    assert {",", ".", "←", "→", "Home", "End", "Page Up", "Page Down", "[", "]", "\\", "1", "2", "3", "4", "?"} <= set(
        rows
    )
    page.evaluate(Axe().axe_script)
    options = json.dumps({"resultTypes": ["violations"], "iframes": False})
    result: list[dict[str, Any]] = page.evaluate(
        f"axe.run('dialog[open]', {options}).then((found) => found.violations)"
    )
    assert [one["id"] for one in result] == []
    page.keyboard.press("3")
    expect(page.get_by_label("View")).to_have_value("")
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    expect(loop).to_be_focused()
    page.get_by_role("button", name="Keyboard shortcuts").click()
    expect(dialog).to_be_visible()
    dialog.get_by_role("button", name="Close").click()
    page.keyboard.press("Space")
    expect(play(page)).to_have_attribute("aria-pressed", "true")


def test_every_key_of_the_list_does_something(page: Page) -> None:
    """The list and the handler are one table: a row without effect would be a row of the list alone."""
    page.keyboard.press("?")
    keys = [key for key in listed(page) if len(key) == 1 and key not in "?←→↑↓"] + ["Home", "End", "PageUp", "PageDown"]
    page.keyboard.press("Escape")
    page.evaluate(
        "() => { window.taken = []; addEventListener('keydown', (e) => e.defaultPrevented && taken.push(e.key)); }"
    )
    for key in keys:
        page.keyboard.press(key)
        if key in {"f", "p"}:  # film and picture open a dialog
            page.get_by_role("button", name="Close").click()
            expect(page.get_by_role("dialog")).to_have_count(0)
    assert page.evaluate("taken") == keys


def test_robot_and_editor_have_their_lists(tab: Tab, addresses: dict[str, str]) -> None:
    page = opened(tab, addresses["view-robot"])
    page.get_by_label("Robot", exact=False).last.click()
    page.keyboard.press("?")
    rows = listed(page)
    assert rows["e"] == "Next effector"
    assert rows["r"] == "Show or hide: Robot"
    page.keyboard.press("Escape")
    effector = page.locator("[name=effector]")
    first = effector.input_value()
    effector.focus()
    page.keyboard.press("e")
    assert effector.input_value() != first, "also where the list itself has the focus"

    page = opened(tab, addresses["view-scenario"])
    page.keyboard.press("?")
    assert "Ctrl+z" in listed(page)
    page.keyboard.press("Escape")
    page.get_by_label("lasts").focus()
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keyboard shortcuts")).to_be_hidden()
