"""The rolling wheel through the pages: fitted, read step by step, and rolling in the scene where the file says."""

import io
import re
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pyarrow.parquet as pq
import pytest
from playwright.sync_api import expect

from support.browser.page import Service, Tab, nodes, opened, read_frames, until

WHEEL = ("/wheel/rim", "/wheel/hub", "/wheel/point")
NEAR_M = 1e-5
"""Bodies are sent in steps of 15 micrometres."""


@pytest.fixture(scope="module")
def fitted(service: Service, trial: Path) -> tuple[str, str]:
    """Ids of a recording and of its wheel."""
    recording = service.client.upload(trial, filename="rolling.c3d")
    job = service.client.submit("fit-cycloid", {"recording_id": recording.id})
    done = service.client.wait(job.id, 120.0)
    assert done.state == "succeeded", done.error
    return recording.id, job.id


def wheel_of(service: Service, job_id: str) -> dict[str, np.ndarray]:
    table = pq.read_table(io.BytesIO(service.client.read_artifact(job_id, "wheel.parquet")))
    return {name: table.column(name).to_numpy() for name in table.column_names}


def test_fit_the_wheel_of_the_sample_by_a_button(tab: Tab, service: Service) -> None:
    page = tab.go("/recordings/sample-walk")
    page.get_by_role("button", name="Fit the wheel").click()
    page.wait_for_url("**/jobs/*")
    job_id = page.url.rpartition("/")[2]
    expect(page.get_by_role("heading", name="The wheel of every step")).to_be_visible(timeout=120_000)
    (step,) = service.client.result(job_id).summary["steps"]
    cells = page.locator('tr[data-step="1"] td').all_text_contents()
    assert cells[1:4] == [f"{1000 * step[key]:.1f}" for key in ("R_m", "r_m", "z0_m")]
    assert cells[6:8] == [f"{step['error_mean_mm']:.2f}", f"{step['error_max_mm']:.2f}"]
    drawn = page.locator("#true-scale circle.rim").first
    assert float(drawn.get_attribute("r") or 0) > 20
    for chart in ("true-scale", "rescaled", "residuals", "theta"):
        box = page.locator(f"#{chart}").bounding_box()
        assert box is not None
        assert box["width"] > 300
        assert box["height"] > 100


def test_the_steps_are_turned_over_by_keyboard(tab: Tab, service: Service, fitted: tuple[str, str]) -> None:
    page = tab.go(f"/jobs/{fitted[1]}")
    steps = service.client.result(fitted[1]).summary["steps"]
    assert len(steps) > 2
    for number in (2, 3):
        page.get_by_role("link", name="Next step").focus()
        page.keyboard.press("Enter")
        page.wait_for_url(f"**step={number}#step")
        heading = page.get_by_role(
            "heading", name=re.compile(f"Step {number}, {steps[number - 1]['side']} foot swings")
        )
        expect(heading).to_be_visible()
    shown = page.locator('tr[data-parameter="R_m"] td').first
    assert shown.text_content() == f"{1000 * steps[2]['R_m']:.1f}"
    page.get_by_role("link", name="Previous step").click()
    page.wait_for_url("**step=2#step")


