"""The page of ``com-bench``: a table per movement, a row per score, a column per estimator."""

from dataclasses import dataclass
from typing import Any, Final

from stridelab.schemas.comparison import BenchColumn, BenchScore, ComBenchSummary
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.methods import METHODS
from stridelab.translations.catalogue import gettext, ngettext, translate_text
from stridelab_web.formatting import method_name

KIND: Final = "com-bench"
MOVEMENT_TITLES: Final = {"standing": "Standing", "grounded": "On the ground", "airborne": "With flights"}
SCORE_TITLES: Final = {
    "force_path_along": "Distance from the force path, ahead",
    "force_path_lateral": "Distance from the force path, sideways",
    "force_path_vertical": "Distance from the force path, vertical",
    "hidden_plate_along": "The same with a plate hidden, ahead",
    "hidden_plate_lateral": "The same with a plate hidden, sideways",
    "standing_offset": "Distance from the centre of pressure",
    "held_back_force_along": "Held-back force over the weight, ahead",
    "held_back_force_lateral": "Held-back force over the weight, sideways",
    "held_back_force_vertical": "Held-back force over the weight, vertical",
    "withheld_flight_vertical": "Acceleration in withheld flights over g",
    "band_coverage_along": "Samples inside the 95 % band, ahead",
    "band_coverage_lateral": "Samples inside the 95 % band, sideways",
}
NEAR_BEST: Final = 1.05
"""Ratio to the best estimator up to which a score is emphasised."""


@dataclass(frozen=True)
class Cell:
    """One score as text, with its interval, and whether it is within 5 % of the best of its row."""

    value: str
    interval: str
    is_near_best: bool


@dataclass(frozen=True)
class Row:
    """One score of all estimators, in the order of ``METHODS``; None where an estimator has none."""

    name: str
    title: str
    unit: str
    people: int
    orders: bool
    cells: tuple[Cell | None, ...]


def com_bench_of(result: JobResult) -> dict[str, Any]:
    """Values for the template."""
    summary = ComBenchSummary.model_validate(result.summary)
    movements = dict.fromkeys(column.movement for column in summary.columns)
    return {
        "summary": summary,
        "methods": METHODS,
        "headline": _best_estimator_sentence(summary),
        "studied": gettext(
            "All estimators on %(recordings)s of %(people)s",
            recordings=ngettext("%(num)s recording", "%(num)s recordings", summary.n_recordings),
            people=ngettext("%(num)s person", "%(num)s people", summary.n_people),
        ),
        "tables": [
            (MOVEMENT_TITLES[movement], [_score_row(one) for one in summary.columns if one.movement == movement])
            for movement in movements
        ],
    }


def _best_estimator_sentence(summary: ComBenchSummary) -> str:
    """Which estimator is best by the score that decides and that most people have, and what follows it."""
    deciding = [column for column in summary.columns if column.orders and column.scores]
    if not deciding:
        return gettext("No score that orders estimators as the truth does could be computed.")
    column = max(deciding, key=lambda one: one.n)
    score = column.name.removeprefix(f"{column.movement}_")
    ranked = sorted(column.scores.items(), key=lambda item: item[1].value)
    method, best = ranked[0]
    cell = _score_cell(column, best)
    values = {
        "method": method_name(method),
        "movement": translate_text(MOVEMENT_TITLES[column.movement]),
        "score": translate_text(SCORE_TITLES.get(score, score)),
        "value": f"{cell.value} {_shown_unit(column)}" if cell is not None else "",
        "interval": f" ({cell.interval})" if cell is not None and cell.interval else "",
        "people": ngettext("%(num)s person", "%(num)s people", column.n),
    }
    if not _is_ordered(column):
        return gettext(
            "%(people)s: too few to order the estimators. Smallest score: %(method)s, %(value)s. Score: %(score)s; "
            "%(movement)s.",
            **values,
        )
    sentence = gettext(
        "Best: %(method)s, %(value)s%(interval)s. Score: %(score)s; %(movement)s; %(people)s.",
        **values,
    )
    close = [method_name(name) for name, one in ranked[1:] if one.over_best is not None and one.over_best <= NEAR_BEST]
    if close:
        sentence += " " + gettext("Within 5 %% of it: %(methods)s.", methods=", ".join(close))
    return sentence


def _is_ordered(column: BenchColumn) -> bool:
    """Whether the order of the estimators means something: with fewer than five people none has an interval."""
    return any(score.ci95 is not None for score in column.scores.values())


def _shown_unit(column: BenchColumn) -> str:
    return "mm" if column.unit == "m" else "%"


def _score_row(column: BenchColumn) -> Row:
    score = column.name.removeprefix(f"{column.movement}_")
    cells = tuple(_score_cell(column, column.scores.get(method)) for method in METHODS)
    return Row(column.name, SCORE_TITLES.get(score, score), _shown_unit(column), column.n, column.orders, cells)


def _score_cell(column: BenchColumn, score: BenchScore | None) -> Cell | None:
    if score is None:
        return None
    factor = 1e3 if column.unit == "m" else 1e2
    interval = (
        "" if score.ci95 is None else f"{factor * score.ci95[0]:.1f}{gettext(' to ')}{factor * score.ci95[1]:.1f}"
    )
    near = _is_ordered(column) and score.over_best is not None and score.over_best <= NEAR_BEST
    return Cell(f"{factor * score.value:.1f}", interval, near)
