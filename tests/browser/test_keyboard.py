"""The whole way by the keyboard alone: upload, estimate, a new scenario, a contact moved by numbers, plan, watch."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stridelab_web.scene.contacts import placed_contacts
from support.browser.page import Service, Tab, few_pictures, focus_by_tab

PLANNED_WITHIN_MS = 420_000
RECORD_LOSSES = """() => {
    const losses = () => JSON.parse(sessionStorage.getItem("losses") ?? "[]");
    let last = "";
    addEventListener("focusin", ({ target }) => { last = target.outerHTML.slice(0, 160); });
    addEventListener("keydown", ({ key }) => { if (key === "Tab") last = ""; }, true);
    setInterval(() => {
        if (!last || document.activeElement !== document.body) return;
        sessionStorage.setItem("losses", JSON.stringify([...losses(), `${location.pathname}: ${last}`]));
        last = "";
    }, 10);
}"""
"""Stores what had the focus when nothing has it any more, but for Tab itself, which leaves a page at its end."""
LOSSES = "() => JSON.parse(sessionStorage.getItem('losses') ?? '[]')"


@pytest.fixture
def page(open_tab: Callable[..., Tab]) -> Iterator[Page]:
    """At the end the focus must not have been lost on any page; the browser reports the refused file as an error."""
    tab = open_tab()
    tab.page.add_init_script(f"({RECORD_LOSSES})()")
    page = tab.go("/")
    page.on("filechooser", lambda _: None)  # from now on the browser reports choosers, not only once one is expected
    yield page
    losses = page.evaluate(LOSSES)
    tab.missteps = [misstep for misstep in tab.missteps if "status of 422" not in misstep]
    assert losses == []


def press_by_tab(page: Page, role: str, name: str) -> None:
    """Go to a button or a link by Tab and press Enter."""
    focus_by_tab(page, page.get_by_role(role, name=name, exact=True))  # type: ignore[arg-type]
    page.keyboard.press("Enter")


def type_number(page: Page, text: str) -> None:
    page.keyboard.press("Control+a")
    page.keyboard.type(text)
    page.keyboard.press("Tab")


@pytest.mark.timeout(600)
def test_from_a_file_to_a_watched_plan(page: Page, service: Service, trial: Path) -> None:
    with page.expect_file_chooser() as chooser:
        focus_by_tab(page, page.locator("[data-upload] input[type=file]"))
        page.keyboard.press("Enter")
    chooser.value.set_files(trial)
    page.wait_for_url("**/recordings/*")
    press_by_tab(page, "button", "Estimate")
    expect(page.locator("[data-headline]")).to_contain_text("Centre of mass known to", timeout=PLANNED_WITHIN_MS)

    press_by_tab(page, "link", "Scenarios")
    page.wait_for_url("**/scenarios")
    press_by_tab(page, "link", "New scenario")
    page.wait_for_url("**/scenarios/new")
    rails = page.locator("select[name=handrails]")
    focus_by_tab(page, rails)
    page.keyboard.press("ArrowDown")
    expect(rails).not_to_have_value("none")
    focus_by_tab(page, page.get_by_label("Stairs of Stairs, obstacle 1"))
    type_number(page, "2")
    press_by_tab(page, "button", "Undo")
    press_by_tab(page, "button", "Redo")
    press_by_tab(page, "button", "Place the feet only")
    page.wait_for_url("**/view/?scenario=*", timeout=PLANNED_WITHIN_MS)

    page.wait_for_selector("[data-ready]")
    scenario_id = page.url.rpartition("=")[2]
    placed = placed_contacts(service.client.scenario(scenario_id))[2]
    row = page.locator("[data-touches] > li").nth(2)
    focus_by_tab(page, row.get_by_role("button"))
    page.keyboard.press("Enter")
    ahead = row.locator("input[name=x]")
    focus_by_tab(page, ahead)
    type_number(page, f"{placed.contact.position_m[0] - 0.01:.3f}")
    expect(page.locator("[data-said]")).to_have_text("Contact 3 stored.")
    expect(page.locator("[data-editor]")).to_have_attribute("data-judged", "valid")
    page.keyboard.press("Shift+Tab")
    expect(ahead).to_be_focused()
    moved = placed_contacts(service.client.scenario(scenario_id))[2]
    assert moved.contact.position_m[0] == pytest.approx(placed.contact.position_m[0] - 0.01, abs=1e-3)

    press_by_tab(page, "button", "Plan")
    with few_pictures(page):
        page.wait_for_url("**/view/?plan=*", timeout=PLANNED_WITHIN_MS)
    page.wait_for_selector("[data-player][data-ready]", timeout=90_000)
    focus_by_tab(page, page.locator("[data-do=play]"))
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Play (space)")).to_be_focused()
    slider = page.get_by_role("slider", name="Time", exact=True)
    focus_by_tab(page, slider)
    at = slider.input_value()
    page.keyboard.press("ArrowRight")
    expect(slider).not_to_have_value(at)
    page.keyboard.press("f")
    film = page.get_by_role("dialog", name="Film of the scene")
    expect(film).to_be_visible()
    page.keyboard.press("Escape")
    expect(film).to_be_hidden()
    expect(slider).to_be_focused()


def test_what_goes_away_hands_the_focus_on(page: Page, trial: Path, tmp_path: Path) -> None:
    """The tour, the refusal of a file, obstacles that move and go, and a step that can no longer be undone."""
    page.goto(f"{page.url}?tour=1")
    press_by_tab(page, "button", "Next")
    page.keyboard.press("Escape")
    expect(page.locator("[data-upload] input[type=file]")).to_be_focused()

    cut = tmp_path / "cut.c3d"
    cut.write_bytes(trial.read_bytes()[:700])
    with page.expect_file_chooser() as chooser:
        page.keyboard.press("Enter")
    chooser.value.set_files(cut)
    press_by_tab(page, "button", "Dismiss the refusal of cut.c3d")
    expect(page.locator("[data-upload] input[type=file]")).to_be_focused()

    press_by_tab(page, "link", "Scenarios")
    page.wait_for_url("**/scenarios")
    press_by_tab(page, "link", "New scenario")
    page.wait_for_url("**/scenarios/new")
    press_by_tab(page, "button", "Add: Box")
    press_by_tab(page, "button", "Earlier: Box, obstacle 2")
    expect(page.get_by_role("button", name="Earlier: Box, obstacle 1")).to_be_focused()
    press_by_tab(page, "button", "Remove: Box, obstacle 1")
    expect(page.get_by_role("button", name="Remove: Stairs, obstacle 1")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("[data-add] button").first).to_be_focused()
    undo = page.get_by_role("button", name="Undo", exact=True)
    focus_by_tab(page, undo)
    for _ in range(4):
        page.keyboard.press("Enter")
    expect(undo).to_be_disabled()
    expect(undo).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_label("Stairs of Stairs, obstacle 1")).to_be_visible()
