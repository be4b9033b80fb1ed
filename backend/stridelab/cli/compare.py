"""``stridelab compare`` and ``com-bench``: all estimators on one recording or on many, as a result folder."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import deliver_estimate
from stridelab.cli.options import Delivery, EstimateRequest, MomentOffsets, with_groups, with_plate_values
from stridelab.cli.results import deliver_result, out, run_kind, show_files, show_quality, show_remarks
from stridelab.cli.study_population import StudyFiles, collect_files, repeated_files, upload_and_run
from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.pipelines.progress import ItemMap, Json
from stridelab.schemas.comparison import (
    Axes,
    BenchColumn,
    BenchMember,
    BenchScore,
    ComBenchInput,
    ComBenchSummary,
    ComBenchTask,
    CompareEstimatorsSummary,
    CompareEstimatorsTask,
    MethodAssessment,
)
from stridelab.schemas.jobs import EstimateComInput, JobResult
from stridelab.schemas.methods import METHODS
from stridelab.schemas.population import LeftOut
from stridelab.schemas.recordings import PlateSwitch
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.local_runs import validate_options, write_result
from stridelab.service.subject_table import MatchedFile

BENCH: Final = "com-bench"


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
    name = f"{request.file.stem}-comparison"
    deliver_estimate("compare-estimators", CompareEstimatorsTask, request, name, delivery, show_comparison, truth)


def show_comparison(result: JobResult, target: Path) -> None:
    """Print one row per estimator."""
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


@with_groups
def bench_methods(
    *,
    files: Annotated[
        list[Path], typer.Argument(help="Folders of recordings, recordings, or zips of them; sub-folders are people.")
    ],
    subjects: Annotated[
        Path | None, typer.Option("--subjects", help="CSV: file, subject, height_m, mass_kg, sex, age, static.")
    ] = None,
    rows: Annotated[
        Path | None,
        typer.Option("--rows", help="File of finished recordings, from which a later run continues (JSON lines)."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the bootstrap intervals.")] = 0,
    moment_offset: MomentOffsets = None,
    delivery: Delivery,
) -> None:
    """Score all estimators on many recordings by what none of them was given; an interrupted run continues."""
    target = delivery.result_path(BENCH)
    finished = rows or target.with_name(f"{target.name}.rows.jsonl")
    plates = with_plate_values({}, moment_offset, "--moment-offset", "moment_offset_m", 3)

    def compute_result(folder: Path) -> JobResult:
        with tempfile.TemporaryDirectory(prefix="stridelab-") as work:
            given = collect_files(files, subjects, Path(work))
            if delivery.server is not None:
                if plates:
                    fault = Fault("--moment-offset", "the service takes it with a recording, by PATCH")
                    message = "--moment-offset is an option of runs without --server."
                    raise InvalidInput("option-invalid", message, [fault])
                return _bench_there(given, seed, folder, delivery)
            return _bench_here(given, repeated_files(given.files), seed, plates, finished, Path(work), folder)

    deliver_result(BENCH, delivery, compute_result, show_bench)
    if rows is None:
        finished.unlink(missing_ok=True)


def _bench_here(
    given: StudyFiles,
    repeated: dict[str, str],
    seed: int,
    plates: Mapping[int, PlateSwitch],
    finished: Path,
    work: Path,
    folder: Path,
) -> JobResult:
    """Run the job's own function in this process; files that repeat another one are listed as left out."""
    from stridelab.service.kinds.com_bench import run as com_bench

    members, left_out = [], []
    for one in given.matched_recordings:
        filename, path = given.files[one.index]
        recording_id = f"recording-{one.index:03d}"
        if filename in repeated:
            message = f"{filename} is the same file as {repeated[filename]}: a recording counts once."
            left_out.append(
                LeftOut(recording_id=recording_id, filename=filename, code="recording-twice", message=message)
            )
            continue
        own = work / recording_id
        own.mkdir()
        (own / "trial").symlink_to(path.resolve())
        person = None if one.row is None else one.row.person
        stated = {} if person is None else person.model_dump(include={"height_m", "mass_kg", "sex", "age_years"})
        fields = {"file": "trial", "filename": filename, "subject": stated, "plates": plates}
        source = RecordingSource.model_validate(fields)
        static = None
        if one.static_index is not None:
            static_name, static_path = given.files[one.static_index]
            (own / "static-trial").symlink_to(static_path.resolve())
            static = RecordingSource(file="static-trial", filename=static_name)
        task = EstimateComTask(recording=source, static=static, input=EstimateComInput(recording_id=recording_id))
        subject = _person_of(given, one)
        members.append(BenchMember(recording_id=recording_id, folder=recording_id, task=task, subject=subject))
    request = validate_options(ComBenchInput, {"recording_ids": [one.recording_id for one in members], "seed": seed})
    items = continued_map(com_bench.map_recordings, finished)
    outcome = run_kind(BENCH, BENCH, ComBenchTask(members=members, seed=seed), work, items=items)
    for artifact in outcome.artifacts:
        shutil.move(work / artifact.name, folder / artifact.name)
    outcome.summary["left_out"] += [one.model_dump() for one in left_out]
    return write_result(folder, BENCH, request, outcome)


