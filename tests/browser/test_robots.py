"""Robots in the browser: the list fills itself, maps are those of the service, and the viewer shows what is chosen."""

from collections.abc import Callable

import numpy as np
import pytest
from playwright.sync_api import Page, Route, expect

from stridelab.schemas.robots import RobotPreparation
from stridelab_web.scene.density_nodes import reach_places
from support.browser.page import Tab, nodes, opened, until
from support.fakes import reachability, robots
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

PARTS = ("cloud", "mode", "50", "80", "95")
SEEN = """(names) => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable;
    return names.filter((name) => {
        let on = false;
        viser.nodeRefFromName[name].traverse((part) => { on ||= part.layers.mask !== 0 });
        return on;
    });
}"""
"""Which nodes are drawn, or have something below them that is."""
HEATMAPS = """() => document.getElementById("maps").data.filter((t) => t.type === "heatmap").map((t) => t.z)"""
A_METRE = """() => {
    const { xaxis, yaxis, xaxis5, yaxis5 } = document.getElementById("maps")._fullLayout;
    return [xaxis, yaxis, xaxis5, yaxis5].map((axis) => axis._length / (axis.range[1] - axis.range[0]));
}"""


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab(900, 640)


def seen(page: Page) -> set[str]:
    """Parts of densities that are drawn."""
    names = [
        f"/reach/{measure}/{name}/{part}"
        for measure in reachability.MEASURES
        for name in reachability.EFFECTORS
        for part in PARTS
    ]
    result: list[str] = page.evaluate(SEEN, names)
    return {name.removeprefix("/reach/") for name in result}


def choose_one_of_several_descriptions(page: Page) -> None:
    """Upload a zip that is refused for its two descriptions, then with one of them."""
    sent: list[bytes] = []
    paths = ["small/hands.urdf", "small/plain.urdf"]
    errors = [{"where": path, "message": "one of several"} for path in paths]
    problem = {"title": "Unreadable", "detail": "Several.", "code": "robot-several-descriptions", "errors": errors}

    def refuse_upload(route: Route) -> None:
        if route.request.method != "POST":
            route.fallback()
            return
        sent.append(route.request.post_data_buffer or b"")
        route.fulfill(status=422, json=problem, content_type="application/problem+json")

    page.route("**/api/v1/robots", refuse_upload)
    page.get_by_label("File").set_input_files([{"name": "small.zip", "mimeType": "application/zip", "buffer": b"PK"}])
    page.get_by_label("Name").fill("small")
    expect(page.get_by_label("Description")).to_be_hidden()
    page.get_by_role("button", name="Upload").click()
    choice = page.get_by_label("Description")
    expect(choice).to_be_focused()
    assert choice.locator("option").all_inner_texts() == ["hands.urdf (small)", "plain.urdf (small)"]
    choice.select_option("small/plain.urdf")
    page.get_by_role("button", name="Upload").click()
    until(page, lambda: len(sent) == 2)
    assert b"description" not in sent[0]
    assert b"small/plain.urdf" in sent[1]
    page.unroute("**/api/v1/robots")


def choose_an_installed_robot(page: Page) -> None:
    """Upload a robot of an installed package in place of a file; its name is proposed."""
    sent: list[bytes] = []

    def refuse_upload(route: Route) -> None:
        if route.request.method != "POST":
            route.fallback()
            return
        sent.append(route.request.post_data_buffer or b"")
        problem = {"title": "Unreadable", "detail": "No soles.", "code": "robot-not-humanoid", "errors": []}
        route.fulfill(status=422, json=problem, content_type="application/problem+json")

    listed = {"items": [{"package": "arms-data", "version": "2.0", "descriptions": ["a/Two_Arms.urdf"]}], "next": None}
    page.route("**/api/v1/robots", refuse_upload)
    page.route("**/api/v1/robots/packages", lambda route: route.fulfill(json=listed))
    page.reload()
    page.get_by_label("or of an installed package").select_option("Two_Arms.urdf")
    expect(page.get_by_label("File", exact=True)).to_be_disabled()
    expect(page.get_by_label("Name")).to_have_value("two-arms")
    page.get_by_role("button", name="Upload").click()
    expect(page.get_by_text("No soles.")).to_be_visible()
    for part in (b'name="package"\r\n\r\narms-data', b'name="description"\r\n\r\na/Two_Arms.urdf'):
        assert part in sent[0]
    assert b'name="file"' not in sent[0]
    page.get_by_label("or of an installed package").select_option("none")
    expect(page.get_by_label("File", exact=True)).to_be_enabled()
    page.unroute("**/api/v1/robots")
    page.unroute("**/api/v1/robots/packages")


