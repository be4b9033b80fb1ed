"""The table of estimators over many recordings: units, emphasis, missing scores."""

from typing import Any

from stridelab.estimation.evaluation.unseen_scores import SCORES
from stridelab.schemas.comparison import BenchColumn, BenchScore
from stridelab.schemas.methods import METHODS
from stridelab_web.pages.results.com_bench import SCORE_TITLES, Cell, _score_row


def column(name: str, unit: Any, **scores: BenchScore) -> BenchColumn:
    return BenchColumn(
        name=name, movement="grounded", unit=unit, orders=True, n=7, recordings=9, unmatched=0, scores=scores
    )


def test_every_score_has_a_title() -> None:
    assert set(SCORE_TITLES) == set(SCORES)


def test_lengths_are_in_millimetres_and_those_near_the_best_are_emphasised() -> None:
    best = BenchScore(value=0.008, ci95=(0.0071, 0.0099), over_best=1.0)
    other = BenchScore(value=0.0085, ci95=None, over_best=1.0625)
    row = _score_row(column("grounded_force_path_along", "m", smoother=best, geometry=other))
    assert (row.title, row.unit, row.people, row.orders) == ("Distance from the force path, ahead", "mm", 7, True)
    cells = dict(zip(METHODS, row.cells, strict=True))
    assert cells["smoother"] == Cell("8.0", "7.1 to 9.9", True)
    assert cells["geometry"] == Cell("8.5", "", False)
    assert cells["kalman"] is None


def test_a_coverage_is_in_percent_and_has_no_best() -> None:
    row = _score_row(column("grounded_band_coverage_along", "1", rts=BenchScore(value=0.94, ci95=None, over_best=None)))
    assert row.unit == "%"
    assert row.cells[METHODS.index("rts")] == Cell("94.0", "", False)
