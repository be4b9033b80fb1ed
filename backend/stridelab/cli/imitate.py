"""``stridelab imitate``: a robot walks as the person of a recording."""

from pathlib import Path
from typing import Annotated, Final

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import deliver_estimate
from stridelab.cli.options import BestMethod, Delivery, EstimateRequest, Estimation, Preparation, Walk, with_groups
from stridelab.cli.results import out, show_files, show_quality
from stridelab.schemas.imitation.contract import ComparedQuantity, ImitateSummary, ImitateTask, WheelTrial
from stridelab.schemas.jobs import JobResult

PAGE_FILE: Final = "motion.html"
WHEEL_ROWS: Final = (
    ("com_excursion_m", "vertical excursion of the plan (m)"),
    ("acceleration_m2_s3", "int |c''|^2 dt of the plan (m^2/s^3)"),
    ("torque_squared_nm2s", "int |tau|^2 dt of the motion (N^2 m^2 s)"),
    ("joint_work_j", "int |tau omega| dt of the motion (J)"),
    ("momentum_mismatch_nms", "angular momentum against the plan, max (N m s)"),
    ("com_error_max_m", "CoM error in the replay, max (m)"),
    ("com_error_rms_m", "CoM error in the replay, RMS (m)"),
    ("torque_ratio_max", "torque over its limit in the replay, max"),
)


@with_groups
def imitate(
    *,
    walk: Walk,
    robot: Annotated[str, typer.Option("--robot", help="The robot that walks, e.g. talos.")],
    step_share: Annotated[
        float | None,
        typer.Option("--step-share", help="Length of the steps over the scaled ones; default: the longest."),
    ] = None,
    pace: Annotated[
        float | None, typer.Option("--pace", help="Pace over the scaled one; default: the fastest.")
    ] = None,
    wheel: Annotated[
        bool, typer.Option("--wheel/--no-wheel", help="Also plan with the person's rolling wheel as reference.")
    ] = True,
    method: BestMethod = None,
    estimation: Estimation,
    preparation: Preparation,
    delivery: Delivery,
) -> None:
    """Let a robot walk as the person of a recording, certified and replayed; needs no server."""
    options = {"robot": robot, "step_share": step_share, "pace": pace, "wheel": wheel}
    request = EstimateRequest(walk, method, estimation, preparation, more=options)
    deliver_estimate("imitate", ImitateTask, request, f"{walk.file.stem}-{robot}", delivery, show_imitation)


def show_imitation(result: JobResult, target: Path) -> None:
    """Print the pace, the comparison of person and robot, and that of the plans with and without the wheel."""
    summary = ImitateSummary.model_validate(result.summary)
    show_quality(summary.quality, summary.warnings)
    out.print(
        f"[bold]{escape(summary.robot)}[/] walks with {summary.step_share:.0%} of the person's steps and at "
        f"{summary.pace:.2f} of the pace, both scaled by the height of the hips "
        f"({summary.hip_height_person_m:.2f} to {summary.hip_height_robot_m:.2f} m): certified, replay completed, "
        f"{summary.speed_share:.0%} of the scaled speed; plans tried: {len(summary.attempts)}"
    )
    table = Table("", "person, measured", "scaled", f"{summary.robot}, in physics", box=None, pad_edge=False)
    for row in summary.comparison:
        unit = "" if row.unit == "1" else f" ({row.unit})"
        table.add_row(f"{row.name.replace('_', ' ')}{unit}", *_table_cells(row))
    out.print(table)
    if summary.wheel:
        wheels = Table("rolling wheel as reference", *(one.wheel for one in summary.wheel), box=None, pad_edge=False)
        wheels.add_row("certified, replay completed", *(_verdict_text(one) for one in summary.wheel))
        for name, title in WHEEL_ROWS:
            wheels.add_row(title, *(_number_text(getattr(one, name)) for one in summary.wheel))
        out.print(wheels)
    show_files(result, target)
    if any(artifact.name == PAGE_FILE for artifact in result.artifacts):
        out.print(f"To see the motion, open {escape(str(target / PAGE_FILE))} in a browser.")


def _table_cells(row: ComparedQuantity) -> list[str]:
    return [_number_text(value) for value in (row.person, row.scaled, row.robot)]


def _number_text(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _verdict_text(trial: WheelTrial) -> str:
    return "yes" if trial.certified and trial.completed else f"no: {escape(trial.reason)}"