def _bench_there(given: StudyFiles, seed: int, folder: Path, delivery: Delivery) -> JobResult:
    """Upload everything, run the job on the server and download its files."""

    def to_request(ids: Mapping[int, str]) -> ComBenchInput:
        named = {ids[one.index]: _person_of(given, one) for one in given.matched_recordings if one.index in ids}
        rows = [{"recording_id": key, "subject": name} for key, name in named.items() if name is not None]
        return validate_options(ComBenchInput, {"recording_ids": list(named), "subjects": rows, "seed": seed})

    return upload_and_run(given, BENCH, BENCH, to_request, folder, delivery)


def _person_of(given: StudyFiles, one: MatchedFile) -> str | None:
    """Pseudonym of the subject table, else the name of the sub-folder."""
    filename, _ = given.files[one.index]
    stated = None if one.row is None else one.row.person.subject
    return stated or (filename.split("/")[0] if "/" in filename else None)


def continued_map(map_items: ItemMap, finished: Path) -> ItemMap:
    """``map_items`` that stores every result in ``finished`` and does not compute those that are there.

    A result belongs to the content of the files, the task and the version of this software; errors are not stored.
    """
    import stridelab

    stored: dict[str, Json] = {}
    if finished.exists():
        for line in filter(None, finished.read_text().splitlines()):
            try:
                row = json.loads(line)
            except json.JSONDecodeError:  # an interrupted run may leave half a line
                continue
            stored[row["key"]] = row["answer"]

    def key_of(item: Json) -> str:
        digest = hashlib.sha256(json.dumps([stridelab.__version__, item["task"]], sort_keys=True).encode())
        for path in sorted(Path(item["folder"]).iterdir()):
            digest.update(path.read_bytes())
        return digest.hexdigest()

    def map_unfinished(work: Any, items: list[Json]) -> Iterator[tuple[int, Json | StridelabError]]:
        keys = [key_of(item) for item in items]
        open_items = [index for index, key in enumerate(keys) if key not in stored]
        yield from ((index, stored[key]) for index, key in enumerate(keys) if key in stored)
        with finished.open("a") as lines:
            lines.write("\n" if lines.tell() else "")  # ends a line that an interrupted run left
            for place, answer in map_items(work, [items[index] for index in open_items]):
                index = open_items[place]
                if not isinstance(answer, StridelabError):
                    lines.write(json.dumps({"key": keys[index], "answer": answer}) + "\n")
                    lines.flush()
                yield index, answer

    return map_unfinished


def show_bench(result: JobResult, target: Path) -> None:
    """Print one table per movement with a row per score."""
    summary = ComBenchSummary.model_validate(result.summary)
    out.print(f"{summary.n_recordings} recordings of {summary.n_people} people")
    for movement in dict.fromkeys(column.movement for column in summary.columns):
        table = Table(movement, "people", *METHODS, box=None, pad_edge=False)
        for column in summary.columns:
            if column.movement == movement:
                cells = [_format_score(column, column.scores.get(method)) for method in METHODS]
                title = column.name.removeprefix(f"{movement}_").replace("_", " ") + _unit_of(column)
                table.add_row(f"[bold]{title}[/]" if column.orders else title, str(column.n), *cells)
        out.print(table)
    out.print("[dim]bold: scores that order estimators as the truth does on simulated people; 95 % in brackets[/]")
    if summary.mass.rms_share is not None:
        out.print(f"mass by the plates: {100 * summary.mass.rms_share:.1f} % RMS off the stated one")
    for refusal in summary.refused:
        out.print(f"[yellow]{refusal.method}[/] {escape(refusal.filename)}: {escape(refusal.message)}")
    for left_out in summary.left_out:
        out.print(f"[yellow]left out[/] {escape(left_out.filename)}: {escape(left_out.message)}")
    show_remarks(summary.warnings)
    show_files(result, target)


def _unit_of(column: BenchColumn) -> str:
    return " mm" if column.unit == "m" else " %"


def _format_score(column: BenchColumn, score: BenchScore | None) -> str:
    if score is None:
        return ""
    scale = 1e3 if column.unit == "m" else 1e2
    interval = "" if score.ci95 is None else f" ({scale * score.ci95[0]:.1f} to {scale * score.ci95[1]:.1f})"
    return f"{scale * score.value:.1f}{interval}"