def test_the_list_asks_for_what_only_a_loaded_robot_tells(tab: Tab) -> None:
    page = tab.go("/robots")
    card = page.locator('[data-robot="boxes"]')
    expect(card.locator("[data-mass]")).to_have_text("60.0 kg")
    expect(card.locator("[data-height]")).to_have_text("0.880 m")
    expect(card.locator("[data-densities]")).to_have_text("uniform, conditioned")
    expect(page.locator('[data-robot="rare"]')).to_contain_text("The package <rare> is not installed.")
    expect(page.get_by_label("or of an installed package")).to_be_hidden()
    choose_one_of_several_descriptions(page)
    choose_an_installed_robot(page)
    page.get_by_role("link", name="Boxes", exact=True).click()
    expect(page.get_by_role("heading", name="Boxes", level=1)).to_be_visible()
    # the browser's own word on the refusal, which may arrive after the page has shown it
    tab.missteps = [m for m in tab.missteps if "status of 422" not in m]


def test_maps_are_those_of_the_service_and_a_metre_is_the_same_everywhere(tab: Tab) -> None:
    page = tab.go("/robots/boxes?measure=conditioned")
    page.wait_for_selector('#maps[data-ready="left_foot"]')
    result = reachability.reach("conditioned").effectors[0].projections
    expected = [values for each in result for values in (each.kernel_per_m2, each.mixture_per_m2)]
    drawn = page.evaluate(HEATMAPS)
    assert len(drawn) == 7, "six maps and the scale of their colours"
    assert np.allclose(drawn[:6], expected)
    lengths = page.evaluate(A_METRE)
    assert lengths == pytest.approx([abs(lengths[0])] * 4, rel=0.01)
    litres = [f"{4000 / 3 * radius**3:.0f}" for radius in reachability.RADII_M.values()]
    for effector in reachability.EFFECTORS:
        expect(page.locator(f'tr[data-effector="{effector}"] [data-volume]')).to_have_text(litres)
    page.get_by_label("Relative to").select_option("right_hand")
    page.wait_for_selector('#maps[data-ready="right_hand"]')
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")


def test_learning_anew_asks_for_what_was_chosen(tab: Tab, lab: Lab) -> None:
    page = tab.go("/robots/boxes")
    page.get_by_label("Postures per effector").fill("3000")
    page.get_by_label("Seed").fill("7")
    page.get_by_role("combobox", name="Measure").select_option("conditioned")
    page.get_by_role("button", name="Learn").click()
    page.wait_for_url("**/jobs/*")
    job_id = page.url.rpartition("/")[2]
    assert lab.fake.inputs[job_id] == {"robot": "boxes", "samples": 3000, "seed": 7, "measure": "conditioned"}
    page.wait_for_selector('#maps[data-ready="left_foot"]', timeout=30_000)


def test_one_effector_under_one_measure_is_shown(tab: Tab) -> None:
    page = opened(tab, "/view/?robot=boxes&measure=uniform&effector=right_foot")
    assert seen(page) == {f"uniform/right_foot/{part}" for part in ("mode", "50", "80", "95")}
    shown = nodes(page, "/reach/uniform/right_foot", "/robot/base_link")
    assert shown["/reach/uniform/right_foot"]["position"] == pytest.approx(reachability.POSES["right_foot"][:3])
    assert shown["/robot/base_link"]["position"] == pytest.approx(robots.REFERENCE[0][:3])
    page.get_by_label("Relative to").select_option("right_hand")
    page.get_by_label("Measure").select_option("conditioned")
    until(page, lambda: seen(page) == {f"conditioned/right_hand/{part}" for part in ("mode", "50", "80", "95")})
    expect(page.locator("[data-frame]")).to_contain_text("where the trunk faces")
    expect(page.locator('[data-volume="95"]')).to_have_text("11 l")


