"""The page of the reproduction: what is missing is requested once, a full queue is shown, drawings are seen."""

import re

import pytest
from playwright.sync_api import Page, expect

from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.reproduction import ITEMS_WITH_DRAWS, ClaimResult, ReproduceSummary
from stridelab_web.pages.reproduction import ITEMS
from support.browser.page import Tab
from support.fakes.web_app import Lab

SVG = b'<svg xmlns="http://www.w3.org/2000/svg" width="300" height="200"><rect width="300" height="200"/></svg>'


@pytest.fixture
def page(lab: Lab, tab: Tab) -> Page:
    """With a result of figure 2.6; nothing that is requested ever begins."""
    fake = lab.fake
    fake.step_s = 3600.0
    fake.jobs.clear()
    job = fake.add_job("reproduce", "succeeded")
    claim = ClaimResult(
        key="a", says="a claim", thesis=0.25, ours=0.0125, unit="m", verdict="met", note="", evidence="simulated", n=5
    )
    summary = ReproduceSummary(
        item="fig-2.6", title="Spectra", verdict="met", thesis={}, ours={}, claims=[claim], seeds=5, note="Meaning."
    )
    fake.results[job.id] = JobResult(
        kind="reproduce", input={}, versions={}, references=[], summary=summary.model_dump(mode="json"),
        artifacts=[Artifact(name="fig-2.6.svg", media_type="image/svg+xml", bytes=len(SVG))],
    )  # fmt: skip
    tab.page.route("**/fig-2.6.svg", lambda route: route.fulfill(body=SVG, content_type="image/svg+xml"))
    return tab.go("/reproduction")


def test_an_item_unfolds_to_its_claims_and_its_drawing(page: Page) -> None:
    card = page.locator("#fig-2\\.6")
    row = card.get_by_role("row", name="a claim")
    drawing = card.get_by_role("img", name="Spectra")
    drawing.scroll_into_view_if_needed()
    page.wait_for_function("() => document.querySelector('.item img').naturalWidth === 300")
    expect(row).to_be_hidden()
    card.get_by_text("1 claim in detail").click()
    expect(row).to_be_visible()
    page.get_by_role("button", name="Unfold all").click()
    page.get_by_role("button", name="Fold all").click()
    expect(row).to_be_hidden()


def test_a_full_queue_is_shown_and_what_is_missing_is_requested_once(page: Page, lab: Lab, tab: Tab) -> None:
    wanted = [name for name in ITEMS if name != "fig-2.6"]
    lab.fake.busy, lab.fake.inputs = 7, {}
    everything = page.get_by_role("button", name=re.compile("all missing items"))
    everything.click()
    message = page.get_by_role("status")
    expect(message).to_contain_text(f"0 of {len(wanted)} were started. 200 jobs are waiting already. Try again in 7 s.")
    expect(everything).to_be_enabled()
    lab.fake.busy = None
    page.get_by_label("Random draws").fill("3")
    everything.click()
    expect(page.get_by_role("heading", name="In progress")).to_be_visible()
    assert [given["item"] for given in lab.fake.inputs.values()] == wanted
    drawn = {given["item"] for given in lab.fake.inputs.values() if given["seeds"] == 3}
    assert drawn == ITEMS_WITH_DRAWS - {"fig-2.6"}, "others would refuse a number of draws"
    assert {given["seeds"] for given in lab.fake.inputs.values()} == {3, None}
    expect(everything).to_be_disabled()
    expect(message).to_contain_text("when the jobs above are finished")
    tab.missteps = [m for m in tab.missteps if "status of 429" not in m]
