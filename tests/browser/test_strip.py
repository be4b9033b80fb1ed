"""The phases of a scenario on their strip: dragged, typed, added, taken away, undone; and who else changes them."""

import json
import re
from collections.abc import Callable
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Locator, Page, Route, expect

from stridelab.schemas.scenarios import StoredScenario
from stridelab_web.scene.contacts import placed_contacts
from support.browser.page import Tab, hold, nodes, opened, until
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

MARKS = """() => Object.entries(document.querySelector("iframe").contentWindow.__viserMutable.nodeRefFromName)
    .filter(([name, node]) => node?.parent && /^\\/contacts\\/\\d+$/.test(name)).length"""
"""How many contacts are in the scene."""


@pytest.fixture
def kept(lab: Lab) -> StoredScenario:
    """A copy of its own for every test."""
    return lab.fake.add_scenario()


@pytest.fixture
def page(open_tab: Callable[..., Tab], kept: StoredScenario) -> Page:
    """The editor, small: without a graphics card every point of the picture costs."""
    return opened(open_tab(1000, 700), f"/view/?scenario={kept.id}")


def durations(lab: Lab, kept: StoredScenario) -> list[float]:
    return [phase.duration_s for phase in lab.fake.scenarios[kept.id].phases]


def standing(lab: Lab, kept: StoredScenario) -> list[set[str]]:
    """Which effectors touch, phase by phase."""
    return [{contact.effector for contact in phase.contacts} for phase in lab.fake.scenarios[kept.id].phases]


def end_of(page: Page, k: int) -> Locator:
    return page.get_by_role("slider", name=f"End of phase {k}", exact=True)


def phase(page: Page, k: int) -> Locator:
    return page.locator("[data-phases] button").nth(k)


def said(page: Page) -> Locator:
    return page.locator("[data-said]").first


def refused(open_tabs: Tab, status: int) -> None:
    """The browser reports a refusal as an error, which here is what was to come."""
    open_tabs.missteps = [m for m in open_tabs.missteps if str(status) not in m]


def drag_border(page: Page, k: int, by_s: float, shift: bool = False) -> None:
    """Take hold of a border and move it by so many seconds of the strip's scale."""
    box, lanes = end_of(page, k).bounding_box(), page.locator("[data-lanes]").bounding_box()
    assert box is not None
    assert lanes is not None
    whole_s = float(end_of(page, k).get_attribute("aria-valuemax") or 0)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    if shift:
        page.keyboard.down("Shift")
    for step in (1, 2, 3, 4):
        page.mouse.move(x + step / 4 * by_s * lanes["width"] / whole_s, y)
    if shift:
        page.keyboard.up("Shift")


def test_a_border_is_dragged_undone_and_done_again(page: Page, lab: Lab, kept: StoredScenario) -> None:
    before = durations(lab, kept)
    drag_border(page, 3, -0.3)
    expect(end_of(page, 3)).to_have_attribute("aria-valuetext", re.compile(r"phase 3 lasts 0\.(49|50|51) seconds"))
    assert durations(lab, kept) == before, "nothing is stored while it is held"
    page.mouse.up()
    expect(said(page)).to_have_text("End of phase 3 stored.")
    after = durations(lab, kept)
    assert after[3] == pytest.approx(before[3] - 0.3, abs=0.02)
    assert after[3] + after[4] == pytest.approx(before[3] + before[4])
    assert after[:3] + after[5:] == before[:3] + before[5:]
    assert page.evaluate(MARKS) == len(placed_contacts(kept))

    page.get_by_role("button", name="Undo").click()
    until(page, lambda: durations(lab, kept) == before)
    expect(said(page)).to_have_text("Undone.")
    page.locator("h1").click()
    page.keyboard.press("Control+Shift+z")
    until(page, lambda: durations(lab, kept) == after)
    page.keyboard.press("Control+z")
    until(page, lambda: durations(lab, kept) == before)
    page.keyboard.press("Control+y")
    until(page, lambda: durations(lab, kept) == after)
    expect(page.get_by_role("button", name="Redo")).to_be_disabled()


def test_with_shift_all_that_follows_moves_along(page: Page, lab: Lab, kept: StoredScenario) -> None:
    before = durations(lab, kept)
    drag_border(page, 1, 0.4, shift=True)
    page.mouse.up()
    expect(said(page)).to_have_text("End of phase 1 stored.")
    # the last movement came without the key: only durations that follow each other can tell
    after = durations(lab, kept)
    assert after[1] == pytest.approx(before[1] + 0.4, abs=0.02)
    assert after[0] == before[0]
    assert after[2:] == before[2:]


