"""An imitation on the page of a job: pace and steps, person and robot in one table, curves, and plans with a wheel."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from starlette.concurrency import run_in_threadpool

from stridelab.schemas.imitation.contract import ComparedQuantity, ImitateSummary, WheelTrial
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.measures import MEASURE_TITLES
from stridelab_web.api_client import JobFiles
from stridelab_web.charts.svg import Chart, range_of
from stridelab_web.formatting import robot_title
from stridelab_web.parquet import read_columns

KIND: Final = "imitate"
TABLE: Final = "curves.parquet"
TITLES: Final[Mapping[str, str]] = {
    "com_height": "Height of the centre of mass",
    "wheel_R": "Rolling wheel, R",
    "wheel_r": "Rolling wheel, r",
    "wheel_z0": "Rolling wheel, z0",
    "wheel_omega": "Rolling wheel, angular speed",
}
"""Titles of the quantities that are no measures of gait."""
CURVES: Final[Mapping[str, tuple[str, str]]] = {
    "com_height_m": ("Height of the centre of mass, from its mean", "height [mm]"),
    "com_sideways_m": ("Centre of mass towards the standing foot", "sideways [mm]"),
    "com_speed_m_s": ("Speed of the centre of mass, from its mean", "speed [mm/s]"),
    "margin_m": ("Margin of stability sideways, single support", "margin [mm]"),
}
LEGEND: Final = (
    ("measured", "line", "person, measured, scaled to the robot"),
    ("", "line", "robot, replayed in physics"),
)
WHEELS: Final = {"none": "Without", "thesis": "Wheel of the thesis", "reversed": "Wheel with s = −1"}
TRIAL_ROWS: Final = (
    ("com_excursion_m", "Vertical excursion of the plan", 1000.0, "mm", 1),
    ("acceleration_m2_s3", "∫ |c″|² dt of the plan", 1.0, "m²/s³", 2),
    ("torque_squared_nm2s", "∫ |τ|² dt of the motion", 1e-3, "10³ N²m²s", 1),
    ("joint_work_j", "∫ |τω| dt of the motion", 1.0, "J", 0),
    ("momentum_mismatch_nms", "Angular momentum against the plan, largest", 1.0, "N m s", 2),
    ("com_error_max_m", "Replay: error of the centre of mass, largest", 1000.0, "mm", 2),
    ("com_error_rms_m", "Replay: error of the centre of mass, RMS", 1000.0, "mm", 2),
    ("torque_ratio_max", "Replay: torque over its limit, largest", 1.0, "", 2),
)
"""Field, title, factor, unit and digits of the table of plans with and without a wheel."""


@dataclass(frozen=True)
class Row:
    """One quantity as text; ``–`` where it is not known."""

    name: str
    title: str
    unit: str
    person: str
    scaled: str
    robot: str
    n: str


async def imitation_of(files: JobFiles, result: JobResult) -> dict[str, Any]:
    """Values of _imitation.html."""
    summary = ImitateSummary.model_validate(result.summary)
    content = await files.read_file(TABLE)
    return {
        "summary": summary,
        "headline": imitation_headline(summary),
        "rows": [compared_row(row) for row in summary.comparison],
        "charts": await run_in_threadpool(draw_curves, content) if content is not None else [],
        "legend": LEGEND,
        "wheels": [WHEELS[trial.wheel] for trial in summary.wheel],
        "trials": trial_rows(summary.wheel),
    }


def imitation_headline(summary: ImitateSummary) -> str:
    """Steps, pace and speed in one sentence."""
    return (
        f"{robot_title(summary.robot)} walks with {summary.step_share:.0%} of the person’s step length and at "
        f"{summary.pace:.2f} of the person’s pace, both scaled by the height of the hips: certified, and completed in "
        f"physics with the centre of mass at most {1000 * summary.replay.com_error_max_m:.1f} mm off. Its speed is "
        f"{summary.speed_share:.0%} of the person’s, scaled."
    )


def compared_row(row: ComparedQuantity) -> Row:
    """One row of the table of person and robot."""
    factor, unit, digits = {"m": (1000.0, "mm", 0), "1": (100.0, "%", 0)}.get(row.unit, (1.0, row.unit, 2))

    def text_of(value: float | None) -> str:
        return "–" if value is None else f"{factor * value:z.{digits}f}"

    title = TITLES.get(row.name) or MEASURE_TITLES.get(row.name, row.name)
    values = (text_of(row.person), text_of(row.scaled), text_of(row.robot))
    return Row(row.name, title, unit, *values, f"{row.n_person}, {row.n_robot}")


def trial_rows(trials: list[WheelTrial]) -> list[tuple[str, str, list[str]]]:
    """Title, unit and one text per plan of every row; empty without plans."""
    if not trials:
        return []
    outcomes = ["yes" if trial.certified and trial.completed else f"no: {trial.reason}" for trial in trials]
    rows = [("Certified and completed", "", outcomes)]
    for name, title, factor, unit, digits in TRIAL_ROWS:
        values = [getattr(trial, name) for trial in trials]
        rows.append((title, unit, ["–" if value is None else f"{factor * value:.{digits}f}" for value in values]))
    return rows


def draw_curves(content: bytes) -> list[Chart]:
    """One chart per curve over a step."""
    columns = read_columns(content)
    share = 100.0 * columns["step_share"]
    charts = []
    for column, (title, y_title) in CURVES.items():
        person, robot = (1000.0 * columns[f"{who}_{column}"] for who in ("person", "robot"))
        chart = Chart((0.0, 100.0), range_of(person, robot), "share of the step [%]", y_title, height=240.0)
        chart.add_curve(share, person, "measured", f"{title}: person, measured, scaled")
        chart.add_curve(share, robot, "", f"{title}: robot, replayed in physics")
        apart = _largest(person, robot, y_title.rpartition("[")[2].rstrip("]"))
        charts.append(chart.with_caption(f"{title}; largest difference {apart}"))
    return charts


def _largest(person: np.ndarray, robot: np.ndarray, unit: str) -> str:
    apart = np.abs(person - robot)
    return f"{np.nanmax(apart):.0f} {unit}" if np.isfinite(apart).any() else "not known"
