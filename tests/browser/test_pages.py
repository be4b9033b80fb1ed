"""From a file to a result through the pages, with the numbers of the interface on them."""

import base64
import io
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from playwright.sync_api import Page, expect

from support.browser.page import Service, Tab


def facts(page: Page) -> dict[str, str]:
    return dict(page.eval_on_selector_all("[data-fact]", "nodes => nodes.map(n => [n.dataset.fact, n.textContent])"))


def other_bytes(trial: Path, folder: Path, name: str) -> Path:
    """The same trial as a file that no other test uploads: C3D readers stop at the end of the data."""
    path = folder / name
    path.write_bytes(trial.read_bytes() + name.encode().ljust(512, b"\0"))
    return path


def test_upload_estimate_and_read_the_result(tab: Tab, service: Service, trial: Path, tmp_path: Path) -> None:
    trial = other_bytes(trial, tmp_path, "walk 02.c3d")
    page = tab.go("/")
    page.set_input_files("input[type=file]", trial)
    page.wait_for_url("**/recordings/*")
    recording = service.client.recording(page.url.rpartition("/")[2])
    assert recording.filename == trial.name
    expect(page.get_by_role("heading", level=1)).to_have_text(trial.name)
    (start_s, end_s), *_ = recording.windows_s
    expect(page.get_by_text(f"from {start_s:.2f} s to {end_s:.2f} s").first).to_be_visible()

    page.get_by_role("button", name="Estimate", exact=True).click()
    page.wait_for_url("**/jobs/*")
    job_id = page.url.rpartition("/")[2]
    expect(page.get_by_role("heading", name="Result")).to_be_visible(timeout=120_000)
    summary = service.client.result(job_id).summary
    shown = facts(page)
    assert shown["mass_kg"] == f"{summary['mass_kg']:.2f} kg"
    assert shown["window_s"] == "{:.2f} to {:.2f} s".format(*summary["window_s"])
    assert shown["bias_m"] == ", ".join(f"{1000 * b:z.1f}" for b in summary["bias_m"]) + " mm"
    assert shown["rms_force_residual_n"] == ", ".join(f"{r:.2f}" for r in summary["rms_force_residual_n"]) + " N"
    with page.expect_download() as download:
        page.get_by_role("link", name="com.csv").click()
    assert download.value.path().read_text().startswith('"time_s","x_m",')
    with page.expect_download() as download:
        page.get_by_role("link", name="All files as ZIP").click()
    assert download.value.path().read_bytes().startswith(b"PK")


def test_a_method_has_only_the_fields_that_it_uses(tab: Tab, service: Service, trial: Path) -> None:
    page = tab.go(f"/recordings/{service.client.upload(trial, filename='options.c3d').id}")
    form = page.locator("[data-estimate]")
    cutoffs, plates = form.get_by_label("Cut-off frequencies"), form.get_by_label("Error of the plates")
    for method, filters, smoother in (
        ("", True, True),
        ("complementary", True, False),
        ("geometry", False, False),
        ("smoother", False, True),
    ):
        form.get_by_label("Method").select_option(method)
        expect(cutoffs).to_be_visible(visible=filters)
        expect(plates).to_be_visible(visible=smoother)
    form.get_by_label("Method").select_option("")
    cutoffs.select_option("thesis")
    expect(plates).to_be_hidden()
    form.get_by_label("Method").select_option("smoother")
    plates.fill("5")
    form.get_by_label("Angular momentum").select_option("segments")
    page.get_by_role("button", name="Estimate", exact=True).click()
    page.wait_for_url("**/jobs/*")
    expect(page.get_by_role("heading", name="Result")).to_be_visible(timeout=120_000)
    request = service.client.result(page.url.rpartition("/")[2]).input
    assert (request["method"], request["cutoffs"]) == ("smoother", "auto")
    assert request["smoother"]["segment_momentum"] is True
    assert {k: v for k, v in request["smoother"]["priors"].items() if v is not None} == {"plate_force_n": 5}
    assert "marker_mm" in " ".join(facts(page))


