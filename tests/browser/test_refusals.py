"""What goes wrong is shown calmly, in words, with what to do; and nothing that a file brings becomes part of a page."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import websockets
from playwright.sync_api import Page, Route, expect

from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import EstimateOffer
from stridelab_web.scene import proxy
from support.browser.every_page import every_page
from support.browser.page import Tab, nodes, opened
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

HOSTILE = '<img src=x onerror="document.title=1">.c3d'


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Iterator[Tab]:
    """A tab in which the browser's own word on a refused request is no misstep."""
    made = open_tab(800, 600)
    yield made
    made.missteps = [m for m in made.missteps if "Failed to load resource" not in m]


def end_login(route: Route) -> None:
    """The answers of a service that knows the caller's token no more."""
    if route.request.url.endswith("/health"):
        route.fallback()
    else:
        problem = {"title": "Unauthenticated", "status": 401, "detail": "This service needs a token."}
        route.fulfill(status=401, content_type="application/problem+json", body=json.dumps(problem))


def drop(page: Page, name: str, content: str) -> None:
    page.evaluate(
        """([name, content]) => {
            const data = new DataTransfer();
            data.items.add(new File([content], name));
            const zone = document.querySelector("[data-upload]");
            for (const kind of ["dragenter", "dragover", "drop"])
                zone.dispatchEvent(new DragEvent(kind, { dataTransfer: data, bubbles: true, cancelable: true }));
        }""",
        [name, content],
    )


def test_a_wrong_file_with_markup_in_its_name_is_refused_in_words(tab: Tab) -> None:
    page = tab.go("/")
    drop(page, HOSTILE, "%PDF-1.7")
    row = page.locator("[data-uploads] li")
    expect(row.get_by_role("alert")).to_contain_text("neither a C3D file nor a ZIP")
    expect(row.locator("b")).to_have_text(HOSTILE)
    assert page.locator("main img").count() == 0
    assert page.title() == "Home · stridelab"


def test_markup_in_stored_names_stays_text(tab: Tab, lab: Lab) -> None:
    recording = lab.fake.add_recording(HOSTILE)
    person = lab.fake.subjects.add(HOSTILE)
    lab.fake.recordings[recording.id] = recording.model_copy(update={"subject_id": person.subject_id})
    for address in ("/", "/recordings", f"/recordings/{recording.id}", "/subjects", f"/subjects/{person.subject_id}"):
        page = tab.go(address)
        expect(page.get_by_text(HOSTILE).first).to_be_visible()
        assert page.locator("main img").count() == 0, address


def test_a_file_that_is_no_scenario_is_named_and_refused(tab: Tab, tmp_path: Path) -> None:
    page = tab.go("/scenarios")
    for name, content, message in (
        ("walk.txt.json", "feet first", "this is not JSON"),
        ("list.json", json.dumps([1, 2]), "this is not a scenario"),
    ):
        (tmp_path / name).write_text(content)
        page.set_input_files("#scenario-file", tmp_path / name)
        expect(page.locator("[data-import] [data-said]")).to_have_text(f"{name}: {message}")


@pytest.mark.parametrize("address", ["/recordings/sample", "/scenarios/stairs"])
def test_a_full_queue_says_when_to_come_back(tab: Tab, lab: Lab, address: str) -> None:
    if address.startswith("/recordings"):
        page = tab.go(f"/recordings/{lab.fake.add_recording().id}")
        button, message = (
            page.get_by_role("button", name="Estimate", exact=True),
            page.locator("[data-estimate] [data-said]").first,
        )
    else:
        page = tab.go(f"/scenarios/{lab.fake.add_scenario().id}")
        form = page.locator("form[data-plan]")
        button, message = form.get_by_role("button", name="Plan"), form.locator("[data-said]")
    lab.fake.busy = 17
    try:
        button.click()
        expect(message).to_have_text("200 jobs are waiting already. Try again in 17 s.")
        expect(button).to_be_enabled()
    finally:
        lab.fake.busy = None
    button.click()
    page.wait_for_url(lambda url: "/jobs/" in url or "/plans/" in url or "/view/" in url)


