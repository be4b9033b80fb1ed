"""``sl.gait_measures`` and ``sl.gait_report``: margins of stability, steps, energy, work, angular momentum of walks."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from stridelab.library.job_files import write_job_files
from stridelab.library.options import Progress, data_frame, ignore_progress, validate_fields
from stridelab.library.recordings import LoadedRecording, load_recording, staged_sources
from stridelab.pipelines.gait_measures.pooled import GaitMeasuresResult
from stridelab.pipelines.gait_measures.pooled import gait_measures as _gait_measures
from stridelab.pipelines.gait_report.html import render_html
from stridelab.pipelines.gait_report.pdf import render_pdf
from stridelab.pipelines.gait_report.report import GaitReport as ComposedReport
from stridelab.pipelines.gait_report.report import gait_report as _compose_report
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import (
    GaitMeasuresInput,
    GaitMeasuresSummary,
    GaitMeasuresTask,
    GaitReportInput,
    GaitReportSummary,
    MeasuresMember,
)
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import EstimateComTask


@dataclass(frozen=True)
class GaitMeasures:
    """Measures of gait per step of a recording, from ``gait_measures``."""

    loaded: LoadedRecording
    request: GaitMeasuresInput
    result: GaitMeasuresResult

    @property
    def summary(self) -> GaitMeasuresSummary:
        """The summary of the job ``gait-measures``: means per measure and side, and what cannot be measured."""
        return self.result.summary

    def to_dataframe(self) -> Any:
        """One row per value, as a data frame of pandas, or of polars if pandas is not installed.

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither pandas nor polars is installed.
        """
        from stridelab.service.kinds.gait_measures.run import measure_columns

        return data_frame(measure_columns(self.result))

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Write the tables of the job as CSV and Parquet, and ``result.json``, into a folder.

        Raises:
            Conflict: ``output-exists`` where the folder exists; ``replace`` allows it for an earlier result.
        """
        from stridelab.service.kinds.gait_measures.run import write_measures

        write = partial(write_measures, result=self.result)
        keys = self.result.citation_keys
        return write_job_files(folder, "gait-measures", self.request, self.summary, keys, write, replace=replace)


def gait_measures(
    recording: LoadedRecording | str | Path,
    *,
    method: str | None = None,
    progress: Progress | None = None,
    **stated: Any,
) -> GaitMeasures:
    """Measures of gait per step: margins of stability, steps, energy, work of the legs, angular momentum.

    Args:
        recording: Result of ``read``, or a path; ``stated`` are then options of ``read``.
        method: An estimator of the centre of mass by name; None takes the best one.
        progress: Called with a fraction from 0 to 1 and a message.

    Raises:
        NotEstimable: The recording is not a walk, or contains no whole step; code and message say what is missing.
    """
    loaded = load_recording(recording, stated)
    request = validate_fields(GaitMeasuresInput, {"recording_ids": [loaded.path.name], "method": method})
    one = validate_fields(EstimateComInput, {"recording_id": loaded.path.name, "method": method})
    with staged_sources(loaded) as (folder, recorded, static):
        task = EstimateComTask(recording=recorded, static=static, input=one)
        member = MeasuresMember(recording_id=loaded.path.name, folder=".", task=task)
        measured = _gait_measures(GaitMeasuresTask(members=[member]), folder, progress or ignore_progress)
        return GaitMeasures(loaded, request, measured)


@dataclass(frozen=True)
class GaitReport:
    """A report on the gait of a person, from ``gait_report``."""

    request: GaitReportInput
    report: ComposedReport

    @property
    def summary(self) -> GaitReportSummary:
        """The summary of the job ``gait-report``: the measures, the reference group and the change."""
        return self.report.summary

    @property
    def html(self) -> str:
        """One page of HTML without scripts and without addresses of other files."""
        return render_html(self.report.content)

    @property
    def pdf(self) -> bytes:
        """The same report as PDF."""
        return render_pdf(self.report.content)

    def save(self, path: str | Path) -> Path:
        """Write the report as PDF if the name ends in ``.pdf``, else as HTML; an earlier file is replaced."""
        path = Path(path)
        path.write_bytes(self.pdf if path.suffix.lower() == ".pdf" else self.html.encode("utf-8"))
        return path


def gait_report(
    recordings: str | Path | Sequence[str | Path],
    *,
    reference: str | Path | None = None,
    before: str | Path | Sequence[str | Path] = (),
    title: str | None = None,
    language: str = "en",
    method: str | None = None,
    static: str | Path | None = None,
    progress: Progress | None = None,
    **person: Any,
) -> GaitReport:
    """Report on the gait of a person, as HTML and PDF.

    Args:
        recordings: Recordings of the person, or folders of them; pooled.
        reference: Folder of other people, with whom the person is compared: a subfolder, or a file beside them, is
            one person.
        before: Earlier recordings of the person, or folders; the report then states the change.
        title: Heading of the report; no name of a person appears anywhere else, except in the names of files.
        language: Language of the report: "en", "de", "fr" or "ja".
        method: An estimator of the centre of mass by name; None takes the best one.
        static: A static trial of the person.
        progress: Called with a fraction from 0 to 1 and a message.
        person: ``height_m``, ``mass_kg``, ``sex`` and ``age_years`` of the person, as in ``read``.

    Raises:
        InvalidInput: There is no recording, or a given value is invalid.
        NotEstimable: No recording has a whole step; code and message say what is missing.
    """
    from stridelab.service.local_recordings import ReportWalks, people_in, report_task
    from stridelab.service.local_runs import collect_recordings

    def paths_of(given: str | Path | Sequence[str | Path]) -> list[Path]:
        listed = [given] if isinstance(given, str | Path) else given
        return collect_recordings([Path(one) for one in listed]) if listed else []

    people = [] if reference is None else people_in(Path(reference))
    walks = ReportWalks(paths_of(recordings), people, paths_of(before))
    subject = validate_fields(SubjectFields, person)
    with tempfile.TemporaryDirectory(prefix="stridelab-") as name:
        fields = {"title": title, "method": method, "language": language}
        task = report_task(walks, subject, fields, None if static is None else Path(static), Path(name))
        return GaitReport(task.input, _compose_report(task, Path(name), progress or ignore_progress))
