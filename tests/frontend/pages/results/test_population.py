"""The pages of populations: everybody is where the summary says, groups are apart, and the thesis stands beside."""

import re
from collections.abc import Callable

import httpx
import pytest

from stridelab_web.pages.results.cycloid_steps import PARAMETERS
from stridelab_web.pages.results.population_bars import THESIS_ERROR_MM, bars_of
from stridelab_web.pages.results.population_charts import AGAINST, groups_of, scatter_chart
from stridelab_web.pages.results.population_tables import correlation_rows, model_rows, population_answer, three_digits
from support.fakes.results import PEOPLE, POPULATION_KIND, population_summary
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


@pytest.fixture
def address(fake: FakeService) -> str:
    return f"/population/{fake.add_job(POPULATION_KIND, 'succeeded').id}"


def test_everybody_of_whom_both_numbers_are_known_is_a_mark_with_words() -> None:
    height, _, _, length = AGAINST
    chart = scatter_chart(population_summary().subjects, height, PARAMETERS[0])
    assert chart is not None
    assert [mark.label for mark in chart.marks] == [name for name, _, tall, _, _ in PEOPLE if tall]
    assert chart.marks[0].text == "P01 (adults): R 100.0 ± 4.0 mm, height 1.62 m"
    assert (chart.x_title, chart.y_title) == ("Height [m]", "R [mm]")
    other = scatter_chart(population_summary().subjects, length, PARAMETERS[3])
    assert other is not None
    assert len(other.marks) == len(PEOPLE)
    assert other.marks[0].text == "P01 (adults): ω 10.90 rad/s, step length 0.65 m", "no deviation is known"


def test_positions_and_error_bars_are_to_the_scale_of_the_axes() -> None:
    chart = scatter_chart(population_summary().subjects, AGAINST[0], PARAMETERS[0])
    assert chart is not None
    tick = {t.text: t.px for t in chart.y_ticks}
    px_per_mm = (tick["90"] - tick["100"]) / 10
    by_name = {mark.label: mark for mark in chart.marks}
    for name, _, tall, R_m, _ in PEOPLE:
        if tall:
            assert by_name[name].y == pytest.approx(tick["100"] - (1000 * R_m - 100) * px_per_mm, abs=0.15)
    assert all(abs(w.y1 - w.y2) == pytest.approx(8.0 * px_per_mm, abs=0.25) for w in chart.whiskers)


def test_groups_differ_in_colour_and_in_shape() -> None:
    groups = groups_of(population_summary().subjects)
    assert {name: group.size for name, group in groups.items()} == {"adults": 4, "children": 2}
    assert len({group.css for group in groups.values()}) == len({group.shape for group in groups.values()}) == 2
    chart = scatter_chart(population_summary().subjects, AGAINST[2], PARAMETERS[0])
    assert chart is not None
    assert [curve.css for curve in chart.curves] == ["trend group0"], "two children make no line"


def test_correlations_come_in_the_order_of_the_pages_with_the_thesis_beside() -> None:
    rows = correlation_rows(population_summary())
    assert [(row.letter, row.against) for row in rows] == [
        ("R", "height"), ("R", "speed"), ("z₀", "height"), ("ω", "height"),
    ]  # fmt: skip
    assert [row.thesis for row in rows] == ["0.67, p < 0.01", "", "0.87, p ≤ 0.001", "weak, p ≥ 0.83"]
    assert [row.clear for row in rows] == [True, False, True, False]
    first = rows[0]
    assert (first.r, first.interval, first.p, first.p_holm) == ("+0.66", "[0.10, 0.90]", "0.027", "0.108")
    assert first.partials == (("", ""), ("–", ""), ("+0.50", "[-0.20, 0.80]"), ("–", ""))
    assert rows[2].p == "< 0.001"


def test_mixed_models_are_in_the_unit_of_the_parameter() -> None:
    (row,) = model_rows(population_summary())
    assert row.effects == ("height: 30 [-13, 73]",)
    assert (row.between, row.within, row.unit) == ("4", "2", "mm")


def test_numbers_have_three_digits_and_no_exponent() -> None:
    assert [three_digits(v) for v in (1023.4, 0.0004567, -13.04, 100.0, 0.0, 2.5)] == [
        "1020", "0.000457", "-13", "100", "0", "2.5",
    ]  # fmt: skip


