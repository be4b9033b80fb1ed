"""Films of the scene, and links that show what was seen."""

import base64
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from support.browser.page import Mouse, Tab, opened, until
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab", "drawn")

VIDEO = """async (data) => {
    const video = document.createElement("video");
    video.src = `data:video/webm;base64,${data}`;
    document.body.append(video);
    await new Promise((done, fail) => {
        video.onloadeddata = done;
        video.onerror = () => fail(video.error.message);
    });
    const canvas = new OffscreenCanvas(video.videoWidth, video.videoHeight), context = canvas.getContext("2d");
    const times_s = [];
    const at = async (t_s) => { // "seeked" alone may come before the picture at this time is presented
        const presented = new Promise((done) => {
            video.requestVideoFrameCallback((_, { mediaTime }) => done(mediaTime));
        });
        video.currentTime = t_s;
        await new Promise((done) => { video.onseeked = done; });
        times_s.push(await presented);
        context.drawImage(video, 0, 0);
        return context.getImageData(0, 0, canvas.width, canvas.height).data;
    };
    const first = await at(0.05), later = await at(0.75);
    const mean = first.reduce((sum, value) => sum + value, 0) / first.length;
    const spread = Math.sqrt(first.reduce((sum, value) => sum + (value - mean) ** 2, 0) / first.length);
    const change = first.reduce((most, value, k) => Math.max(most, Math.abs(value - later[k])), 0);
    return { duration_s: video.duration, width: video.videoWidth, height: video.videoHeight, spread, change, times_s };
}"""
"""Two pictures of a film, compared where they are: as text, their numbers would take seconds to reach the test."""
CAMERA = """() => {
    const { camera, cameraControl } = document.querySelector("iframe").contentWindow.__viserMutable;
    const at = camera.position.clone();
    return [...cameraControl.getPosition(at.clone()).toArray(), ...cameraControl.getTarget(at.clone()).toArray()];
}"""
TURN = """() => {
    const { cameraControl } = document.querySelector("iframe").contentWindow.__viserMutable;
    cameraControl.rotate(0.4, -0.1, false);
}"""


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab(900, 560)


def film(page: Page, folder: Path, **fields: str) -> Path:
    """The film of the dialog with these fields: two clicks, if none is changed."""
    mouse = Mouse(at_most=2)
    mouse.click(page.get_by_role("button", name="Film…"))
    dialog = page.get_by_role("dialog", name="Film of the scene")
    for name, value in fields.items():
        field = dialog.locator(f"[name={name}]")
        field.fill(value) if name in ("from", "to") else field.select_option(value)
    with page.expect_download(timeout=90_000) as saved:
        mouse.click(dialog.get_by_role("button", name="Save film"))
    path = folder / saved.value.suggested_filename
    saved.value.save_as(path)
    expect(dialog).to_be_hidden()
    return path


@pytest.mark.timeout(240)
def test_a_film_is_two_clicks_and_plays_in_its_own_time(tab: Tab, lab: Lab, chromium: Browser, tmp_path: Path) -> None:
    """The played range of one second at 25 pictures per second, in the size of the page."""
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&from=2&to=3")
    width, height = page.evaluate(
        "() => { const { canvas } = document.querySelector('iframe').contentWindow.__viserMutable;"
        " return [canvas.clientWidth, canvas.clientHeight]; }"
    )
    path = film(page, tmp_path)
    assert path.name == "Two steps.webm"
    player = chromium.new_page()
    try:
        seen = player.evaluate(VIDEO, base64.b64encode(path.read_bytes()).decode())
    finally:
        player.close()
    assert seen["duration_s"] == pytest.approx(26 / 25)
    assert abs(seen["width"] - width) <= 1
    assert abs(seen["height"] - height) <= 1
    assert seen["spread"] > 5, "the pictures are not empty"
    assert seen["times_s"] == pytest.approx([0.04, 0.72], abs=0.05), "the pictures that were compared"
    assert seen["change"] > 50, f"and the robot moves: {seen}"


@pytest.mark.timeout(240)
def test_a_gif_has_the_chosen_range_speed_and_size(tab: Tab, lab: Lab, tmp_path: Path) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=1")
    fields = {"format": "gif", "size": "0.5", "rate": "10", "from": "2", "to": "2.5", "speed": "0.5"}
    path = film(page, tmp_path, **fields)
    expect(page.locator("[data-time]")).to_contain_text("s · frame")
    with Image.open(path) as gif:
        assert getattr(gif, "n_frames", 1) == 11, "half a second at half speed"
        assert gif.info["duration"] == 100
        pictures = []
        for k in (0, 10):
            gif.seek(k)
            pictures.append(np.asarray(gif.convert("RGB"), dtype=float))
    assert np.abs(pictures[0] - pictures[1]).max() > 50
    corner = pictures[0][0, 0]
    assert np.abs(corner - 255).max() <= 8, "the background is that of the page"


def test_a_film_can_be_stopped(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=1")
    page.get_by_role("button", name="Film…").click()
    dialog = page.get_by_role("dialog", name="Film of the scene")
    dialog.get_by_role("button", name="Save film").click()
    expect(dialog.get_by_role("progressbar")).to_be_visible()
    dialog.get_by_role("button", name="Close").click()
    expect(dialog).to_be_hidden()
    slider = page.get_by_role("slider", name="Time")
    slider.fill("100")
    expect(slider).to_have_value("100")


def test_a_link_shows_what_was_seen_after_one_click(tab: Tab, open_tab: Callable[..., Tab], lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    before = page.evaluate(CAMERA)
    page.evaluate(TURN)
    until(page, lambda: bool(np.abs(np.subtract(page.evaluate(CAMERA), before)).max() > 0.1))
    page.get_by_label("Forces", exact=True).uncheck()
    page.get_by_label("Cones").check()
    page.get_by_role("slider", name="Time").fill("150")
    Mouse(at_most=1).click(page.get_by_role("button", name="Copy link"))
    expect(page.locator("[data-said-link]")).to_have_text("Copied.")
    link = page.evaluate("() => navigator.clipboard.readText()")
    seen = page.evaluate(CAMERA)

    other = opened(open_tab(900, 560), link.removeprefix(tab.url))
    assert np.abs(np.subtract(other.evaluate(CAMERA), seen)).max() < 0.005
    expect(other.get_by_label("Forces", exact=True)).not_to_be_checked()
    expect(other.get_by_label("Cones")).to_be_checked()
    expect(other.get_by_role("slider", name="Time")).to_have_value("150")
