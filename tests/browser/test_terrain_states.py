"""The page of a terrain from a file on a fake interface: each of its states fits, is accessible and says what to do."""

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import FilePayload, Locator, Page, Route, expect

from support.browser.accessibility import faults_at_every_size
from support.browser.page import Tab
from support.browser.places import click_at_place
from support.fakes.terrains import RISE_M, TREADS

pytestmark = pytest.mark.usefixtures("lab")

ADDRESS = "/scenarios/new/file"
TOP_M = f"{TREADS * RISE_M:.2f}"


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Iterator[Tab]:
    """A tab in which the browser's own word on a refused request is no misstep."""
    made = open_tab()
    yield made
    made.missteps = [m for m in made.missteps if "Failed to load resource" not in m]


def choose_terrain_file(page: Page, name: str) -> Locator:
    """Choose a file of this name; returns the plan."""
    file: FilePayload = {"name": name, "mimeType": "application/octet-stream", "buffer": b"solid"}
    page.locator("input[type=file]").set_input_files(file)
    return page.locator("[data-plan-view]")


def test_every_state_fits_and_is_accessible(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    wrong = faults_at_every_size(page, "terrain-empty")
    plan = choose_terrain_file(page, "stairs.stl")
    expect(plan.locator("polygon.floor")).to_have_count(TREADS + 3)
    wrong |= faults_at_every_size(page, "terrain-found")
    click_at_place(page, 0.0, 0.0)
    click_at_place(page, 3.7, 0.1)
    expect(page.locator("[data-placed]")).to_have_text(f"Start point: 0.00 m high. Goal point: {TOP_M} m high.")
    wrong |= faults_at_every_size(page, "terrain-placed")
    page.get_by_label("Goal, x").fill("9")
    page.get_by_role("button", name="Place the feet only").click()
    expect(page.locator("[data-place-said]")).to_contain_text("move the goal")
    wrong |= faults_at_every_size(page, "terrain-not-crossed")
    choose_terrain_file(page, "a-wide-terrain-with-quite-a-long-name-of-its-file.stl")
    expect(page.locator("[data-offers] button")).to_have_count(2)
    wrong |= faults_at_every_size(page, "terrain-wrong-unit")
    choose_terrain_file(page, "wall.obj")
    expect(page.locator("[data-file-said]")).to_contain_text("another unit")
    wrong |= faults_at_every_size(page, "terrain-refused")
    assert wrong == {}


@pytest.mark.parametrize("language", ["de", "fr", "ja"])
def test_translations_fit_on_a_phone(open_tab: Callable[..., Tab], language: str) -> None:
    page = open_tab(390, 844).go(f"{ADDRESS}?language={language}")
    assert page.locator("html").get_attribute("lang") == language
    choose_terrain_file(page, "stairs.stl")
    expect(page.locator("[data-named] li")).to_have_count(2)
    assert "Stairs" not in page.locator("main").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") == 390


def test_surfaces_stairs_and_rails_are_named_and_coloured_by_height(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    plan = choose_terrain_file(page, "stairs.stl")
    expect(page.locator("[data-summary]")).to_have_text(f"14 surfaces, 0.00 to {TOP_M} m high.")
    expect(page.locator("[data-named] li").first).to_have_text(
        "Stairs 1: 8 treads, rise 17.0 cm, run 28.0 cm, 1.20 m wide"
    )
    expect(page.locator("[data-named] li").last).to_have_text("Rails: rail 1, rail 2")
    expect(page.locator("[data-lowest]")).to_have_text("0.00 m")
    expect(page.locator("[data-highest]")).to_have_text(f"{TOP_M} m")
    for text in ("Stairs 1", "rail 1", "rail 2"):
        expect(plan.locator("text.named", has_text=text)).to_have_count(1)
    expect(plan.locator("polygon.wall")).to_have_count(1)
    colours = plan.locator("polygon.floor").evaluate_all("(all) => all.map((one) => getComputedStyle(one).fill)")
    assert len(set(colours)) == TREADS + 2, "floor, ramp, treads; the landing is as high as the last tread"
    expect(page.locator("[data-remarks] li")).to_have_count(1)


def test_clicks_and_numbers_set_the_same_places(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    choose_terrain_file(page, "stairs.stl")
    click_at_place(page, -0.5, 0.2)
    expect(page.get_by_label("the goal", exact=True)).to_be_checked()
    assert float(page.get_by_label("Start, x").input_value()) == pytest.approx(-0.5, abs=0.02)
    assert float(page.get_by_label("Start, y").input_value()) == pytest.approx(0.2, abs=0.02)
    click_at_place(page, 2.0, -2.0)
    expect(page.locator("[data-placed]")).to_contain_text("There is no surface at")
    assert page.get_by_label("Goal, x").input_value() == ""
    page.get_by_label("Goal, x").fill("3.7")
    page.get_by_label("Goal, x").press("Tab")
    page.keyboard.type("0")
    expect(page.locator("[data-placed]")).to_contain_text(f"Goal point: {TOP_M} m high.")
    expect(page.locator("[data-plan-view] circle.goal")).to_have_count(1)
    page.set_viewport_size({"width": 390, "height": 844})
    click_at_place(page, 3.5, -0.1)
    assert float(page.get_by_label("Goal, x").input_value()) == pytest.approx(3.5, abs=0.03)


def test_what_is_missing_is_named_before_anything_is_sent(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url))
    problem = page.locator("[data-plan-said]")
    plan = page.get_by_role("button", name="Plan the motion")
    plan.click()
    expect(problem).to_have_text("Choose a file with a terrain first.")
    choose_terrain_file(page, "stairs.stl")
    expect(page.locator("[data-found]")).to_be_visible()
    plan.click()
    expect(problem).to_have_text("Choose the start first.")
    page.get_by_label("Start, x").fill("0")
    page.get_by_label("Start, y").fill("0")
    plan.click()
    expect(problem).to_have_text("Choose the goal first.")
    page.get_by_label("Goal, x").fill("3.7")
    page.get_by_label("Goal, y").fill("0")
    page.get_by_label("Friction").fill("3")
    plan.click()
    expect(problem).to_have_text("Friction: a number from 0.05 to 2.")
    assert not [url for url in sent if "crossing" in url or "/jobs" in url]


def test_the_unit_that_fits_is_offered_and_used(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    choose_terrain_file(page, "wide.stl")
    expect(page.locator("[data-file-said]")).to_have_text("wide.stl: The size of this terrain does not fit its unit.")
    page.get_by_role("button", name="Read it in millimetres: 4.0 m wide").click()
    expect(page.locator("[data-found]")).to_be_visible()
    expect(page.get_by_label("Unit of the file")).to_have_value("mm")
    expect(page.locator("[data-offers] button")).to_have_count(0)


def test_the_other_axis_is_offered_where_nothing_can_be_stood_on(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    choose_terrain_file(page, "wall.obj")
    with page.expect_request("**/api/v1/terrains"):
        page.get_by_role("button", name="Read it with y up").click()
    expect(page.get_by_label("Axis that points up")).to_have_value("+y")
    expect(page.get_by_role("button", name="Read it with z up")).to_be_visible()


def test_a_file_that_is_chosen_before_the_script_has_come_is_read(tab: Tab) -> None:
    waiting: list[Route] = []
    tab.page.route("**/terrain/terrain_file.js", lambda route: waiting.append(route))
    tab.page.goto(f"{tab.url}{ADDRESS}", wait_until="commit")
    plan = choose_terrain_file(tab.page, "stairs.stl")
    waiting[0].continue_()
    expect(plan.locator("polygon.floor")).to_have_count(TREADS + 3)


def test_a_dropped_file_is_read(tab: Tab) -> None:
    page = tab.go(ADDRESS)
    page.evaluate(
        """() => {
            const dataTransfer = new DataTransfer();
            dataTransfer.items.add(new File(["solid"], "stairs.stl"));
            document.querySelector("[data-drop]").dispatchEvent(new DragEvent("drop", { dataTransfer }));
        }"""
    )
    expect(page.locator("[data-file-said]")).to_have_text("stairs.stl")
    expect(page.locator("[data-plan-view] polygon.floor")).to_have_count(TREADS + 3)
    expect(page.get_by_label("Name")).to_have_value("stairs")