def test_links_to_what_was_deleted_lead_on(tab: Tab) -> None:
    for address, message in (
        ("/plans/gone", "There is no such job."),
        ("/plans/gone?with=too", "There is no such job."),
        ("/jobs/gone", "There is no such job."),
        ("/view/?plan=gone", "There is no such job."),
        ("/view/?recording=gone", "There is no such recording."),
        ("/view/?scenario=gone", "There is no such scenario."),
        ("/subjects/gone", "There is no such subject."),
    ):
        page = tab.go(address)
        expect(page.get_by_role("heading", level=1)).to_have_text("Not found")
        expect(page.get_by_text(message)).to_be_visible()
        assert "Traceback" not in page.content()
    said = page.evaluate("""async () => {
        const { fetchChecked } = await import("/static/js/shared/api.js");
        return fetchChecked("/plans/gone").catch((error) => error.message);
    }""")
    assert said == "There is no such job.", "what a script asks for says the same as the page"
    page.get_by_role("main").get_by_role("link", name="Home").click()
    expect(page).to_have_title("Home · stridelab")


def test_a_service_that_goes_away_is_shown_and_reached_again(tab: Tab, lab: Lab) -> None:
    recording = lab.fake.add_recording()
    page = tab.go(f"/recordings/{recording.id}")
    notice = page.get_by_role("complementary", name="Connection")

    def hang_up(route: Route) -> None:
        route.abort()

    page.route("**/api/**", hang_up)
    page.get_by_label("Height").fill("1.8")
    page.get_by_role("button", name="Save subject").click()
    expect(page.locator("[data-subject] [data-said]")).to_have_text("The service does not answer. Is it still running?")
    expect(notice).to_contain_text("The page keeps what it shows")
    expect(page.get_by_label("Height")).to_have_value("1.8")
    page.unroute("**/api/**", hang_up)
    notice.get_by_role("button", name="Retry now").click()
    expect(notice.get_by_role("status")).to_have_text("The service answers again.")
    expect(notice).to_be_hidden()
    page.route("**/api/**", end_login)
    page.get_by_role("button", name="Save subject").click()
    expect(notice.get_by_role("status")).to_contain_text("Your login has ended.")
    expect(page.locator("[data-subject] [data-said]")).to_have_text("Not done: log in again, then repeat it.")
    expect(notice.get_by_role("link", name="Log in")).to_have_attribute("target", "_blank")
    expect(page.get_by_label("Height")).to_have_value("1.8")
    page.unroute("**/api/**", end_login)
    page.evaluate("() => window.dispatchEvent(new Event('focus'))")
    expect(notice.get_by_role("status")).to_have_text("You are logged in again.")
    page.get_by_role("button", name="Save subject").click()
    page.wait_for_function("() => document.querySelector('[name=height_m]').defaultValue === '1.8'")
    assert lab.fake.patches[-1] == {"subject": {"height_m": 1.8}}, "only what was changed is sent"


@pytest.mark.parametrize(
    "name",
    ["recording", "estimate", "comparison", "wheel", "receding", "reproduction-of-one", "plan", "view-recording"],
)
def test_what_has_lost_its_files_says_so_once_and_shows_the_rest(tab: Tab, lab: Lab, name: str) -> None:
    address = every_page(lab.fake)[name]
    lab.fake.files_are_gone = True
    try:
        page = tab.go(address)
        said = page.get_by_text(re.compile("gone.*Restore a backup, or"))
        expect(said).to_have_count(1)
        expect(said).to_be_visible()
        assert page.get_by_text("gone").count() == 1, "it is said once"
        assert page.locator("#cursor").count() == 0, "nothing moves curves that are not there"
        if name == "view-recording":
            page.wait_for_selector("[data-ready]", timeout=90_000)
            assert nodes(page, "/markers/0")["/markers/0"]["drawn"], "the markers are of the recording"
    finally:
        lab.fake.files_are_gone = False


