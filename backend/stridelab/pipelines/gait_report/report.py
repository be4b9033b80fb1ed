"""Report on the gait of a person: the measures, the curves, the reference group and the change, as HTML and PDF.

GaitReportTask -> GaitMeasuresResult (person, before, people) -> ReportContent -> report.html, report.pdf
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stridelab.errors import InvalidInput, StridelabError
from stridelab.measures.gait_cycle import CURVE_NAMES, CurveName, CycleCurve, MeanCurve, cycle_curves, mean_curve
from stridelab.measures.measure import Measure
from stridelab.pipelines.gait_measures.pooled import GaitMeasuresResult, gait_measures
from stridelab.pipelines.gait_measures.recording import MeasuredRecording
from stridelab.pipelines.gait_report.comparison import change_between, compare_with_people
from stridelab.pipelines.gait_report.content import ReportContent
from stridelab.pipelines.gait_report.logo import Logo, read_logo
from stridelab.pipelines.gait_report.texts import report_content
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.base import Remark
from stridelab.schemas.measures import GaitMeasuresTask, GaitReportSummary, GaitReportTask, MeasuresMember
from stridelab.schemas.population import LeftOut
from stridelab.translations.catalogue import in_language


@dataclass(frozen=True)
class GaitReport:
    """The report before it is written; ``measured`` are the measures of the person."""

    content: ReportContent
    measured: GaitMeasuresResult
    summary: GaitReportSummary


@dataclass(frozen=True)
class _Person:
    """Measures and mean curves of one person of the reference group."""

    measures: Sequence[Measure]
    curves: Mapping[CurveName, MeanCurve]


def gait_report(task: GaitReportTask, folder: Path, progress: ProgressCallback) -> GaitReport:
    """Measure all recordings of ``task``, whose files are in ``folder``, and write the texts of the report.

    Recordings of the reference group or from before that cannot be measured are listed with the reason. An unusable
    logo is a remark (``logo-not-used``). Raises as ``gait_measures`` does.
    """
    groups = [task.members, *(person.members for person in task.reference), task.before]
    total = sum(len(group) for group in groups)
    done = 0

    def measure(members: Sequence[MeasuresMember]) -> GaitMeasuresResult:
        start = done

        def inner(fraction: float, message: str) -> None:
            progress((0.95 * start + fraction * len(members)) / total, message)

        return gait_measures(GaitMeasuresTask(members=list(members)), folder, inner)

    measured = measure(task.members)
    done += len(task.members)
    left_out = list(measured.summary.left_out)
    people: list[_Person] = []
    for person in task.reference:
        try:
            one = measure(person.members)
            left_out += one.summary.left_out
            people.append(_Person(_all_measures(one), _mean_curves(person_curves(one.recordings))))
        except StridelabError as error:
            left_out += _all_left_out(person.members, error)
        done += len(person.members)
    earlier: list[Sequence[Measure]] = []
    if task.before:
        try:
            before = measure(task.before)
            earlier = [one.measures for one in before.recordings]
            left_out += before.summary.left_out
        except StridelabError as error:
            left_out += _all_left_out(task.before, error)
    logo, remarks = _logo_of(task, folder)
    summary = GaitReportSummary(
        **measured.summary.model_dump(exclude={"left_out", "warnings"}),
        left_out=left_out,
        warnings=[*measured.summary.warnings, *remarks],
        reference=compare_with_people(_all_measures(measured), [person.measures for person in people]),
        reference_people=len(people),
        changes=change_between(earlier, [one.measures for one in measured.recordings]),
    )
    reference = {
        name: mean
        for name in CURVE_NAMES
        if (mean := mean_curve(person.curves[name].mean_m for person in people if name in person.curves)) is not None
    }
    curves = person_curves(measured.recordings)
    with in_language(task.input.language):
        content = report_content(task, measured, summary, curves, reference, logo)
    return GaitReport(content, measured, summary)


def _all_measures(result: GaitMeasuresResult) -> list[Measure]:
    return [*(measure for one in result.recordings for measure in one.measures), *result.pooled]


def person_curves(recordings: Sequence[MeasuredRecording]) -> list[CycleCurve]:
    """Curves of all cycles of all recordings."""
    return [curve for one in recordings for curve in cycle_curves(one.motion, one.steps)]


def _mean_curves(curves: Sequence[CycleCurve]) -> dict[CurveName, MeanCurve]:
    """Means over both sides by name."""
    means = {name: mean_curve(one.value_m for one in curves if one.name == name) for name in CURVE_NAMES}
    return {name: mean for name, mean in means.items() if mean is not None}


def _all_left_out(members: Sequence[MeasuresMember], error: StridelabError) -> list[LeftOut]:
    """Entries for recordings of which none could be measured; an error of several names the reason of each."""
    reasons = {fault.where: fault.message for fault in error.faults} if error.code == "nothing-measured" else {}
    names = [(member.recording_id, member.task.recording.filename) for member in members]
    return [
        LeftOut(recording_id=recording_id, filename=name, code=error.code, message=reasons.get(name, error.message))
        for recording_id, name in names
    ]


def _logo_of(task: GaitReportTask, folder: Path) -> tuple[Logo | None, list[Remark]]:
    if task.logo is None:
        return None, []
    try:
        return read_logo(folder / task.logo), []
    except InvalidInput as error:
        return None, [Remark(code="logo-not-used", message=error.message)]
