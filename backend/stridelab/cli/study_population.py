"""``stridelab study-population``: fits and correlates the wheels of many subjects and writes a result folder."""

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.options import BestMethod, Delivery, StepChoice, with_groups
from stridelab.cli.results import Bar, deliver_result, err, out, run_in_scratch, show_files, show_quality, show_remarks
from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.recordings.files.batch_zip import BatchLimits, is_batch, unpack_batch
from stridelab.recordings.files.recording_files import recordings_in
from stridelab.recordings.files.trial_pairs import forces_beside, pack_trial
from stridelab.schemas.base import Contract
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidTask
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.population import (
    MAX_RECORDINGS,
    CorrelationResult,
    StudyPopulationInput,
    StudyPopulationSummary,
    StudyPopulationTask,
    SubjectOfRecording,
)
from stridelab.schemas.recordings import RecordingPatch, SubjectFields
from stridelab.schemas.tasks import RecordingSource
from stridelab.service.local_runs import require_file, validate_options, write_result
from stridelab.service.subject_table import MatchedFile, TableRow, match_files, read_subject_table

if TYPE_CHECKING:
    from stridelab.client import Client

LIMITS: Final = BatchLimits(files=MAX_RECORDINGS, file_bytes=2_000_000_000, total_bytes=20_000_000_000)
PARAMETER_SYMBOLS: Final = {"R_m": "R", "r_m": "r", "z0_m": "z0", "omega_rad_s": "omega"}
REGRESSOR_NAMES: Final = {"height_m": "height", "leg_m": "leg", "speed_m_s": "speed", "step_length_m": "step length"}


@dataclass(frozen=True)
class StudyFiles:
    """Given recordings by the names that the subject table uses, and the rows of the table."""

    files: tuple[tuple[str, Path], ...]
    rows: tuple[TableRow, ...]

    @property
    def matched_recordings(self) -> tuple[MatchedFile, ...]:
        """The recordings with their rows."""
        return match_files([name for name, _ in self.files], self.rows)


def collect_recordings(paths: Sequence[Path], subjects: Path | None, folder: Path) -> StudyFiles:
    """All recordings below ``paths``: files, folders (searched through) and zips of recordings (unpacked).

    Raises as ``collect_files`` does, and ``InvalidInput`` (``recording-twice``).
    """
    given = collect_files(paths, subjects, folder)
    for name, same in repeated_files(given.files).items():
        message = f"{name} is the same file as {same}: a recording counts once."
        raise InvalidInput("recording-twice", message, [Fault(name, "given twice")])
    return given


def collect_files(paths: Sequence[Path], subjects: Path | None, folder: Path) -> StudyFiles:
    """``collect_recordings`` where the same file may occur twice.

    Raises ``InvalidInput`` (``no-recordings``, ``subject-table-twice``, ``subject-table-invalid``) and what
    ``unpack_batch`` raises.
    """
    files: list[tuple[str, Path]] = []
    table: bytes | None = None
    if subjects is not None:
        require_file(subjects)
        table = subjects.read_bytes()
    for index, path in enumerate(paths):
        if path.is_dir():
            for recording in recordings_in(path):
                forces = forces_beside(recording)
                packed = recording if forces is None else folder / f"trial-{len(files)}.zip"
                if forces is not None:
                    pack_trial((recording, forces), packed)
                files.append((recording.relative_to(path).as_posix(), packed))
            continue
        require_file(path)
        if not is_batch(path):
            files.append((path.name, path))
            continue
        own = folder / f"zip-{index}"
        own.mkdir()
        batch = unpack_batch(path, own, LIMITS)
        files += batch.files
        if batch.table is not None and table is not None:
            fault = Fault(str(path), "holds a .csv, and there is another table")
            raise InvalidInput("subject-table-twice", "There are two subject tables; one is read.", [fault])
        table = batch.table if batch.table is not None else table
    if not files:
        named = ", ".join(str(path) for path in paths)
        raise InvalidInput("no-recordings", f"There is no .c3d, .trc or .zip in {named}.", [Fault("FILES", "nothing")])
    return StudyFiles(tuple(files), () if table is None else read_subject_table(table))


