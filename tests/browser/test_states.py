"""States that a page comes to by use, at four sizes and in light and dark: axe-core has nothing serious to say of them.

``test_every_page.py`` looks at pages as they are loaded, ``test_live_robot.py`` and ``test_live_balance.py`` at live
ones. Each state here is reached once, and its window is then made larger and smaller.
"""

import json
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, Route, expect

from support.browser.accessibility import faults_at_every_size
from support.browser.page import Tab, opened
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")


def first_tour(page: Page) -> None:
    expect(page.get_by_role("region", name="Tour")).to_be_visible()


def next_of_tour(page: Page) -> None:
    title = page.get_by_role("region", name="Tour").get_by_role("heading")
    before = title.inner_text()
    page.get_by_role("region", name="Tour").locator("button.primary").click()
    expect(title).not_to_have_text(before)


def refused_and_waiting_uploads(page: Page) -> None:
    """One file refused for good, one that may be tried again, and one on its way."""
    problem = {"title": "Unprocessable", "detail": "This is neither a C3D file nor a ZIP.", "code": "unknown-format"}

    def answer_upload(route: Route) -> None:
        body = route.request.post_data_buffer or b""
        if b"bad.c3d" in body:
            route.fulfill(status=422, content_type="application/problem+json", body=json.dumps(problem))
        elif b"later.c3d" in body:
            route.abort()

    page.route("**/api/v1/recordings?reuse=true", answer_upload)
    files = [{"name": f"{name}.c3d", "mimeType": "", "buffer": b"x"} for name in ("bad", "later", "slow", "next")]
    page.locator("[data-upload] input[type=file]").set_input_files(files)  # type: ignore[arg-type]
    expect(page.locator("[data-uploads] [role=alert]")).to_have_count(2)
    expect(page.locator("[data-uploads] progress:not([hidden])")).to_have_count(2)


def chosen_recordings(page: Page) -> None:
    for box in page.locator("input[name=recording]").all()[:2]:
        box.check()


def wanted_notification(page: Page) -> None:
    """As in a browser with windows, which offers it."""
    page.evaluate("() => document.querySelectorAll('[data-notify]').forEach((one) => { one.hidden = false; })")
    expect(page.get_by_role("checkbox", name="Notify me")).to_be_visible()


def lost_connection(page: Page) -> None:
    page.route("**/api/**", lambda route: route.abort())
    page.get_by_label("Height").fill("1.8")
    page.get_by_role("button", name="Save subject").click()
    expect(page.get_by_role("complementary", name="Connection")).to_be_visible()


def ended_login(page: Page) -> None:
    refusal = {"title": "Unauthenticated", "status": 401, "detail": "This service needs a token."}

    def refuse_token(route: Route) -> None:
        if route.request.url.endswith("/health"):
            route.fallback()
        else:
            route.fulfill(status=401, content_type="application/problem+json", body=json.dumps(refusal))

    page.route("**/api/**", refuse_token)
    page.get_by_label("Height").fill("1.8")
    page.get_by_role("button", name="Save subject").click()
    expect(page.get_by_role("complementary", name="Connection").get_by_role("link", name="Log in")).to_be_visible()


def film_dialog(page: Page) -> None:
    page.get_by_role("button", name="Film…").click()
    # its modules are loaded when the first one is wanted
    expect(page.get_by_role("dialog", name="Film of the scene")).to_be_visible(timeout=90_000)


def empty_film(page: Page) -> None:
    film_dialog(page)
    page.locator("dialog[open] [name=to]").fill("0")
    expect(page.get_by_role("button", name="Save film")).to_be_disabled()


def picture_dialog(page: Page) -> None:
    page.get_by_role("button", name="Picture…").click()
    expect(page.get_by_role("dialog", name="Picture of the scene")).to_be_visible()


def shortcuts_dialog(page: Page) -> None:
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keyboard shortcuts")).to_be_visible()


def copied_link(page: Page) -> None:
    page.keyboard.press("l")
    expect(page.locator("[data-said-link]")).not_to_be_empty()


def open_editor(page: Page) -> None:
    """A contact, the terrain with a surface, and the push are open."""
    page.locator("[data-touches] button").first.click()
    page.locator("details.terrain summary").click()
    page.locator("[data-surfaces] button").first.click()
    page.get_by_text("Apply a push").click()
    expect(page.locator("[data-surfaces] input").first).to_be_visible()


