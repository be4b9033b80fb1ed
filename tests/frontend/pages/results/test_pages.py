"""Every page says what the interface says, and nothing that a file name smuggles in."""

import re
from collections.abc import Callable
from typing import Any, get_args

import httpx
import pytest

from stridelab.schemas.base import FaultItem, Problem
from stridelab.schemas.jobs import EstimateComInput, JobResult, Progress
from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import EstimateOffer, TrialClock
from stridelab_web.pages.results.summary_facts import facts_of, headline_of, main_and_other_facts, sentences_of
from support.fakes.service import FakeService
from support.fakes.web_app import make_client

Browse = Callable[[str], httpx.Response]


def test_home_shows_the_latest_recordings_and_jobs(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording("walk.c3d")
    job = fake.add_job(state="running", recording_id=recording.id, progress=Progress(fraction=0.5, message="fusing"))
    page = browse("/").text
    assert f'href="/recordings/{recording.id}"' in page
    assert f'href="/jobs/{job.id}"' in page
    assert 'value="0.5"' in page
    assert "fusing" in page


def test_home_without_anything_says_what_to_do(browse: Browse) -> None:
    page = browse("/")
    assert page.status_code == 200
    assert "Nothing uploaded yet: drop a C3D above" in page.text


def test_a_file_name_is_text_and_never_markup(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording('<script>alert("x")</script>.c3d')
    for address in ("/", "/recordings", f"/recordings/{recording.id}", f"/view/?recording={recording.id}"):
        page = browse(address).text
        assert "<script>alert" not in page
        assert "&lt;script&gt;alert" in page


def test_recording_page_tells_windows_plates_and_what_is_missing(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording()
    page = browse(f"/recordings/{recording.id}").text
    assert "All contact forces are measured from 0.60 s to 2.40 s." in page
    assert '<rect class="window" x="20.0%" width="60.0%"' in page
    assert "Plate 2 loaded: 1.40 s to 2.40 s" in page
    assert "l mt2" in page
    assert "C7 is hidden for the last 0.5 s." in page
    assert 'name="height_m" min="0.4" max="2.6" step="any" value="1.71"' in page


def test_recording_page_of_an_unknown_id_is_a_friendly_404(browse: Browse) -> None:
    page = browse("/recordings/nothing")
    assert page.status_code == 404
    assert "There is no such recording." in page.text
    assert 'href="/recordings"' in page.text


def test_unknown_address_is_a_friendly_404(browse: Browse) -> None:
    page = browse("/nothing/here")
    assert page.status_code == 404
    assert "There is no page at this address." in page.text


def test_recording_page_offers_every_method_and_the_latency_that_the_interface_would_take(
    fake: FakeService, browse: Browse
) -> None:
    page = browse(f"/recordings/{fake.add_recording().id}").text
    method = page[page.index('<select name="method">') :].partition("</select>")[0]
    requested = EstimateComInput.model_fields["method"].annotation
    named = {name for part in get_args(requested) for name in get_args(part)}
    assert set(re.findall(r'value="(\w+)"', method)) == named
    latency = page[page.index('<select name="latency">') :].partition("</select>")[0]
    assert re.findall(r'value="(\w+)" selected', latency) == [EstimateComInput(recording_id="x").latency]


@pytest.mark.parametrize(
    ("estimated_s", "sd_s", "applied_s", "said"),
    [
        (0.0123, 0.002, 0.0123, "The force comes 12.3 ± 2.0 ms later than the markers; this was corrected."),
        (-0.004, None, 0.0, "The force comes 4.0 ms earlier than the markers; this was not corrected."),
        (
            0.012,
            0.001,
            -0.005,
            "The force comes 12.0 ± 1.0 ms later than the markers; -5.0 ms were corrected, as requested.",
        ),
    ],
)
def test_the_sentence_on_the_clocks_says_what_was_estimated_and_done(
    estimated_s: float, sd_s: float | None, applied_s: float, said: str
) -> None:
    summary: dict[str, Any] = {
        "latency_s": estimated_s,
        "latency_sd_s": sd_s,
        "latency_applied_s": applied_s,
        "observability": {},
    }
    result = JobResult(kind="estimate-com", input={}, versions={}, references=[], summary=summary, artifacts=[])
    assert sentences_of(result) == [said]


def test_the_sentence_on_the_clocks_says_whose_latency_it_is() -> None:
    summary = {"latency_s": 0.0181, "latency_sd_s": 0.0006, "latency_applied_s": 0.0181, "observability": {}}
    summary |= {"latency_source": "session", "latency_n_trials": 12}
    result = JobResult(kind="estimate-com", input={}, versions={}, references=[], summary=summary, artifacts=[])
    message = (
        "The force comes 18.1 ± 0.6 ms later than the markers, as 12 trials of its session say; this was corrected."
    )
    assert sentences_of(result) == [message]


def test_a_result_with_a_band_starts_with_how_well_the_position_is_known() -> None:
    def result(**summary: Any) -> JobResult:
        return JobResult(kind="estimate-com", input={}, versions={}, references=[], summary=summary, artifacts=[])

    known = result(sd_m=[0.00255, 0.0015, 0.02], mass_kg=60.0, rate_hz=100.0)
    assert headline_of(known) == "Centre of mass known to ±5 mm along x, ±3 mm along y and ±39 mm in height (95 %)."
    for direction, answer in (
        ((-0.99, 0.14), "Centre of mass known to ±5 mm ahead, ±3 mm sideways and ±39 mm in height (95 %)."),
        ((0.1, 0.995), "Centre of mass known to ±3 mm ahead, ±5 mm sideways and ±39 mm in height (95 %)."),
        ((0.8, 0.6), headline_of(known)),  # between the axes, neither of them is ahead
    ):
        assert headline_of(result(sd_m=[0.00255, 0.0015, 0.02], walking_direction=direction)) == answer
    shown, folded = main_and_other_facts(known, facts_of(known))
    assert ([fact.key for fact in shown], [fact.key for fact in folded]) == (["mass_kg"], ["rate_hz"])
    older = result(mass_kg=60.0, rate_hz=100.0)
    assert headline_of(older) is None
    assert main_and_other_facts(older, facts_of(older)) == (facts_of(older), [])


def test_the_belts_of_a_treadmill_are_facts_of_their_results_only() -> None:
    def texts(treadmill: dict[str, Any] | None) -> dict[str, str]:
        summary = {"mass_kg": 60.0, "treadmill": treadmill}
        result = JobResult(kind="estimate-com", input={}, versions={}, references=[], summary=summary, artifacts=[])
        return {fact.name: fact.text for fact in facts_of(result)}

    belts = texts({"left_m_s": 1.4, "right_m_s": 0.9, "source": "stated", "frame": "laboratory"})
    assert belts["Belt under the left foot"] == "1.40 m/s"
    assert belts["Belt under the right foot"] == "0.90 m/s"
    assert (belts["Belt speeds taken from"], belts["Frame of the positions"]) == ("stated", "laboratory")
    assert texts(None) == {"Mass": "60.00 kg"}


def test_a_recording_links_the_other_trials_of_its_session(fake: FakeService, browse: Browse) -> None:
    clock = TrialClock(latency_s=0.0175, sd_s=0.0012)
    walk = fake.add_recording("walk_1.c3d", session_id="s1", clock=clock)
    other = fake.add_recording("walk_2.c3d", session_id="s1", clock=clock)
    still = fake.add_recording("standing.c3d", session_id="s1", still=True)
    stranger = fake.add_recording("stranger.c3d", session_id="s2")
    page = browse(f"/recordings/{walk.id}").text
    session = page[page.index('id="session-h"') : page.index('id="static-h"')]
    assert f'href="/recordings/{other.id}"' in session
    assert f'href="/recordings/{still.id}"' in session
    assert f'href="/recordings/{walk.id}"' not in session
    assert stranger.id not in session
    assert "force 17.5 ± 1.2 ms late" in session
    assert "stands still" in session
    assert '<option value="">taken from the session</option>' in page
    alone = browse(f"/recordings/{stranger.id}").text
    assert "No other trial of this session is here." in alone
    assert '<option value="">none</option>' in alone


def test_static_trials_offered_are_the_other_recordings(fake: FakeService, browse: Browse) -> None:
    standing, walking = fake.add_recording("standing.c3d"), fake.add_recording("walking.c3d")
    page = browse(f"/recordings/{walking.id}").text
    assert f'<option value="{standing.id}"' in page
    assert f'<option value="{walking.id}"' not in page


def test_jobs_page_filters_by_state(fake: FakeService, browse: Browse) -> None:
    failed, queued = fake.add_job(state="failed"), fake.add_job(queue_position=3)
    assert "place 3 in the queue" in browse("/jobs").text
    page = browse("/jobs?state=failed").text
    assert failed.id in page
    assert queued.id not in page


def test_jobs_page_filters_by_kind_beside_the_state_and_keeps_both_in_its_links(
    fake: FakeService, browse: Browse
) -> None:
    wheel, plan = (fake.add_job(kind, "failed") for kind in ("fit-cycloid", "plan-motion"))
    page = browse("/jobs?state=failed&kind=plan-motion").text
    assert plan.id in page
    assert wheel.id not in page
    assert '<option value="plan-motion" selected>Motion plan</option>' in page
    assert 'href="/jobs?state=running&amp;kind=plan-motion"' in page
    assert 'name="state" value="failed"' in page
    assert "No job of this state and kind" in browse("/jobs?state=queued&kind=plan-motion").text
    markup = browse("/jobs?kind=%3Cb%3E").text
    assert "<b>" not in markup
    assert "Show all" in markup


def test_jobs_page_offers_a_kind_of_job_that_it_has_no_title_for(fake: FakeService, browse: Browse) -> None:
    fake.add_job("weigh-recording", "failed")
    page = browse("/jobs").text
    assert '<option value="weigh-recording" >Weigh recording</option>' in page
    assert page.count('<option value="fit-cycloid"') == 1


def test_failed_job_says_why_and_where_and_shows_its_log(fake: FakeService, browse: Browse) -> None:
    problem = Problem(
        title="Unprocessable",
        status=422,
        code="no-window",
        detail="No interval is measured.",
        errors=[FaultItem(where="plate 2", message="never loaded")],
    )
    job = fake.add_job(state="failed", error=problem, log_tail="step 3 of 7\n<b>stopped</b>")
    page = browse(f"/jobs/{job.id}").text
    for part in ("No interval is measured.", "plate 2", "never loaded", "no-window", "&lt;b&gt;stopped"):
        assert part in page
    assert 'data-final="true"' in page
    assert page.count("No interval is measured.") == 1


def test_a_failure_is_shown_once_on_the_page_of_its_job(fake: FakeService, browse: Browse) -> None:
    detail = "The knee is straight in phases[3]. The hand is 0.2 m too far away."
    places = [
        FaultItem(where="phases[3]", message="The knee is straight"),
        FaultItem(where="phases[5]", message="The hand is 0.2 m too far away."),
        FaultItem(where="stage: whole body", message="stopped after 3.1 s"),
    ]
    problem = Problem(title="Failed", status=422, code="stance-unreachable", detail=detail, errors=places)
    page = browse(f"/jobs/{fake.add_job(state='failed', error=problem, log_tail='the log').id}").text
    assert page.count("The knee is straight") == 1
    assert page.count("0.2 m too far away") == 1
    assert re.findall(r"<li><b>([^<]*)</b>([^<]*)</li>", page) == [
        ("phases[5]", ""),
        ("stage: whole body", ": stopped after 3.1 s"),
    ]
    assert "<details ><summary>End of the log" in page, "folded: the sentence says why"
    assert re.search(r"<progress[^>]*>", page)
    assert 'class="wide" hidden' in page, "a bar of a job that has ended says nothing"


def test_result_page_shows_every_number_of_the_summary_with_its_unit(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording()
    job = fake.add_job(state="succeeded", recording_id=recording.id)
    page = browse(f"/jobs/{job.id}").text
    shown = dict(re.findall(r'data-fact="([^"]+)">([^<]*)<', page))
    assert shown["mass_kg"] == "60.25 kg"
    assert shown["latency_s"] == "11.3 ms"
    assert shown["rms_force_residual_n"] == "3.21, 2.50, 7.75 N"
    assert shown["bias_m"] == "1.2, -3.4, 5.6 mm"
    assert shown["window_s"] == "0.60 to 2.40 s"
    assert shown["observability.rank"] == "5"
    assert shown["diagnostics.marker_mm"] == "0.34 mm"
    assert shown["diagnostics.momentum_about_walk_nms"] == "0.62 N m s"
    assert re.findall(r"data-sentence>([^<]*)<", page) == [
        "The height is known from the markers alone.",
        "The force comes 11.3 ± 1.2 ms later than the markers; this was not corrected.",
    ]
    assert "observability.sentence" not in shown
    assert shown["latency_along_s"] == "19.7 ms"
    assert "Arms have no markers" in page
    assert f"/api/v1/jobs/{job.id}/artifacts/com.parquet" in page
    assert f"/api/v1/jobs/{job.id}/bundle.zip" in page
    assert f"/view/?recording={recording.id}&amp;job={job.id}" in page


def test_result_of_a_simulation_leads_to_its_recording(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording()
    job = fake.add_job("simulate-recording", "succeeded")
    page = browse(f"/jobs/{job.id}").text
    assert f'href="/recordings/{recording.id}">Open the new recording' in page
    assert "data-plots" not in page
    assert browse(f"/jobs/{job.id}/plots.json").status_code == 404


def test_result_outlives_its_recording(fake: FakeService, browse: Browse) -> None:
    job = fake.add_job(state="succeeded", recording_id="gone")
    page = browse(f"/jobs/{job.id}")
    assert page.status_code == 200
    assert "/view/?recording" not in page.text


def test_viewer_page_takes_the_newest_estimate_unless_told(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording()
    assert f'data-scene="/view/scene/recording/{recording.id}/-"' in browse(f"/view/?recording={recording.id}").text
    older = fake.add_job(state="succeeded", recording_id=recording.id)
    newer = fake.add_job(state="succeeded", recording_id=recording.id)
    assert (
        f'data-scene="/view/scene/recording/{recording.id}/{newer.id}"'
        in browse(f"/view/?recording={recording.id}").text
    )
    assert f'data-scene="/view/scene/recording/{recording.id}/{older.id}"' in browse(f"/view/?job={older.id}").text
    assert f'data-start="{recording.windows_s[0][0]}"' in browse(f"/view/?recording={recording.id}").text
    assert browse("/view/").status_code == 404


@pytest.mark.parametrize("address", ["/", "/recordings", "/jobs", "/login", "/nothing"])
def test_pages_hold_no_inline_script_style_or_handler(browse: Browse, address: str) -> None:
    page = browse(address).text
    assert not re.search(r"<script(?![^>]*\bsrc=)", page)
    assert not re.search(r"<style|\sstyle=|\son\w+=", page)
    assert not re.search(r'(?:src|href)="(?:https?:)?//', page)


def test_pages_are_not_cached_by_browsers(browse: Browse) -> None:
    assert browse("/jobs").headers["cache-control"] == "no-store"


def test_an_interface_that_is_down_is_a_503_page(fake: FakeService) -> None:
    def refuse(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused", request=request)

    page = make_client(fake, transport=httpx.MockTransport(refuse)).get("/")
    assert page.status_code == 503
    assert "does not answer" in page.text


NO_PLATES = "The recording has no force plate."


def refusing(*possible: str, reason: str = NO_PLATES) -> list[EstimateOffer]:
    return [
        EstimateOffer(method=method, possible=True)
        if method in possible
        else EstimateOffer(method=method, possible=False, code="no-plates", reason=reason)
        for method in METHODS
    ]


OFFERED = ("Estimate", "Compare all methods", "Fit the wheel", "Measures of gait", "Report", "Imitate")
"""Buttons of the form that estimates."""


def estimate_form(page: str) -> str:
    return page[page.index("<form data-estimate") :].partition("</form>")[0]


def buttons(form: str) -> dict[str, bool]:
    """The form's buttons by their text, and whether they can be pressed."""
    outcome = re.findall(r"<button([^>]*)>([^<]*)</button>", form)
    for attributes, _ in outcome:
        assert ("disabled" in attributes) == ('aria-describedby="refused"' in attributes)
    return {text: "disabled" not in attributes for attributes, text in outcome}


def test_what_is_known_to_fail_is_not_offered_and_says_why(fake: FakeService, browse: Browse) -> None:
    unknown = fake.add_recording(marker_set=None, estimates=refusing(reason="These <b>labels</b> aren't known."))
    form = estimate_form(browse(f"/recordings/{unknown.id}").text)
    assert buttons(form) == dict.fromkeys(OFFERED, False)
    assert ">These &lt;b&gt;labels&lt;/b&gt; aren&#39;t known.</p>" in form
    assert "hidden" not in form[form.index('id="refused"') :].partition(">")[0]


def test_proposed_names_are_asked_to_be_checked(fake: FakeService, browse: Browse) -> None:
    """The form is open and filled with the proposal, as for an unknown set, and estimates are offered."""
    for marker_set, asked in (("proposed", True), (None, True), ("isb", False)):
        page = browse(f"/recordings/{fake.add_recording(marker_set=marker_set).id}").text
        assert ("data-unnamed" in page) == (">Name the markers<" in page) == asked
    assert buttons(estimate_form(page)) == dict.fromkeys(OFFERED, True)


def test_without_plates_markers_only_are_offered(fake: FakeService, browse: Browse) -> None:
    form = estimate_form(browse(f"/recordings/{fake.add_recording(estimates=refusing('geometry')).id}").text)
    assert buttons(form) == dict.fromkeys(OFFERED, True) | {"Compare all methods": False}
    assert re.findall(r'value="(\w+)" selected>[^<]*</option>', form.partition("</select>")[0]) == ["geometry"]
    assert f">{NO_PLATES}</p>" in form


def test_a_recording_of_which_nothing_is_known_to_fail_offers_all(fake: FakeService, browse: Browse) -> None:
    for estimates in ([], refusing(*METHODS)):
        form = estimate_form(browse(f"/recordings/{fake.add_recording(estimates=estimates).id}").text)
        assert buttons(form) == dict.fromkeys(OFFERED, True)
        assert "selected" not in form.partition("</select>")[0]
        assert "data-why hidden></p>" in form


def test_upload_fields_take_every_file_that_is_read(fake: FakeService, browse: Browse) -> None:
    recording = fake.add_recording()
    for address in ("/", "/recordings", "/population", f"/view/?recording={recording.id}"):
        page = browse(address).text
        accepted = [one for one in re.findall(r'accept="([^"]*)"', page) if ".c3d" in one]
        assert accepted, address
        taken = {".c3d", ".trc", ".mvnx", ".zip"} | (set() if address == "/population" else {".tsv", ".csv"})
        assert all(taken == set(one.split(",")) for one in accepted)
