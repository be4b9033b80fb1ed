"""The scene is moved by the page: where a node stands after a seek is where tracks.parquet says."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from playwright.sync_api import Page, expect

from support.browser.page import DRAWN_OVER, Service, Tab

STATE = """() => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable;
    const found = {};
    for (const [name, object] of Object.entries(viser.nodeRefFromName)) {
        if (!object) continue;
        found[name] = {
            pose: viser.nodePoseData[name]?.position ?? null,
            wxyz: viser.nodePoseData[name]?.wxyz ?? null,
            drawn: object.position.toArray(),
            scale: object.scale.toArray(),
        };
    }
    return found;
}"""
TOLERANCE_M = 1e-6
"""Frames are float32: at 10 m from the origin their steps are 1e-6 m."""


def scene(tab: Tab, address: str) -> Page:
    page = tab.go(address)
    page.wait_for_selector("[data-player][data-ready]", timeout=60_000)
    return page


def drawn(page: Page, until: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """State of the scene once ``until`` holds: viser applies poses in its next image."""
    for _ in range(100):
        state: dict[str, Any] = page.evaluate(STATE)
        if until(state):
            return state
        page.wait_for_timeout(100)
    raise AssertionError("the scene does not come to the expected state")


def at_rest(state: dict[str, Any]) -> bool:
    return all(
        np.allclose(node["drawn"], node["pose"], atol=1e-9)
        for name, node in state.items()
        if name.startswith("/markers/") and node["pose"]
    )


@pytest.fixture(scope="module")
def tracks(service: Service, estimated: tuple[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = service.client.download_tracks(estimated[0], tmp_path_factory.mktemp("tracks") / "tracks.parquet")
    return {name: column.to_numpy() for name, column in zip(*_columns(path.read_bytes()), strict=True)}


def _columns(content: bytes) -> tuple[list[str], list[Any]]:
    table = pq.read_table(io.BytesIO(content))
    return table.column_names, table.columns


def place(tracks: dict[str, Any], before: str, after: str, frame: int) -> np.ndarray:
    return np.array([tracks[f"{before}{axis}{after}"][frame] for axis in "xyz"])


def test_markers_forces_and_com_stand_where_the_files_say(
    tab: Tab, service: Service, estimated: tuple[str, str], tracks: dict[str, Any]
) -> None:
    recording_id, job_id = estimated
    recording, result = service.client.recording(recording_id), service.client.result(job_id)
    t_s = sum(result.summary["window_s"]) / 2
    page = scene(tab, f"/view/?recording={recording_id}&t={t_s:.3f}")
    frame = int(np.argmin(np.abs(tracks["time_s"] - t_s)))
    expect(page.locator("[data-time]")).to_contain_text(f"frame {frame + 1} of {recording.n_frames}")
    state = drawn(page, at_rest)

    for k, label in enumerate(recording.labels):
        expected = place(tracks, f"{label}_", "_m", frame)
        assert np.abs(np.array(state[f"/markers/{k}"]["drawn"]) - expected).max() < TOLERANCE_M, label
    com = pq.read_table(io.BytesIO(service.client.read_artifact(job_id, "com.parquet")))
    expected = np.array([com.column(f"{axis}_m")[frame].as_py() for axis in "xyz"])
    assert np.abs(np.array(state["/com/fused"]["drawn"]) - expected).max() < TOLERANCE_M

    loaded = [p.index for p in recording.plates if any(a < t_s < b for a, b in p.loaded_s)]
    assert loaded
    for index in loaded:
        force = place(tracks, f"plate{index}_f", "_n", frame)
        origin = place(tracks, f"plate{index}_cop", "_m", frame)
        shaft, head = state[f"/forces/plate{index}_shaft"], state[f"/forces/plate{index}_head"]
        assert np.abs(np.array(shaft["drawn"]) - origin).max() < TOLERANCE_M
        assert np.abs(np.array(head["drawn"]) - (origin + force / 1000)).max() < 2 * TOLERANCE_M
        assert shaft["scale"][2] == pytest.approx(np.linalg.norm(force) / 1000 - 0.08, abs=1e-6)
        w, x, y, z = shaft["wxyz"]
        up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        assert up == pytest.approx(force / np.linalg.norm(force), abs=1e-6)
    for plate in recording.plates:
        if not any(a - 0.05 < t_s < b + 0.05 for a, b in plate.loaded_s):
            assert max(state[f"/forces/plate{plate.index}_shaft"]["scale"]) < 1e-4, "an unloaded plate shows no force"


def test_central_axis_and_band_are_where_the_file_says(tab: Tab, service: Service) -> None:
    """By com.parquet alone, on the sample's two plates: along the force through its point nearest to the geometry."""
    recording_id, job_id = "sample-walk", "sample-walk-com"
    table = pq.read_table(io.BytesIO(service.client.read_artifact(job_id, "com.parquet")))
    com = {name: table.column(name).to_numpy() for name in table.column_names}
    whole = np.flatnonzero(com["complete"] & np.isfinite(com["axis_x_m"]) & np.isfinite(com["sd_x_m"]))
    outside = int(np.flatnonzero(~com["complete"])[-1])
    page = scene(tab, f"/view/?recording={recording_id}&job={job_id}&t={com['time_s'][outside]:.3f}")
    state = drawn(page, lambda state: at_rest(state) and max(state["/axis/line"]["scale"]) < 1e-4)
    assert max(state["/com/band"]["scale"]) < 1e-4, "no band where there is no estimate"

    for frame in (int(whole[len(whole) // 4]), int(whole[3 * len(whole) // 4])):
        page.get_by_role("slider", name="Time").fill(str(frame))
        fused, force, on_axis = (
            np.array([com[name.format(axis)][frame] for axis in "xyz"]) for name in ("{}_m", "force_{}_n", "axis_{}_m")
        )
        state = drawn(page, stands_at("/com/fused", fused))
        band, line = state["/com/band"], state["/axis/line"]
        assert np.abs(np.array(band["drawn"]) - fused).max() < TOLERANCE_M
        semi_m = 1.96 * np.array([com[f"sd_{axis}_m"][frame] for axis in "xyz"])
        assert band["scale"] == pytest.approx(semi_m, rel=1e-5)

        low, length = np.array(line["drawn"]), line["scale"][2]
        w, x, y, z = line["wxyz"]
        along = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        assert along == pytest.approx(force / np.linalg.norm(force), abs=1e-6)
        assert np.linalg.norm(np.cross(on_axis - low, along)) < 2 * TOLERANCE_M
        assert low[2] == pytest.approx(0.0, abs=1e-5), "it begins on the plates"
        assert 0.0 < (on_axis - low) @ along < length

    page.get_by_label("Band size").select_option("5")
    state = drawn(page, lambda state: np.allclose(state["/com/band"]["scale"], 5 * semi_m, rtol=1e-5))
    assert max(state["/inputs/axis/point"]["scale"]) < 1e-4
    page.get_by_label("Point on axis").check()
    state = drawn(page, lambda state: max(state["/inputs/axis/point"]["scale"]) > 1e-4)
    assert np.abs(np.array(state["/inputs/axis/point"]["drawn"]) - on_axis).max() < TOLERANCE_M
    page.get_by_label("Central axis").uncheck()
    drawn(page, lambda state: max(state["/axis/line"]["scale"]) < 1e-4)


def stands_at(node: str, position_m: np.ndarray) -> Callable[[dict[str, Any]], bool]:
    return lambda state: bool(np.abs(np.array(state[node]["drawn"]) - position_m).max() < TOLERANCE_M)


def test_timeline_steps_scrubs_plays_and_keeps_the_address(
    tab: Tab, service: Service, estimated: tuple[str, str], tracks: dict[str, Any]
) -> None:
    recording_id, _ = estimated
    page = scene(tab, f"/view/?recording={recording_id}&t=0")
    label = service.client.recording(recording_id).labels[0]

    def marker_stands_at(frame: int) -> Callable[[dict[str, Any]], bool]:
        expected = place(tracks, f"{label}_", "_m", frame)
        return lambda state: bool(np.abs(np.array(state["/markers/0"]["drawn"]) - expected).max() < TOLERANCE_M)

    drawn(page, marker_stands_at(0))
    page.keyboard.press(".")
    page.keyboard.press("ArrowRight")
    page.keyboard.press(",")
    drawn(page, marker_stands_at(1))
    page.wait_for_url(f"**t={tracks['time_s'][1]:.3f}")

    slider = page.get_by_role("slider", name="Time")
    slider.fill("37")
    drawn(page, marker_stands_at(37))
    page.wait_for_url(f"**t={tracks['time_s'][37]:.3f}")
    assert slider.get_attribute("aria-valuetext") == f"{tracks['time_s'][37]:.3f} seconds, frame 38"
    slider.focus()
    page.keyboard.press("ArrowLeft")
    drawn(page, marker_stands_at(36))
    # the address is written a few times a second at most, so the scene is ahead of it
    page.wait_for_url(f"**t={tracks['time_s'][36]:.3f}")
    page.reload()
    page.wait_for_selector("[data-player][data-ready]", timeout=60_000)
    drawn(page, marker_stands_at(36))

    page.get_by_label("Speed").select_option("2")
    page.locator("body").press(" ")
    page.wait_for_function("() => Number(document.querySelector('#time').value) > 60")
    page.locator("body").press(" ")
    expect(page.get_by_role("button", name="Play (space)")).to_have_attribute("aria-pressed", "false")
    stopped = int(slider.input_value())
    drawn(page, marker_stands_at(stopped))


def test_layers_can_be_switched_off(tab: Tab, estimated: tuple[str, str]) -> None:
    page = scene(tab, f"/view/?recording={estimated[0]}&job={estimated[1]}&t=1")

    def size(state: dict[str, Any], name: str) -> float:
        return float(max(state[name]["scale"]))

    drawn(page, lambda state: size(state, "/body/thigh/l") > 0.01 and size(state, "/paths/fused") == 1)
    drawn(page, lambda state: size(state, "/skeleton/0") < 1e-4)
    page.get_by_label("Body").uncheck()
    page.get_by_label("Path").uncheck()
    drawn(page, lambda state: size(state, "/body/thigh/l") < 1e-4 and size(state, "/paths/fused") < 1e-4)
    page.get_by_label("Body").check()
    page.get_by_label("Lines").check()
    drawn(page, lambda state: size(state, "/body/thigh/l") > 0.01 and size(state, "/skeleton/0") > 0.01)


def test_the_centre_of_mass_is_seen_through_the_body(tab: Tab, estimated: tuple[str, str]) -> None:
    page = scene(tab, f"/view/?recording={estimated[0]}&job={estimated[1]}&t=1")
    names = ["/com/fused", "/forces/plate1_head", "/body/thigh/l", "/markers/0"]
    assert page.evaluate(DRAWN_OVER, names) == [True, True, False, False]
    page.get_by_label("See through").uncheck()
    assert page.evaluate(DRAWN_OVER, names) == [False] * 4


def test_lost_connection_is_taken_up_at_the_same_instant(
    tab: Tab, service: Service, estimated: tuple[str, str], tracks: dict[str, Any]
) -> None:
    """A small window: the page has no sideways scroll, and a rebuilt scene stands where the timeline does."""
    tab.page.set_viewport_size({"width": 800, "height": 600})
    page = scene(tab, f"/view/?recording={estimated[0]}&t=0.5")
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert page.evaluate("() => document.documentElement.scrollHeight <= window.innerHeight")
    page.evaluate("() => document.querySelector('iframe').contentWindow.location.reload()")
    frame = int(np.argmin(np.abs(tracks["time_s"] - 0.5)))
    expected = place(tracks, f"{service.client.recording(estimated[0]).labels[0]}_", "_m", frame)

    def stands(state: dict[str, Any]) -> bool:
        return "/markers/0" in state and bool(np.abs(np.array(state["/markers/0"]["drawn"]) - expected).max() < 1e-6)

    page.wait_for_timeout(500)
    page.wait_for_function("() => document.querySelector('iframe').contentWindow.__viserMutable", timeout=60_000)
    drawn(page, stands)


def test_a_recording_that_does_not_exist_is_said(tab: Tab) -> None:
    page = tab.go("/view/?recording=nothing")
    expect(page.get_by_role("heading", level=1)).to_have_text("Not found")
    tab.missteps = [m for m in tab.missteps if "status of 404" not in m]


def test_the_scene_beside_the_curves_shares_their_cursor(tab: Tab, estimated: tuple[str, str]) -> None:
    recording, _ = estimated
    page = tab.go(f"/recordings/{recording}")
    expect(page.locator("[data-headline]")).to_contain_text("Centre of mass known to")
    page.wait_for_selector("#plots[data-ready]", timeout=60_000)
    height = page.locator("#plots").evaluate("box => box.getBoundingClientRect().height")
    page.get_by_role("button", name="3D beside the curves").click()
    frame = page.frame_locator("[data-beside] > iframe")
    expect(frame.locator("[data-player][data-ready]")).to_be_attached(timeout=60_000)
    expect(frame.get_by_role("banner")).to_be_hidden()
    clock, read_out = frame.locator("[data-time]"), page.locator("#readout")

    page.locator("#cursor").evaluate("(box) => { box.value = '40'; box.dispatchEvent(new Event('input')); }")
    time_s = (read_out.text_content() or "").split()[1]
    expect(clock).to_contain_text(f"{time_s} s")

    page.wait_for_timeout(100)  # longer than the interval at which the curves follow
    frame.locator("[data-do=forward]").click()
    expect(clock).not_to_contain_text(f"{time_s} s")
    moved_s = (clock.text_content() or "").split()[0]
    expect(read_out).to_contain_text(f"t {moved_s} s")
    # Curves that give way to the scene keep their height.
    assert page.locator("#plots").evaluate("box => box.getBoundingClientRect().height") == height

    page.reload()
    expect(page.locator("[data-beside] > iframe")).to_be_visible()  # as it was left
    page.get_by_role("button", name="3D beside the curves").click()
    expect(page.locator("[data-beside] > iframe")).to_have_count(0)