def refused_json(page: Page) -> None:
    page.get_by_role("button", name="JSON").click()
    page.get_by_label("JSON of the scenario").fill("{")
    page.locator("[data-json-store]").click()
    expect(page.locator("[data-json-said]")).to_have_text("This is not JSON.")


def obstacles_of_all_kinds(page: Page) -> None:
    for button in page.locator("[data-add] button").all():
        button.click()
    page.get_by_label("Rise in cm of Stairs, obstacle 1").fill("900")
    page.get_by_role("button", name="Plan the motion").click()
    expect(page.locator("[data-plan-said]")).not_to_be_empty()


def deletion_dialog(page: Page) -> None:
    page.locator("[data-delete]").click()
    expect(page.locator("dialog[open]")).to_contain_text("Delete")


def refused_deletion(page: Page) -> None:
    """With the reason, as where another person has the rights."""
    problem = {"title": "Forbidden", "detail": "This recording belongs to another owner.", "code": "not-owner"}
    page.route(
        "**/api/**",
        lambda route: route.fulfill(status=403, content_type="application/problem+json", body=json.dumps(problem)),
    )
    deletion_dialog(page)
    page.locator("dialog[open] [data-yes]").click()
    expect(page.locator("dialog[open] [data-said]")).to_have_text(problem["detail"])


def running_plan(page: Page) -> None:
    """In the editor: its progress and what is shown meanwhile."""
    expect(page.locator("[data-plan-live]")).to_be_visible()
    expect(page.locator("[data-plan-message]")).to_contain_text("whole body")
    expect(page.get_by_role("button", name="Cancel")).to_be_enabled()


def filling_certificate(page: Page) -> None:
    """A check that has failed, while others are still computed."""
    certificate = page.locator("[data-plan-certificate]")
    certificate.evaluate("""(one) => {
        one.hidden = false;
        one.className = "outcome outcome-failed";
        one.textContent = "Certificate: 3 of 9 checks, terrain distance failed";
    }""")
    expect(certificate).to_be_visible()


def running_progress(page: Page) -> None:
    wanted_notification(page)
    expect(page.locator("progress").first).to_be_visible()


STATES: dict[str, tuple[str, tuple[Callable[[Page], None], ...]]] = {
    "first visit": ("/?tour=1", (first_tour, next_of_tour, next_of_tour, next_of_tour)),
    "uploads": ("home", (refused_and_waiting_uploads,)),
    "chosen recordings": ("recordings", (chosen_recordings,)),
    "running job": ("running", (wanted_notification,)),
    "running plan": ("plan-running", (running_progress,)),
    "editor of a running plan": ("view-planning", (running_plan, filling_certificate, shortcuts_dialog)),
    "connection": ("recording", (lost_connection,)),
    "deletion of a recording": ("recording", (deletion_dialog, refused_deletion)),
    "deletion of a subject": ("subject", (deletion_dialog,)),
    "deletion of a job": ("failed", (deletion_dialog,)),
    "deletion of a plan": ("plan", (deletion_dialog,)),
    "login": ("recording", (ended_login,)),
    "viewer": ("view-plan", (copied_link, film_dialog, empty_film, picture_dialog, shortcuts_dialog)),
    "editor": ("view-scenario", (open_editor, shortcuts_dialog, refused_json)),
    "robot in 3D": ("view-robot", (shortcuts_dialog,)),
    "new scenario": ("new scenario", (obstacles_of_all_kinds,)),
}
"""Pages, and the states that each comes to one after the other; a dialog is closed before the next."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", STATES)
def test_a_state_is_accessible_at_every_size(tab: Tab, lab: Lab, addresses: dict[str, str], name: str) -> None:
    address, states = STATES[name]
    where = addresses.get(address, address)
    page = opened(tab, where) if address.startswith("view-") else tab.go(where)
    result: dict[str, dict[str, list[str]]] = {}
    for number, reach in enumerate(states):
        reach(page)
        if faults := faults_at_every_size(page, f"{name.replace(' ', '-')}-{number}"):
            result[f"{number} {reach.__name__}"] = faults
        if page.locator("dialog[open]").count():
            page.keyboard.press("Escape")
            expect(page.locator("dialog[open]")).to_have_count(0)
    tab.missteps = [misstep for misstep in tab.missteps if "Failed to load resource" not in misstep]
    assert result == {}
