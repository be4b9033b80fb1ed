"""Comfortable in a dark room, with less motion, and on screens from 800 to 3840 pixels."""

import itertools

import pytest
from playwright.sync_api import Page, expect

from support.browser.page import TWO_PICTURES, Tab, opened, until
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

BACKGROUND = "() => getComputedStyle(document.body).backgroundColor"
PAPER = "() => document.getElementById('plots')._fullLayout.paper_bgcolor"
SCENE_BACKGROUND = """() => {
    const { canvas } = document.querySelector("iframe").contentWindow.__viserMutable;
    let node = canvas;
    const colour = () => canvas.ownerDocument.defaultView.getComputedStyle(node).backgroundColor;
    while (colour() === "rgba(0, 0, 0, 0)") node = node.parentElement;
    return colour();
}"""
PATH_COLOUR = """() => {
    const node = document.querySelector("iframe").contentWindow.__viserMutable.nodeRefFromName["/paths/com"];
    return `#${node.children.find((part) => part.isMesh).material.color.getHexString()}`;
}"""
TERRAIN_COLOURS = """() => {
    const { nodeRefFromName } = document.querySelector("iframe").contentWindow.__viserMutable;
    const named = Object.entries(nodeRefFromName).filter(([name, node]) => node && name.startsWith("/terrain/"));
    const meshes = named.flatMap(([, node]) => node.children.filter((part) => part.isMesh && part.material.color));
    return meshes.map((mesh) => `#${mesh.material.color.getHexString()}`);
}"""
RUNNING = "() => document.getAnimations().filter((one) => one.playState === 'running').length"


def lightness(css: str) -> float:
    """Of ``rgb(r, g, b)`` or ``#rrggbb``, from 0 (black) to 1."""
    if css.startswith("#"):
        digits = css[1:] if len(css) == 7 else "".join(2 * letter for letter in css[1:])
        parts = [int(digits[k : k + 2], 16) for k in (0, 2, 4)]
    else:
        parts = [int(part) for part in css.partition("(")[2].rstrip(")").split(",")[:3]]
    return sum(parts) / 765


def test_plots_and_drawings_follow_the_room_and_keep_their_place(tab: Tab, addresses: dict[str, str]) -> None:
    page = tab.go(addresses["plan"])
    page.wait_for_selector("#plots[data-ready]")
    page.get_by_role("slider", name="Cursor").fill("40")
    page.evaluate("() => Plotly.relayout('plots', { 'xaxis.range': [0.2, 0.9] })")
    read = page.locator("#readout").inner_text()
    assert min(lightness(page.evaluate(BACKGROUND)), lightness(page.evaluate(PAPER))) > 0.9
    light = page.evaluate(PAPER)
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"(before) => ({PAPER})() !== before", arg=light)
    assert max(lightness(page.evaluate(BACKGROUND)), lightness(page.evaluate(PAPER))) < 0.2
    assert page.locator("#readout").inner_text() == read
    assert page.evaluate("() => document.getElementById('plots').layout.xaxis.range") == [0.2, 0.9]
    page = tab.go(addresses["scenario"])
    box = page.locator(".drawing .box").first
    assert lightness(box.evaluate("(box) => getComputedStyle(box).fill")) < 0.35
    page.emulate_media(color_scheme="light")
    assert lightness(box.evaluate("(box) => getComputedStyle(box).fill")) > 0.8


