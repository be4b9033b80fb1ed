"""``stridelab measures``: measures of gait of one or more recordings of a person, pooled; writes a result folder."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.deliver import deliver_result, run_kind
from stridelab.cli.estimate import require_file
from stridelab.cli.options import Age, BestMethod, Delivery, Height, Mass, PersonSex, Static, with_groups
from stridelab.cli.results import Bar, out, show_files, show_quality, show_remarks, validate_options, write_result
from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.recordings.files.recording_files import recordings_in
from stridelab.schemas.jobs import EstimateComInput, JobResult
from stridelab.schemas.measures import GaitMeasuresInput, GaitMeasuresSummary, MeasureValue
from stridelab.schemas.recordings import RecordingPatch, SubjectFields
from stridelab.schemas.tasks import EstimateComTask, GaitMeasuresTask, MeasuresMember, RecordingSource

if TYPE_CHECKING:
    from stridelab.client import Client

KIND: Final = "gait-measures"
_SCALES: Final = {"m": (1e3, "mm", 1), "1": (1.0, "", 3), "s": (1.0, "s", 3), "1/min": (1.0, "1/min", 1)}


@with_groups
def measure_gait(
    *,
    files: Annotated[list[Path], typer.Argument(help="Recordings of one person, or folders of them; pooled.")],
    height_m: Height = None,
    mass_kg: Mass = None,
    sex: PersonSex = None,
    age_years: Age = None,
    method: BestMethod = None,
    static: Static = None,
    delivery: Delivery,
) -> None:
    """Measure margins of stability, steps, energy, work of the legs and angular momentum; needs no server."""
    stated = {"height_m": height_m, "mass_kg": mass_kg, "sex": sex, "age_years": age_years}
    subject = validate_options(SubjectFields, stated)

    def compute(folder: Path) -> JobResult:
        paths = _collect_recordings(files)
        if delivery.server is None:
            return _measure_here(paths, static, subject, method, folder)
        return _measure_there(paths, static, subject, method, folder, delivery)

    deliver_result("measures", delivery, compute, _show_measures)


def _collect_recordings(given: Sequence[Path]) -> list[Path]:
    """Given files and the recordings in given folders. Raises ``InvalidInput`` (``no-recordings``) without any."""
    paths: list[Path] = []
    for path in given:
        if path.is_dir():
            paths += recordings_in(path)
        else:
            require_file(path)
            paths.append(path)
    if not paths:
        named = ", ".join(str(path) for path in given)
        raise InvalidInput("no-recordings", f"There is no recording in {named}.", [Fault("FILES", "nothing")])
    return paths


def _measure_here(
    paths: Sequence[Path], static: Path | None, subject: SubjectFields, method: str | None, folder: Path
) -> JobResult:
    """Run the job's own function in this process."""
    ids = [f"recording-{index:03d}" for index in range(len(paths))]
    request = validate_options(GaitMeasuresInput, {"recording_ids": ids, "method": method})
    members = []
    for name, path in zip(ids, paths, strict=True):
        (folder / name).mkdir()
        shutil.copyfile(path, folder / name / "trial")
        source = RecordingSource(file="trial", filename=path.name, subject=subject)
        static_source = None
        if static is not None:
            shutil.copyfile(static, folder / name / "static-trial")
            static_source = RecordingSource(file="static-trial", filename=static.name)
        one = EstimateComInput(recording_id=name, method=request.method)
        task = EstimateComTask(recording=source, static=static_source, input=one)
        members.append(MeasuresMember(recording_id=name, folder=name, task=task))
    outcome = run_kind(KIND, "measures", GaitMeasuresTask(members=members), folder)
    for name in ids:
        shutil.rmtree(folder / name)
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
        static_id = None if static is None else client.upload(static, subject).id
        ids = []
        for index, path in enumerate(paths):
            bar(AFTER_UPLOAD * index / len(paths), f"uploading {path.name}")
            ids.append(client.upload(path, subject).id)
            if static_id is not None:
                client.patch_recording(ids[-1], RecordingPatch(static_recording_id=static_id))
        fields: Mapping[str, Any] = {"recording_ids": ids, "method": method}
        return validate_options(GaitMeasuresInput, fields)

    return run_remotely(KIND, "measures", upload_inputs, folder, delivery, unprepared=UnreadableFile)


def _show_measures(result: JobResult, target: Path) -> None:
    """Print a row per measure with both sides."""
    summary = GaitMeasuresSummary.model_validate(result.summary)
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
    for missing in summary.not_measured:
        out.print(f"[yellow]not measured[/] {missing.name.replace('_', ' ')}: {escape(missing.message)}")
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
