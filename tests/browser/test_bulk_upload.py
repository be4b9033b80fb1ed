"""A bulk upload that the service reads in a job: the page follows it, and names what was refused."""

import json

import pytest
from playwright.sync_api import Route, expect

from stridelab.schemas.base import Problem
from stridelab.schemas.jobs import JobResult, Progress
from support.browser.page import Tab
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")
FILE = {"name": "walk.c3d", "mimeType": "application/octet-stream", "buffer": b"C3D" * 100}


def test_the_job_of_a_large_upload_is_followed_to_its_end(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_job("read-batch", "running", progress=Progress(fraction=0.5, message="1 of 2 files read"))
    stored = lab.fake.add_recording("walk.c3d")
    refused = [{"filename": "broken.c3d", "code": "not-a-recording", "message": "It is no recording."}]
    summary = {"recording_ids": [stored.id], "studied": [stored.id], "subjects": [], "refused": refused}
    lab.fake.results[job.id] = JobResult(
        kind=job.kind, input={}, versions={}, references=[], summary=summary, artifacts=[]
    )

    def accept(route: Route) -> None:
        route.fulfill(status=202, body=job.model_dump_json(), content_type="application/json")

    page = tab.go("/population")
    page.route("**/api/v1/recordings/batch", accept)
    form = page.locator("[data-batch]")
    form.get_by_label("Recordings").set_input_files([FILE])
    form.get_by_role("button", name="Upload and study").click()
    message = form.locator("[data-said]")
    expect(message).to_have_text("1 of 2 files read")
    expect(form.get_by_label("Upload", exact=True)).to_have_attribute("value", "0.5")
    lab.fake.change(job.id, state="succeeded", progress=Progress(fraction=1.0))
    expect(message).to_have_text("1 uploaded, 1 refused.")
    expect(form.locator("[data-refused] li")).to_have_text(["broken.c3d: It is no recording."])
    with page.expect_request("**/api/v1/jobs/study-population") as request:
        form.get_by_role("button", name="Study the others").click()
    assert json.loads(request.value.post_data or "")["recording_ids"] == [stored.id]


def test_why_a_job_read_nothing_is_said(tab: Tab, lab: Lab) -> None:
    problem = Problem(title="Job failed", status=422, code="nothing-readable", detail="None of the files can be read.")
    job = lab.fake.add_job("read-batch", "failed", error=problem)
    page = tab.go("/population")
    page.route(
        "**/api/v1/recordings/batch",
        lambda route: route.fulfill(status=202, body=job.model_dump_json(), content_type="application/json"),
    )
    form = page.locator("[data-batch]")
    form.get_by_label("Recordings").set_input_files([FILE])
    form.get_by_role("button", name="Upload and study").click()
    expect(form.locator("[data-said]")).to_have_text("None of the files can be read.")
