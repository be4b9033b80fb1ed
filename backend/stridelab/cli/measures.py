"""``stridelab measures`` and ``stridelab report``: measures of gait of the recordings of a person, pooled."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.options import BestMethod, Delivery, StatedPerson, Static, with_groups
from stridelab.cli.results import Bar, deliver_result, out, run_in_scratch, show_files, show_quality, show_remarks
from stridelab.errors import UnreadableFile
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.measures import (
    REASON_OF,
    GaitMeasuresInput,
    GaitMeasuresTask,
    GaitReportInput,
    GaitReportSummary,
    GaitReportTask,
    MeasureValue,
)
from stridelab.schemas.recordings import RecordingPatch, SubjectFields
from stridelab.service.local_recordings import ReportWalks, people_in, report_task, share_by_day, stage_walks
from stridelab.service.local_runs import RESULT_FILE, collect_recordings, validate_options, write_result
from stridelab.service.settings import current_settings

if TYPE_CHECKING:
    from stridelab.client import Client

KIND: Final = "gait-measures"
REPORT_KIND: Final = "gait-report"
PDF: Final = "report.pdf"
_SCALES: Final = {
    "m": (1e3, "mm", 1),
    "1": (1.0, "", 3),
    "s": (1.0, "s", 3),
    "1/min": (1.0, "1/min", 1),
    "rad/s": (1.0, "rad/s", 2),
}


@with_groups
def measure_gait(
    *,
    files: Annotated[list[Path], typer.Argument(help="Recordings of one person, or folders of them; pooled.")],
    person: StatedPerson,
    method: BestMethod = None,
    static: Static = None,
    delivery: Delivery,
) -> None:
    """Measure margins of stability, steps, energy, work of the legs and angular momentum; needs no server."""
    subject = person.subject_fields()

    def compute_result(folder: Path) -> JobResult:
        paths = collect_recordings(files)
        if delivery.server is None:
            return _measure_here(paths, static, subject, method, folder)
        return _measure_there(paths, static, subject, method, folder, delivery)

    deliver_result("measures", delivery, compute_result, _show_measures)


def _measure_here(
    paths: Sequence[Path], static: Path | None, subject: SubjectFields, method: str | None, folder: Path
) -> JobResult:
    """Run the job's own function in this process."""

    def stage_members(work: Path) -> GaitMeasuresTask:
        return GaitMeasuresTask(members=share_by_day(stage_walks(paths, work, subject, method, static), work))

    task, outcome = run_in_scratch(KIND, "measures", stage_members, folder)
    ids = [one.recording_id for one in task.members]
    request = validate_options(GaitMeasuresInput, {"recording_ids": ids, "method": method})
    return write_result(folder, KIND, request, outcome)


def _measure_there(
    paths: Sequence[Path],
    static: Path | None,
    subject: SubjectFields,
    method: str | None,
    folder: Path,
    delivery: Delivery,
) -> JobResult:
    """Upload the recordings, run the job on the server and download its files."""
    from stridelab.cli.remote import AFTER_UPLOAD, run_remotely

    def upload_inputs(client: "Client", bar: Bar) -> GaitMeasuresInput:
        ids = _upload_walks(client, paths, subject, static, lambda share, text: bar(AFTER_UPLOAD * share, text))
        fields: Mapping[str, Any] = {"recording_ids": ids, "method": method}
        return validate_options(GaitMeasuresInput, fields)

    return run_remotely(KIND, "measures", upload_inputs, folder, delivery, unprepared=UnreadableFile)


def _upload_walks(
    client: "Client",
    paths: Sequence[Path],
    subject: SubjectFields,
    static: Path | None,
    progress: Callable[[float, str], None],
) -> list[str]:
    """Upload recordings of one person; returns their ids."""
    static_id = None if static is None else client.upload(static, subject).id
    ids = []
    for index, path in enumerate(paths):
        progress(index / len(paths), f"uploading {path.name}")
        ids.append(client.upload(path, subject).id)
        if static_id is not None:
            client.patch_recording(ids[-1], RecordingPatch(static_recording_id=static_id))
    return ids