def test_bars_are_to_scale_and_the_thesis_has_its_line() -> None:
    distance, start, end = bars_of(population_summary().subjects)
    ticks = {text: at for at, text in distance.ticks}
    per_mm = ticks["1"] - ticks["0"] if "1" in ticks else (ticks["1.0"] - ticks["0.0"])
    assert distance.line == pytest.approx(THESIS_ERROR_MM * per_mm, abs=0.02)
    for bar, (name, _, _, R_m, _) in zip(distance.bars, PEOPLE, strict=True):
        assert bar.subject == name
        assert bar.at == pytest.approx(10 * (R_m - 0.02) * per_mm, abs=0.02)
        assert bar.width == pytest.approx(0.6 * per_mm, abs=0.02)
    assert start.bars[0].text == "P01: -80.00, standard deviation 20.00"
    assert start.bars[0].at < start.line, "too early is to the left of no error"
    assert end.bars[0].width == 0.0
    assert all(0 <= bar.low <= bar.at <= 100 for figure in (distance, start, end) for bar in figure.bars)


def test_the_page_shows_all_of_it(address: str, browse: Browse) -> None:
    page = browse(address).text
    assert "Population of 6" in page
    assert page.count('class="mark-of"') == 4 * 5, "C02 has no height"
    assert len(re.findall(r"<tr data-subject=", page)) == 6
    assert "children <span" in page
    assert "by height" in page
    assert "turn.c3d</a> is left out: The walk turns." in page
    for stem in ("subjects", "steps", "correlations"):
        for end in ("csv", "parquet"):
            assert re.search(rf'/artifacts/{stem}\.{end}" download>(CSV|Parquet)', page)
    assert " style=" not in page
    assert 'aria-current="page">Against height' in page
    other = browse(f"{address}?against=speed_m_s").text
    assert 'aria-current="page">Against speed' in other
    assert other.count('class="mark-of"') == 4 * 6
    assert 'aria-current="page">Against height' in browse(f"{address}?against=shoe_size").text


def test_a_job_page_leads_to_its_population_and_back(fake: FakeService, browse: Browse, address: str) -> None:
    answer = browse(address.replace("/population/", "/jobs/"))
    assert (answer.status_code, answer.headers["location"]) == (303, address)
    other = fake.add_job("estimate-com", "succeeded")
    answer = browse(f"/population/{other.id}")
    assert (answer.status_code, answer.headers["location"]) == (303, f"/jobs/{other.id}")
    waiting = browse(f"/population/{fake.add_job(POPULATION_KIND).id}")
    assert waiting.status_code == 200
    assert "data-cancel" in waiting.text


def test_chosen_recordings_are_ticked_and_named(fake: FakeService, browse: Browse) -> None:
    first, second = fake.add_recording("anna 1.c3d"), fake.add_recording("b.c3d")
    assert f'name="recording" value="{first.id}"' in browse("/recordings").text
    page = browse(f"/population?recording={first.id}").text
    rows = dict(re.findall(r'<tr data-recording="(\w+)">(.*?)</tr>', page, re.DOTALL))
    assert list(rows) == [first.id, second.id], "what was chosen comes first"
    assert "checked" in rows[first.id]
    assert "checked" not in rows[second.id]
    assert 'name="subject" maxlength="80" value="anna 1"' in rows[first.id]


def test_without_recordings_there_is_nothing_to_choose(browse: Browse) -> None:
    page = browse("/population").text
    assert "Nothing uploaded yet" in page
    assert "data-recording" not in page


def test_a_study_begins_with_its_clear_correlations(browse: Browse, address: str) -> None:
    summary = population_summary()
    rows = correlation_rows(summary)
    answer = population_answer(summary, rows)
    own = [row for row in rows if row.pair.group == rows[0].pair.group]
    clear = [row for row in own if row.clear]
    assert answer.startswith(f"{len(summary.subjects)} subjects: ")
    assert (f"{len(clear)} of {len(own)} correlations are clear" if clear else "none of") in answer
    assert population_answer(summary, ()) == f"{len(summary.subjects)} subjects: too few for a correlation."
    assert "data-headline" in browse(address).text