def test_an_edit_is_stored_once_the_reader_has_logged_in_again(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}&phase=1")
    notice, said = page.get_by_role("complementary", name="Connection"), page.locator("[data-said]").first
    verdict = page.locator("[data-verdict]")
    expect(verdict).to_contain_text("Valid")
    page.route("**/api/**", end_login)
    page.get_by_label("lasts").fill("1.45")
    page.locator("h1").click()  # which leaves the field, and so stores
    expect(notice.get_by_role("status")).to_contain_text("Your login has ended.")
    expect(said).to_have_text("Not stored yet: it will be once you have logged in again.")
    expect(verdict).to_contain_text("Valid")
    assert page.get_by_text("login has ended").count() == 1, "it is said once"
    assert lab.fake.scenarios[scenario.id].phases[1].duration_s != 1.45
    page.unroute_all()
    page.evaluate("() => window.dispatchEvent(new Event('focus'))")
    expect(said).to_have_text("Phase 1 stored.")
    expect(notice.get_by_role("status")).to_have_text("You are logged in again.")
    assert lab.fake.scenarios[scenario.id].phases[1].duration_s == 1.45


def test_a_course_is_drawn_once_the_reader_has_logged_in_again(tab: Tab, lab: Lab) -> None:
    page = tab.go("/scenarios/new")
    said = page.locator("[data-course-said]")
    expect(page.locator("[data-pictures] svg").first).to_be_visible()
    page.evaluate("() => document.querySelector('[data-pictures]').replaceChildren()")
    for part in ("**/api/**", "**/scenarios/new/pictures**"):
        page.route(part, end_login)
    page.get_by_label("Rise in cm of Stairs, obstacle 1").fill("11")
    expect(page.get_by_role("complementary", name="Connection")).to_contain_text("Your login has ended.")
    expect(said).to_have_text("")
    page.unroute_all()
    page.evaluate("() => window.dispatchEvent(new Event('focus'))")
    expect(page.locator("[data-pictures] svg").first).to_be_visible()


def test_a_job_is_followed_through_a_lost_connection(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_job(state="running")
    page = tab.go("/jobs")
    row = page.locator(f"tr[data-job='{job.id}']")
    page.route("**/api/**", lambda route: route.abort())
    notice = page.get_by_role("complementary", name="Connection")
    expect(notice).to_contain_text("does not answer")
    lab.fake.change(job.id, state="failed")
    page.unroute_all()
    expect(row.locator("[data-state]")).to_have_text("failed")
    expect(notice).to_be_hidden()


def test_a_scene_whose_first_connection_is_refused_is_taken_up(
    tab: Tab, lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by a viewer that is starting: viser's client itself would try again only in a window that has the focus."""
    job, genuine, tries = lab.fake.add_plan(), websockets.connect, []

    def once_refused(address: str, **options: Any) -> Any:
        tries.append(address)
        if len(tries) == 1:
            raise ConnectionRefusedError(address)
        return genuine(address, **options)

    monkeypatch.setattr(proxy.websockets, "connect", once_refused)  # type: ignore[attr-defined]
    page = tab.go(f"/view/?plan={job.id}")
    page.wait_for_selector("[data-ready]", timeout=120_000)
    assert len(tries) == 2


def test_a_method_that_is_known_to_fail_is_not_started(tab: Tab, lab: Lab) -> None:
    reason = "The recording has no force plate."
    offers = [
        EstimateOffer(method=method, possible=method == "geometry", code="no-plates", reason=reason)
        for method in METHODS
    ]
    page = tab.go(f"/recordings/{lab.fake.add_recording(estimates=offers).id}")
    form = page.locator("[data-estimate]")
    start, compare = (form.get_by_role("button", name=name, exact=True) for name in ("Estimate", "Compare all methods"))
    expect(form.get_by_label("Method")).to_have_value("geometry")
    expect(start).to_be_enabled()
    expect(compare).to_be_disabled()
    form.get_by_label("Method").select_option("smoother")
    expect(start).to_be_disabled()
    expect(start).to_have_accessible_description(reason)
    expect(form.get_by_text(reason)).to_be_visible()
    form.get_by_label("Method").select_option("geometry")
    expect(start).to_be_enabled()
    start.click()
    page.wait_for_url("**/jobs/*")
