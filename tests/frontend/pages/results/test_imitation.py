"""The page of an imitation: the sentence, person and robot in one table, curves, plans with a wheel, and attempts."""

import re
from collections.abc import Callable

import httpx
import numpy as np

from stridelab.schemas.imitation.contract import ComparedQuantity, ImitateSummary
from stridelab_web.pages.results.imitation import compared_row, draw_curves, imitation_headline, trial_rows
from support.browser.every_page import every_page
from support.fakes.imitation import imitation_result
from support.fakes.service import FakeService


def row_of(name: str, unit: str, value: float | None) -> tuple[str, str, str]:
    row = compared_row(
        ComparedQuantity(name=name, unit=unit, person=value, scaled=value, robot=value, n_person=2, n_robot=3)
    )
    return row.title, row.unit, row.robot


def test_quantities_are_in_the_units_of_the_page() -> None:
    assert row_of("com_height", "m", 0.8314) == ("Height of the centre of mass", "mm", "831")
    assert row_of("double_support_share", "1", 0.214)[1:] == ("%", "21")
    assert row_of("walking_speed", "m/s", 1.234)[1:] == ("m/s", "1.23")
    assert row_of("wheel_r", "m", None)[2] == "–"


def test_the_headline_has_steps_pace_error_and_speed() -> None:
    text = imitation_headline(ImitateSummary.model_validate(imitation_result()[0]))
    for part in ("boxes", "80%", "0.60", "3.3 mm", "47%"):
        assert part in text


def test_every_plan_has_a_column_and_unknown_costs_a_dash() -> None:
    trials = ImitateSummary.model_validate(imitation_result()[0]).wheel
    rows = {title: values for title, _, values in trial_rows(trials)}
    assert rows["Certified and completed"] == ["yes", "yes", "no: certificate: contact drift"]
    assert rows["Vertical excursion of the plan"] == ["5.0", "5.0", "–"]
    assert trial_rows([]) == []


def test_curves_of_both_are_drawn_and_their_distance_is_said() -> None:
    charts = draw_curves(imitation_result()[1]["curves.parquet"])
    assert len(charts) == 4
    assert [len(chart.curves) for chart in charts] == [2] * 4
    assert charts[0].caption.endswith(f"largest difference {np.abs(0.01 - 0.002) * 1000:.0f} mm")


def test_the_page_shows_all_of_it(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    html = browse(every_page(fake)["imitation"]).text
    page = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html))
    assert "boxes walks with 80% of the person’s step length" in page
    assert "The last stride is repeated." in page
    assert "certificate: &lt;self&gt; 3" in html
    assert "2 plans tried" in page
    assert "<i>walk" not in html
    assert 'data-compared="wheel_r"' in html
    assert "/view/?plan=" in html


def test_a_recording_offers_the_robots(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    page = browse(every_page(fake)["recording"]).text
    assert "data-imitate" in page
    assert '<option value="boxes">Boxes</option>' in page