def repeated_files(files: Sequence[tuple[str, Path]]) -> dict[str, str]:
    """Names of files that repeat an earlier one, and the name of that."""
    first: dict[str, str] = {}
    repeated = {}
    for name, path in files:
        digest = _file_sha256(path)
        if digest in first:
            repeated[name] = first[digest]
        first.setdefault(digest, name)
    return repeated


def _file_sha256(path: Path) -> str:
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def study_here(given: StudyFiles, options: Mapping[str, Any], folder: Path) -> JobResult:
    """Run the job's own function in this process; ``folder`` then holds what the service would publish."""
    ids = {one.index: f"recording-{k}" for k, one in enumerate(given.matched_recordings)}
    request = request_of(given, ids, options)

    def stage_members(work: Path) -> StudyPopulationTask:
        members = [_stage_member(given, one, ids[one.index], request, work) for one in given.matched_recordings]
        return StudyPopulationTask(members=members, pooled=request.pooled, seed=request.seed)

    _, outcome = run_in_scratch("study-population", "population", stage_members, folder)
    return write_result(folder, "study-population", request, outcome)


def upload_and_run(
    given: StudyFiles,
    kind: str,
    title: str,
    to_request: Callable[[Mapping[int, str]], Contract],
    folder: Path,
    delivery: Delivery,
) -> JobResult:
    """Upload everything, run a job on the server of ``delivery`` and download its files; prints refused files.

    ``to_request`` returns the job's input for the ids of the stored recordings by index of the file.
    """
    from stridelab.cli.remote import AFTER_UPLOAD, run_remotely

    def upload_inputs(client: "Client", bar: Bar) -> Contract:
        def show_upload(sent: int, total: int) -> None:
            bar(AFTER_UPLOAD * sent / max(total, 1), "uploading")

        stored = client.upload_batch(given.files, progress=show_upload)
        by_hash = {one.sha256: one.id for one in stored.recordings}
        everywhere = {place: by_hash.get(_file_sha256(path)) for place, (_, path) in enumerate(given.files)}
        ids = {place: recording_id for place, recording_id in everywhere.items() if recording_id is not None}
        for refused in stored.refused:
            err.print(f"[yellow]refused[/] {escape(refused.filename)}: {escape(refused.message)}")
        for one in given.matched_recordings:
            if one.index in ids and one.static_index is not None and one.static_index in ids:
                client.patch_recording(ids[one.index], RecordingPatch(static_recording_id=ids[one.static_index]))
        return to_request(ids)

    return run_remotely(kind, title, upload_inputs, folder, delivery, unprepared=UnreadableFile)


def request_of(given: StudyFiles, ids: Mapping[int, str], options: Mapping[str, Any]) -> StudyPopulationInput:
    """The job's input; ``ids`` are the ids of the stored recordings by index of the file."""
    studied = [one for one in given.matched_recordings if one.index in ids]
    rows = [
        SubjectOfRecording(recording_id=ids[one.index], **one.row.person.model_dump())
        for one in studied
        if one.row is not None
    ]
    fields = {"recording_ids": [ids[one.index] for one in studied], "subjects": rows, **options}
    return validate_options(StudyPopulationInput, fields)


def _stage_member(
    given: StudyFiles, one: MatchedFile, recording_id: str, request: StudyPopulationInput, work: Path
) -> Any:
    from stridelab.service.kinds.study_population.kind import population_member

    (work / recording_id).mkdir()
    filename, path = given.files[one.index]
    shutil.copyfile(path, work / recording_id / "trial")
    static = None
    if one.static_index is not None:
        static_name, static_path = given.files[one.static_index]
        shutil.copyfile(static_path, work / recording_id / "static-trial")
        static = RecordingSource(file="static-trial", filename=static_name)
    source = RecordingSource(file="trial", filename=filename, subject=SubjectFields())
    fit = FitCycloidInput(recording_id=recording_id, method=request.method, steps=request.steps)
    task = FitCycloidTask(recording=source, static=static, input=fit)
    row = next((row for row in request.subjects if row.recording_id == recording_id), None)
    return population_member(recording_id, task, row)


