"""Succeeded is not passed: wherever a job or its motion is shown, the verdict on its result stands beside it."""

import re
from collections.abc import Callable

import httpx
import pytest

from stridelab.schemas.jobs import JobVerdict
from stridelab.schemas.plans import StoppedMotion
from stridelab_web.pages.home import SAMPLE_SCENARIO
from support.browser.every_page import every_page
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
FELL = JobVerdict(outcome="failed", code="replay-fell", message="Certified, but the <robot> falls at 7.9 s")
DOUBTFUL = JobVerdict(outcome="doubtful", code="sensors-doubtful", message="Doubtful: force residual")
AGREE = JobVerdict(outcome="passed", code="sensors-agree", message="Sensors agree")
SHOWN = "Certified, but the &lt;robot&gt; falls at 7.9 s"


def row_of(page: str, job_id: str) -> str:
    match = re.search(rf'<tr data-job="{job_id}".*?</tr>', page, re.DOTALL)
    assert match is not None
    return match.group()


@pytest.mark.parametrize("verdict", [FELL, DOUBTFUL, AGREE])
def test_lists_of_jobs_show_the_verdict(fake: FakeService, browse: Browse, verdict: JobVerdict) -> None:
    recording = fake.add_recording()
    job = fake.add_job(state="succeeded", recording_id=recording.id, verdict=verdict)
    for address in ("/jobs", "/", f"/recordings/{recording.id}"):
        row = row_of(browse(address).text, job.id)
        assert f'class="state state-succeeded judged-{verdict.outcome}"' in row
        assert f'<span class="outcome outcome-{verdict.outcome}" data-outcome>' in row
        assert verdict.message.replace("<robot>", "&lt;robot&gt;") in row
        assert re.search(r"<progress[^>]* hidden>", row), "a full bar would say that all is well"


def test_a_job_without_a_verdict_shows_none(fake: FakeService, browse: Browse) -> None:
    done, running = fake.add_job("sweep", "succeeded"), fake.add_job(state="running")
    page = browse("/jobs").text
    for job in (done, running):
        assert '<span class="outcome" data-outcome hidden></span>' in row_of(page, job.id)
    assert not re.search(r"<progress[^>]* hidden>", row_of(page, running.id))
    assert 'class="state state-succeeded"' in row_of(page, done.id)


def test_the_page_of_a_plan_and_its_tab_say_that_it_fell(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan(replay=True)
    fake.change(job.id, verdict=FELL)
    page = browse(f"/plans/{job.id}").text
    head = page[page.index('aria-label="State"') : page.index('id="certificate-h"')]
    assert f'<span class="outcome outcome-failed" data-outcome>{SHOWN}</span>' in head
    assert "<title>✗ Plan" in page
    assert '<p class="verdict wrong" data-passed="false">' in page


@pytest.mark.parametrize(
    ("verdict", "state", "mark"),
    [(AGREE, "succeeded", "✓ "), (DOUBTFUL, "succeeded", "! "), (None, "failed", "✗ "), (None, "running", "")],
)
def test_the_tab_of_a_job_says_how_it_ended(
    fake: FakeService, browse: Browse, verdict: JobVerdict | None, state: str, mark: str
) -> None:
    job = fake.add_job(state=state, verdict=verdict)
    assert f"<title>{mark}Centre of mass" in browse(f"/jobs/{job.id}").text


def test_the_viewer_says_the_verdict_and_links_its_reasons(fake: FakeService, browse: Browse) -> None:
    plan, recording = fake.add_plan(), fake.add_recording()
    fake.change(plan.id, verdict=FELL)
    estimate = fake.add_job(state="succeeded", recording_id=recording.id, verdict=DOUBTFUL)
    link = '<a class="outcome outcome-{}" data-outcome href="{}">{}</a>'
    assert link.format("failed", f"/plans/{plan.id}", SHOWN) in browse(f"/view/?plan={plan.id}").text
    shown = browse(f"/view/?recording={recording.id}").text
    assert link.format("doubtful", f"/jobs/{estimate.id}", "Doubtful: force residual") in shown
    assert "data-outcome" not in browse(f"/view/?recording={fake.add_recording().id}").text


def test_the_viewer_says_of_a_plan_that_failed_how_far_its_motion_goes(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan()
    fake.change(job.id, state="failed", verdict=None)
    fake.stopped[job.id] = StoppedMotion(time_s=1.24, phase=1, level=0, level_name="dynamics", names=["torque"])
    page = browse(f"/view/?plan={job.id}").text
    assert "Failed: the body cannot follow the plan beyond 1.24 s</a>" in page


def test_a_card_that_offers_a_motion_to_watch_says_its_verdict(fake: FakeService, browse: Browse) -> None:
    scenario = fake.add_scenario()
    fake.scenarios[SAMPLE_SCENARIO] = scenario.model_copy(update={"id": SAMPLE_SCENARIO})
    plan = fake.add_plan(scenario_id=SAMPLE_SCENARIO)
    fake.change(plan.id, scenario_id=SAMPLE_SCENARIO, verdict=FELL)
    page = browse("/").text
    card = page[page.index(f'href="/view/?plan={plan.id}') - 400 :]
    assert f'<p class="outcome outcome-failed" data-outcome>{SHOWN}</p>' in card[:600]


def test_jobs_are_named_by_what_they_are_about(fake: FakeService, browse: Browse) -> None:
    """Several recordings by their number, others by robot or item; only a job of which nothing is known by its id."""
    recording = fake.add_recording("<walk>.c3d")
    jobs = {
        "2 recordings": fake.add_job("gait-measures", n_recordings=2),
        "&lt;walk&gt;.c3d": fake.add_job(recording_id=recording.id),
        "Figure 2.6": fake.add_job("reproduce", about="fig-2.6"),
        "talos": fake.add_job("learn-reachability", about="talos"),
        "Steps &lt;1&gt;": fake.add_job("sweep", about="Steps <1>"),
    }
    unknown = fake.add_job("read-batch")
    page = browse("/jobs").text
    for name, job in (*jobs.items(), (unknown.id[:8], unknown)):
        row = row_of(page, job.id)
        assert re.search(rf'class="hint">{re.escape(name)}</span>', row), name
        assert (job.id[:8] in row.replace(job.id, "")) == (job is unknown)
    heading = browse(f"/jobs/{jobs['2 recordings'].id}").text
    assert '<p class="hint">2 recordings · <time' in heading, "the id of a job says nothing to a reader"


def test_a_result_whose_files_are_gone_shows_its_summary_and_says_what_to_do(fake: FakeService, browse: Browse) -> None:
    """The same way for every kind of result whose page reads a file."""
    addresses = every_page(fake)
    fake.files_are_gone = True
    shown = {
        "wheel": "wheel.parquet",
        "sweep": "sweep.parquet",
        "imitation": "curves.parquet",
        "pushes": "pushes.parquet",
        "receding": "receding.parquet",
        "learned": "reachability.json",
    }
    for name, file in shown.items():
        page = browse(addresses[name])
        assert page.status_code == 200, name
        notices = re.findall(r"<p[^>]*data-gone>(.*?)</p>", page.text, re.S)
        text = f"A part of this result is not shown, because its file is gone ({file})."
        assert [" ".join(notice.split()) for notice in notices] == [
            f"{text} Restore a backup, or compute the result again."
        ], name
        assert 'class="headline"' in page.text or 'class="facts"' in page.text, name
    assert "data-gone" not in browse(addresses["measures"]).text
    fake.files_are_gone = False
    assert all("data-gone" not in browse(addresses[name]).text for name in shown)
