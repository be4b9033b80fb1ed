"""Plan against plan in a browser: chosen in a form, drawn full and dashed over the same axes, stored in the address."""

import io
import json
from collections.abc import Callable

import numpy as np
import pyarrow.parquet as pq
import pytest
from playwright.sync_api import expect

from support.browser.page import Tab
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

TRACES = """() => document.getElementById("plots").data.filter((trace) => trace.key)
    .map((trace) => [trace.key, trace.line.dash ?? "solid", JSON.stringify(Array.from(trace.y))])"""


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab(800, 600)


def test_another_plan_is_chosen_and_both_are_drawn(tab: Tab, lab: Lab) -> None:
    job, other = lab.fake.add_plan(), lab.fake.add_plan()
    page = tab.go(f"/plans/{job.id}")
    page.get_by_label("Other plan", exact=True).select_option(other.id)
    page.get_by_role("button", name="Compare").click()
    page.wait_for_url(f"**/plans/{job.id}?with={other.id}*")
    page.wait_for_selector("#plots[data-ready]")
    expect(page.locator("tr[data-figure=objective] td").nth(2)).to_have_text("0")

    file = pq.read_table(io.BytesIO(lab.fake.plans[other.id]["centroidal.parquet"]))
    drawn = {key: (dash, np.array(json.loads(values), dtype=float)) for key, dash, values in page.evaluate(TRACES)}
    assert {dash for key, (dash, _) in drawn.items() if key.startswith("other_")} == {"dash"}
    assert {dash for key, (dash, _) in drawn.items() if not key.startswith("other_")} == {"solid"}
    for key in ("com_x_m", "com_vx_m_s", "l_y_nms"):
        for name in (key, f"other_{key}"):
            np.testing.assert_allclose(drawn[name][1], file.column(key).to_numpy(), atol=1e-4)
    page.get_by_role("slider", name="Cursor").fill("40")
    expect(page.locator("#readout")).to_contain_text("x 0.0800, 0.0800 m")
    assert page.evaluate("document.documentElement.scrollWidth") == 800

    page.get_by_role("link", name="This plan only").click()
    page.wait_for_selector("#plots[data-ready]")
    assert not [key for key, *_ in page.evaluate(TRACES) if key.startswith("other_")]