@with_groups
def report_gait(
    *,
    files: Annotated[list[Path], typer.Argument(help="Recordings of one person, or folders of them; pooled.")],
    reference: Annotated[
        Path | None,
        typer.Option("--reference", help="Folder of other people: a subfolder, or a file beside them, is a person."),
    ] = None,
    before: Annotated[
        list[Path] | None, typer.Option("--before", help="Earlier recordings of the person, or folders; repeatable.")
    ] = None,
    title: Annotated[str | None, typer.Option("--title", help="Heading; the only place for a name.")] = None,
    language: Annotated[
        str | None,
        typer.Option("--language", help="Language of the report: en, de, fr or ja; else STRIDELAB_LANGUAGE, else en."),
    ] = None,
    pdf: Annotated[bool, typer.Option("--pdf", help="Also write report.pdf; needs no browser.")] = False,
    person: StatedPerson,
    method: BestMethod = None,
    static: Static = None,
    delivery: Delivery,
) -> None:
    """Write a report on the gait of a person as one page of HTML, and as PDF; needs no server."""
    subject = person.subject_fields()
    walks = ReportWalks(
        collect_recordings(files),
        [] if reference is None else people_in(reference),
        collect_recordings(before) if before else [],
    )

    def compute_result(folder: Path) -> JobResult:
        run = _report_here if delivery.server is None else _report_there
        fields = {"title": title, "method": method, "language": language or current_settings().language or "en"}
        result = run(walks, subject, fields, static, folder, delivery)
        if not pdf:
            (folder / PDF).unlink()
            kept = [one for one in result.artifacts if one.name != PDF]
            result = result.model_copy(update={"artifacts": kept})
            (folder / RESULT_FILE).write_text(result.model_dump_json(indent=2) + "\n", encoding="utf-8")
        return result

    deliver_result("report", delivery, compute_result, _show_measures)


def _report_here(
    walks: ReportWalks,
    subject: SubjectFields,
    fields: Mapping[str, Any],
    static: Path | None,
    folder: Path,
    _delivery: Delivery,
) -> JobResult:
    def stage_report(work: Path) -> GaitReportTask:
        return report_task(walks, subject, fields, static, work)

    task, outcome = run_in_scratch(REPORT_KIND, "report", stage_report, folder)
    return write_result(folder, REPORT_KIND, task.input, outcome)


def _report_there(
    walks: ReportWalks,
    subject: SubjectFields,
    fields: Mapping[str, Any],
    static: Path | None,
    folder: Path,
    delivery: Delivery,
) -> JobResult:
    """Upload all recordings, those of the reference group under the names of their folders; run and download."""
    from stridelab.cli.remote import AFTER_UPLOAD, run_remotely

    walks.refuse_shared_files()

    def upload_inputs(client: "Client", bar: Bar) -> GaitReportInput:
        def show_upload(share: float, text: str) -> None:
            bar(AFTER_UPLOAD * share, text)

        reference = []
        for number, paths in enumerate(walks.people, start=1):
            person = SubjectFields(name=f"reference {number}")
            reference += _upload_walks(client, paths, person, None, show_upload)
        ids = [_upload_walks(client, paths, subject, static, show_upload) for paths in (walks.person, walks.before)]
        request = {"recording_ids": ids[0], "before_recording_ids": ids[1], "reference_recording_ids": reference}
        return validate_options(GaitReportInput, {**fields, **request})

    return run_remotely(REPORT_KIND, "report", upload_inputs, folder, delivery, unprepared=UnreadableFile)


def _show_measures(result: JobResult, target: Path) -> None:
    """Print a row per measure with both sides."""
    summary = GaitReportSummary.model_validate(result.summary)  # of a report, or of measures without its fields
    show_quality(summary.quality, summary.warnings)
    out.print(f"{summary.steps} steps in {summary.n_recordings} recordings")
    table = Table("", "mean", "95 %", "left", "right", "n", "", box=None, pad_edge=False)
    by_side = {(one.name, one.side): one for one in summary.measures}
    for one in summary.measures:
        if one.side is None:
            left, right = by_side.get((one.name, "left")), by_side.get((one.name, "right"))
            sides = (_format_mean(left), _format_mean(right))
            cells = [_format_mean(one), _format_interval(one), *sides, str(one.n), _display_unit(one)]
            table.add_row(one.name.replace("_", " "), *cells)
    out.print(table)
    given = {one.name for one in summary.measures}
    named = given | {missing.name for missing in summary.not_measured}
    for missing in summary.not_measured:
        alike = [name for name, other in REASON_OF.items() if other == missing.name and name not in named]
        titles = ", ".join(name.replace("_", " ") for name in (missing.name, *alike))
        out.print(f"[yellow]not measured[/] {titles}: {escape(missing.message)}")
    for left_out in summary.left_out:
        out.print(f"[yellow]left out[/] {escape(left_out.filename)}: {escape(left_out.message)}")
    show_remarks(summary.warnings)
    show_files(result, target)


def _display_scale(one: MeasureValue) -> tuple[float, str, int]:
    return _SCALES.get(one.unit, (1.0, one.unit, 3))


def _display_unit(one: MeasureValue) -> str:
    return _display_scale(one)[1]


def _format_mean(one: MeasureValue | None) -> str:
    if one is None:
        return ""
    scale, _, digits = _display_scale(one)
    return f"{scale * one.mean:.{digits}f}"


def _format_interval(one: MeasureValue) -> str:
    if one.ci95 is None:
        return ""
    scale, _, digits = _display_scale(one)
    return f"{scale * one.ci95[0]:.{digits}f} to {scale * one.ci95[1]:.{digits}f}"
