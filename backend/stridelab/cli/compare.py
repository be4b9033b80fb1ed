"""``stridelab compare``: compares all estimators on one recording and writes a result folder."""

import shutil
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import require_file, staged_files
from stridelab.cli.options import Delivery, EstimateRequest
from stridelab.cli.results import (
    end_if_contradicted,
    out,
    progress_bar,
    refuse_to_overwrite,
    result_folder,
    show_files,
    show_json,
    show_quality,
    show_remarks,
    write_result,
)
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.comparison import Axes, CompareEstimatorsInput, CompareEstimatorsSummary, MethodAssessment
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.methods import METHODS
from stridelab.schemas.tasks import CompareEstimatorsTask

TRUTH = "known-truth.parquet"


def compare_methods(
    request: EstimateRequest,
    *,
    truth: Path | None,
    delivery: Delivery,
) -> None:
    """Compare here or on a server, write the result folder and show the table."""
    if truth is not None and delivery.server is not None:
        fault = Fault("--truth", "contradicts --server")
        raise InvalidInput("option-invalid", "A service knows the truth of its own simulated recordings only.", [fault])
    target = delivery.result_path(f"{request.file.stem}-comparison")
    refuse_to_overwrite(target, force=delivery.force)
    for path in (*request.files, request.static, truth):
        if path is not None:
            require_file(path)
    with result_folder(target, force=delivery.force) as folder:
        if delivery.server is None:
            result = compare_here(request, folder, truth)
        else:
            from stridelab.cli.remote import estimate_remotely

            kind = "compare-estimators"
            result = estimate_remotely(request, folder, delivery.server, delivery.token, kind, CompareEstimatorsInput)
    show_comparison(result, target, as_json=delivery.as_json)
    end_if_contradicted(result)


def compare_here(request: EstimateRequest, folder: Path, truth: Path | None) -> JobResult:
    """Run the job's own function in this process."""
    from stridelab.service.kinds.compare_estimators import run as compare_estimators

    input_ = request.to_input(request.file.name, CompareEstimatorsInput)
    with progress_bar(request.file.name) as bar, staged_files(request, folder) as (recording, static):
        bar(0.0, "starting")
        if truth is not None:
            shutil.copyfile(truth, folder / TRUTH)
        task = CompareEstimatorsTask(
            recording=recording, static=static, input=input_, truth=None if truth is None else TRUTH
        )
        outcome = compare_estimators.run(task, folder, bar)
        (folder / TRUTH).unlink(missing_ok=True)
    return write_result(folder, "compare-estimators", input_, outcome)


def show_comparison(result: JobResult, target: Path, *, as_json: bool) -> None:
    """Print one row per estimator, or the result as JSON."""
    if as_json:
        show_json(result)
        return
    summary = CompareEstimatorsSummary.model_validate(result.summary)
    show_quality(summary.quality, summary.warnings)
    start_s, end_s = summary.window_s
    out.print(f"{start_s:.2f} to {end_s:.2f} s at {summary.rate_hz:g} Hz, {summary.mass_kg:.1f} kg")
    for heads, cells in _TABLES:
        rows = {name: cells(summary.methods[name]) for name in sorted(summary.methods, key=_method_order)}
        if any(any(row) for row in rows.values()):
            table = Table("", *heads, box=None, pad_edge=False)
            table.columns[0].no_wrap = True
            for name, row in rows.items():
                table.add_row(f"[bold]{escape(name)}[/]", *row)
            out.print(table)
    out.print("[dim]three numbers: along the walk / lateral / vertical[/]")
    for name, reason in summary.refused.items():
        out.print(f"[yellow]{escape(name)}[/] {escape(reason.message)} [dim]({escape(reason.code)})[/]")
    show_remarks(summary.warnings)
    show_files(result, target)


def _method_order(name: str) -> tuple[int, str]:
    """Sort key: the best method first, each followed by its variant with the thesis' settings."""
    plain = name.removesuffix("-thesis")
    return (METHODS.index(plain) if plain in METHODS else len(METHODS), name)


def _error_cells(a: MethodAssessment) -> list[str]:
    if a.truth is None:
        return [""] * 4
    t = a.truth
    lag = "" if t.lag_s.lateral is None else f"{1e3 * t.lag_s.lateral:.1f}"
    return [f"{1e3 * t.horizontal_m:.1f}", f"{1e3 * t.vertical_m:.1f}", _format_axes(t.coverage, 100.0, 0), lag]


def _force_cells(a: MethodAssessment) -> list[str]:
    held_back = "" if a.held_back_n is None else _format_axes(a.held_back_n)
    return [_format_axes(a.offset_m, 1e3), _format_axes(a.force_residual_n), held_back]


def _physics_cells(a: MethodAssessment) -> list[str]:
    return [
        "" if a.momentum_rate is None else _format_number(a.momentum_rate.correlation.lateral, 2),
        "" if a.standing_m is None else f"{1e3 * a.standing_m:.1f}",
        "" if a.flight is None else f"{100.0 * a.flight.vertical_share:+.1f}",
    ]


def _format_axes(axes: Axes, scale: float = 1.0, digits: int = 1) -> str:
    return " / ".join(
        _format_number(None if v is None else scale * v, digits) for v in (axes.along, axes.lateral, axes.vertical)
    )


def _format_number(value: float | None, digits: int) -> str:
    return "?" if value is None else f"{value:.{digits}f}"


_TABLES = (
    (("horizontal mm", "vertical mm", "in the band %", "lag ms"), _error_cells),
    (("offset mm", "residual N", "held back N"), _force_cells),
    (("r of dL/dt", "standing mm", "flight %"), _physics_cells),
)
"""Errors against the truth; agreement with the force; agreement with physics."""
