"""A newcomer's way: from the front page of a fresh service to a moving result of either wing, in at most two clicks."""

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from support.browser.page import FETCHED, Mouse, Service, Tab, few_pictures, focus_by_tab

CLICKS_AT_MOST = 2
PLANNED_WITHIN_MS = 420_000
"""On a machine with one busy core."""


def expect_motion(page: Page, timeout_ms: float = 60_000) -> None:
    """The viewer plays: its button says so, and its clock goes on."""
    page.wait_for_selector("[data-player][data-ready]", timeout=timeout_ms)
    expect(page.get_by_role("button", name="Pause (space)")).to_be_visible()
    first = page.locator("[data-time]").text_content()
    expect(page.locator("[data-time]")).not_to_have_text(first or "")


@pytest.fixture
def page(open_tab: Callable[..., Tab]) -> Page:
    tab = open_tab()
    return tab.go("/")


def test_a_walking_person(page: Page) -> None:
    """By Tab, Enter and Space alone; the picker of files is reached on the way. The front page is small."""
    fetched = dict(page.evaluate(FETCHED))
    assert any(name.endswith("/app.css") for name in fetched)
    assert 20_000 < sum(fetched.values()) < 100_000
    assert not any("plotly" in name for name in fetched)
    with page.expect_file_chooser():
        focus_by_tab(page, page.locator("[data-upload] input[type=file]"))
        page.keyboard.press("Enter")
    focus_by_tab(page, page.get_by_role("link", name="Watch the sample walk"))
    page.keyboard.press("Enter")
    page.wait_for_url("**/view/?recording=sample-walk*")
    expect_motion(page)
    expect(page.locator('[data-show="/paths/"]')).to_be_visible()
    stage = page.locator(".stage")
    focus_by_tab(page, stage.locator("iframe"))
    expect(stage).to_have_attribute("data-focused", "")
    focus_by_tab(page, page.locator("[data-do=play]"))
    expect(stage).not_to_have_attribute("data-focused", "")
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Play (space)")).to_be_focused()


@pytest.mark.timeout(600)
def test_a_robot_that_climbs_stairs(page: Page, service: Service) -> None:
    mouse = Mouse(CLICKS_AT_MOST)
    card = page.locator("li", has=page.get_by_role("heading", name="Six stairs"))
    mouse.click(card.get_by_role("button", name="Plan"))
    page.wait_for_url("**/view/?scenario=six-stairs&planning=*")
    expect(page.get_by_role("progressbar", name="Progress of the plan")).to_be_visible()
    with few_pictures(page):
        page.wait_for_url("**/view/?plan=*", timeout=PLANNED_WITHIN_MS)
    expect_motion(page)
    plan = service.client.jobs(kind="plan-motion", scenario_id="six-stairs").items[0]
    assert service.client.result(plan.id).summary["certificate"]["passed"]

    page.goto(service.url)
    mouse = Mouse(CLICKS_AT_MOST)
    mouse.click(card.get_by_role("link", name="Watch"))
    page.wait_for_url(f"**/view/?plan={plan.id}*")
    expect_motion(page)


@pytest.mark.timeout(600)
def test_a_new_stair_with_a_rail_is_planned_and_watched(page: Page, service: Service) -> None:
    mouse = Mouse(at_most=8)
    mouse.click(page.get_by_role("link", name="New scenario"))
    mouse.choose(page.locator("select[name=handrails]"), "right")
    mouse.fill(page.get_by_label("Stairs of Stairs, obstacle 1"), "2")
    mouse.click(page.get_by_role("button", name="Plan the motion"))
    page.wait_for_url("**/view/?scenario=*&planning=*", timeout=PLANNED_WITHIN_MS)
    with few_pictures(page):
        page.wait_for_url("**/view/?plan=*", timeout=PLANNED_WITHIN_MS)
    expect_motion(page)
    scenario = service.client.jobs(kind="plan-motion").items[0].scenario_id
    assert scenario is not None
    contacts = {c.effector for phase in service.client.scenario(scenario).phases for c in phase.contacts}
    assert "right_hand" in contacts, "the rail is used"


@pytest.mark.timeout(600)
def test_a_recording_of_ones_own_to_com_comparison_and_csv(page: Page, trial: Path) -> None:
    """With the click on "Choose files", whose dialog is the system's."""
    mouse = Mouse(at_most=4)
    with page.expect_file_chooser() as chooser:
        mouse.click(page.get_by_role("button", name="Choose files"))
    chooser.value.set_files(trial)
    page.wait_for_url("**/recordings/*")
    mouse.click(page.get_by_role("button", name="Estimate", exact=True))
    expect(page.locator("[data-headline]")).to_contain_text("Centre of mass known to", timeout=PLANNED_WITHIN_MS)
    with page.expect_download() as saved:
        mouse.click(page.get_by_role("link", name="CSV", exact=True))
    assert saved.value.suggested_filename == "com.csv"
    job_url = page.url
    mouse.click(page.get_by_role("button", name="Compare all methods"))
    page.wait_for_url(lambda url: job_url not in url)
    expect(page.get_by_role("heading", level=1)).to_have_text("Comparison of methods")
    expect(page.get_by_role("heading", name="Result")).to_be_visible(timeout=PLANNED_WITHIN_MS)
