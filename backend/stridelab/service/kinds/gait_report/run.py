"""``gait-report``: ``report.html``, ``report.pdf``, and the tables of ``gait-measures``."""

from pathlib import Path
from typing import Final

from stridelab.pipelines.gait_report.html import render_html
from stridelab.pipelines.gait_report.pdf import render_pdf
from stridelab.pipelines.gait_report.report import GaitReport, gait_report
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.measures import GaitReportTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.gait_measures.run import write_measures

HTML: Final = "report.html"
PDF: Final = "report.pdf"


def run(task: GaitReportTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Write the report on the recordings of ``task``; the summary is a ``GaitReportSummary``.

    Raises as ``stridelab.pipelines.gait_report.report.gait_report`` does.
    """
    report = gait_report(task, folder, progress)
    progress(0.97, "writing the report")
    artifacts = (*write_report(folder, report), *write_measures(folder, report.measured))
    progress(1.0, "done")
    return Outcome(report.summary.model_dump(mode="json"), report.measured.citation_keys, artifacts)


def write_report(folder: Path, report: GaitReport) -> tuple[ArtifactFile, ...]:
    """Write the page and the PDF into ``folder``."""
    (folder / HTML).write_text(render_html(report.content), encoding="utf-8")
    (folder / PDF).write_bytes(render_pdf(report.content))
    return ArtifactFile(HTML, "text/html"), ArtifactFile(PDF, "application/pdf")