def test_a_border_that_is_let_go_by_escape_goes_back(page: Page, lab: Lab, kept: StoredScenario) -> None:
    before = durations(lab, kept)
    drag_border(page, 0, 0.3)
    expect(end_of(page, 0)).to_have_attribute("aria-valuetext", re.compile(r"phase 0 lasts 1\.\d+ seconds"))
    page.keyboard.press("Escape")
    expect(end_of(page, 0)).to_have_attribute("aria-valuetext", re.compile(r"phase 0 lasts 1\.00 seconds"))
    page.mouse.up()
    assert durations(lab, kept) == before


def test_keys_move_a_border_and_are_stored_once_they_rest(page: Page, lab: Lab, kept: StoredScenario) -> None:
    phase(page, 3).click()
    assert page.locator("[data-borders] [tabindex='0']").count() == 2, (
        "the borders of the chosen phase, for the tab key"
    )
    end_of(page, 3).focus()
    for key in ("ArrowLeft", "ArrowLeft", "Shift+ArrowRight"):
        page.keyboard.press(key)
    expect(end_of(page, 3)).to_have_attribute("aria-valuenow", "2.710")
    expect(said(page)).to_have_text("End of phase 3 stored.")
    assert durations(lab, kept)[3:5] == pytest.approx([0.71, 0.29])
    for _ in range(30):
        page.keyboard.press("ArrowRight")
    until(page, lambda: durations(lab, kept)[3:5] == pytest.approx([0.95, 0.05]))  # the shortest that a phase lasts
    page.get_by_role("button", name="Undo").click()
    until(page, lambda: durations(lab, kept)[3:5] == pytest.approx([0.71, 0.29]))


def test_phases_are_typed_split_added_and_removed(page: Page, lab: Lab, kept: StoredScenario) -> None:
    before = durations(lab, kept)
    phase(page, 1).focus()
    page.keyboard.press("Enter")
    duration = page.get_by_label("lasts")
    expect(duration).to_have_value("0.8")
    duration.fill("1.25")
    expect(end_of(page, 1)).to_have_attribute("aria-valuenow", "2.250")
    assert durations(lab, kept) == before, "nothing is stored while it is typed"
    duration.press("Enter")
    until(page, lambda: durations(lab, kept) == pytest.approx([before[0], 1.25, *before[2:]]))

    page.get_by_role("button", name="Split").press("Enter")
    until(page, lambda: durations(lab, kept) == pytest.approx([before[0], 0.625, 0.625, *before[2:]]))
    expect(page.locator("[data-phases] button")).to_have_count(10)
    assert standing(lab, kept)[1] == standing(lab, kept)[2] == {"left_foot", "right_hand"}
    assert page.evaluate(MARKS) == len(placed_contacts(kept)), "a touch that is split in time is one touch"
    page.get_by_role("button", name="Add", exact=True).press("Enter")
    until(page, lambda: durations(lab, kept) == pytest.approx([before[0], 0.625, 0.5, 0.625, *before[2:]]))
    for _ in range(2):
        page.get_by_role("button", name="Remove").press("Enter")
        expect(said(page)).to_have_text("Phase 1 removed.")
        n = len(durations(lab, kept))
        expect(page.locator("[data-phases] button")).to_have_count(n)
    until(page, lambda: durations(lab, kept) == pytest.approx([before[0], 0.625, *before[2:]]))
    for _ in range(5):
        page.get_by_role("button", name="Undo").click()
        expect(said(page)).to_have_text("Undone.")
    until(page, lambda: durations(lab, kept) == before)
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()


def test_contacts_come_and_go_and_the_picture_follows(page: Page, lab: Lab, kept: StoredScenario) -> None:
    until(page, lambda: page.evaluate(MARKS) == 7)
    phase(page, 3).click()
    left = page.locator("select[data-effector=left_foot]")
    assert left.locator("option").all_inner_texts() == [
        "does not touch",
        "as in phase 2",
        "as in phase 4",
        "at a new place",
    ]
    left.select_option("at a new place")
    expect(said(page)).to_have_text("Phase 3 stored.")
    placed = {contact.effector: contact for contact in lab.fake.scenarios[kept.id].phases[3].contacts}
    assert placed["left_foot"].position_m == pytest.approx((0.15, 0.09, 0.1))  # between, on the first step
    until(page, lambda: page.evaluate(MARKS) == 8)
    until(page, lambda: nodes(page, "/contacts/5")["/contacts/5"]["position"] == pytest.approx([0.15, 0.09, 0.1]))
    expect(page.locator("[data-touches] > li")).to_have_count(8)

    left.select_option("does not touch")
    until(page, lambda: page.evaluate(MARKS) == 7)
    assert "left_foot" not in standing(lab, kept)[3]
    phase(page, 0).click()
    page.locator("select[data-effector=right_hand]").select_option("as in phase 1")
    lane = page.locator("[data-lane=right_hand]")
    expect(lane).to_have_attribute("aria-label", "right hand touches from 0.00 s to 5.80 s")
    until(page, lambda: "right_hand" in standing(lab, kept)[0])
    box = lane.bounding_box()
    assert box is not None
    lane.dblclick(position={"x": box["width"] * 0.4 / 5.8, "y": 5})
    expect(lane).to_have_attribute("aria-label", "right hand touches from 1.00 s to 5.80 s")
    until(page, lambda: lab.fake.scenarios[kept.id].phases == kept.phases)
    page.get_by_role("button", name="Undo").click()
    until(page, lambda: "right_hand" in standing(lab, kept)[0])


