"""The page of a receding horizon: replans beside what 20 Hz leave, pushes where they are felt, and the way to 3D."""

import re
from collections.abc import Callable

import httpx
import numpy as np
import pytest

from stridelab.schemas.receding import Push
from stridelab_web.pages.results.receding import effect_times_s, push_text, receding_curves, replan_chart
from support.fakes.robots import receding_columns
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
PUSHES = [Push(time_s=1.05, velocity_m_s=(0.0, 0.06, 0.0)), Push(time_s=2.0, velocity_m_s=(-0.1, 0.0, 0.02))]


def texts(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


def test_a_push_is_felt_at_the_end_of_its_period() -> None:
    assert effect_times_s(PUSHES, 0.1) == pytest.approx([1.1, 2.1])
    assert [push_text(push) for push in PUSHES] == ["+0.06 m/s in y", "-0.10 m/s in x, +0.02 m/s in z"]
    assert push_text(Push(time_s=0.0, velocity_m_s=(0.0, 0.0, 0.0))) == "nothing"


def test_every_replan_is_a_mark_on_its_side_of_the_line() -> None:
    columns = receding_columns()
    chart = replan_chart(columns, PUSHES, 0.1)
    replans = [mark for mark in chart.marks if mark.css != "push"]
    assert len(replans) == np.isfinite(columns["replan_ms"]).sum()
    (line,) = [level for level in chart.whiskers if level.css == "rule"]
    for mark, took_ms, stored in zip(replans, columns["replan_ms"], columns["carried_on"], strict=False):
        assert (mark.y < line.y1) == (took_ms > 50.0)
        assert mark.css == ("late" if took_ms > 50.0 or stored else "timely")
        assert mark.shape == ("cross" if stored else "circle")
    assert next(mark.text for mark in chart.marks if mark.css == "push") == "Pushed by +0.06 m/s in y at 1.10 s"


def test_curves_are_those_of_the_table_and_shaded_after_a_push() -> None:
    columns = receding_columns()
    drawn = receding_curves(columns, PUSHES, 0.1)
    assert np.allclose(drawn["columns"]["com_y_m"], columns["com_y_m"], atol=1e-5)
    assert drawn["shades_s"] == [pytest.approx([1.1, 1.2]), pytest.approx([2.1, 2.2])]
    assert drawn["columns"]["replan_ms"][-1] is None


def test_the_page_says_it_in_words_with_units(fake: FakeService, browse: Browse) -> None:
    job = fake.add_receding([push.model_dump(mode="json") for push in PUSHES])
    page = browse(f"/jobs/{job.id}").text
    shown = texts(page)
    assert "In 1 of 40 periods no solution was found" in shown
    assert "The centre of mass ends at its place of rest." in shown
    assert "30 of 40 replans took at most 50 ms, the period of 20 Hz" in shown
    assert "Replan, longest 120 ms" in shown
    assert "Solver CasADi with ipopt" in shown
    assert "1.10 s: +0.06 m/s in y" in shown
    assert f'href="/view/?plan={job.id}"' in page
    assert f'data-plots="/jobs/{job.id}/plots.json"' in page
    assert browse(f"/jobs/{job.id}/plots.json").json()["columns"]["com_z_m"][0] == 0.88


def test_it_is_watched_like_a_plan(fake: FakeService, browse: Browse) -> None:
    job = fake.add_receding([])
    page = browse(f"/view/?plan={job.id}").text
    assert f'href="/jobs/{job.id}"' in page
    assert '"/robot/"' not in page


def test_a_scenario_is_walked_from_its_page(fake: FakeService, browse: Browse) -> None:
    scenario = fake.add_scenario()
    job = fake.add_job("plan-receding", "succeeded", scenario_id=scenario.id)
    page = browse(f"/scenarios/{scenario.id}").text
    assert f'data-receding="{scenario.id}"' in page
    assert "Plan with a receding horizon" in page
    assert f'href="/jobs/{job.id}"' in page
