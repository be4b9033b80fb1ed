"""``stridelab estimate`` and ``stridelab simulate``: run the service's jobs here or there and write result folders."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_type_hints

from rich.markup import escape

from stridelab.cli.options import Delivery, EstimateRequest, parse_named_value, parse_numbers
from stridelab.cli.results import (
    Show,
    deliver_result,
    err,
    out,
    run_here,
    show_files,
    show_quality,
    show_remarks,
    show_rows,
)
from stridelab.schemas.jobs import (
    EstimateComInput,
    EstimateComSummary,
    JobResult,
    SimulateRecordingInput,
    SimulateRecordingSummary,
)
from stridelab.schemas.sessions import SessionValues
from stridelab.schemas.tasks import EstimateComTask, RecordingSource, SimulateRecordingTask
from stridelab.service.local_runs import require_file, validate_options

TRUTH = "known-truth.parquet"


def estimate_recording(request: EstimateRequest, delivery: Delivery) -> None:
    """Estimate one recording here or on a server, write the result folder and show the summary."""
    deliver_estimate("estimate-com", EstimateComTask, request, f"{request.file.stem}-com", delivery, show_estimate)


def deliver_estimate(
    kind: str,
    task_model: type[EstimateComTask],
    request: EstimateRequest,
    default_name: str,
    delivery: Delivery,
    show: Show,
    truth: Path | None = None,
) -> None:
    """Run a job on one recording here or on a server, write the result folder and show the result."""

    def compute_result(folder: Path) -> JobResult:
        for path in (*request.files, request.static, truth):
            if path is not None:
                require_file(path)
        if request.unstated_forces is not None:
            err.print(f"[dim]with the forces of[/] {escape(str(request.unstated_forces))}")
        if delivery.server is None:
            return estimate_here(request, folder, kind, task_model, truth=truth)
        from stridelab.cli.remote import estimate_remotely

        return estimate_remotely(request, folder, delivery, kind, _input_model(task_model))

    deliver_result(default_name, delivery, compute_result, show)


def estimate_here(
    request: EstimateRequest,
    folder: Path,
    kind: str = "estimate-com",
    task_model: type[EstimateComTask] = EstimateComTask,
    *,
    session: SessionValues | None = None,
    truth: Path | None = None,
) -> JobResult:
    """Run the job's own function in this process; ``folder`` then holds exactly what the service would publish.

    ``session`` holds the values that the trials of the recording's session share, ``truth`` is the file with the true
    motion.
    """
    input_ = request.to_input(request.file.name, _input_model(task_model))
    fields: dict[str, Any] = {"session": session, "input": input_}
    with staged_files(request, folder) as (recording, static):
        if truth is not None:
            shutil.copyfile(truth, folder / TRUTH)
            fields["truth"] = TRUTH
        task = task_model(recording=recording, static=static, **fields)
        return run_here(kind, request.file.name, task, folder)


def _input_model(task_model: type[EstimateComTask]) -> type[EstimateComInput]:
    model: type[EstimateComInput] = get_type_hints(task_model)["input"]
    return model


@contextmanager
def staged_files(request: EstimateRequest, folder: Path) -> Iterator[tuple[RecordingSource, RecordingSource | None]]:
    """Context manager that copies the files of a request into ``folder``, as the worker does."""
    recording = request.to_source("trial", subject=request.subject_fields())
    static = None
    if request.static is not None:
        static = RecordingSource(file="static-trial", filename=request.static.name, marker_sets=recording.marker_sets)
        shutil.copyfile(request.static, folder / "static-trial")
    request.write_upload(folder / "trial")
    yield recording, static
    for name in ("trial", "static-trial", TRUTH):
        (folder / name).unlink(missing_ok=True)


def simulate_walk(
    fields: Mapping[str, Any], *, noise: Sequence[str], out_dir: Path | None, force: bool, as_json: bool
) -> None:
    """Simulate one recording into a folder and show the summary."""
    stated = {
        key: parse_numbers("--noise", value, 1)[0]
        for key, value in (parse_named_value("--noise", text) for text in noise)
    }
    input_ = validate_options(SimulateRecordingInput, {**fields, "noise": stated})
    deliver_result(
        f"simulated-{input_.seed}",
        Delivery(out_dir, force, as_json),
        lambda folder: _simulate_here(input_, folder),
        _show_simulated,
    )


def _simulate_here(input_: SimulateRecordingInput, folder: Path) -> JobResult:
    from stridelab.service.kinds.simulate_recording.run import remove_private_files

    result = run_here("simulate-recording", "simulating", SimulateRecordingTask(input=input_), folder)
    remove_private_files(folder)
    return result


def _show_simulated(result: JobResult, target: Path) -> None:
    summary = SimulateRecordingSummary.model_validate(result.summary)
    out.print(f"{summary.n_steps} steps at {summary.speed_m_s:.2f} m/s")
    show_files(result, target)


def show_estimate(result: JobResult, target: Path) -> None:
    """Print the summary as a table."""
    summary = EstimateComSummary.model_validate(result.summary)
    show_quality(summary.quality, summary.warnings)
    show_rows(_summary_rows(summary))
    show_remarks(summary.warnings)
    show_files(result, target)


def _summary_rows(summary: EstimateComSummary) -> list[tuple[str, str]]:
    start_s, end_s = summary.window_s
    latency = "not estimated"
    if summary.latency_s is not None:
        spread = f" ± {1e3 * summary.latency_sd_s:.1f}" if summary.latency_sd_s is not None else ""
        latency = f"{1e3 * summary.latency_s:+.1f}{spread} ms, {1e3 * summary.latency_applied_s:.1f} ms applied"
        if summary.latency_source == "session":
            latency += f", of {summary.latency_n_trials} trials of the session"
    rows = [
        ("window", f"{start_s:.2f} to {end_s:.2f} s at {summary.rate_hz:g} Hz"),
        ("method", f"{summary.method}, segment table {summary.segment_table}"),
        ("mass", "not known" if summary.mass_kg is None else f"{summary.mass_kg:.1f} kg"),
        ("force latency", latency),
    ]
    if summary.treadmill is not None:
        belts = summary.treadmill
        speeds = f"left {belts.left_m_s:.2f} m/s, right {belts.right_m_s:.2f} m/s"
        known = "as stated" if belts.source == "stated" else "from the standing feet"
        rows.append(("treadmill", f"{speeds}, {known}; positions in the laboratory frame"))
    if summary.bias_m:
        rows.append(("fused minus geometry", _format_xyz([1e3 * value for value in summary.bias_m], "mm")))
    if summary.rms_force_residual_n:
        rows.append(("force residual, RMS", _format_xyz(summary.rms_force_residual_n, "N")))
    return rows


def _format_xyz(values: Sequence[float], unit: str) -> str:
    return " / ".join(f"{value:.1f}" for value in values) + f" {unit} (x / y / z)"


def run_job(kind: str, title: str, task: Any, folder: Path, delivery: Delivery) -> JobResult:
    """Run a job that needs no files, here or on the service of ``delivery``."""
    if delivery.server is None:
        return run_here(kind, title, task, folder)
    from stridelab.cli.remote import run_remotely_as_is

    return run_remotely_as_is(kind, title, task.input, folder, delivery)