def test_plots_show_the_curves_of_the_file(tab: Tab, service: Service, estimated: tuple[str, str]) -> None:
    _recording_id, job_id = estimated
    page = tab.go(f"/jobs/{job_id}")
    page.wait_for_selector("#plots[data-ready]")
    table = pq.read_table(io.BytesIO(service.client.read_artifact(job_id, "com.parquet")))
    traces = page.evaluate(
        "() => document.getElementById('plots').data.filter(t => t.key)"
        ".map(t => [t.key, JSON.stringify(Array.from(t.y))])"
    )
    drawn = {key: np.array(json.loads(values), dtype=float) for key, values in traces}
    assert {"x_m", "y_m", "z_m", "geometry_z_m", "axis_x_m", "vx_m_s", "force_z_n"} <= set(drawn)
    for key, tolerance in (("x_m", 1e-5), ("z_m", 1e-5), ("geometry_y_m", 1e-5), ("vx_m_s", 1e-4), ("force_z_n", 0.1)):
        expected = table.column(key).to_numpy()
        np.testing.assert_allclose(drawn[key], expected, atol=tolerance, equal_nan=True)
    axes = page.locator("#plots [class^=y][class$=title]")
    assert all("[" in title for title in axes.all_text_contents())
    assert axes.count() == 7


def test_inputs_are_switched_by_keyboard(tab: Tab, estimated: tuple[str, str]) -> None:
    page = tab.go(f"/jobs/{estimated[1]}")
    page.wait_for_selector("#plots[data-ready]")

    def shown() -> list[str]:
        result: list[str] = page.evaluate(
            "() => document.getElementById('plots').data.filter(t => t.key && t.visible !== false).map(t => t.key)"
        )
        return result

    assert {"axis_y_m", "geometry_y_m", "y_m", "force_y_n"} <= set(shown())
    page.get_by_role("checkbox", name="central axis").press(" ")
    page.wait_for_function("() => document.getElementById('plots').data.some(t => t.visible === false)")
    hidden = {"axis_x_m", "axis_y_m", "axis_z_m"}
    assert not hidden & set(shown())
    assert {"geometry_y_m", "y_m", "force_y_n"} <= set(shown())
    page.get_by_role("checkbox", name="central axis").press(" ")
    page.wait_for_function("() => document.getElementById('plots').data.every(t => t.visible !== false)")
    assert hidden <= set(shown())


def test_cursor_is_shared_by_readout_plots_and_viewer_link(
    tab: Tab, service: Service, estimated: tuple[str, str]
) -> None:
    recording_id, job_id = estimated
    page = tab.go(f"/jobs/{job_id}")
    page.wait_for_selector("#plots[data-ready]")
    cursor = page.get_by_role("slider", name="Cursor")
    cursor.focus()
    page.keyboard.press("Home")
    expect(page.locator("#readout")).to_contain_text("t 0.000 s")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    at = page.evaluate("() => document.getElementById('plots').layout.shapes[1].x0")
    expect(page.locator("#readout")).to_contain_text(f"t {at:.3f} s")
    link = page.get_by_role("link", name="View this instant in 3D")
    expect(link).to_have_attribute("href", f"/view/?recording={recording_id}&job={job_id}&t={at:.3f}")
    page.evaluate("() => Plotly.relayout('plots', { 'xaxis.range': [0.2, 0.3] })")
    page.get_by_role("button", name="Show window").click()
    window_s = service.client.result(job_id).summary["window_s"]
    zoomed = (
        "([a, b]) => { const r = document.getElementById('plots').layout.xaxis.range; return r[0] === a && r[1] === b }"
    )
    page.wait_for_function(zoomed, arg=window_s)


