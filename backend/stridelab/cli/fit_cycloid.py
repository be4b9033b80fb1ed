"""``stridelab fit-cycloid``: fits the rolling wheel to every step of a recording and writes a result folder."""

from pathlib import Path
from typing import Final

from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import deliver_estimate
from stridelab.cli.options import (
    BestMethod,
    Delivery,
    EstimateRequest,
    Estimation,
    Preparation,
    StepChoice,
    Walk,
    with_groups,
)
from stridelab.cli.results import out, show_files, show_quality, show_remarks
from stridelab.schemas.cycloid import FitCycloidSummary, FitCycloidTask, FittedStep, Rival, StepScatter
from stridelab.schemas.jobs import JobResult

_WHEEL: Final = ("R mm", "r mm", "z0 m", "rad/s", "2piR/L", "mm", "worst", "s=-1", "clock")
_TIMES: Final = ("m/s", "L m", "both down", "by (3.3.3)", "best path", "best in time")


def fit_steps(request: EstimateRequest, delivery: Delivery) -> None:
    """Fit here or on a server, write the result folder and show the steps."""
    deliver_estimate("fit-cycloid", FitCycloidTask, request, f"{request.file.stem}-wheel", delivery, show_fit)


def show_fit(result: JobResult, target: Path) -> None:
    """Print a row per step, the scatter between steps and the best rival curves."""
    summary = FitCycloidSummary.model_validate(result.summary)
    show_quality(summary.quality, summary.warnings)
    mass = "mass not known" if summary.mass_kg is None else f"{summary.mass_kg:.1f} kg"
    out.print(f"{summary.method}, {summary.rate_hz:g} Hz, {mass}; steps left out: {summary.steps_left_out}")
    wheels = Table("", *_WHEEL, box=None, pad_edge=False)
    times = Table("", *_TIMES, box=None, pad_edge=False)
    for step in summary.steps:
        wheels.add_row(_step_name(step), *_wheel_cells(step))
        times.add_row(_step_name(step), *_timing_cells(step))
    out.print(wheels)
    out.print(_format_scatter(summary.step_to_step_sd))
    out.print(times)
    for step in summary.steps:
        if step.flags:
            out.print(f"[yellow]{_step_name(step)}[/] {escape(', '.join(step.flags))}")
    show_remarks(summary.warnings)
    show_files(result, target)


def _format_scatter(sd: StepScatter | None) -> str:
    if sd is None:
        return "[dim]only one step and no overlapping interval: the scatter is not known[/]"
    between = f"{sd.n} steps" if sd.between == "steps" else f"{sd.n} overlapping intervals"
    return (
        f"[dim]sd between {between}: R {1e3 * sd.R_m:.1f} mm, r {1e3 * sd.r_m:.1f} mm, z0 {1e3 * sd.z0_m:.1f} mm, "
        f"{sd.omega_rad_s:.2f} rad/s; errors in mm: mean, worst, with s = -1, at uniform rotation[/]"
    )


def _step_name(step: FittedStep) -> str:
    return f"{step.t0_s:.2f} s {step.side}"


def _wheel_cells(step: FittedStep) -> list[str]:
    share = "" if step.circumference_share is None else f"{step.circumference_share:.2f}"
    return [
        f"{1e3 * step.R_m:.1f}",
        f"{1e3 * step.r_m:.1f}",
        f"{step.z0_m:.3f}",
        f"{step.omega_rad_s:.2f}",
        share,
        f"{step.error_mean_mm:.2f}",
        f"{step.error_max_mm:.1f}",
        f"{step.reversed.error_mean_mm:.2f}",
        f"{step.timed.error_mean_mm:.1f}",
    ]


def _timing_cells(step: FittedStep) -> list[str]:
    length = "" if step.step_length_m is None else f"{step.step_length_m:.2f}"
    start_s, end_s = step.double_support_s
    rule = "-".join("?" if t is None else f"{t:.2f}" for t in step.double_support_model_s)
    best = {space: _best_model([r for r in step.rivals if r.space == space]) for space in ("path", "time")}
    return [
        f"{step.speed_m_s:.2f}", length, f"{start_s:.2f}-{end_s:.2f}", rule, best["path"], best["time"],
    ]  # fmt: skip


def _best_model(rivals: list[Rival]) -> str:
    return min(rivals, key=lambda rival: rival.aic).model if rivals else ""


@with_groups
def fit_cycloid(
    *,
    walk: Walk,
    steps: StepChoice = "measured",
    method: BestMethod = None,
    estimation: Estimation,
    preparation: Preparation,
    delivery: Delivery,
) -> None:
    """Fit the rolling wheel to every step of one recording; needs no server."""
    request = EstimateRequest(walk, method, estimation, preparation, steps)
    fit_steps(request, delivery)
