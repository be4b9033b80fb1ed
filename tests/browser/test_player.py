"""The player of the viewer: a range that is played again and again, views, following, pictures."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, Route, expect

from support.browser.page import Tab, opened, until
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

CAMERA = """() => {
    const { camera, cameraControl, nodeRefFromName } = document.querySelector("iframe").contentWindow.__viserMutable;
    const root = nodeRefFromName[""], at = camera.position.clone();
    const target = root.worldToLocal(cameraControl.getTarget(at.clone())).toArray();
    return { at: root.worldToLocal(cameraControl.getPosition(at.clone())).toArray(), target };
}"""
"""Where the camera is and looks at, in the world of the scene."""


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab(900, 640)


def frame(page: Page) -> int:
    return int(page.get_by_role("slider", name="Time").input_value())


def test_a_range_is_played_again_and_again_and_stays_in_the_address(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=2")
    page.locator("body").press("[")
    page.get_by_role("slider", name="Time").fill("120")
    page.locator("body").press("]")
    begin = page.get_by_role("slider", name="Start of the played range")
    end = page.get_by_role("slider", name="End of the played range")
    expect(begin).to_have_attribute("aria-valuenow", "100")
    expect(end).to_have_attribute("aria-valuenow", "120")
    begin.press("ArrowLeft")
    end.press("PageDown")
    expect(begin).to_have_attribute("aria-valuetext", "1.980 seconds, frame 100")
    expect(end).to_have_attribute("aria-valuenow", "110")
    assert "from=1.980" in page.url
    assert "to=2.200" in page.url

    frames = """() => new Promise((done) => {
        const slider = document.querySelector("#time"), seen = [];
        const look = () => {
            seen.push(Number(slider.value));
            if (seen.length < 90 || !seen.some((at, k) => at < seen[k - 1])) requestAnimationFrame(look);
            else done(seen);
        };
        look();
    })"""
    page.get_by_label("Speed").select_option("2")
    page.get_by_role("button", name="Play (space)").click()
    until(page, lambda: 99 <= frame(page) <= 110)
    seen = page.evaluate(frames)
    assert min(seen) >= 99
    assert max(seen) <= 110, "it goes back from the end of the range"
    page.get_by_role("button", name="Pause (space)").click()

    page.reload()
    page.wait_for_selector("[data-player][data-ready]", timeout=90_000)
    expect(begin).to_have_attribute("aria-valuenow", "99")
    expect(end).to_have_attribute("aria-valuenow", "110")
    box, row = end.bounding_box(), page.locator("[data-range]").bounding_box()
    assert box is not None
    assert row is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 5)
    page.mouse.down()
    page.mouse.move(row["x"] + row["width"] * 0.75, box["y"] + 5, steps=4)
    page.mouse.up()
    until(page, lambda: abs(float(end.get_attribute("aria-valuenow") or 0) - 0.75 * 290) < 4)
    page.locator("h1").press("\\")
    expect(begin).to_have_attribute("aria-valuenow", "0")
    assert "from=" not in page.url


def test_the_scene_is_looked_at_from_its_sides_and_along_the_way(tab: Tab, lab: Lab) -> None:
    job = lab.fake.add_plan()
    page = opened(tab, f"/view/?plan={job.id}&t=1")

    def seen(key: str) -> np.ndarray:
        page.locator("body").press(key)
        state = page.evaluate(CAMERA)
        towards = np.subtract(state["at"], state["target"])
        return np.asarray(towards / np.linalg.norm(towards))

    assert seen("1") @ [0, -1, 0] > 0.95
    expect(page.get_by_label("View")).to_have_value("side")
    assert seen("2") @ [1, 0, 0] > 0.95
    assert seen("3") @ [0, 0, 1] > 0.95

    page.get_by_label("Follow").check()
    before = page.evaluate(CAMERA)
    page.get_by_role("slider", name="Time").fill("150")
    until(page, lambda: page.evaluate(CAMERA)["target"][0] > before["target"][0] + 0.05)
    after = page.evaluate(CAMERA)
    assert np.subtract(after["at"], before["at"]) == pytest.approx(
        np.subtract(after["target"], before["target"]), abs=1e-3
    ), "it moves along without turning"
    page.get_by_label("Follow").uncheck()
    page.get_by_role("slider", name="Time").fill("200")
    assert page.evaluate(CAMERA)["target"] == pytest.approx(after["target"], abs=1e-6)


def picture(page: Page, times: int, transparent: bool) -> Image.Image:
    """The PNG that the dialog gives."""
    page.get_by_role("button", name="Picture…").click()
    dialog = page.get_by_role("dialog", name="Picture of the scene")
    dialog.get_by_label("Size").select_option(str(times))
    dialog.get_by_label("Transparent background").set_checked(transparent)
    with page.expect_download(timeout=90_000) as download:
        dialog.get_by_role("button", name="Save PNG").click()
    expect(dialog).to_be_hidden()
    assert download.value.suggested_filename == "Two steps 1.000 s.png"
    return Image.open(io.BytesIO(Path(download.value.path()).read_bytes()))


@pytest.mark.usefixtures("drawn")
def test_what_is_seen_can_be_saved_as_a_picture(tab: Tab, lab: Lab) -> None:
    page = opened(tab, f"/view/?plan={lab.fake.add_plan().id}&t=1")
    box = page.locator("iframe").bounding_box()
    assert box is not None
    shown = picture(page, 1, transparent=False).convert("RGBA")
    assert shown.size == (round(box["width"]), round(box["height"]))
    assert shown.getchannel("A").getextrema() == (255, 255)
    assert len(shown.convert("RGB").getcolors(1 << 20) or []) > 200, "there is more than a background"

    large = picture(page, 4, transparent=False).convert("RGB")
    assert large.size == (4 * shown.width, 4 * shown.height)
    smaller = np.asarray(large.resize(shown.size, Image.Resampling.BOX), dtype=float)
    assert np.abs(smaller - np.asarray(shown.convert("RGB"), dtype=float)).mean() < 3, "its parts fit together"

    clear = picture(page, 3, transparent=True)
    assert clear.size == (3 * shown.width, 3 * shown.height)
    assert clear.mode == "RGBA"
    least, most = clear.getchannel("A").getextrema()
    assert (least, most) == (0, 255)
    assert clear.getpixel((0, 0)) == (0, 0, 0, 0), "above the horizon is nothing"


@pytest.mark.usefixtures("drawn")
def test_a_picture_of_a_dark_room_is_dark(open_tab: Callable[..., Tab], lab: Lab) -> None:
    tab = open_tab(900, 640, color_scheme="dark")
    page = opened(tab, f"/view/?plan={lab.fake.add_plan().id}&t=1")
    pixel = picture(page, 2, transparent=False).convert("RGB").getpixel((1, 1))
    assert isinstance(pixel, tuple)
    red, green, blue = pixel
    assert max(red, green, blue) < 60


def test_the_player_fits_a_small_window(tab: Tab, lab: Lab) -> None:
    tab.page.set_viewport_size({"width": 800, "height": 600})
    page = opened(tab, f"/view/?plan={lab.fake.add_plan(replay=True).id}")
    for side in ("Width", "Height"):
        assert page.evaluate(f"() => document.documentElement.scroll{side} <= window.inner{side}")
    stage = page.locator("[data-stage]").bounding_box()
    assert stage is not None
    assert stage["height"] > 300
    controls = page.locator(".player-row").bounding_box()
    assert controls is not None
    assert controls["height"] < 100, "two lines: playback, and everything else"
    last = page.locator(".player .more > :visible").last
    last.scroll_into_view_if_needed()
    box = last.bounding_box()
    assert box is not None
    assert box["x"] + box["width"] <= 800, "it can be scrolled to"
    sizes = page.evaluate("""() => [...document.querySelectorAll(".player button, .player [role=slider]")]
        .filter((node) => node.checkVisibility())
        .map((node) => [node.getBoundingClientRect().width, node.getBoundingClientRect().height])""")
    assert min(width for width, _ in sizes) >= 24


def test_steps_are_shown_of_a_walk_whose_wheel_is_known(tab: Tab, lab: Lab) -> None:
    recording = lab.fake.add_recording()
    page = opened(tab, f"/view/?recording={recording.id}&t=1")
    assert json.loads(page.locator("[data-player]").get_attribute("data-steps") or "") == []
    expect(page.get_by_role("button", name="Upload…")).to_be_visible()
    expect(page.locator("[data-time]")).not_to_contain_text("step")


def test_a_small_recording_goes_up_from_within_the_viewer(tab: Tab, lab: Lab, tmp_path: Path) -> None:
    shown, uploaded = lab.fake.add_recording(), lab.fake.add_recording("new.c3d")
    refusal = {"title": "Unprocessable", "status": 422, "code": "not-c3d", "detail": "This is no C3D file."}
    request: list[str] = []

    def answer(route: Route) -> None:
        request.append(route.request.method)
        first = len(request) == 1
        route.fulfill(status=422 if first else 201, json=refusal if first else uploaded.model_dump(mode="json"))

    wrong, large, small = (tmp_path / name for name in ("<b>holiday.c3d", "large.c3d", "new.c3d"))
    wrong.write_bytes(b"not a recording")
    small.write_bytes(b"a recording")
    with large.open("wb") as file:
        file.truncate(31_000_000)
    page = opened(tab, f"/view/?recording={shown.id}")
    page.route("**/api/v1/recordings?*", answer)
    message = page.locator("[data-said-upload]")
    page.set_input_files("[data-upload-file]", wrong)
    expect(message).to_have_text("<b>holiday.c3d: This is no C3D file.")
    page.set_input_files("[data-upload-file]", large)
    expect(message).to_contain_text("page of recordings")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Upload…").press("Enter")
    chooser.value.set_files(small)
    page.wait_for_url(f"**/view/?recording={uploaded.id}*")
    assert request == ["POST", "POST"], "what is too large is not sent"
    tab.missteps = [m for m in tab.missteps if "status of 422" not in m]