def test_the_newest_estimate_and_the_strip_of_its_recording_share_a_cursor(
    tab: Tab, estimated: tuple[str, str]
) -> None:
    recording_id, _job_id = estimated
    page = tab.go(f"/recordings/{recording_id}")
    page.wait_for_selector("#plots[data-ready]")
    mark = page.locator(".strip .now").first
    start_s, end_s = page.evaluate("() => document.getElementById('plots')._fullLayout.xaxis.range")

    def places() -> tuple[float, float]:
        at = page.evaluate("() => document.getElementById('plots').layout.shapes.at(-1).x0")
        share = float((mark.get_attribute("x1") or "nan%").removesuffix("%")) / 100.0
        return float(at), start_s + share * (end_s - start_s)

    at_s, marked_s = places()
    assert marked_s == pytest.approx(at_s)
    page.get_by_role("slider", name="Cursor").press("Home")
    assert places() == (0.0, 0.0)
    strip = page.locator(".strip svg").first
    box = strip.bounding_box()
    assert box is not None
    strip.click(position={"x": 0.75 * box["width"], "y": 5})
    at_s, marked_s = places()
    assert at_s == pytest.approx(start_s + 0.75 * (end_s - start_s), abs=0.02)
    assert marked_s == pytest.approx(at_s)
    link = page.get_by_role("link", name="View this instant in 3D")
    expect(link).to_have_attribute("href", re.compile(rf"&t={at_s:.3f}$"))


def test_many_files_at_once_each_with_its_own_answer(tab: Tab, trial: Path, tmp_path: Path) -> None:
    (tmp_path / "holiday.c3d").write_bytes(b"not a recording")
    (tmp_path / "empty.c3d").write_bytes(b"")
    page = tab.go("/recordings")
    page.set_input_files("input[type=file]", [trial, tmp_path / "holiday.c3d", tmp_path / "empty.c3d"])
    rows = page.locator("[data-uploads] li")
    expect(rows).to_have_count(3)
    expect(rows.nth(0).get_by_role("link")).to_be_visible(timeout=60_000)
    for k in (1, 2):
        expect(rows.nth(k).get_by_role("alert")).not_to_be_empty(timeout=60_000)
        expect(rows.nth(k)).to_contain_text("refused")
    tab.missteps = [m for m in tab.missteps if "status of 422" not in m]


def test_dropped_files_go_up_too(tab: Tab, trial: Path, tmp_path: Path) -> None:
    page = tab.go("/")
    content = base64.b64encode(other_bytes(trial, tmp_path, "dropped.c3d").read_bytes()).decode()
    page.evaluate(
        """([bytes, name]) => {
            const data = new DataTransfer();
            data.items.add(new File([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))], name));
            const zone = document.querySelector("[data-upload]");
            for (const kind of ["dragenter", "dragover", "drop"])
                zone.dispatchEvent(new DragEvent(kind, { dataTransfer: data, bubbles: true, cancelable: true }));
        }""",
        [content, "dropped.c3d"],
    )
    page.wait_for_url("**/recordings/*")
    expect(page.get_by_role("heading", level=1)).to_have_text("dropped.c3d")


def test_forms_change_the_recording(tab: Tab, service: Service, trial: Path) -> None:
    recording = service.client.upload(trial, filename="forms.c3d")
    other = service.client.upload(trial, filename="standing.c3d")
    page = tab.go(f"/recordings/{recording.id}")
    page.get_by_label("Pseudonym").fill("P07")
    page.get_by_label("Height").fill("1.83")
    with page.expect_navigation():
        page.get_by_role("button", name="Save subject").click()
    page.get_by_label("Trial of the same person").select_option(label="standing.c3d")
    with page.expect_navigation():
        page.locator("[data-static] button").click()
    page.get_by_label("Use plate 1").uncheck()
    page.get_by_label("Offset of the moments of plate 2 along y").fill("-5.5")
    with page.expect_navigation():
        page.get_by_role("button", name="Save plates").click()
    expect(page.get_by_text("Plate 1 loaded (not used)")).to_be_visible()
    expect(page.get_by_label("Offset of the moments of plate 2 along y")).to_have_value("-5.5")
    expect(page.get_by_label("Offset of the moments of plate 1 along y")).to_have_value("")
    changed = service.client.recording(recording.id)
    assert (changed.subject.name, changed.subject.height_m) == ("P07", 1.83)
    assert changed.static_recording_id == other.id
    assert next(plate.use for plate in changed.plates) is False
    assert [plate.moment_offset_m for plate in changed.plates[:2]] == [None, (0.0, -0.0055, 0.0)]


