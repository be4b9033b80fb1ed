"""All methods on one recording, through the pages: the tables say what the summary says, the figures what the files."""

import io
import json

import numpy as np
import pyarrow.parquet as pq
from playwright.sync_api import expect

from support.browser.page import Service, Tab

LEAST_M = 1e-8
"""Amplitudes per root hertz up to here are rounding and not drawn."""


def test_compare_on_the_sample_and_read_the_spectra(tab: Tab, service: Service) -> None:
    page = tab.go("/recordings/sample-walk")
    page.get_by_role("button", name="Compare all methods").click()
    page.wait_for_url("**/jobs/*")
    job_id = page.url.rpartition("/")[2]
    expect(page.get_by_role("heading", name="Result")).to_be_visible(timeout=180_000)
    summary = service.client.result(job_id).summary

    rows = page.locator("tr[data-method]")
    assert set(rows.evaluate_all("rows => rows.map(row => row.dataset.method)")) == set(summary["methods"])
    for name, assessed in summary["methods"].items():
        first = page.locator(f'tr[data-method="{name}"]').first.locator("td")
        assert first.nth(0).text_content() == f"{1000 * assessed['truth']['horizontal_m']:.2f}"
        assert first.nth(2).text_content() == f"{1000 * assessed['truth']['vertical_m']:.2f}"

    page.wait_for_selector("#plots[data-ready]")
    types = page.evaluate(
        "() => { const { xaxis, yaxis, yaxis3 } = document.getElementById('plots').layout;"
        " return [xaxis.type, yaxis.type, yaxis3.type]; }"
    )
    assert types == ["log", "log", "log"]
    table = pq.read_table(io.BytesIO(service.client.read_artifact(job_id, "spectra.parquet")))
    frequency = table.column("frequency_hz").to_numpy()
    traces = page.evaluate(
        "() => document.getElementById('plots').data.filter(t => t.key)"
        ".map(t => [t.key, JSON.stringify([Array.from(t.x), Array.from(t.y)])])"
    )
    assert len(traces) == 3 * len(summary["methods"])
    for key, values in traces:
        x, y = (np.array(v, dtype=float) for v in json.loads(values))
        np.testing.assert_allclose(x, frequency[frequency > 0], atol=1e-5)
        amplitude = table.column(key).to_numpy()[frequency > 0]
        np.testing.assert_allclose(y, np.where(amplitude > LEAST_M, 1000 * amplitude, np.nan), atol=1e-6)

    cursor = page.get_by_role("slider", name="Cursor")
    cursor.focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    k = int(np.flatnonzero(frequency > 0)[1])
    expect(page.locator("#readout")).to_contain_text(f"f {frequency[k]:.2f} Hz")
    values = ", ".join(f"{1000 * table.column(f'complementary_{axis}_m_rthz')[k].as_py():.2f}" for axis in "xyz")
    expect(page.locator("#readout")).to_contain_text(f"complementary filter {values} mm/√Hz")
    line = page.evaluate(
        "() => { const plots = document.getElementById('plots'), axis = plots._fullLayout.xaxis;"
        " return [plots.layout.shapes[0].x0, ...axis.range]; }"
    )
    assert line[0] == np.round(frequency[k], 5), "the cursor stands at its frequency"
    assert line[1] <= np.log10(line[0]) <= line[2]

    page.get_by_role("checkbox", name="complementary filter", exact=True).uncheck()
    expect(page.locator("#readout")).not_to_contain_text(f"complementary filter {values}")
    page.get_by_role("link", name="Over time").click()
    page.wait_for_selector("#plots[data-ready]")
    expect(page.get_by_role("heading", name="Over time")).to_be_visible()


def test_every_figure_fits_a_small_window(tab: Tab, service: Service) -> None:
    done = service.client.jobs(1, kind="compare-estimators", state="succeeded").items
    job = done[0] if done else service.client.submit("compare-estimators", {"recording_id": "sample-walk"})
    assert service.client.wait(job.id, 180.0).state == "succeeded"
    tab.page.set_viewport_size({"width": 800, "height": 600})
    for figure in ("spectra", "time", "contributions", "filters"):
        page = tab.go(f"/jobs/{job.id}?figure={figure}")
        page.wait_for_selector("#plots[data-ready]")
        assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth"), figure
