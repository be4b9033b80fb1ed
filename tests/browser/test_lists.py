"""Lists and texts: verdicts that arrive, uploads that appear, refusals that stay, local times, strips in line."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from stridelab.schemas.jobs import JobVerdict, Progress
from stridelab.schemas.plans import PhaseDuration
from support.browser.page import Tab, opened
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

UTC_TEXT = "2026-01-02 03:04 UTC"
NEW_YORK_TEXT = "2026-01-01 22:04 "


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Two recordings, and what is none."""
    made = []
    for name, content in (("a.c3d", b"\x02Pa"), ("b.c3d", b"\x02Pb"), ("holiday.c3d", b"GIF89a")):
        (tmp_path / name).write_bytes(content)
        made.append(tmp_path / name)
    return made


@pytest.fixture
def in_new_york(chromium: Browser) -> Iterator[BrowserContext]:
    context = chromium.new_context(timezone_id="America/New_York", locale="en-US")
    yield context
    context.close()


def upload(page: Page, paths: list[Path]) -> None:
    page.set_input_files("[data-upload] input[type=file]", paths)


def refusals(page: Page) -> list[str]:
    return page.locator("[data-uploads] [role=alert]").all_text_contents()


def test_a_row_shows_the_verdict_when_its_job_has_ended(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_job(state="running", progress=Progress(fraction=0.5, message="fusing"))
    page = tab.go("/jobs")
    row = page.locator(f"tr[data-job='{job.id}']")
    expect(row.get_by_role("progressbar")).to_be_visible()
    expect(row.locator("[data-outcome]")).to_be_hidden()
    verdict = JobVerdict(outcome="failed", code="sensors-contradict", message="Sensors contradict each other: mass")
    lab.fake.change(job.id, state="succeeded", verdict=verdict, has_result=True, progress=Progress(fraction=1.0))
    expect(row.locator("[data-outcome]")).to_have_text("Sensors contradict each other: mass")
    expect(row.get_by_role("progressbar")).to_be_hidden()
    colours = row.evaluate(
        "(row) => [row.querySelector('[data-outcome]'), document.documentElement].map((node, k) => k ? "
        "getComputedStyle(node).getPropertyValue('--red') : getComputedStyle(node).color)"
    )
    assert colours == ["rgb(179, 18, 46)", "#b3122e"]


def test_uploads_appear_in_the_list_and_leave_the_ticks(tab: Tab, lab: Lab, files: list[Path]) -> None:
    old = lab.fake.add_recording("old.c3d")
    page = tab.go("/recordings")
    page.get_by_label("Choose old.c3d").check()
    upload(page, files[:2])
    table = page.locator("[data-recordings] table")
    for path in files[:2]:
        expect(table.get_by_role("link", name=path.name, exact=True)).to_be_visible()
    expect(page.get_by_label("Choose old.c3d")).to_be_checked()
    expect(page.get_by_label("Choose a.c3d")).not_to_be_checked()
    assert page.locator("[data-uploads] li").count() == 2
    assert old.id in page.locator("[data-recordings] input:checked").evaluate_all(
        "(all) => all.map((box) => box.value)"
    )


def test_the_first_upload_of_all_replaces_the_empty_list(tab: Tab, lab: Lab, files: list[Path]) -> None:
    stored = dict(lab.fake.recordings)
    lab.fake.recordings.clear()
    try:
        page = tab.go("/recordings")
        expect(page.get_by_text("Nothing uploaded yet.")).to_be_visible()
        upload(page, files[:2])
        expect(page.locator("[data-recordings] tbody tr")).to_have_count(2)
        expect(page.get_by_text("Nothing uploaded yet.")).to_have_count(0)
    finally:
        lab.fake.recordings.update(stored)


def test_the_same_file_again_says_so_and_opens_the_old_one(tab: Tab, lab: Lab, tmp_path: Path) -> None:
    again, new = tmp_path / "again.c3d", tmp_path / "new.c3d"
    again.write_bytes(b"\x02P again")
    new.write_bytes(b"\x02P new")
    page = tab.go("/recordings")
    upload(page, [again])
    page.wait_for_url("**/recordings/*")
    address, count = page.url, len(lab.fake.recordings)
    expect(page.locator("[data-known]")).to_have_count(0)
    page = tab.go("/recordings")
    upload(page, [again])
    page.wait_for_url("**/recordings/*")
    expect(page.locator("[data-known]")).to_contain_text("This file was already uploaded on 2026-01-02 03:04 UTC")
    assert page.url == address, "the address is that of the recording alone"
    assert len(lab.fake.recordings) == count

    page = tab.go("/recordings")
    upload(page, [again, new])
    row = page.locator("[data-uploads] li").first
    expect(row).to_contain_text("already uploaded on 2026-01-02 03:04 UTC")
    expect(row.get_by_role("link", name="open")).to_have_attribute("href", address.removeprefix(tab.url))
    expect(page.locator("[data-uploads] li").nth(1).get_by_role("link")).to_be_visible()
    assert len(lab.fake.recordings) == count + 1
    row.get_by_role("button", name="Upload again.c3d as a second recording").click()
    expect(page.locator("[data-uploads] li").last.get_by_role("link")).to_contain_text("open")
    assert len(lab.fake.recordings) == count + 2


def test_refusals_stay_with_name_and_reason_until_they_are_dismissed(tab: Tab, files: list[Path]) -> None:
    page = tab.go("/recordings")
    upload(page, [files[2], files[0]])
    reason = "holiday.c3d is neither a C3D file nor a ZIP. holiday.c3d: no C3D header"
    expect(page.locator("[data-uploads] [role=alert]")).to_have_text(reason)
    page.reload()
    expect(page.locator("[data-uploads] li b")).to_have_text(["holiday.c3d"])
    assert refusals(page) == [reason]
    page = tab.go("/")
    assert refusals(page) == [reason]
    page.get_by_role("button", name="Dismiss the refusal of holiday.c3d").click()
    expect(page.locator("[data-uploads] li")).to_have_count(0)
    page.reload()
    assert refusals(page) == []
    page.route("**/api/v1/recordings*", lambda route: route.abort())
    upload(page, [files[1]])
    row = page.locator("[data-uploads] li")
    expect(row).to_contain_text("not uploaded")
    assert refusals(page) == ["The service does not answer. Is it still running?"]
    page.unroute_all()
    row.get_by_role("button", name="Try to upload b.c3d again").click()
    page.wait_for_url("**/recordings/*")
    tab.missteps = [m for m in tab.missteps if "status of 422" not in m and "net::ERR_FAILED" not in m]


@pytest.mark.parametrize(("status", "code"), [(413, "storage-limit"), (507, "disk-full")])
def test_a_file_that_found_no_space_is_offered_again(tab: Tab, files: list[Path], status: int, code: str) -> None:
    """The sentence says what to do; after that the file need not be chosen anew."""
    page = tab.go("/recordings")
    sentence = "You store 9.0 MB, and 9 MB is the limit for one user; delete something first."
    problem = {"title": "Full", "status": status, "code": code, "detail": sentence}
    refusal = {"status": status, "content_type": "application/problem+json", "body": json.dumps(problem)}
    page.route("**/api/v1/recordings*", lambda route: route.fulfill(**refusal))
    upload(page, [files[1]])
    row = page.locator("[data-uploads] li")
    expect(row).to_contain_text("not uploaded")
    assert refusals(page) == [sentence]
    page.unroute_all()
    row.get_by_role("button", name="Try to upload b.c3d again").click()
    page.wait_for_url("**/recordings/*")
    tab.missteps = [m for m in tab.missteps if f"status of {status}" not in m]


def test_times_are_those_of_the_reader_with_their_zone(lab: Lab, in_new_york: BrowserContext) -> None:
    recording = lab.fake.add_recording()
    person = lab.fake.subjects.add("P1")
    plan, other = lab.fake.add_plan(), lab.fake.add_plan()
    page = in_new_york.new_page()
    for address in ("/recordings", f"/recordings/{recording.id}", "/jobs", f"/plans/{plan.id}", "/subjects"):
        page.goto(f"{lab.url}{address}")
        times = page.locator("time")
        assert times.count() > 0, address
        for k in range(times.count()):
            expect(times.nth(k)).to_have_text(f"{NEW_YORK_TEXT}EST")
            expect(times.nth(k)).to_have_attribute("title", UTC_TEXT)
        assert "UTC" not in page.locator("main").inner_text(), address
    page.goto(f"{lab.url}/plans/{plan.id}?with={other.id}")
    expect(page.locator(f"option[value='{other.id}']")).to_contain_text(f"{NEW_YORK_TEXT}EST")
    page.goto(f"{lab.url}/subjects/{person.subject_id}")
    expect(page.locator("select[name=recording] option").first).to_contain_text(f"{NEW_YORK_TEXT}EST")


def test_without_scripts_times_are_in_utc_and_say_so(lab: Lab, chromium: Browser) -> None:
    lab.fake.add_recording()
    context = chromium.new_context(timezone_id="America/New_York", java_script_enabled=False)
    page = context.new_page()
    page.goto(f"{lab.url}/recordings")
    expect(page.locator("time").first).to_have_text(UTC_TEXT)
    context.close()


def test_the_chosen_phase_is_counted_among_all(open_tab: Callable[..., Tab], lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(open_tab(1000, 700), f"/view/?scenario={scenario.id}")
    page.locator("[data-phases] button").nth(1).click()
    expect(page.locator("[data-phase-number]")).to_have_text(f"1 (2 of {len(scenario.phases)})")
    page.locator("[data-phases] button").last.click()
    last = len(scenario.phases) - 1
    expect(page.locator("[data-phase-number]")).to_have_text(f"{last} ({last + 1} of {last + 1})")


PLACES = """([start_s, end_s]) => {
    const box = document.getElementById("plots"), { xaxis, _size } = box._fullLayout;
    const origin = box.getBoundingClientRect().left + _size.l;
    return [start_s, end_s].map((t_s) => origin + xaxis.d2p(t_s));
}"""
"""Where the curves have two instants, in pixels of the page."""


def edges(page: Page, bar: str) -> list[float]:
    result: list[float] = page.locator(bar).first.evaluate(
        "(bar) => { const { left, right } = bar.getBoundingClientRect(); return [left, right]; }"
    )
    return result


@pytest.mark.parametrize("width", [390, 800, 1400, 2000])
def test_the_strip_of_a_recording_stands_above_the_same_instants_of_the_curves(
    open_tab: Callable[..., Tab], lab: Lab, width: int
) -> None:
    recording = lab.fake.add_recording()
    lab.fake.add_job(state="succeeded", recording_id=recording.id)
    page = open_tab(width, 850).go(f"/recordings/{recording.id}")
    page.wait_for_selector("#plots[data-ready]")
    window_s = list(recording.windows_s[0])
    assert edges(page, ".strip .window") == pytest.approx(page.evaluate(PLACES, window_s), abs=1.0)
    page.evaluate("() => Plotly.relayout('plots', { 'xaxis.range': [0.5, 2.5] })")
    assert edges(page, ".strip .window") == pytest.approx(page.evaluate(PLACES, window_s), abs=1.0)
    page.get_by_role("slider", name="Cursor").press("Home")
    for _ in range(3):
        page.get_by_role("slider", name="Cursor").press("PageUp")
    at_s = page.evaluate("() => document.getElementById('plots').layout.shapes.at(-1).x0")
    mark = page.locator(".strip .now").first.evaluate("(mark) => mark.getBoundingClientRect().left")
    assert mark == pytest.approx(page.evaluate(PLACES, [at_s, at_s])[0], abs=1.0)


def test_the_phases_that_a_solver_chose_stand_above_the_same_instants(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    result = lab.fake.result(job.id)
    phases = [PhaseDuration(given_s=s, chosen_s=s) for s in (1.0, 0.8, 0.2, 0.8, 0.2, 0.8, 0.2, 0.8, 1.0)]
    summary = result.summary | {"phase_durations": [phase.model_dump() for phase in phases]}
    lab.fake.results[job.id] = result.model_copy(update={"summary": summary})
    page = tab.go(f"/plans/{job.id}")
    page.wait_for_selector("#plots[data-ready]")
    first = page.locator(".strip.phases svg").nth(1).locator("rect:not(.track)").first
    shown = first.evaluate("(bar) => { const { left, right } = bar.getBoundingClientRect(); return [left, right]; }")
    assert shown == pytest.approx(page.evaluate(PLACES, [0.0, 1.0]), abs=1.0)


def test_a_table_wider_than_its_place_shows_a_bar(phone: Page, lab: Lab) -> None:
    lab.fake.add_recording()
    phone.goto(f"{lab.url}/recordings")
    table = phone.locator("[data-recordings] .scroll")
    sizes = table.evaluate("(box) => [box.scrollWidth - box.clientWidth, box.offsetHeight - box.clientHeight]")
    assert sizes[0] > 0
    assert sizes[1] >= 8, "the bar takes its place beside the rows"
    expect(table).to_have_attribute("data-more", "right")
    table.evaluate("(box) => box.scrollTo(1, 0)")
    table.evaluate("(box) => box.scrollTo(box.scrollWidth, 0)")
    expect(table).to_have_attribute("data-more", "left")


def test_chosen_recordings_are_estimated_in_three_clicks(tab: Tab, lab: Lab) -> None:
    ids = {lab.fake.add_recording(f"walk {k}.c3d").id for k in range(2)}
    page = tab.go("/recordings")
    page.get_by_role("button", name="Estimate").click()
    expect(page.get_by_text("Choose recordings first.")).to_be_visible()
    page.get_by_label("all on this page").check()
    page.get_by_role("button", name="Estimate").click()
    page.wait_for_url("**/jobs?kind=estimate-com")
    assert {job.recording_id for job in lab.fake.jobs.values()} >= ids