def test_cancel_a_waiting_and_a_running_job(tab: Tab, service: Service) -> None:
    long = {"duration_s": 60.0}
    jobs = [service.client.submit("simulate-recording", {**long, "seed": seed}) for seed in range(11, 15)]
    first, second = jobs[0], jobs[-1]
    page = tab.go("/jobs")
    row = page.locator(f'tr[data-job="{second.id}"]')
    expect(row).to_contain_text("queue")
    row.get_by_role("button", name="Cancel").click()
    expect(row).to_contain_text("cancelled")
    assert service.client.job(second.id).state == "cancelled"

    page = tab.go(f"/jobs/{first.id}")
    expect(page.locator("[data-state]")).to_have_text("running")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("[data-state]")).to_have_text("cancelled")
    assert service.client.job(first.id).state == "cancelled"
    expect(page.get_by_role("button", name="Cancel")).to_have_count(0)
    for job in jobs[1:-1]:
        service.client.cancel(job.id)


def test_failure_is_shown_with_its_reason(tab: Tab, service: Service, trial: Path) -> None:
    recording = service.client.upload(trial, filename="no windows.c3d")
    page = tab.go(f"/recordings/{recording.id}")
    for box in page.get_by_role("checkbox", name="Use plate").all():
        box.uncheck()
    with page.expect_navigation():
        page.get_by_role("button", name="Save plates").click()
    # the page itself offers only what can succeed without plates
    job = service.client.submit("estimate-com", {"recording_id": recording.id, "method": "smoother"})
    page = tab.go(f"/jobs/{job.id}")
    expect(page.locator("[data-state]")).to_have_text("failed", timeout=60_000)
    error = service.client.job(job.id).error
    assert error is not None
    expect(page.get_by_role("alert")).to_contain_text(error.detail)


def test_the_whole_way_by_keyboard(tab: Tab, service: Service, trial: Path) -> None:
    recording = service.client.upload(trial, filename="keys.c3d")
    page = tab.go("/recordings")

    def tab_to(name: str, limit: int = 60) -> None:
        for _ in range(limit):
            page.keyboard.press("Tab")
            if page.evaluate("() => document.activeElement.textContent.trim()").startswith(name):
                outline = page.evaluate("() => getComputedStyle(document.activeElement).outlineStyle")
                assert outline != "none", f"the focus on {name} cannot be seen"
                return
        raise AssertionError(f"Tab never reaches {name}")

    tab_to("Skip to content", 1)
    tab_to("keys.c3d")
    page.keyboard.press("Enter")
    page.wait_for_url(f"**/recordings/{recording.id}")
    tab_to("Estimate")
    page.keyboard.press("Enter")
    page.wait_for_url("**/jobs/*")
    expect(page.get_by_role("heading", name="Result")).to_be_visible(timeout=120_000)

    page = tab.go(f"/recordings/{recording.id}")
    tab_to("Delete")
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_be_visible()
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    assert service.client.recording(recording.id).id == recording.id
    page.keyboard.press("Enter")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Enter")
    page.wait_for_url("**/recordings")
    expect(page.get_by_text("keys.c3d")).to_have_count(0)


def test_no_page_scrolls_sideways(open_tab: Callable[..., Tab], service: Service, estimated: tuple[str, str]) -> None:
    recording_id, job_id = estimated
    addresses = (
        "/",
        "/recordings",
        f"/recordings/{recording_id}",
        "/jobs",
        f"/jobs/{job_id}",
        "/reproduction",
        "/login",
    )
    for width, height in ((1400, 850), (800, 600)):
        tab = open_tab(width, height)
        for address in addresses:
            page = tab.go(address)
            wide = page.evaluate("() => document.documentElement.scrollWidth - window.innerWidth")
            assert wide <= 0, f"{address} is {wide} pixels too wide at {width}x{height}"
            assert page.title().endswith("stridelab")