def test_what_the_judge_refuses_in_a_phase_goes_back(
    open_tab: Callable[..., Tab], lab: Lab, kept: StoredScenario
) -> None:
    tab = open_tab(1000, 700)
    page = opened(tab, f"/view/?scenario={kept.id}")
    page.get_by_role("button", name="JSON").click()
    text = page.get_by_label("JSON of the scenario")
    expect(text).to_have_value(re.compile("phases"))
    body = json.loads(text.input_value())
    foot = next(c for c in body["phases"][2]["contacts"] if c["effector"] == "right_foot")
    foot["position_m"][1] = -0.7
    text.fill(json.dumps(body, indent=1))
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Store").click()
    fault = dialog.get_by_role("listitem")
    expect(fault).to_contain_text("phases[2].contacts[right_foot]: The foot stands on nothing.")
    fault.get_by_role("button").click()
    start, end = page.evaluate("() => { const t = document.activeElement; return [t.selectionStart, t.selectionEnd]; }")
    assert text.input_value()[:end].count("right_foot") == 1 + text.input_value()[:start].count("right_foot") or (
        "{" in text.input_value()[start:end]
    )
    assert lab.fake.scenarios[kept.id].phases == kept.phases
    text.fill('{"name": "half"')
    dialog.get_by_role("button", name="Store").click()
    expect(dialog).to_contain_text("This is not JSON.")
    text.fill("null")
    dialog.get_by_role("button", name="Store").click()
    expect(dialog).to_contain_text("This is not a scenario")

    foot["position_m"][1] = -0.11
    body["name"] = "By hand"
    text.fill(json.dumps(body))
    text.press("Control+Enter")
    expect(dialog).to_be_hidden()
    until(page, lambda: lab.fake.scenarios[kept.id].name == "By hand")
    until(page, lambda: page.evaluate(MARKS) == len(placed_contacts(lab.fake.scenarios[kept.id])))
    page.locator("h1").click()
    page.keyboard.press("Control+z")
    until(page, lambda: lab.fake.scenarios[kept.id].name == kept.name)
    refused(tab, 422)


def test_another_terrain_is_shown_without_losing_the_way_back(page: Page, lab: Lab, kept: StoredScenario) -> None:
    page.get_by_role("button", name="JSON").click()
    text = page.get_by_label("JSON of the scenario")
    expect(text).to_have_value(re.compile("phases"))
    body = json.loads(text.input_value())
    body["terrain"].append({"name": "block", "kind": "box", "center_m": [2.5, 0, 0.1], "size_m": [0.2, 0.2, 0.2]})
    text.fill(json.dumps(body))
    text.press("Control+Enter")
    until(page, lambda: bool(nodes_there(page, "/terrain/4")))
    page.get_by_role("button", name="Undo").click()
    until(page, lambda: len(lab.fake.scenarios[kept.id].terrain) == 4)
    until(page, lambda: not nodes_there(page, "/terrain/4"))


def nodes_there(page: Page, name: str) -> bool:
    """Whether viser has such a node; it has none while the scene is loaded anew."""
    script = "(name) => Boolean(document.querySelector('iframe').contentWindow.__viserMutable?.nodeRefFromName[name])"
    return bool(page.evaluate(script, name))


def test_a_foothold_that_is_dragged_into_the_sky_stays_on_its_tread(tab: Tab, lab: Lab, kept: StoredScenario) -> None:
    page = opened(tab, f"/view/?scenario={kept.id}")
    hold(page, "/contacts/4", (0.34, -0.15, 0.1))
    stage = page.locator("[data-stage]").bounding_box()
    assert stage is not None
    page.mouse.move(stage["x"] + stage["width"] / 2, stage["y"] + 3, steps=4)  # above the horizon: on no surface at all
    page.mouse.up()
    expect(page.locator("[data-said]")).to_contain_text(re.compile(r"^(Stored\.|This scenario cannot be used)"))
    contacts = {contact.effector: contact for contact in lab.fake.scenarios[kept.id].phases[2].contacts}
    x, y, z = contacts["right_foot"].position_m
    assert 0.145 < x < 0.445, "the lower step, up to where the next one begins"
    assert abs(y) < 0.6
    assert z == pytest.approx(0.1)
    until(page, lambda: nodes(page, "/contacts/4")["/contacts/4"]["position"] == pytest.approx([x, y, z], abs=1e-6))
    refused(tab, 422)


