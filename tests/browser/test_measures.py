"""Measures of gait through the pages: started by a button, and shown as the interface gives them."""

import pytest
from playwright.sync_api import expect

from support.browser.page import Service, Tab
from support.fakes.web_app import Lab


def test_measure_the_sample_by_a_button(tab: Tab, service: Service) -> None:
    page = tab.go("/recordings/sample-walk")
    page.get_by_role("button", name="Measures of gait", exact=True).click()
    page.wait_for_url("**/jobs/*")
    job_id = page.url.rpartition("/")[2]
    expect(page.get_by_role("heading", name="All measures")).to_be_visible(timeout=120_000)
    summary = service.client.result(job_id).summary
    means = {one["name"]: one["mean"] for one in summary["measures"] if one["side"] is None}
    shown = page.locator('[data-main="margin_of_stability_ml_min"] b').text_content() or ""
    assert shown == f"{1000 * means['margin_of_stability_ml_min']:.0f} mm"
    assert page.locator("tr[data-measure]").count() == len(means)
    assert f"{summary['steps']} steps in 1 recording" in (page.locator("[data-headline]").text_content() or "")
    with page.expect_download() as download:
        page.get_by_role("link", name="measures.csv").first.click()
    assert download.value.path().read_text().startswith('"recording","measure","side"')


def test_a_session_is_measured_by_a_button(tab: Tab, lab: Lab) -> None:
    walks = [lab.fake.add_recording(f"walk_{k}.c3d", session_id="gait") for k in (1, 2)]
    page = tab.go(f"/recordings/{walks[0].id}")
    page.get_by_role("button", name="Measures of gait of 2 recordings").click()
    page.wait_for_url("**/jobs/*")
    job = lab.fake.jobs[page.url.rpartition("/")[2]]
    assert job.kind == "gait-measures"
    assert lab.fake.inputs[job.id] == {"recording_ids": [walk.id for walk in walks]}


@pytest.mark.parametrize(("method", "given"), [("smoother", "smoother"), ("geometry", "geometry"), ("", None)])
def test_a_recording_is_measured_by_the_chosen_method(tab: Tab, lab: Lab, method: str, given: str | None) -> None:
    walk = lab.fake.add_recording()
    page = tab.go(f"/recordings/{walk.id}")
    page.locator("[data-estimate] [name=method]").select_option(method)
    page.get_by_role("button", name="Measures of gait", exact=True).click()
    page.wait_for_url("**/jobs/*")
    assert lab.fake.inputs[page.url.rpartition("/")[2]] == {"recording_ids": [walk.id], "method": given}


def test_a_report_is_written_by_a_button(tab: Tab, service: Service) -> None:
    page = tab.go("/recordings/sample-walk")
    page.locator("[data-report]").click()
    page.wait_for_url("**/jobs/*")
    expect(page.get_by_role("heading", name="Gait report", exact=True)).to_be_visible()
    expect(page.get_by_role("heading", name="All measures")).to_be_visible(timeout=120_000)
    with page.expect_download() as download:
        page.get_by_role("link", name="report.pdf").first.click()
    assert download.value.path().read_bytes().startswith(b"%PDF-")


def test_a_session_has_a_report_by_a_button(tab: Tab, lab: Lab) -> None:
    walks = [lab.fake.add_recording(f"walk_{k}.c3d", session_id="report") for k in (1, 2)]
    page = tab.go(f"/recordings/{walks[0].id}?language=ja")
    page.locator("[data-session-report]").click()
    page.wait_for_url("**/jobs/*")
    job = lab.fake.jobs[page.url.rpartition("/")[2]]
    assert job.kind == "gait-report"
    assert lab.fake.inputs[job.id] == {"recording_ids": [walk.id for walk in walks], "language": "ja"}


def test_a_report_is_compared_with_a_group_and_with_earlier_walks(tab: Tab, lab: Lab) -> None:
    walks = [lab.fake.add_recording(f"walk_{k}.c3d", session_id="now") for k in (1, 2)]
    earlier = [lab.fake.add_recording(f"earlier_{k}.c3d", session_id="then") for k in (1, 2)]
    other = lab.fake.add_recording("other.c3d")
    page = tab.go(f"/recordings/{walks[0].id}")
    form = page.locator("[data-gait-report]")
    form.locator("summary").click()
    form.locator(f'[data-group="{other.id}"] select').select_option("reference_recording_ids")
    form.get_by_label("Use of earlier").select_option("before_recording_ids")
    form.get_by_label("Heading").fill("After training")
    form.get_by_role("button", name="Write the report").click()
    page.wait_for_url("**/jobs/*")
    assert lab.fake.inputs[page.url.rpartition("/")[2]] == {
        "recording_ids": [walk.id for walk in walks],
        "title": "After training",
        "reference_recording_ids": [other.id],
        "before_recording_ids": sorted(one.id for one in earlier),
        "language": "en",
    }


def test_a_report_of_one_recording_takes_the_chosen_method(tab: Tab, lab: Lab) -> None:
    walk = lab.fake.add_recording("lone.c3d")
    page = tab.go(f"/recordings/{walk.id}")
    page.locator("[data-estimate] [name=method]").select_option("geometry")
    page.get_by_role("button", name="Write the report").click()
    page.wait_for_url("**/jobs/*")
    assert lab.fake.inputs[page.url.rpartition("/")[2]] == {
        "recording_ids": [walk.id],
        "method": "geometry",
        "language": "en",
    }