def test_the_wheel_rolls_where_the_file_says_and_can_be_hidden(
    tab: Tab, service: Service, fitted: tuple[str, str]
) -> None:
    recording_id, job_id = fitted
    wheel, steps = wheel_of(service, job_id), service.client.result(job_id).summary["steps"]
    page = opened(tab, f"/view/?recording={recording_id}&job={job_id}")
    with httpx.Client(base_url=service.url, trust_env=False) as http:
        layout, _ = read_frames(http.get(f"/view/scene/recording/{recording_id}/{job_id}/frames.bin").content)
    time_s = layout["time_s"]
    for number in (0, len(steps) // 2):
        rows = np.flatnonzero(wheel["step"] == number)
        row = int(rows[len(rows) // 3])
        frame = int(np.argmin(np.abs(np.array(time_s) - wheel["time_s"][row])))
        row = int(rows[np.argmin(np.abs(wheel["time_s"][rows] - time_s[frame]))])
        assert abs(wheel["time_s"][row] - time_s[frame]) < 1e-6, "the frames are samples of the file"
        page.get_by_role("slider", name="Time").fill(str(frame))
        expect(page.locator("[data-time]")).to_contain_text(step_at(steps, time_s[frame]))
        hub = np.array([wheel[key][row] for key in ("hub_world_x_m", "hub_world_y_m", "hub_z_m")])

        def at_the_hub(hub: np.ndarray = hub) -> bool:
            return bool(np.abs(np.array(nodes(page, WHEEL[1])[WHEEL[1]]["position"]) - hub).max() < NEAR_M)

        until(page, at_the_hub)
        seen: dict[str, Any] = nodes(page, *WHEEL)
        assert seen["/wheel/rim"]["scale"] == pytest.approx([steps[number]["R_m"]] * 3, rel=1e-5)
        assert seen["/wheel/rim"]["position"] == pytest.approx(hub, abs=NEAR_M)
        point = np.array(seen["/wheel/point"]["position"])
        assert point[2] == pytest.approx(wheel["model_z_m"][row], abs=NEAR_M)
        assert np.linalg.norm(point - hub) == pytest.approx(steps[number]["r_m"], abs=2 * NEAR_M)
        # the spoke that hangs down in the wheel's own frame points from the hub to the point
        w, x, y, z = seen["/wheel/rim"]["wxyz"]
        down = -np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        assert down == pytest.approx((point - hub) / np.linalg.norm(point - hub), abs=1e-3)

    page.get_by_role("checkbox", name="Wheel").uncheck()
    until(page, lambda: max(nodes(page, "/wheel/rim")["/wheel/rim"]["scale"]) < 1e-4)
    assert min(nodes(page, "/com/fused")["/com/fused"]["scale"]) > 1e-3, "the rest stays"


def step_at(steps: list[dict[str, Any]], t_s: float) -> str:
    """The step in which an instant lies, and how much of it is over, in the words of the player."""
    k = next(k for k, step in enumerate(steps) if step["t0_s"] <= t_s < step["t1_s"])
    part = (t_s - steps[k]["t0_s"]) / (steps[k]["t1_s"] - steps[k]["t0_s"])
    return f"step {k + 1} of {len(steps)}, {int(100 * part + 0.5)} %"


@pytest.fixture(scope="module")
def two_people(service: Service) -> list[str]:
    """File names of the walks of two people."""
    jobs = [service.client.submit("simulate-recording", {"duration_s": 3.0, "seed": seed}) for seed in (11, 12)]
    for job in jobs:
        assert service.client.wait(job.id, 120.0).state == "succeeded"
    made = [service.client.result(job.id).summary["recording_id"] for job in jobs]
    return [service.client.recording(recording_id).filename for recording_id in made]


def test_a_population_from_the_list_of_recordings(tab: Tab, service: Service, two_people: list[str]) -> None:
    names = two_people
    first, second = (name.removesuffix(".c3d") for name in names)
    page = tab.go("/recordings")
    for name in names:
        page.get_by_role("checkbox", name=f"Choose {name}").first.check()
    page.get_by_role("button", name="Study a population…").click()
    page.wait_for_url("**/population?recording=*")
    expect(page.get_by_text("2 recordings of 2 people")).to_be_visible()
    page.get_by_label("Group of all chosen").fill("adults")
    page.get_by_role("button", name="Study", exact=True).click()
    page.wait_for_url(re.compile(r"/population/\w+$"))
    expect(page.get_by_role("heading", name="Population of 2")).to_be_visible(timeout=180_000)
    summary = service.client.result(page.url.rpartition("/")[2]).summary
    assert {(s["subject"], s["group"]) for s in summary["subjects"]} == {(first, "adults"), (second, "adults")}

    who = page.get_by_label(re.compile(rf"^{second} \(adults\): R ")).first
    who.focus()
    assert who.locator("text").evaluate("node => getComputedStyle(node).visibility") == "visible"
    other = page.get_by_label(re.compile(rf"^{first} \(adults\): R ")).first.locator("text")
    assert other.evaluate("node => getComputedStyle(node).visibility") == "hidden"
    page.get_by_role("checkbox", name="Show all names").check()
    assert other.evaluate("node => getComputedStyle(node).visibility") == "visible"
    page.set_viewport_size({"width": 800, "height": 600})
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")


def test_files_with_a_subject_table_go_up_at_once(tab: Tab, trial: Path, tmp_path: Path) -> None:
    broken, table = tmp_path / "broken.c3d", tmp_path / "who.csv"
    broken.write_bytes(b"no recording")
    table.write_text(f"file,subject,group\n{trial.name},Q01,adults\nbroken.c3d,Q02,adults\n")
    page = tab.go("/population")
    page.get_by_label("Recordings", exact=True).set_input_files([trial, broken])
    page.get_by_label("Subject table").set_input_files(table)
    page.get_by_role("button", name="Upload and study").click()
    expect(page.locator("[data-refused]")).to_contain_text("broken.c3d:", timeout=60_000)
    page.get_by_role("button", name="Study the others").click()
    page.wait_for_url(re.compile(r"/population/\w+$"))
    expect(page.get_by_role("heading", name="Population of 1")).to_be_visible(timeout=180_000)
    expect(page.locator('tr[data-subject="Q01"]')).to_contain_text("adults")
