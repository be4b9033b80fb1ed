"""The table of estimators over many recordings: units, emphasis, missing scores."""

from typing import Any

from stridelab.estimation.evaluation.unseen_scores import SCORES
from stridelab.schemas.comparison import BenchColumn, BenchScore, ComBenchSummary, MassAgreement
from stridelab.schemas.methods import METHODS
from stridelab.schemas.quality import Quality
from stridelab_web.pages.results.com_bench import SCORE_TITLES, Cell, _best_estimator_sentence, _score_row


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


def test_the_answer_names_the_best_by_the_score_that_decides_for_most_people() -> None:
    """A score that does not order estimators, or of fewer people, does not decide; what is as good is named."""
    best = BenchScore(value=0.008, ci95=(0.0071, 0.0099), over_best=1.0)
    close = BenchScore(value=0.0083, ci95=None, over_best=1.04)
    worse = BenchScore(value=0.02, ci95=None, over_best=2.5)
    decides = column("grounded_force_path_along", "m", geometry=worse, rts=close, smoother=best)
    fewer = column("grounded_force_path_vertical", "m", kalman=best).model_copy(update={"n": 3})
    undecided = column("grounded_held_back_force_along", "1", kalman=best).model_copy(update={"orders": False, "n": 9})

    def answer(*columns: BenchColumn) -> str:
        summary = ComBenchSummary(
            columns=list(columns), n_recordings=9, n_people=7, mass=MassAgreement(n=0, rms_share=None, max_share=None),
            refused=[], left_out=[], quality=Quality(verdict="good", checks=[], not_checked={}), trials=[], warnings=[],
        )  # fmt: skip
        return _best_estimator_sentence(summary)

    assert answer(undecided, fewer, decides) == (
        "Best: smoother, 8.0 mm (7.1 to 9.9). Score: Distance from the force path, ahead; On the ground; 7 people. "
        "Within 5 % of it: RTS smoother."
    )
    alone = {name: one.model_copy(update={"ci95": None}) for name, one in decides.scores.items()}
    few = decides.model_copy(update={"n": 3, "scores": alone})
    assert answer(few) == (
        "3 people: too few to order the estimators. Smallest score: smoother, 8.0 mm. Score: Distance from the force "
        "path, ahead; On the ground."
    )
    assert not any(cell.is_near_best for cell in _score_row(few).cells if cell is not None)
    assert answer(undecided) == "No score that orders estimators as the truth does could be computed."