def show_study(result: JobResult, target: Path) -> None:
    """Print a row per subject and per correlation."""
    summary = StudyPopulationSummary.model_validate(result.summary)
    show_quality(summary.quality, summary.warnings)
    subjects = Table("", "group", "steps", "height m", "speed m/s", "R mm", "r mm", "z0 m", "omega rad/s", "error mm",
                   box=None, pad_edge=False)  # fmt: skip
    for one in summary.subjects:
        subjects.add_row(
            f"[bold]{escape(one.subject)}[/]", escape(one.group), str(one.n_steps), _format_optional(one.height_m, 2),
            _format_optional(one.speed_m_s, 2), _with_sd(one.R_m, one.R_sd_m, 1e3, 1),
            _with_sd(one.r_m, one.r_sd_m, 1e3, 1),
            _with_sd(one.z0_m, one.z0_sd_m, 1.0, 3), _with_sd(one.omega_rad_s, one.omega_sd_rad_s, 1.0, 1),
            f"{one.error_mean_mm:.2f}",
        )  # fmt: skip
    out.print(subjects)
    if summary.correlations:
        pairs = Table("", "against", "n", "r", "95 %", "p", "p of all", "at one speed", "thesis",
                      box=None, pad_edge=False)  # fmt: skip
        for pair in summary.correlations:
            pairs.add_row(*_correlation_cells(pair))
        out.print(pairs)
    for left in summary.left_out:
        out.print(f"[yellow]left out[/] {escape(left.filename)}: {escape(left.message)} [dim]({escape(left.code)})[/]")
    show_remarks(summary.warnings)
    show_files(result, target)


def _correlation_cells(pair: CorrelationResult) -> list[str]:
    interval = "" if pair.ci95 is None else f"{pair.ci95[0]:+.2f} to {pair.ci95[1]:+.2f}"
    return [
        f"[bold]{escape(pair.group)} {PARAMETER_SYMBOLS[pair.parameter]}[/]",
        REGRESSOR_NAMES[pair.against],
        str(pair.n),
        f"{pair.r:+.2f}",
        interval,
        f"{pair.p:.3f}",
        f"{pair.p_holm:.3f}",
        _format_optional(pair.partial_on_speed, 2),
        _format_optional(pair.thesis, 2),
    ]


def _format_optional(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _with_sd(value: float, sd: float | None, scale: float, digits: int) -> str:
    spread = "" if sd is None else f" ± {scale * sd:.{digits}f}"
    return f"{scale * value:.{digits}f}{spread}"


@with_groups
def study_population(
    *,
    files: Annotated[
        list[Path],
        typer.Argument(help="Recordings (.c3d, .trc, or .zip of TRC and MOT), folders of them, or zips of them."),
    ],
    subjects: Annotated[
        Path | None, typer.Option("--subjects", help="CSV: file, subject, group, height_m, mass_kg, sex, age, static.")
    ] = None,
    method: BestMethod = None,
    steps: StepChoice = "measured",
    pooled: Annotated[bool, typer.Option("--pooled", help="Also correlate all groups together.")] = False,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the bootstrap intervals.")] = 0,
    delivery: Delivery,
) -> None:
    """Fit the wheels of many subjects, and correlate them with height, leg, speed and step length."""
    options = {"method": method, "steps": steps, "pooled": pooled, "seed": seed}

    def compute_result(folder: Path) -> JobResult:
        with tempfile.TemporaryDirectory(prefix="stridelab-") as unpacked:
            given = collect_recordings(files, subjects, Path(unpacked))
            if delivery.server is None:
                return study_here(given, options, folder)
            to_request = partial(request_of, given, options=options)
            return upload_and_run(given, "study-population", "population", to_request, folder, delivery)

    deliver_result("population", delivery, compute_result, show_study)
