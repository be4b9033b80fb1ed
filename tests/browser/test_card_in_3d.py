"""The card of one's own robot is corrected in its 3D view: links and marks are clicked, corners of soles dragged."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from support.browser.page import ON_SCREEN, Tab, opened, until
from support.fakes import robots
from support.fakes.own_card import own_robot
from support.fakes.web_app import Lab


@pytest.fixture
def page(lab: Lab, open_tab: Callable[..., Tab]) -> Iterator[Page]:
    """The 3D view of the robot of boxes, which is the user's own."""
    lab.fake.card.own = own_robot()
    try:
        page = opened(open_tab(1100, 760), "/view/?robot=boxes&show=robot")
        expect(page.locator("[data-contact]")).to_have_count(3)
        yield page
    finally:
        lab.fake.card.own = None


def middle_px(target: Locator) -> tuple[float, float]:
    """Middle of a mark in the page; 0 of one that is drawn anew at this moment."""
    x, y = target.evaluate("""(mark) => {
        const { left, top, width, height } = mark.getBoundingClientRect();
        return [left + width / 2, top + height / 2];
    }""")
    return x, y


def click_link(page: Page, link: str) -> tuple[float, float]:
    x, y = page.evaluate(ON_SCREEN, f"/robot/{link}")
    page.mouse.click(x, y)
    expect(page.locator("[data-link]")).to_have_text(link)
    return x, y


def saved_card(page: Page, lab: Lab) -> dict[str, Any]:
    """Effectors of the card that the page stores."""
    with page.expect_navigation():
        page.get_by_role("button", name="Save the card").click()
    assert lab.fake.card.own is not None
    effectors: dict[str, Any] = lab.fake.card.own.card["effectors"]
    return effectors


def test_a_dragged_corner_changes_the_sole_and_leaves_the_opposite_one(page: Page, lab: Lab) -> None:
    page.locator('[data-contact="right_foot"]').click()
    expect(page.locator('[name="contact"]')).to_have_value("right_foot")
    corners = [page.locator(f'[data-corner="{k}"]') for k in range(4)]
    until(page, lambda: all(corner.is_visible() for corner in corners))
    (x, y), opposite = middle_px(corners[0]), middle_px(corners[2])
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y + 12, steps=4)
    page.mouse.up()
    until(page, lambda: middle_px(corners[0]) == pytest.approx((x + 30, y + 12), abs=2.0))
    until(page, lambda: middle_px(corners[2]) == pytest.approx(opposite, abs=2.0))
    foot = saved_card(page, lab)["right_foot"]
    half, place = foot["contact_half_size_m"], foot["position_m"]
    assert half != pytest.approx(robots.HALF_M, abs=0.005)
    assert [place[i] - half[i] for i in (0, 1)] == pytest.approx([-each for each in robots.HALF_M], abs=2e-4)
    assert place[2] == pytest.approx(-0.05)
    assert foot["frame"] == "leg_right_6_link"


def test_a_clicked_link_becomes_a_hand_where_it_was_clicked(page: Page, lab: Lab) -> None:
    x, y = click_link(page, "base_link")
    expect(page.locator('[name="clicked"]')).to_have_value("")
    page.locator('[name="clicked"]').select_option("left_hand")
    mark = page.locator('[data-contact="left_hand"]')
    until(page, lambda: mark.is_visible() and middle_px(mark) == pytest.approx((x, y), abs=2.0))
    hand = saved_card(page, lab)["left_hand"]
    assert (hand["frame"], hand["kind"]) == ("base_link", "point")
    assert max(map(abs, hand["position_m"])) > 0.01, "the surface that was clicked, not the origin"


def test_the_link_of_a_hand_is_no_contact_and_that_of_a_foot_must_be_one(page: Page, lab: Lab) -> None:
    click_link(page, "leg_left_6_link")
    expect(page.locator('[name="contact"]')).to_have_value("left_foot")
    page.locator('[name="clicked"]').select_option("")
    expect(page.locator("[data-said]")).to_contain_text("walks on two soles")
    expect(page.get_by_role("button", name="Save the card")).to_be_disabled()
    click_link(page, "arm_right_7_link")
    expect(page.locator('[name="clicked"]')).to_have_value("right_hand")
    page.locator('[name="clicked"]').select_option("")
    expect(page.locator('[data-contact="right_hand"]')).to_have_count(0)
    assert set(saved_card(page, lab)) == {"left_foot", "right_foot"}


def test_another_link_keeps_the_place_of_a_sole_and_numbers_change_it(page: Page, lab: Lab) -> None:
    mark = page.locator('[data-contact="left_foot"]')
    before = middle_px(mark)
    page.get_by_role("combobox", name="Link").select_option("base_link")
    expect(page.get_by_role("button", name="Save the card")).to_be_enabled()
    until(page, lambda: middle_px(mark) == pytest.approx(before, abs=2.0))
    page.get_by_label("Half width (m)").fill("0.04")
    page.get_by_label("Half width (m)").press("Tab")
    foot = saved_card(page, lab)["left_foot"]
    assert foot["frame"] == "base_link"
    assert foot["position_m"] == pytest.approx([0.0, 0.09, -0.9], abs=1e-4)
    assert foot["contact_half_size_m"] == pytest.approx([0.1, 0.04])


def test_an_implausible_torque_is_kept_until_its_estimate_is_chosen(lab: Lab, open_tab: Callable[..., Tab]) -> None:
    lab.fake.card.own = own_robot()
    try:
        page = open_tab(900, 640).go("/robots/boxes")
        expect(page.get_by_text("Stated torques that are implausible: 1.")).to_be_visible()
        row = page.locator("[data-fields] tr", has=page.get_by_role("button", name="Use the estimate, 90"))
        expect(row.locator("input")).to_have_value("40")
        page.get_by_role("button", name="Use all estimates").click()
        last = page.locator("[data-fields] tr").last
        expect(last.locator("input")).to_have_value("90")
        expect(last).to_contain_text("assumed")
        with page.expect_navigation():
            page.get_by_role("button", name="Save the card").click()
        assert lab.fake.card.own.card["limits"]["torque_nm"] == {"knee": 90}
        page.get_by_text("Version 2 of the card").click()
        with page.expect_navigation():
            page.get_by_role("button", name="Take it back").click()
        assert lab.fake.card.own.card["limits"]["torque_nm"] == {"knee": 40}
        assert lab.fake.card.own.version == 3
    finally:
        lab.fake.card.own = None
