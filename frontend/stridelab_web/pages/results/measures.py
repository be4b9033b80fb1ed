"""Measures of gait on the page of a job: the main values, then all of them with both sides."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.measures import BodySide, GaitMeasuresSummary, MeasureValue
from stridelab_web.formatting import code_words, count_text

KIND: Final = "gait-measures"
TITLES: Final[Mapping[str, str]] = {
    "walking_speed": "Walking speed",
    "step_length": "Step length",
    "step_width": "Step width",
    "step_time": "Step time",
    "cadence": "Cadence",
    "double_support_share": "Double support, share of the step time",
    "stride_length": "Stride length",
    "stride_time": "Stride time",
    "stance_share": "Stance, share of the stride time",
    "swing_share": "Swing, share of the stride time",
    "margin_of_stability_ml_min": "Margin of stability sideways, minimum over single support",
    "margin_of_stability_ml_contact": "Margin of stability sideways, at the strike",
    "margin_of_stability_ap_contact": "Margin of stability ahead, at the strike",
    "capture_point_offset_ap": "Foot ahead of the capture point",
    "capture_point_offset_ml": "Foot outwards of the capture point",
    "com_vertical_excursion": "Vertical excursion of the centre of mass",
    "com_lateral_excursion": "Lateral excursion of the centre of mass",
    "energy_recovery": "Recovery of mechanical energy",
    "external_work": "External work per stride",
    "limb_work_left_positive": "Positive work of the left leg",
    "limb_work_left_negative": "Negative work of the left leg",
    "limb_work_right_positive": "Positive work of the right leg",
    "limb_work_right_negative": "Negative work of the right leg",
    "angular_momentum_range_x": "Range of the angular momentum about the axis ahead",
    "angular_momentum_range_y": "Range of the angular momentum about the lateral axis",
    "angular_momentum_range_z": "Range of the angular momentum about the vertical axis",
    "foot_placement_gain_position": "Foot placement, gain of the position",
    "foot_placement_gain_velocity": "Foot placement, gain of the velocity",
    "foot_placement_residual": "Foot placement, residual",
    "foot_placement_explained": "Foot placement, share of the variance explained",
}
"""Titles of the measures, in the order of the table; others follow under their names."""
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
MIN_STEPS: Final = 3
"""Steps below which the headline refers to the intervals: Student's quantile for two values is 12.7."""
METRES: Final = frozenset({"step_length", "stride_length"})
"""Lengths shown in metres; the others are in millimetres."""
PERCENT: Final = frozenset(
    {
        "double_support_share",
        "stance_share",
        "swing_share",
        "energy_recovery",
        "foot_placement_explained",
    }
)
"""Ratios shown in percent; the others are plain numbers."""


@dataclass(frozen=True)
class Scale:
    """How a measure is written: the factor to ``unit`` and the number of decimals."""

    factor: float
    unit: str
    digits: int

    def number(self, value: float) -> str:
        """``value`` without its unit."""
        return f"{self.factor * value:z.{self.digits}f}"


_SCALES: Final[Mapping[str, Scale]] = {
    "m": Scale(1000.0, "mm", 0),
    "s": Scale(1.0, "s", 3),
    "m/s": Scale(1.0, "m/s", 2),
    "J/kg": Scale(1.0, "J/kg", 2),
    "1/min": Scale(1.0, "1/min", 1),
    "1": Scale(1.0, "", 3),
}


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
    summary = GaitMeasuresSummary.model_validate(result.summary)
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
        "downloads": [name for name in ("measures.csv", "xcom.csv") if name in present],
    }


def measure_title(name: str) -> str:
    """Title of a measure; of one without an entry in ``TITLES``, its name in words."""
    return TITLES.get(name, code_words(name).capitalize())


def measure_scale(name: str, unit: str) -> Scale:
    """Factor, unit and decimals of a measure, the same for all its values."""
    if unit == "m" and name in METRES:
        return Scale(1.0, "m", 3)
    if name in PERCENT:
        return Scale(100.0, "%", 0)
    return _SCALES.get(unit, Scale(1.0, unit, 3))


def measure_rows(summary: GaitMeasuresSummary) -> tuple[Row, ...]:
    """All measures over both sides, in the order of ``TITLES``."""
    by_side = {(one.name, one.side): one for one in summary.measures}
    order = list(TITLES)
    both = [one for one in summary.measures if one.side is None]
    both.sort(key=lambda one: order.index(one.name) if one.name in TITLES else len(order))
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
