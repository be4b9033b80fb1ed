"""What opening a scene may cost without a clock: files, contexts, pictures (docs/viewer.md has the seconds)."""

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from support.browser.every_page import ROBOT
from support.browser.page import Tab, opened
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

NO_WEBGL = """(() => {
    const element = HTMLCanvasElement.prototype, { getContext } = element;
    element.getContext = function (kind, ...options) {
        return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...options);
    };
})()"""
"""A browser whose drawing in 3D is switched off."""
WATCHED = """(() => {
    const report = window.top.__report ??= { contexts: 0, probes: 0, shaders: [], pictures: [], draws: 0 };
    const offscreen = OffscreenCanvas.prototype, probe = offscreen.getContext;
    offscreen.getContext = function (kind, ...options) {
        if (kind.startsWith("webgl")) report.probes += 1;
        return probe.call(this, kind, ...options);
    };
    const all = WebGL2RenderingContext.prototype, element = HTMLCanvasElement.prototype;
    const { getContext } = element, { shaderSource } = all;
    element.getContext = function (kind, ...options) {
        if (kind.startsWith("webgl")) report.contexts += 1;
        return getContext.call(this, kind, ...options);
    };
    all.shaderSource = function (shader, text) {
        report.shaders.push(/#define SHADER_NAME (\\w+)/.exec(text)?.[1] ?? "");
        return shaderSource.call(this, shader, text);
    };
    for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
        const draw = all[name];
        all[name] = function (...how) {
            report.draws += 1;
            report.held ??= window.top.document.querySelector("[data-stage]").hasAttribute("data-held");
            return draw.apply(this, how);
        };
    }
})()"""
RENDERER = """(() => {
    const { getParameter } = WebGL2RenderingContext.prototype, { getContext } = HTMLCanvasElement.prototype;
    const UNMASKED_RENDERER = 0x9246;
    WebGL2RenderingContext.prototype.getParameter = function (name) {
        return name === UNMASKED_RENDERER ? "%s" : getParameter.call(this, name);
    };
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
        if (kind === "webgl2") window.__asked = options.antialias;
        return getContext.call(this, kind, options);
    };
})()"""
"""What draws, by its own name, and whether antialiasing was asked of it."""
MATERIALS = """() => {
    const types = new Set();
    const { scene } = document.querySelector("iframe").contentWindow.__viserMutable;
    scene.traverse(({ material }) => types.add(material?.type));
    return [...types];
}"""
VISER = """() => document.querySelector("iframe").contentWindow.performance.getEntriesByType("resource")
    .filter(({ name }) => name.includes("/static/viser/"))
    .map(({ name, transferSize }) => [name.split("/").at(-1), transferSize])"""
PAGES = ("plan", "recording", "scenario", "robot")


@pytest.fixture
def addresses(lab: Lab) -> dict[str, str]:
    fake = lab.fake
    return {
        "plan": f"/view/?plan={fake.add_plan().id}",
        "recording": f"/view/?recording={fake.add_recording().id}",
        "scenario": f"/view/?scenario={fake.add_scenario().id}",
        "robot": f"/view/?robot={ROBOT}",
    }


def watched(tab: Tab, address: str) -> tuple[Page, dict[str, Any]]:
    """A page whose scene is complete, and what it took until then."""
    tab.page.add_init_script(WATCHED)
    page = opened(tab, address)
    reports: dict[str, Any] = page.evaluate("() => ({ ...window.__report })")
    return page, reports


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize("kind", PAGES)
def test_nothing_is_drawn_before_the_scene_is_complete(tab: Tab, addresses: dict[str, str], kind: str) -> None:
    """Without a graphics card each picture costs a third of a second, and the image of a city a whole one."""
    page, reports = watched(tab, addresses[kind])
    assert reports["draws"] > 0
    assert reports["held"] is False
    assert reports["contexts"] == 1
    assert reports["probes"] == 1, "of one pixel, whether there is a graphics card"
    assert "GainMapDecoderMaterial" not in reports["shaders"]
    assert page.locator("[data-veil]").is_hidden()


@pytest.mark.parametrize(
    ("renderer", "antialias", "material"),
    [("SwiftShader driver", False, "MeshLambertMaterial"), ("Intel(R) Iris(R) Xe", True, "MeshStandardMaterial")],
)
def test_only_pictures_of_the_processor_are_simplified(
    tab: Tab, addresses: dict[str, str], renderer: str, antialias: bool, material: str
) -> None:
    tab.page.add_init_script(RENDERER % renderer)
    page = opened(tab, addresses["plan"])
    assert page.evaluate("() => document.querySelector('iframe').contentWindow.__asked") is antialias
    materials = set(page.evaluate(MATERIALS))
    assert material in materials
    assert materials.isdisjoint({"MeshLambertMaterial", "MeshStandardMaterial"} - {material})


def test_the_client_of_viser_is_fetched_once_for_all_scenes(tab: Tab, addresses: dict[str, str]) -> None:
    page = opened(tab, addresses["plan"])
    first = dict(page.evaluate(VISER))
    assert sorted(name.rpartition(".")[2] for name in first) == ["js"]
    assert 250_000 < sum(first.values()) < 320_000
    for kind in ("recording", "scenario", "plan"):
        again = dict(opened(tab, addresses[kind]).evaluate(VISER))
        assert again == dict.fromkeys(first, 0), "nothing of it crosses the network again"


def test_the_timeline_keeps_its_height_while_a_scene_loads(tab: Tab, addresses: dict[str, str]) -> None:
    """A stage of another size makes viser begin anew with its picture, and wait for what is being drawn."""
    tab.page.add_init_script(
        """document.addEventListener("DOMContentLoaded", () => {
            const stage = document.querySelector("[data-stage]"); // viser's page has none
            const note = ([{ contentRect }]) => (window.__heights ??= []).push(contentRect.height);
            if (stage) new ResizeObserver(note).observe(stage);
        })"""
    )
    page = opened(tab, addresses["plan"])
    assert len(page.evaluate("() => window.__heights")) == 1


@pytest.mark.parametrize("size", [(480, 360), (360, 640)])
def test_a_window_as_small_as_a_hand_shows_a_scene(
    open_tab: Callable[..., Tab], addresses: dict[str, str], size: tuple[int, int]
) -> None:
    page = opened(open_tab(*size), addresses["plan"])
    box = page.locator("[data-stage]").bounding_box()
    assert box is not None
    assert box["height"] >= 190
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")


@pytest.mark.parametrize("kind", PAGES)
def test_a_browser_that_cannot_draw_gets_the_reason(tab: Tab, addresses: dict[str, str], kind: str) -> None:
    """The veil over the scene says why it stays empty, in place of "preparing" without end."""
    tab.page.add_init_script(NO_WEBGL)
    veil = tab.go(addresses[kind]).locator("[data-veil]")
    expect(veil).to_contain_text("no WebGL 2", timeout=20_000)
    expect(veil).to_be_visible()
    assert all("WebGL" in misstep for misstep in tab.missteps), "the client says so on the console too"
    tab.missteps.clear()