def test_two_editors_of_one_scenario_are_told(open_tab: Callable[..., Tab], lab: Lab, kept: StoredScenario) -> None:
    first, tab = open_tab(900, 640), open_tab(900, 640)
    one, other = opened(first, f"/view/?scenario={kept.id}"), opened(tab, f"/view/?scenario={kept.id}")
    before = durations(lab, kept)
    phase(one, 1).click()
    one.get_by_label("lasts").fill("1.1")
    one.get_by_label("lasts").press("Enter")
    expect(said(one)).to_have_text("Phase 1 stored.")
    expect(said(other)).to_contain_text("Changed in another window")
    phase(other, 1).click()
    expect(other.get_by_label("lasts")).to_have_value("1.1")
    other.get_by_role("button", name="Undo").click()
    until(other, lambda: durations(lab, kept) == before)
    expect(said(one)).to_contain_text("Changed in another window")

    # what is stored in between, unseen, is not overwritten
    def late(route: Route) -> None:
        if route.request.method == "PUT":
            theirs = lab.fake.scenarios[kept.id].model_copy(update={"name": "Theirs"})
            lab.fake.client().put_scenario(kept.id, theirs)
        route.continue_()

    other.route("**/api/v1/scenarios/*", late)
    other.get_by_label("lasts").fill("1.3")
    other.get_by_label("lasts").press("Enter")
    expect(said(other)).to_contain_text("Not stored: it was changed in another window")
    assert lab.fake.scenarios[kept.id].name == "Theirs"
    assert durations(lab, kept) == before
    expect(other.get_by_label("lasts")).to_have_value("0.8")
    refused(tab, 412)


def test_a_reload_keeps_place_and_way_back(page: Page, lab: Lab, kept: StoredScenario) -> None:
    before = durations(lab, kept)
    phase(page, 3).click()
    page.get_by_label("lasts").fill("0.9")
    page.get_by_label("lasts").press("Enter")
    expect(said(page)).to_have_text("Phase 3 stored.")
    page.get_by_role("button", name="4 right foot").click()
    phase(page, 2).click()
    page.reload()
    page.wait_for_selector("[data-ready]", timeout=90_000)
    expect(page.get_by_role("button", name="4 right foot")).to_have_attribute("aria-expanded", "true")
    expect(phase(page, 2)).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Undo").click()
    until(page, lambda: durations(lab, kept) == before)


def test_a_sample_is_looked_at_and_copied_before_it_is_changed(tab: Tab, lab: Lab) -> None:
    sample = lab.fake.add_scenario(bundled=True)
    page = opened(tab, f"/view/?scenario={sample.id}")
    phase(page, 2).click()
    expect(page.get_by_label("lasts")).to_have_value("0.2")
    page.get_by_role("button", name="JSON").click()
    text = page.get_by_label("JSON of the scenario")
    expect(text).to_have_value(re.compile("phases"))
    body = json.loads(text.input_value())
    body["phases"][0]["duration_s"] = 2.0
    text.fill(json.dumps(body))
    page.get_by_role("button", name="Store as a copy").click()
    page.wait_for_url(lambda url: "scenario=" in url and sample.id not in url)
    query = parse_qs(urlsplit(page.url).query)
    assert query["phase"] == ["2"], "the copy opens at the same phase"
    copied = lab.fake.scenarios[query["scenario"][0]]
    assert copied.phases[0].duration_s == 2.0
    assert lab.fake.scenarios[sample.id] == sample
    page.wait_for_selector("[data-ready]", timeout=60_000)


@pytest.mark.parametrize(("width", "height"), [(1400, 850), (800, 600)])
def test_the_strip_fits_and_can_be_widened(tab: Tab, kept: StoredScenario, width: int, height: int) -> None:
    tab.page.set_viewport_size({"width": width, "height": height})
    page = opened(tab, f"/view/?scenario={kept.id}")
    for side in ("Width", "Height"):
        assert page.evaluate(f"() => document.documentElement.scroll{side} <= window.inner{side}")
    stage = page.locator("[data-stage]").bounding_box()
    assert stage is not None
    assert stage["height"] > 0.35 * height
    narrow = end_of(page, 8).bounding_box()
    page.get_by_role("button", name="Wider strip").click()
    wide = end_of(page, 8).bounding_box()
    assert narrow is not None
    assert wide is not None
    assert wide["x"] != narrow["x"]
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
