"""The page of the rolling wheel says what the summary says, and its pictures what the samples say."""

import html
import inspect
import re
from collections.abc import Callable
from typing import get_args

import httpx
import numpy as np
import pytest

from stridelab.schemas.cycloid import FitCycloidSummary
from stridelab.walking import step_fit
from stridelab.walking.timed_fit import Bound
from stridelab_web.pages.results.cycloid import draw_step, samples_of
from stridelab_web.pages.results.cycloid_steps import FLAGS, MODELS, contests_of, flag_sentence, steps_of, values_of
from stridelab_web.parquet import read_columns
from stridelab_web.scene.cycloid_frames import radius_m
from support.fakes.recorded_walk import KIND, RESIDUAL_M, STEPS_S, WHEELS, samples, summary, theta_rad, wheel_parquet
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


@pytest.fixture
def address(fake: FakeService) -> str:
    return f"/jobs/{fake.add_job(KIND, 'succeeded', recording_id=fake.add_recording().id).id}"


def cells(page: str, name: str) -> list[str]:
    """Texts of the cells of the row that carries ``name`` as an attribute."""
    (row,) = re.findall(rf"<tr[^>]*{name}[^>]*>(.*?)</tr>", page, re.DOTALL)
    return [re.sub(r"<[^>]*>|\s+", " ", cell).strip() for cell in re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)]


def test_every_step_has_a_row_and_the_requested_one_is_shown(address: str, browse: Browse) -> None:
    page = browse(f"{address}?step=2").text
    assert cells(page, 'data-step="1"') == [
        "0.60 – 1.20", "105.0", "15.0", "940.0", "11.00", "1.00", "0.52", "0.72", "-70", "30", "0.660", "1.10", "none",
    ]  # fmt: skip
    assert cells(page, 'data-step="2"')[5:] == ["–", "1.52", "1.72", "–", "-50", "–", "1.10", "2"]
    assert "Step 2, right foot swings" in page
    assert re.search(r'rel="prev" href="/jobs/\w+\?step=1#step"', page)
    assert 'rel="next"' not in page
    assert "1 more step was detected but not fitted" in page
    assert "Fitted from 1.240 s to 1.800 s" in page


@pytest.mark.parametrize("asked", ["", "0", "3", "x", "²", "-1"])
def test_what_is_no_step_shows_the_first(address: str, browse: Browse, asked: str) -> None:
    page = browse(f"{address}?step={asked}").text
    assert "Step 1, left foot swings" in page
    assert 'rel="prev"' not in page
    assert 'rel="next"' in page


def test_flags_are_sentences(address: str, browse: Browse) -> None:
    page = browse(f"{address}?step=2").text
    (shown,) = re.findall(r"<ul[^>]*data-flags>(.*?)</ul>", page, re.DOTALL)
    for code in ("timed-omega-low", "r-too-large"):
        assert FLAGS[code] in html.unescape(shown)
    assert "data-flags" not in browse(address).text
    assert flag_sentence("never-heard-of") == "Never heard of."


def test_every_flag_of_a_fit_has_its_sentence() -> None:
    codes = {f"timed-{bound}" for bound in get_args(Bound)}
    codes |= set(re.findall(r'"([a-z]+(?:-[a-z]+)*)":', inspect.getsource(step_fit)))
    assert len(codes) > 8
    assert codes <= set(FLAGS)


def test_formal_deviation_and_scatter_stand_side_by_side(address: str, browse: Browse) -> None:
    page = browse(address).text
    assert cells(page, 'data-parameter="R_m"') == ["105.0", "1.1", "4.9", "101.0", "105.0", "105.0"]
    assert cells(page, 'data-parameter="omega_rad_s"')[:3] == ["11.00", "–", "0.28"]
    assert cells(page, 'data-parameter="error_mean_mm"') == ["0.52", "–", "–", "0.61", "7.20", "4.30"]


def test_without_a_second_step_there_is_no_scatter() -> None:
    values = values_of(steps_of(summary())[0], None)
    assert [line.scatter for line in values] == ["–"] * len(values)


def test_the_thesis_rule_stands_beside_the_measured_double_support(address: str, browse: Browse) -> None:
    first, second = browse(address).text, browse(f"{address}?step=2").text
    assert cells(first, 'data-timing="start"') == ["1.050", "0.980", "-70"]
    assert cells(first, 'data-timing="end"') == ["1.200", "1.230", "30"]
    assert cells(second, 'data-timing="start"') == ["1.650", "–", "–"]
    assert "Plates [s]" in first
    assert "Markers [s]" in second