def test_the_scene_follows_the_room_and_its_lines_stay_seen(tab: Tab, addresses: dict[str, str]) -> None:
    page = opened(tab, addresses["view-plan"])
    assert lightness(page.evaluate(SCENE_BACKGROUND)) > 0.9
    light = lightness(page.evaluate(PATH_COLOUR))
    assert light < 0.3
    by_day = page.evaluate(TERRAIN_COLOURS)
    assert max(map(lightness, by_day)) > 0.9
    page.emulate_media(color_scheme="dark")
    until(page, lambda: lightness(page.evaluate(SCENE_BACKGROUND)) < 0.2)
    assert lightness(page.evaluate(PATH_COLOUR)) > 0.5
    by_night = [lightness(colour) for colour in page.evaluate(TERRAIN_COLOURS)]
    assert len(by_night) == len(by_day)
    assert min(by_night) > 0.1, "a surface is seen before the background"
    assert max(by_night) < 0.55, "the terrain glares"
    page.emulate_media(color_scheme="light")
    until(page, lambda: lightness(page.evaluate(SCENE_BACKGROUND)) > 0.9)
    assert lightness(page.evaluate(PATH_COLOUR)) == light
    assert page.evaluate(TERRAIN_COLOURS) == by_day
    page.emulate_media(color_scheme="dark")
    page = opened(tab, addresses["view-scenario"])
    assert lightness(page.evaluate(SCENE_BACKGROUND)) < 0.2
    assert lightness(page.evaluate(PATH_COLOUR.replace("/paths/com", "/live/planned"))) > 0.5
    assert lightness(page.evaluate(PATH_COLOUR.replace("/paths/com", "/support/region"))) < 0.5, "it keeps its colour"
    assert max(map(lightness, page.evaluate(TERRAIN_COLOURS))) < 0.55


def test_nothing_moves_by_itself_for_who_wants_less_motion(tab: Tab, addresses: dict[str, str]) -> None:
    for part in ("frames.bin", "open"):
        tab.page.route(f"**/{part}", lambda _: None)  # never answered: the page waits, as for a large scene
    tab.page.emulate_media(reduced_motion="reduce")
    page = tab.go(addresses["view-plan"])
    expect(page.get_by_text("Loading the scene")).to_be_visible()
    assert page.evaluate(RUNNING) == 0
    page.emulate_media(reduced_motion="no-preference")
    page.wait_for_function(f"() => ({RUNNING})() > 0")
    page.unroute_all(behavior="ignoreErrors")


@pytest.mark.parametrize("name", ["home", "recording", "subjects", "scenario", "jobs", "settings", "reproduction"])
def test_every_width_is_used_and_no_line_is_too_long(tab: Tab, addresses: dict[str, str], name: str) -> None:
    page = tab.go(addresses[name])
    for width, height in ((800, 600), (1920, 1080), (2560, 1440), (3840, 2160)):
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate(TWO_PICTURES)
        used, letters_px = _measures(page)
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, name
        assert used > 0.6, f"{name} is an island of {used:.0%}"
        assert letters_px >= width / 175, f"{name} has letters of {letters_px} pixels"
        for text in page.locator("main :is(.lead, .said, section > p)").all():
            wide = text.evaluate("(p) => p.getBoundingClientRect().width / parseFloat(getComputedStyle(p).fontSize)")
            inside = text.evaluate("(p) => p.textContent.trim().length")
            assert min(2 * wide, inside) < 140, f"{name} has a line of {2 * wide:.0f} letters"


def _measures(page: Page) -> tuple[float, float]:
    used, letters_px = page.evaluate(
        "() => [document.querySelector('main').getBoundingClientRect().width / innerWidth,"
        " parseFloat(getComputedStyle(document.body).fontSize)]"
    )
    return used, letters_px


LABELS = """() => [...document.querySelectorAll(".strip .axis text")].map((text) => text.getBoundingClientRect())
    .filter(({ width }) => width > 0).map(({ left, right }) => [left, right]).sort(([a], [b]) => a - b)"""


@pytest.mark.parametrize("width", [390, 800, 1400])
def test_the_times_below_a_strip_do_not_overlap(tab: Tab, lab: Lab, width: int) -> None:
    recording = lab.fake.add_recording("usual.c3d", duration_s=1.56)  # a mark every 0.2 s
    tab.page.set_viewport_size({"width": width, "height": 844})
    page = tab.go(f"/recordings/{recording.id}")
    labels = page.evaluate(LABELS)
    assert len(labels) > 2
    assert all(right < left for (_, right), (left, _) in itertools.pairwise(labels)), labels


def test_the_name_of_a_chosen_file_is_not_cut(tab: Tab, addresses: dict[str, str]) -> None:
    """Browsers cut it in the middle, in German and Japanese too."""
    for name, size in (("robots", 1400), ("population-new", 1400), ("robots", 390), ("population-new", 390)):
        tab.page.set_viewport_size({"width": size, "height": 844})
        page = tab.go(addresses[name])
        for field in page.locator("input[type=file]:visible").all():
            box = field.bounding_box()
            assert box is not None
            assert box["width"] >= 280, name
