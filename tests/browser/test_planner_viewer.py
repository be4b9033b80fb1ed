"""Plans and scenarios in the viewer: what is drawn is what the files say, and what is dragged is what is stored."""

import math
import re
from collections.abc import Callable
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from playwright.sync_api import Route, expect

from stridelab.schemas.base import FaultItem, Problem
from stridelab_web.scene.contacts import placed_contacts
from support.browser.page import DRAWN_OVER, Tab, drag, nodes, opened, until
from support.fakes import robots
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

FOOT = "/robot/leg_right_6_link"


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    """Small: without a graphics card every point of the picture costs."""
    return open_tab(900, 640)


def positions(lab: Lab, scenario_id: str, effector: str) -> list[tuple[float, ...] | None]:
    """Where an effector is, phase by phase, in the stored scenario."""
    return [
        next((c.position_m for c in phase.contacts if c.effector == effector), None)
        for phase in lab.fake.scenarios[scenario_id].phases
    ]


def test_the_robot_stands_where_the_files_say(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=2.0")
    given = robots.scenario()
    poses, time_s = robots.poses(given), robots.display_times_s(given)

    def foot_is_at(frame: int) -> Callable[[], bool]:
        expected = poses[frame, robots.LINKS.index("leg_right_6_link")].astype(float)

        def holds() -> bool:
            shown = nodes(page, FOOT)[FOOT]
            near = np.abs(np.array(shown["position"]) - expected[:3]).max() < 1e-4
            return bool(near and abs(np.dot(shown["wxyz"], expected[3:])) > 1 - 1e-6)

        return holds

    until(page, foot_is_at(100))
    expect(page.locator("[data-time]")).to_have_text(f"2.000 s · frame 101 of {len(time_s)} · phase 3")
    page.get_by_role("slider", name="Time").fill("211")
    until(page, foot_is_at(211))
    page.wait_for_url(f"**t={time_s[211]:.3f}")
    page.locator("body").press(".")
    until(page, foot_is_at(212))


def test_between_two_frames_the_robot_turns_the_short_way(tab: Tab, lab: Lab) -> None:
    """The fake's quaternions change sign from frame to frame, as q and -q are the same turn."""
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=1.0")
    page.get_by_label("Speed").select_option("0.1")
    page.locator("body").press(" ")
    for _ in range(8):
        shown = nodes(page, FOOT)[FOOT]
        t_s = shown["position"][0] / 0.12
        expected = robots.foot_pose(np.array([t_s]))[0]
        assert abs(np.dot(shown["wxyz"], expected[3:])) > 1 - 1e-5
        page.wait_for_timeout(60)
    page.locator("body").press(" ")


def test_contacts_and_forces_are_there_while_the_effector_touches(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=0.5")
    names = ("/contacts/1/touching", "/contacts/2/touching", "/contacts/3/touching", "/forces/right_hand_shaft")

    def there() -> list[bool]:
        shown = nodes(page, *names)
        assert [shown[name]["drawn"] for name in names] == [max(shown[name]["scale"]) > 1e-3 for name in names]
        return [shown[name]["drawn"] for name in names]

    until(page, lambda: there() == [True, True, False, False])
    page.get_by_role("slider", name="Time").fill("75")  # 1.5 s: left foot and right hand
    until(page, lambda: there() == [True, False, True, True])
    page.get_by_label("Contacts").uncheck()
    until(page, lambda: there() == [False, False, False, True])
    page.get_by_label("Forces").uncheck()
    until(page, lambda: not any(there()))


def test_cones_follow_the_forces_of_loaded_contacts_when_switched_on(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=1.5")
    requested: list[str] = []
    names = ("/cones/1", "/cones/2", "/cones/3", "/momentum/com_head")

    def there() -> list[bool]:
        shown = nodes(page, *names)
        return [max(shown[name]["scale"]) > 1e-3 for name in names]

    assert there() == [False] * 4
    page.get_by_label("Cones").check()
    until(page, lambda: there() == [True, False, True, False])  # left foot and right hand
    page.get_by_label("Angular momentum").check()
    until(page, lambda: there() == [True, False, True, True])
    force = nodes(page, "/cones/3", "/forces/right_hand_shaft")
    assert force["/cones/3"]["position"] == pytest.approx(force["/forces/right_hand_shaft"]["position"])
    assert page.evaluate(DRAWN_OVER, ["/cones/1"]) == [True]
    page.get_by_label("See through").uncheck()
    assert page.evaluate(CLEAR, "/cones/1"), "what can be seen through stays so"
    page.on("request", lambda request: requested.append(request.url))
    page.get_by_role("slider", name="Time").fill("25")  # 0.5 s: both feet
    until(page, lambda: there() == [True, True, False, True])
    assert [url for url in requested if "/view/scene/" in url] == []


def test_the_ghost_of_the_replay_and_its_forces_are_there_until_it_falls(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan(replay=True)
    page = opened(tab, f"/view/?plan={job.id}&t=0.5")
    names = (FOOT, "/ghost/leg_right_6_link", "/forces/left_foot_shaft", "/measured/left_foot_shaft")

    def there() -> list[bool]:
        shown = nodes(page, *names)
        return [max(shown[name]["scale"]) > 1e-3 for name in names]

    until(page, lambda: there() == [True, True, True, False])  # a fall shows its ghost at once
    page.get_by_label("Measured forces").check()
    until(page, lambda: there() == [True] * 4)
    shown = nodes(page, *names[:2])
    apart = np.subtract(shown[names[1]]["position"], shown[names[0]]["position"])
    assert apart == pytest.approx([0.0, 0.0, 0.01], abs=1e-5)
    page.get_by_label("Replay").uncheck()
    until(page, lambda: there() == [True, False, True, True])
    page.get_by_label("Replay").check()
    page.get_by_role("slider", name="Time").fill("160")  # 3.2 s, after the fall
    until(page, lambda: there()[:2] == [True, False])


def test_a_checks_worst_moment_is_one_choice_or_one_click_away(tab: Tab, lab: Lab) -> None:
    page = opened(tab, f"/view/?plan={lab.fake.add_plan(replay=True).id}")
    clock = page.locator("[data-time]")
    page.get_by_label("Worst of").select_option("2.500")
    expect(clock).to_contain_text("2.500 s")
    page.locator("rect.check.bad").click()
    expect(clock).to_contain_text(re.compile(r"1\.2[46]0 s"))
    assert page.viewport_size is not None
    assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]


CLEAR = """(name) => {
    let material = null;
    document.querySelector("iframe").contentWindow.__viserMutable.nodeRefFromName[name].traverse((part) => {
        material ??= part.material ?? null;
    });
    return material.transparent && material.opacity < 1;
}"""


def test_the_centre_of_mass_is_seen_through_the_body_unless_switched_off(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=0.5")
    inside = ["/com/plan", "/com/plan/light", "/paths/com", "/forces/left_foot_head"]
    assert page.evaluate(DRAWN_OVER, [*inside, FOOT, "/terrain/0"]) == [True] * 4 + [False] * 2
    page.get_by_label("See through").uncheck()
    assert page.evaluate(DRAWN_OVER, inside) == [False] * 4
    assert "through=0" in page.url
    page = opened(tab, page.url.removeprefix(lab.url))
    expect(page.get_by_label("See through")).not_to_be_checked()
    assert page.evaluate(DRAWN_OVER, inside) == [False] * 4
    page.get_by_label("See through").check()
    assert page.evaluate(DRAWN_OVER, inside) == [True] * 4
    assert "through" not in page.url


def test_a_recording_without_joint_centres_has_nothing_to_see_through(tab: Tab, lab: Lab) -> None:
    page = opened(tab, f"/view/?recording={lab.fake.add_recording().id}")
    expect(page.get_by_label("See through")).to_be_hidden()


def test_the_robot_at_the_start_does_not_keep_its_footholds(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    drag(page, "/contacts/1", (0.0, 0.14, 0.0))  # the left foot's link is above it
    expect(page.locator("[data-said]")).to_have_text("Stored.")
    stored = positions(lab, scenario.id, "left_foot")[0] or ()
    assert math.dist(stored, (0.0, 0.14, 0.0)) < 0.01
    middle = (stored[1] - 0.09) / 2
    until(page, lambda: abs(nodes(page, "/robot")["/robot"]["position"][1] - middle) < 1e-6)


def test_the_phase_strip_leads_to_its_instant(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=0")
    strip = page.get_by_role("img", name="right foot touches")
    box = strip.bounding_box()
    assert box is not None
    strip.click(position={"x": box["width"] / 2, "y": box["height"] / 2})
    expect(page.locator("[data-time]")).to_contain_text("2.900 s")
    page.locator("body").press("PageDown")
    expect(page.locator("[data-time]")).to_contain_text("3.000 s")
    expect(page.locator("[data-time]")).to_contain_text("phase 5")
    page.locator("body").press("PageUp")
    expect(page.locator("[data-time]")).to_contain_text("2.800 s")


def test_a_dragged_foothold_is_stored_where_it_was_let_go(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    before = positions(lab, scenario.id, "left_foot")
    target = (0.28, 0.21, 0.1)  # touch 5: the left foot on the first step, phases 4 to 6
    drag(page, "/contacts/5", target)
    expect(page.locator("[data-said]")).to_have_text("Stored.")
    after = positions(lab, scenario.id, "left_foot")
    assert [k for k, (a, b) in enumerate(zip(before, after, strict=True)) if a != b] == [4, 5, 6]
    assert after[4] == after[5] == after[6] != None  # noqa: E711
    assert math.dist(after[4] or (), target) < 0.01
    expect(page.get_by_role("button", name="5 left foot")).to_contain_text(f"{(after[4] or ())[0]:.3f}")

    page.get_by_role("button", name="Undo").click()
    until(page, lambda: positions(lab, scenario.id, "left_foot") == before)
    until(page, lambda: math.dist(nodes(page, "/contacts/5")["/contacts/5"]["position"], before[4] or ()) < 1e-6)


def test_a_foothold_does_not_leave_its_tread(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    drag(page, "/contacts/4", (1.2, -0.15, 0.1))  # far into the next step
    expect(page.locator("[data-said]")).to_have_text("Stored.")
    stored = positions(lab, scenario.id, "right_foot")[2] or ()
    # the next step begins at 0.445, half the sole is 0.10 m long
    assert stored[0] == pytest.approx(0.345, abs=1e-3)
    assert stored[2] == pytest.approx(0.1)


def test_what_the_service_refuses_goes_back_with_its_sentence(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    before = positions(lab, scenario.id, "left_foot")
    drag(page, "/contacts/5", (0.3, 0.48, 0.1))  # beyond what the fake judge allows
    expect(page.locator("[data-said]")).to_contain_text("The foot stands on nothing.")
    assert positions(lab, scenario.id, "left_foot") == before
    until(page, lambda: math.dist(nodes(page, "/contacts/5")["/contacts/5"]["position"], before[4] or ()) < 1e-6)
    tab.missteps = [m for m in tab.missteps if "422" not in m]


def test_without_the_fast_solver_the_page_says_so_and_asks_for_no_push(tab: Tab, lab: Lab) -> None:
    page = opened(tab, f"/view/?scenario={lab.fake.add_scenario().id}")
    expect(page.locator("[data-live-said]")).to_contain_text("The C++ solver has not been built here.")
    expect(page.locator("[data-live-on]")).to_be_disabled()


def test_keys_and_numbers_move_what_the_mouse_moves(tab: Tab, lab: Lab) -> None:
    tab.page.set_viewport_size({"width": 800, "height": 600})
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert page.evaluate("() => document.documentElement.scrollHeight <= window.innerHeight")
    contact = page.get_by_role("button", name="4 right foot")
    for key in ("ArrowUp", "ArrowUp", "ArrowRight", "Shift+ArrowDown"):
        contact.press(key)
    expect(page.locator("[data-said]")).to_have_text("Contact 4 stored.")
    assert positions(lab, scenario.id, "right_foot")[2] == pytest.approx((0.319, -0.1, 0.1))
    assert positions(lab, scenario.id, "right_foot")[4] == pytest.approx((0.319, -0.1, 0.1))

    row = page.locator("li", has=contact)
    row.get_by_label("x").fill("0.31")
    row.get_by_label("x").press("Enter")
    until(page, lambda: positions(lab, scenario.id, "right_foot")[3] == pytest.approx((0.31, -0.1, 0.1)))
    row.get_by_label("turn").fill("10")
    row.get_by_label("turn").press("Enter")
    half = math.radians(5)

    def turned() -> bool:
        contacts = {c.effector: c for c in lab.fake.scenarios[scenario.id].phases[3].contacts}
        return contacts["right_foot"].orientation_wxyz == pytest.approx((math.cos(half), 0, 0, math.sin(half)))

    until(page, turned)
    until(page, lambda: abs(nodes(page, "/contacts/4")["/contacts/4"]["wxyz"][3] - math.sin(half)) < 1e-6)
    page.locator("h1").click()
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(page, lambda: positions(lab, scenario.id, "right_foot")[3] == pytest.approx((0.319, -0.1, 0.1)))


def test_a_phase_that_is_only_passed_in_motion_says_so(tab: Tab, lab: Lab) -> None:
    page = opened(tab, f"/view/?scenario={lab.fake.add_scenario().id}")
    bars, message = page.locator("[data-phases] button"), page.locator("[data-phase-said]")
    expect(bars.nth(3)).to_have_attribute("aria-pressed", "true")  # the tightest, before anything is chosen
    expect(message).to_have_text(
        "Phase 3: right foot, right hand. "
        "Only passed in motion: to rest, the CoM would have to be 2.0 cm farther than it reaches."
    )
    assert [bars.nth(k).get_attribute("data-kind") for k in (2, 3, 4)] == ["rest", "motion", "rest"]
    page.get_by_role("button", name="4 right foot").click()  # phases 2 to 4
    expect(bars.nth(3)).to_have_attribute("aria-pressed", "true")
    bars.nth(2).click()
    expect(message).to_contain_text(
        "Phase 2: left foot, right foot, right hand. The CoM can rest here with 6.0 cm to spare."
    )
    row = page.locator("li", has=page.get_by_role("button", name="4 right foot"))
    expect(row.locator("[data-margins]")).to_contain_text("4.0 cm inside the edge of ground")
    expect(row.locator("[data-margins]")).to_contain_text("25.0 cm to spare, least in phase 2")


def test_the_scene_keeps_its_place_while_the_judge_thinks(tab: Tab, lab: Lab) -> None:
    """What is taken hold of must not move away under the pointer once the first answer comes."""
    held: list[Route] = []
    tab.page.route("**/api/v1/scenarios/check", lambda route: held.append(route))
    page = opened(tab, f"/view/?scenario={lab.fake.add_scenario().id}")
    before = page.locator("iframe").bounding_box()
    until(page, lambda: len(held) == 1)
    held[0].continue_()
    expect(page.locator("[data-phases] button")).to_have_count(9)
    assert page.locator("iframe").bounding_box() == before


def test_samples_are_copied_before_they_are_changed(tab: Tab, lab: Lab) -> None:
    sample = lab.fake.add_scenario(bundled=True)
    page = opened(tab, f"/view/?scenario={sample.id}")
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()
    page.get_by_role("button", name="5 left foot").press("ArrowUp")
    page.wait_for_url(lambda url: "scenario=" in url and sample.id not in url)
    assert lab.fake.scenarios[sample.id] == sample
    copied = lab.fake.scenarios[parse_qs(urlsplit(page.url).query)["scenario"][0]]
    assert (copied.name, copied.bundled) == ("Two steps (copy)", False)
    x, y, z = placed_contacts(sample)[4].contact.position_m
    assert placed_contacts(copied)[4].contact.position_m == pytest.approx((x + 0.01, y, z))
    page.wait_for_selector("[data-ready]", timeout=60_000)
    expect(page.get_by_role("button", name="5 left foot")).to_have_attribute("aria-expanded", "true")
    page.get_by_role("button", name="Undo").click()
    expect(page.locator("[data-said]")).to_have_text("Undone.")
    assert lab.fake.scenarios[copied.id].phases == sample.phases


def test_a_drag_in_a_sample_makes_a_copy_and_moves_nothing_for_others(tab: Tab, lab: Lab) -> None:
    sample = lab.fake.add_scenario(bundled=True)
    page = opened(tab, f"/view/?scenario={sample.id}")
    target = (0.28, 0.21, 0.1)
    drag(page, "/contacts/5", target)
    page.wait_for_url(lambda url: "scenario=" in url and sample.id not in url)
    copied = lab.fake.scenarios[parse_qs(urlsplit(page.url).query)["scenario"][0]]
    moved = placed_contacts(copied)[4].contact.position_m
    assert math.dist(moved, target) < 0.01
    assert lab.fake.scenarios[sample.id] == sample


def test_planning_shows_its_progress_and_leads_to_the_plan(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    page.get_by_role("button", name="Plan").click()
    expect(page.get_by_role("progressbar")).to_be_visible()
    page.wait_for_url("**/view/?plan=*")
    page.wait_for_selector("[data-player][data-ready]", timeout=60_000)
    job_id = page.url.partition("plan=")[2].partition("&")[0]
    assert lab.fake.inputs[job_id] == {"scenario_id": scenario.id, "whole_body": True, "replay": True}
    expect(page.get_by_role("link", name="Scenario", exact=True)).to_have_attribute(
        "href", f"/view/?scenario={scenario.id}"
    )


def test_a_plan_can_be_cancelled_and_a_failure_says_why(tab: Tab, lab: Lab) -> None:
    scenario = lab.fake.add_scenario()
    page = opened(tab, f"/view/?scenario={scenario.id}")
    page.get_by_role("button", name="Plan").click()
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("alert")).to_have_text("Cancelled.")
    expect(page.get_by_role("button", name="Plan")).to_be_enabled()
    lab.fake.failing = Problem(
        title="Failed", status=422, code="whole-body-failed", detail="The whole body cannot follow the plan.",
        errors=[FaultItem(where="phases[3]", message="The knee is straight.")],
    )  # fmt: skip
    try:
        page.get_by_role("button", name="Plan").click()
        expect(page.get_by_role("alert")).to_have_text(
            "The whole body cannot follow the plan. phases[3]: The knee is straight."
        )
    finally:
        lab.fake.failing = None
