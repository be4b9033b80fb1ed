"""Measures of gait on the page of a job: the main values, then all of them with both sides."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.measures import (
    MEASURE_TITLES,
    BodySide,
    GaitMeasuresSummary,
    GaitReportSummary,
    MeasureValue,
    measure_scale,
    measure_title,
)
from stridelab_web.formatting import count_text

KINDS: Final = frozenset({"gait-measures", "gait-report"})
MAIN: Final[Mapping[str, str]] = {
    "walking_speed": "Speed",
    "step_length": "Step length",
    "step_width": "Step width",
    "margin_of_stability_ml_min": "Margin of stability, sideways",
    "margin_of_stability_ap_contact": "Margin of stability, ahead",
    "energy_recovery": "Energy recovery",
    "double_support_share": "Double support",
}
"""Measures of which the first ``N_MAIN`` that are known are shown above the table, with their short titles."""
N_MAIN: Final = 6
DOWNLOADS: Final = ("report.pdf", "report.html", "measures.csv", "xcom.csv")
MIN_STEPS: Final = 3
"""Steps below which the headline refers to the intervals: Student's quantile for two values is 12.7."""


@dataclass(frozen=True)
class Row:
    """One measure as text; empty where it is not known. ``interval`` contains the mean with 95 % confidence."""

    name: str
    title: str
    short: str
    unit: str
    mean: str
    interval: str
    left: str
    right: str
    symmetry: str
    n: int


def measures_of(result: JobResult) -> dict[str, Any]:
    """Values for the template."""
    summary = GaitReportSummary.model_validate(result.summary)  # of a report, or of measures without its fields
    rows = {row.name: row for row in measure_rows(summary)}
    contradicted = [item for item in summary.left_out if item.code == "contradicted"]
    present = {item.name for item in result.artifacts}
    return {
        "summary": summary,
        "headline": measures_headline(summary),
        "main": [rows[name] for name in MAIN if name in rows][:N_MAIN],
        "rows": list(rows.values()),
        "contradicted": contradicted,
        "left_out": [item for item in summary.left_out if item not in contradicted],
        "missing": [(measure_title(item.name), item) for item in summary.not_measured],
        "downloads": [name for name in DOWNLOADS if name in present],
    }


def measure_rows(summary: GaitMeasuresSummary) -> tuple[Row, ...]:
    """All measures over both sides, in the order of ``MEASURE_TITLES``."""
    by_side = {(one.name, one.side): one for one in summary.measures}
    order = list(MEASURE_TITLES)
    both = [one for one in summary.measures if one.side is None]
    both.sort(key=lambda one: order.index(one.name) if one.name in MEASURE_TITLES else len(order))
    return tuple(_measure_row(one, by_side) for one in both)


def _measure_row(one: MeasureValue, by_side: Mapping[tuple[str, BodySide | None], MeasureValue]) -> Row:
    scale = measure_scale(one.name, one.unit)
    left, right = by_side.get((one.name, "left")), by_side.get((one.name, "right"))
    return Row(
        name=one.name,
        title=measure_title(one.name),
        short=MAIN.get(one.name, measure_title(one.name)),
        unit=scale.unit,
        mean=scale.number(one.mean),
        interval="" if one.ci95 is None else f"{scale.number(one.ci95[0])} to {scale.number(one.ci95[1])}",
        left="" if left is None else scale.number(left.mean),
        right="" if right is None else scale.number(right.mean),
        symmetry="" if one.symmetry is None else f"{100.0 * one.symmetry:+z.1f} %",
        n=one.n,
    )


def measures_headline(summary: GaitMeasuresSummary) -> str:
    """The steps, their speed and their margin of stability sideways as one sentence."""
    rows = {row.name: row for row in measure_rows(summary)}
    known = []
    if speed := rows.get("walking_speed"):
        known.append(f"at {_with_interval(speed)}")
    if margin := rows.get("margin_of_stability_ml_min"):
        known.append(f"with a margin of stability of {_with_interval(margin)} sideways")
    steps = f"{count_text(summary.steps, 'step')} in {count_text(summary.n_recordings, 'recording')}"
    few = " Few steps: the intervals below are wide." if summary.steps < MIN_STEPS else ""
    return f"{' '.join([steps, *known])}.{few}"


def _with_interval(row: Row) -> str:
    value = f"{row.mean} {row.unit}".strip()
    return f"{value} ({row.interval}, 95 %)" if row.interval and row.n >= MIN_STEPS else value
