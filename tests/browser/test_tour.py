"""The tour of the home page: four steps at the first visit, which can be left, and comes again only when asked."""

import pytest
from playwright.sync_api import expect

from support.browser.page import Tab

pytestmark = pytest.mark.usefixtures("lab")


def test_the_tour_has_four_steps_and_comes_once(tab: Tab) -> None:
    page = tab.go("/")
    card = page.get_by_role("region", name="Tour")
    seen = []
    for k in range(4):
        expect(card).to_contain_text(f"{k + 1} of 4")
        seen.append(page.locator(".shown-by-tour").get_attribute("data-tour"))
        card.get_by_role("button", name="Next" if k < 3 else "Done").click()
    assert seen == ["sample", "upload", "robots", "help"]
    expect(card).to_have_count(0)
    expect(page.locator(".shown-by-tour")).to_have_count(0)
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    expect(card).to_have_count(0)
    page.get_by_role("link", name="Help").click()
    page.get_by_role("link", name="Tour of four steps").click()
    expect(card).to_contain_text("1 of 4")


def test_the_tour_is_left_at_any_step(tab: Tab) -> None:
    page = tab.go("/")
    card = page.get_by_role("region", name="Tour")
    card.get_by_role("button", name="Next").click()
    card.get_by_role("button", name="Leave the tour").click()
    expect(card).to_have_count(0)
    page.reload()
    expect(card).to_have_count(0)


def test_on_a_phone_the_card_hides_neither_the_heading_nor_what_it_points_to(tab: Tab) -> None:
    tab.page.set_viewport_size({"width": 390, "height": 844})
    page = tab.go("/")
    card = page.get_by_role("region", name="Tour")
    expect(card).to_contain_text("1 of 4")
    for k in range(4):
        if k:
            card.get_by_role("button", name="Next").click()
        boxes = [node.bounding_box() for node in (card, page.locator(".shown-by-tour"), page.locator("h1"))]
        hiding, marked, heading = (box or {"y": -1.0, "height": 0.0} for box in boxes)
        for part in (marked, heading):
            assert part["y"] + part["height"] <= hiding["y"] or part["y"] >= hiding["y"] + hiding["height"]
