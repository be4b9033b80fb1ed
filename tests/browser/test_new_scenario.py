"""A scenario from nothing on the real service: obstacles in a row, drawn while they change, then feet and hands."""

import pytest
from playwright.sync_api import expect

from support.browser.page import Service, Tab

PLANNED_WITHIN_MS = 120_000


@pytest.mark.timeout(300)
def test_stairs_with_a_rail_become_a_scenario(tab: Tab, service: Service) -> None:
    """Six clicks: the page, the robot, the rail, one more obstacle, its height, and the feet."""
    page = tab.go("/scenarios")
    page.get_by_role("link", name="New scenario").click()
    drawn = page.locator("[data-pictures] svg")
    expect(drawn).to_have_count(2)
    boxes = drawn.first.locator("polygon.box")
    expect(boxes).to_have_count(6)
    page.locator("select[name=robot]").select_option("talos")
    page.locator("select[name=handrails]").select_option("right")
    expect(drawn.first.locator("polygon.rail")).to_have_count(3)
    page.get_by_role("button", name="Add: Level ground").click()
    expect(boxes).to_have_count(7)
    page.get_by_label("Rise in cm of Stairs, obstacle 1").fill("12")
    page.get_by_role("button", name="Place the feet only").click()
    page.wait_for_url("**/view/?scenario=*", timeout=PLANNED_WITHIN_MS)
    stored = service.client.scenario(page.url.rpartition("=")[2])
    heights = {c.effector: c.position_m[2] for c in stored.phases[-1].contacts}
    assert heights["left_foot"] == heights["right_foot"] == pytest.approx(4 * 0.12)
    assert "right_hand" in heights


def test_numbers_outside_their_range_are_named_and_nothing_starts(tab: Tab, service: Service) -> None:
    page = tab.go("/scenarios/new")
    expect(page.locator("[data-pictures] svg")).to_have_count(2)
    before = len(service.client.jobs(kind="plan-contacts").items)
    page.get_by_label("Depth in cm of Stairs, obstacle 1").fill("1")
    reason = "Depth in cm of Stairs, obstacle 1: a number from 5 to 200."
    expect(page.locator("[data-course-said]")).to_have_text(reason)
    page.get_by_role("button", name="Plan the motion").click()
    expect(page.locator("[data-plan-said]")).to_have_text(reason)
    page.get_by_label("Depth in cm of Stairs, obstacle 1").fill("30")
    page.get_by_label("Stairs of Stairs, obstacle 1").fill("2.5")
    expect(page.locator("[data-course-said]")).to_have_text(
        "Stairs of Stairs, obstacle 1: a whole number from 1 to 40."
    )
    page.get_by_role("button", name="Remove: Stairs, obstacle 1").click()
    expect(page.locator("[data-course-said]")).to_have_text("Add an obstacle.")
    assert len(service.client.jobs(kind="plan-contacts").items) == before


def test_measured_numbers_are_taken_as_they_are(tab: Tab, service: Service) -> None:
    """17.3 cm is no multiple of the step of the arrow keys; neither is the friction of a report."""
    page = tab.go("/scenarios/new")
    expect(page.locator("[data-pictures] svg")).to_have_count(2)
    page.get_by_label("Rise in cm of Stairs, obstacle 1").fill("17.3")
    with page.expect_response("**/scenarios/new/pictures?*") as drawn:
        page.get_by_label("Friction").fill("0.33")
    assert drawn.value.ok
    page.get_by_label("Friction").press("Enter")
    page.reload()
    expect(page.get_by_label("Rise in cm of Stairs, obstacle 1")).to_have_value("17.3")
    with page.expect_response("**/scenarios/new/pictures?*") as drawn:
        page.get_by_role("button", name="Add: Gap").click()
    assert drawn.value.ok
    expect(page.locator("[data-course-said]")).to_have_text("")


def test_too_many_obstacles_are_counted(tab: Tab, service: Service) -> None:
    page = tab.go("/scenarios/new")
    expect(page.locator("[data-pictures] svg")).to_have_count(2)
    for _ in range(20):
        page.get_by_role("button", name="Add: Gap").click()
    expect(page.locator("[data-course-said]")).to_have_text("A course has at most 20 obstacles.")


def test_an_obstacle_is_dragged_by_its_handle_and_everything_is_undone(tab: Tab, service: Service) -> None:
    page = tab.go("/scenarios/new")
    rise = page.get_by_label("Rise in cm of Stairs, obstacle 1")
    depth = page.get_by_label("Depth in cm of Stairs, obstacle 1")
    handle = page.locator("[data-handle='0']")
    box = handle.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y - 20, steps=4)
    expect(rise).not_to_have_value("10")
    page.mouse.up()
    dragged = rise.input_value(), depth.input_value()
    assert float(dragged[0]) > 10
    assert float(dragged[1]) > 30
    page.wait_for_function(f"() => document.querySelector('[data-handle]').getBoundingClientRect().x != {box['x']}")

    page.locator("select[name=robot]").select_option("hrp2")
    page.get_by_role("button", name="Add: Box").click()
    expect(page.get_by_label("Height in cm of Box, obstacle 2")).to_have_value("10")
    page.reload()
    expect(page.get_by_label("Height in cm of Box, obstacle 2")).to_have_value("10")
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_label("Height in cm of Box, obstacle 2")).to_have_count(0)
    page.get_by_role("button", name="Undo").click()
    expect(page.locator("select[name=robot]")).to_have_value("talos")
    page.keyboard.press("Control+z")
    expect(rise).to_have_value("10")
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()
    page.get_by_role("button", name="Redo").click()
    expect(rise).to_have_value(dragged[0])
    expect(depth).to_have_value(dragged[1])


def test_flights_of_building_codes_are_offered_and_a_ladder_is_refused(tab: Tab) -> None:
    page = tab.go("/scenarios/new")
    drawn = page.locator("[data-pictures] svg").first
    expect(drawn.locator("polygon.box")).to_have_count(6)
    preset = page.get_by_label("Start from")
    preset.select_option("Stairs of a house, 17 × 28 cm")
    expect(page.locator("select[name=handrails]")).to_have_value("left right")
    expect(page.get_by_label("Rise in cm of Stairs, obstacle 1")).to_have_value("17")
    expect(drawn.locator("polygon.box")).to_have_count(7)
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_label("Rise in cm of Stairs, obstacle 1")).to_have_value("10")
    preset.select_option("Steep as a ladder, 25 × 20 cm")
    page.get_by_role("button", name="Plan the motion").click()
    refused = page.locator("[data-plan-said]")
    expect(refused).to_contain_text("There is no way to the goal", timeout=PLANNED_WITHIN_MS)
    expect(refused).to_contain_text("0.066 m farther up")
