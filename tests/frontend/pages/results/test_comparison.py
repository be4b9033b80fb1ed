"""The page of a comparison says what the summary says, and draws what the tables hold."""

import re
from collections.abc import Callable
from typing import get_args

import httpx
import numpy as np
import pytest

from stridelab.schemas.comparison import Axes, CompareEstimatorsSummary
from stridelab_web.assets import STATIC
from stridelab_web.charts.plotly import Style
from stridelab_web.formatting import method_name
from stridelab_web.pages.results.comparison import against_physics, against_truth, comparison_headline
from stridelab_web.pages.results.comparison_plots import FIGURES
from stridelab_web.parquet import read_columns
from support.fakes.results import OFFSETS_M, comparison_summary, tables, truth_m
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
AXES = "xyz"
IN_ORDER = ["smoother", "kalman-thesis", "geometry"]


def cells(page: str, method: str) -> list[tuple[str, bool]]:
    """Texts of all cells of a method, both tables one after the other, and whether they are in bold."""
    rows = re.findall(rf'<tr data-method="{method}">(.*?)</tr>', page, re.DOTALL)
    return [(text, "best" in css) for row in rows for css, text in re.findall(r'<td class="([^"]*)">([^<]*)</td>', row)]


def test_tables_say_what_the_summary_says_horizontal_and_vertical_apart(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/jobs/{fake.add_comparison().id}").text
    assert list(dict.fromkeys(re.findall(r'data-method="([^"]+)"', page))) == IN_ORDER
    horizontal = float(np.hypot(*OFFSETS_M["smoother"][:2])) * 1000
    assert cells(page, "smoother")[:6] == [
        (f"{horizontal:.2f}", True), (f"{1.5 * horizontal:.2f}", True), ("3.00", True),
        ("95", False), ("100", False), ("50", False),
    ]  # fmt: skip
    # the same height error twice: both are the smallest
    assert cells(page, "kalman-thesis")[2] == ("3.00", True)
    assert cells(page, "geometry")[0] == ("6.00", False)
    assert "The force comes 12.0 ± 2.0 ms later than the markers; this was corrected." in page
    assert "RTS smoother: It needs more than a second." in page
    assert "Kalman filter, thesis: It takes the angular momentum for constant." in page
    assert "The truth of this recording is unknown" not in page


def test_without_a_truth_methods_are_held_against_physics(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/jobs/{fake.add_comparison(with_truth=False).id}").text
    assert ". The truth of this recording is unknown" in page
    assert "Against the truth" not in page
    shown = [text for text, _ in cells(page, "kalman-thesis")]
    assert shown == ["12.0", "-4.0", "3.0", "–", "–", "–", "0.97", "0.98", "-0.10", "12.0", "-4.0", "3.0"]


def test_groups_of_which_nothing_applies_are_left_out() -> None:
    known = comparison_summary(with_truth=True)
    assert [group.title for group in against_truth(known)] == [
        "Error [mm]", "Inside the 95 % band [%]", "Stated standard deviation [mm]",
    ]  # fmt: skip
    assert "In flight" not in {group.title for group in against_physics(known)}
    assert against_truth(comparison_summary(with_truth=False)) == []


def test_the_headline_names_the_method_that_errs_least_or_predicts_hidden_force_best() -> None:
    known = comparison_summary(with_truth=True)
    truths = {name: one.truth.horizontal_m for name, one in known.methods.items() if one.truth}
    least = min(truths, key=lambda name: truths[name])
    expected = f"Smallest horizontal error: {method_name(least)}, {1000 * truths[least]:.1f} mm RMS."
    assert comparison_headline(known) == expected
    assert comparison_headline(comparison_summary(with_truth=False)) == "", "vertically nothing is held back"
    hidden = {"smoother": (5.0, 6.0, 7.0), "rts": (4.0, 6.5, 8.0), "geometry": (9.0, 2.0, 9.0)}
    unknown = known.model_copy(update={"methods": {
        name: known.methods["smoother"].model_copy(
            update={"truth": None, "held_back_n": Axes(along=along, lateral=lateral, vertical=vertical)}
        )
        for name, (along, lateral, vertical) in hidden.items()
    }})  # fmt: skip
    assert comparison_headline(unknown) == (
        "Hidden force is predicted best along the walk by RTS smoother, sideways by markers only, "
        "vertically by smoother."
    )


def test_a_column_of_dashes_has_no_best() -> None:
    (held_back,) = (g for g in against_physics(comparison_summary(with_truth=False)) if "held back" in g.title)
    assert [held_back.cells[name][2].best for name in OFFSETS_M] == [False, False, False]
    assert held_back.cells["smoother"][0].best
    assert not held_back.cells["geometry"][0].best


def drawn(name: str, known: CompareEstimatorsSummary, *, with_truth: bool = True) -> dict[str, object]:
    figure = FIGURES[name]
    return figure.draw(read_columns(tables(with_truth=with_truth)[figure.table]), known)


def test_spectra_are_drawn_by_decades_in_millimetres(fake: FakeService, browse: Browse) -> None:
    answer = browse(f"/jobs/{fake.add_comparison().id}/figures/spectra.json").json()
    assert answer["x"]["key"] == "frequency_hz"
    assert answer["x"]["log"]
    assert [row["log"] for row in answer["rows"]] == [True, True, True]
    f = np.array(answer["columns"]["frequency_hz"])
    assert f[0] > 0
    for method, offset in OFFSETS_M.items():
        for axis, size in zip(AXES, offset, strict=True):
            key = f"{method.replace('-', '_')}_{axis}_m_rthz"
            if size == 0.0:
                assert key not in answer["columns"], "zero has no place on a logarithmic axis"
            else:
                assert np.array(answer["columns"][key]) == pytest.approx(1000 * abs(size) / f, abs=1e-6)
    assert [switch["key"] for switch in answer["switches"]] == IN_ORDER
    styles = {trace["group"]: trace["style"] for row in answer["rows"] for trace in row["traces"]}
    assert len(set(styles.values())) == len(styles), "every method has a line of its own"


@pytest.mark.parametrize(("with_truth", "against"), [(True, (0.0, 0.0, 0.0)), (False, OFFSETS_M["geometry"])])
def test_deviations_are_from_the_truth_or_else_from_the_markers(
    with_truth: bool, against: tuple[float, float, float]
) -> None:
    answer = drawn("time", comparison_summary(with_truth=with_truth), with_truth=with_truth)
    columns = answer["columns"]
    assert isinstance(columns, dict)
    for axis, offset, zero in zip(AXES, OFFSETS_M["smoother"], against, strict=True):
        assert np.array(columns[f"smoother_{axis}_m"]) == pytest.approx(1000 * (offset - zero), abs=1e-6)
    assert ("geometry_x_m" in columns) == with_truth


def test_contributions_and_filters_show_the_three_inputs(fake: FakeService, browse: Browse) -> None:
    job = fake.add_comparison()
    shares = browse(f"/jobs/{job.id}/figures/contributions.json").json()["columns"]
    parts = [np.array(shares[f"{name}_x_m"]) for name in ("geometry", "force", "axis")]
    assert np.sum(parts, axis=0) == pytest.approx(truth_m(np.array(shares["time_s"]))[:, 0], abs=2e-6)
    filters = browse(f"/jobs/{job.id}/figures/filters.json").json()
    assert [row["title"] for row in filters["rows"]] == ["Gain [dB]", "Phase [rad]"]
    assert min(filters["columns"]["axis_gain_db"]) == -100.0, "nothing at all is drawn as -100 dB"


def test_one_figure_is_shown_and_the_others_are_offered(fake: FakeService, browse: Browse) -> None:
    job = fake.add_comparison()
    for request, shown in (("", "spectra"), ("?figure=time", "time"), ("?figure=nothing", "spectra")):
        page = browse(f"/jobs/{job.id}{request}").text
        assert f'data-plots="/jobs/{job.id}/figures/{shown}.json"' in page
        assert re.findall(r'figure=(\w+)#figures" aria-current', page) == [shown]
        assert set(re.findall(r"figure=(\w+)#figures", page)) == set(FIGURES)
    assert browse(f"/jobs/{job.id}/figures/nothing.json").status_code == 404
    assert browse(f"/jobs/{fake.add_job(state='succeeded').id}/figures/time.json").status_code == 404


def test_every_line_that_a_trace_can_have_is_known_to_the_page_script() -> None:
    script = (STATIC / "js" / "charts" / "plots.js").read_text(encoding="utf-8")
    css = (STATIC / "css" / "app.css").read_text(encoding="utf-8")
    for style in get_args(Style):
        assert f" {style}: {{ color" in script, style
    for style in get_args(Style):
        if style.startswith("line") or style in ("second", "third"):
            assert f".key.{style} {{" in css, style
