"""The browser's notification at the end of a job says the verdict, only to a reader who asked and looks elsewhere."""

from typing import Any

import pytest
from playwright.sync_api import Page, expect

from stridelab.schemas.jobs import JobVerdict, Progress
from support.browser.page import Tab
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

STAND_IN = """
    const stored = (key) => JSON.parse(sessionStorage.getItem(key) ?? "null");
    const store = (key, value) => sessionStorage.setItem(key, JSON.stringify(value));
    window.Notification = class extends EventTarget {
        static get permission() { return stored("permission") ?? "default"; }
        static async requestPermission() { store("permission", stored("answer") ?? "granted"); return this.permission; }
        constructor(title, { body }) { super(); store("notices", [...stored("notices") ?? [], [title, body]]); }
    };
    Object.defineProperty(document, "hidden", { get: () => stored("in-background") ?? false });
"""
"""Chromium without windows denies all notifications; and its tabs are never in the background."""
FELL = JobVerdict(outcome="failed", code="replay-fell", message="Certified; the replay falls at 3.2 s")


@pytest.fixture
def page(tab: Tab) -> Page:
    tab.page.add_init_script(STAND_IN)
    return tab.page


def sent_notices(page: Page) -> Any:
    return page.evaluate("() => JSON.parse(sessionStorage.getItem('notices') ?? '[]')")


def look_elsewhere(page: Page) -> None:
    page.evaluate("() => sessionStorage.setItem('in-background', 'true')")


@pytest.mark.parametrize("asked", [True, False])
def test_the_page_of_a_plan_notifies_with_its_verdict(page: Page, tab: Tab, lab: Lab, asked: bool) -> None:
    job = lab.fake.add_job("plan-motion", "running", about="Six stairs", progress=Progress(fraction=0.4))
    tab.go(f"/plans/{job.id}")
    wanted = page.get_by_role("checkbox", name="Notify me at its end")
    wanted.set_checked(asked)
    look_elsewhere(page)
    lab.fake.change(job.id, state="succeeded", verdict=FELL, progress=Progress(fraction=1.0))
    expect(page.locator("[data-outcome]")).to_contain_text(FELL.message)
    assert sent_notices(page) == ([["Plan", f"✗ {FELL.message}"]] if asked else [])


def test_the_list_of_jobs_notifies_in_the_background_only(page: Page, tab: Tab, lab: Lab) -> None:
    first, second = (lab.fake.add_job("plan-motion", "running", about=name) for name in ("near", "far"))
    tab.go(f"/jobs/{first.id}")
    page.get_by_role("checkbox", name="Notify me at its end").check()
    tab.go("/jobs")
    rows = {job.id: page.locator(f"tr[data-job='{job.id}']") for job in (first, second)}
    lab.fake.change(first.id, state="succeeded", verdict=FELL)
    expect(rows[first.id].locator("[data-outcome]")).to_have_text(FELL.message)
    assert sent_notices(page) == []
    look_elsewhere(page)
    lab.fake.change(
        second.id, state="succeeded", verdict=JobVerdict(outcome="passed", code="certified", message="Certified")
    )
    expect(rows[second.id].locator("[data-outcome]")).to_have_text("Certified")
    assert sent_notices(page) == [["Motion plan far", "✓ Certified"]]


def test_a_browser_that_refuses_is_believed(page: Page, tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_job("plan-motion", "running")
    tab.go(f"/jobs/{job.id}")
    page.evaluate("() => sessionStorage.setItem('answer', '\"denied\"')")
    wanted = page.get_by_role("checkbox", name="Notify me at its end")
    wanted.click()
    expect(page.locator("[data-notify]")).to_contain_text("The browser does not allow notifications")
    expect(wanted).not_to_be_checked()
    page.reload()
    expect(page.locator("[data-live]")).to_be_visible()
    expect(wanted).to_have_count(0)