def test_the_best_model_is_marked_and_wins_are_counted() -> None:
    steps = steps_of(summary())
    path, time = contests_of(steps[0], steps)
    by_name = {entrant.rival.model: entrant for entrant in path.entrants}
    assert by_name["two-harmonics"].best == {"rms_mm", "aic"}
    assert by_name["wheel"].best == {"held_out_mm"}
    assert by_name["sinusoid"].aic_above_best == pytest.approx(11.5)
    # in the second step the wheel's AIC is the smallest
    assert {name: entrant.wins for name, entrant in by_name.items() if entrant.wins} == {"two-harmonics": 1, "wheel": 1}
    assert [e.wins for e in time.entrants if e.rival.model == "two-harmonics"] == [2]
    assert {entrant.rival.model for contest in (path, time) for entrant in contest.entrants} == set(MODELS)


def test_samples_of_a_step_are_its_own_where_two_steps_meet() -> None:
    columns = read_columns(wheel_parquet())
    for k, step in enumerate(steps_of(summary())):
        result = samples_of(columns, step)
        np.testing.assert_array_equal(result["time_s"], samples(k)["time_s"])
        assert radius_m(result) == pytest.approx(WHEELS[k][0], rel=1e-9)


def test_pictures_show_the_path_the_rest_and_the_angle() -> None:
    step = steps_of(summary())[0]
    own = samples(0)
    charts = draw_step(own, step)
    rim = charts.true_scale.circles[0]
    px_per_m = (charts.true_scale.right - charts.true_scale.left) / (2 * WHEELS[0][0] + np.ptp(own["hub_x_m"])) / 1.04
    assert rim.radius == pytest.approx(WHEELS[0][0] * px_per_m, rel=1e-3)
    ahead, up = (c for c in charts.residuals.curves if c.css in ("ahead", "up"))
    heights = {float(pair.split(",")[1]) for pair in up.points.split()}
    assert len(heights) == 1, "the rest upwards is a constant"
    tick = {t.text: t.px for t in charts.residuals.y_ticks}
    assert heights.pop() == pytest.approx(
        tick["0.00"] + (tick["0.00"] - tick["0.50"]) * -1000 * RESIDUAL_M[1] / 0.5 * 1.0, abs=0.2
    )
    assert len(ahead.points.split()) == len(own["time_s"])
    theta = theta_rad(0, own["time_s"])
    slope, start = np.polyfit(own["time_s"], theta, 1)
    assert charts.off_line_rad == pytest.approx(np.std(theta - start - slope * own["time_s"]), rel=1e-9)
    assert charts.stretched > 2


def test_axes_have_units_and_marks_have_words(address: str, browse: Browse) -> None:
    page = browse(address).text
    titles = re.findall(r'<text class="title"[^>]*>([^<]*)</text>', page)
    assert len(titles) == 8
    assert all(re.search(r"\[(m|mm|s|rad)\]", title) for title in titles), titles
    assert page.count('<svg viewBox="0 0') == 4
    assert " style=" not in page


def test_a_result_without_steps_or_samples_is_still_a_page(fake: FakeService, browse: Browse, address: str) -> None:
    job_id = address.rpartition("/")[2]
    whole = fake.result(job_id)
    bare = FitCycloidSummary.model_validate(whole.summary).model_copy(update={"steps": []})
    fake.results[job_id] = whole.model_copy(update={"summary": bare.model_dump(mode="json"), "artifacts": []})
    page = browse(address)
    assert page.status_code == 200
    assert "The recording has no complete step" in page.text
    fake.results[job_id] = whole.model_copy(update={"artifacts": []})
    page = browse(address)
    assert page.status_code == 200
    assert "At true scale" not in page.text
    assert "/view/" not in page.text


def test_the_viewer_opens_at_the_step(address: str, browse: Browse) -> None:
    page = browse(f"{address}?step=2").text
    assert re.search(rf'/view/\?recording=\w+&amp;job=\w+&amp;t={STEPS_S[1][0]:.3f}"', page)


def test_a_recording_offers_the_wheel(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/recordings/{fake.add_recording().id}").text
    assert "Fit the wheel" in page