def test_every_part_has_a_key_and_the_address_remembers(tab: Tab) -> None:
    page = opened(tab, "/view/?robot=boxes")
    assert page.evaluate("() => document.documentElement.scrollHeight <= window.innerHeight")
    for key in ("e", "m", "c", "1", "3", "4", "r"):
        page.locator("body").press(key)
    expected = {f"conditioned/right_foot/{part}" for part in ("cloud", "80")}
    until(page, lambda: seen(page) == expected)
    assert page.evaluate(SEEN, ["/robot/base_link"]) == []
    expect(page.get_by_label("Robot r")).not_to_be_checked()
    page = opened(tab, page.url.removeprefix(tab.url))
    until(page, lambda: seen(page) == expected)


def test_a_robot_without_densities_stands_alone(tab: Tab, lab: Lab) -> None:
    lab.fake.measures = []
    try:
        page = opened(tab, "/view/?robot=boxes")
        expect(page.get_by_text("No densities have been learned for this robot yet")).to_be_visible()
        assert page.evaluate(SEEN, ["/robot/base_link"]) == ["/robot/base_link"]
    finally:
        lab.fake.measures = list(reachability.MEASURES)


def test_a_plan_shows_the_densities_of_the_present_phase(tab: Tab, lab: Lab) -> None:
    page = opened(tab, f"/view/?plan={lab.fake.add_plan().id}&t=1.5")
    places = reach_places(robots.scenario())
    names = [place.name for place in places]
    assert page.evaluate(SEEN, names) == []
    page.get_by_label("Reach, 80 %").check()
    now = [place.name for place in places if place.start_s <= 1.5 <= place.end_s]
    assert len(now) == 2
    until(page, lambda: page.evaluate(SEEN, names) == now)
    shown = nodes(page, *now)
    for place in places:
        if place.name in now:
            assert shown[place.name]["position"] == pytest.approx(place.contact.position_m)


def test_a_robot_that_is_being_prepared_tells_how_far_it_is_and_then_opens_by_itself(tab: Tab, lab: Lab) -> None:
    def tell(fraction: float, message: str) -> None:
        lab.fake.preparation = RobotPreparation(state="preparing", fraction=fraction, message=message)

    tell(0.1, "loading the robot")
    try:
        page = tab.go("/view/?robot=boxes&show=robot")
        bar = page.get_by_role("progressbar", name="Preparation of the robot")
        for fraction, message in ((0.1, "loading the robot"), (0.42, "thinning out its meshes"), (0.8, "enclosing")):
            tell(fraction, message)
            expect(page.get_by_role("status")).to_have_text(f"{100 * fraction:.0f} %: {message}")
            expect(bar).to_have_js_property("value", round(100 * fraction))
    finally:
        lab.fake.preparation = robots.READY
    page.wait_for_selector("[data-ready=true]", timeout=120_000)
    assert "robot=boxes&show=robot" in page.url, "the address stays"


def test_a_viewer_without_room_says_which_limit_is_met(tab: Tab) -> None:
    detail = "You have 16 3D views open in browsers. Close one of those tabs, then load this page again."
    problem = {"title": "Too Many Requests", "status": 429, "code": "scene-limit", "detail": detail}
    tab.page.route("**/open", lambda route: route.fulfill(status=429, json=problem))
    page = tab.go("/view/?robot=boxes")
    expect(page.locator("[data-veil]")).to_have_text(detail)
    expect(page.locator("iframe")).to_have_count(0)
    tab.missteps.clear()  # the browser logs the 429
