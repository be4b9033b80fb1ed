"""Measures of gait on the page of a job: the main values, then all of them with both sides."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from stridelab.client import AsyncClient
from stridelab.schemas.base import Remark
from stridelab.schemas.jobs import Job, JobResult
from stridelab.schemas.measures import (
    FEW_PEOPLE,
    MEASURE_TITLES,
    BodySide,
    Bounds,
    ChangeValue,
    GaitMeasuresSummary,
    GaitReportSummary,
    MeasureScale,
    MeasureValue,
    ReferenceValue,
    measure_scale,
    measure_title,
)
from stridelab.schemas.population import LeftOut
from stridelab.translations.catalogue import gettext, ngettext
from stridelab_web.formatting import VERDICT_CODES
from stridelab_web.scene.result_files import STABILITY_TABLE

KINDS: Final = frozenset({"gait-measures", "gait-report"})
MAIN: Final[Mapping[str, str]] = {
    "walking_speed": "Speed",
    "step_length": "Step length",
    "step_width": "Step width",
    "margin_of_stability_ml_min": "Margin of stability, sideways",
    "margin_of_stability_ap_contact": "Margin of stability, ahead",
    "energy_recovery": "Energy recovery",
    "double_support_share": "Double support",
}
"""Measures of which the first ``N_MAIN`` that are known are shown above the table, with their short titles."""
N_MAIN: Final = 6
DOWNLOADS: Final = ("report.pdf", "report.html", "measures.csv", "steps.csv", "xcom.csv")
MIN_STEPS: Final = 3
"""Steps below which the headline refers to the intervals: Student's quantile for two values is 12.7."""

N_CANDIDATES: Final = 5
"""Newest jobs of a recording, and recordings of a session, that are looked through for the wanted measures."""
CAUTIONS: Final = frozenset({"force-not-used", "weight-beside-plates", "several-people", "speeds-mixed"})
"""Codes of the remarks that are shown beside the main values."""
ONE_FOOT: Final = "one-foot-marked"
NO_MEANING: Final = "means nothing"
_SCORE: Final = MeasureScale(1.0, "", 1)


@dataclass(frozen=True)
class Row:
    """One measure as text; empty where it is not known. ``interval`` contains the mean with 95 % confidence."""

    name: str
    title: str
    short: str
    unit: str
    mean: str
    interval: str
    left: str
    right: str
    symmetry: str
    n: int


@dataclass(frozen=True)
class BesideGroup:
    """A measure of the person beside that of the reference group as text; empty where it is not known."""

    name: str
    title: str
    unit: str
    value: str
    group: str
    n_people: int
    difference: str
    interval: str
    z: str
    z_interval: str


@dataclass(frozen=True)
class BeforeAfter:
    """The change of a measure as text; ``is_clear`` if its interval is without zero, ``n`` are the recordings."""

    name: str
    title: str
    unit: str
    before: str
    after: str
    n: str
    change: str
    interval: str
    is_clear: bool


@dataclass(frozen=True)
class NewestGait:
    """What a clinician sees first of a recording or of a session: a sentence, the main values and where the rest is."""

    job_id: str
    n_recordings: int
    headline: str
    cautions: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    main: tuple[Row, ...]
    scene_url: str | None
    downloads: tuple[str, ...]


async def newest_gait(client: AsyncClient, recording_ids: Sequence[str], jobs: Sequence[Job]) -> NewestGait | None:
    """The newest measures among ``jobs`` that are of ``recording_ids`` alone, else the newest that include the first.

    Those of other recordings beside are of a session; None without any.
    """
    pooled: JobResult | None = None
    pooled_id, wanted = "", set(recording_ids)
    for job in [one for one in jobs if one.kind in KINDS and one.state == "succeeded"][:N_CANDIDATES]:
        result = await client.result(job.id)
        if set(result.input.get("recording_ids") or ()) <= wanted:
            return _gait_of(job.id, result)
        if pooled is None:
            pooled, pooled_id = result, job.id
    return None if pooled is None else _gait_of(pooled_id, pooled)


def _gait_of(job_id: str, result: JobResult) -> NewestGait:
    values = measures_of(result)
    summary: GaitMeasuresSummary = values["summary"]
    trials = summary.trials
    scene = f"/view/?recording={trials[0].recording_id}&job={job_id}" if values["has_scene"] and trials else None
    return NewestGait(
        job_id=job_id,
        n_recordings=summary.n_recordings,
        headline=values["headline"],
        cautions=tuple(dict.fromkeys(one.message for one in summary.warnings if one.code in CAUTIONS)),
        left_out=tuple(summary.left_out),
        main=tuple(values["main"]),
        scene_url=scene,
        downloads=tuple(name for name in values["downloads"] if name.startswith("report.")),
    )


def measures_of(result: JobResult) -> dict[str, Any]:
    """Values for the template."""
    summary = GaitReportSummary.model_validate(result.summary)  # of a report, or of measures without its fields
    rows = {row.name: row for row in measure_rows(summary)}
    contradicted = [item for item in summary.left_out if item.code == "contradicted"]
    present = {item.name for item in result.artifacts}
    return {
        "summary": summary,
        "headline": measures_headline(summary),
        "steps": steps_by_side(summary),
        "main": [rows[name] for name in MAIN if name in rows][:N_MAIN],
        "rows": list(rows.values()),
        "beside": reference_rows(summary),
        "changes": change_rows(summary),
        "few_people": FEW_PEOPLE,
        "contradicted": contradicted,
        "left_out": [item for item in summary.left_out if item not in contradicted],
        "cautions": [item for item in summary.warnings if item.code in CAUTIONS],
        "remarks": remarks_by_code(summary.warnings),
        "missing": [(gettext(measure_title(item.name)), item) for item in summary.not_measured],
        "has_scene": STABILITY_TABLE in present,
        "downloads": [name for name in DOWNLOADS if name in present],
    }


def remarks_by_code(warnings: Sequence[Remark]) -> list[list[Remark]]:
    """Remarks but for the cautions and the verdict, those of one code together: recordings differ in numbers only."""
    by_code: dict[str, list[Remark]] = {}
    for one in warnings:
        if one.code not in VERDICT_CODES | CAUTIONS:
            by_code.setdefault(one.code, []).append(one)
    return list(by_code.values())


def measure_rows(summary: GaitMeasuresSummary) -> tuple[Row, ...]:
    """All measures over both sides, in the order of ``MEASURE_TITLES``."""
    by_side = {(one.name, one.side): one for one in summary.measures}
    order = list(MEASURE_TITLES)
    both = [one for one in summary.measures if one.side is None]
    both.sort(key=lambda one: order.index(one.name) if one.name in MEASURE_TITLES else len(order))
    return tuple(_measure_row(one, by_side) for one in both)


def _measure_row(one: MeasureValue, by_side: Mapping[tuple[str, BodySide | None], MeasureValue]) -> Row:
    scale = measure_scale(one.name, one.unit)
    left, right = by_side.get((one.name, "left")), by_side.get((one.name, "right"))
    return Row(
        name=one.name,
        title=gettext(measure_title(one.name)),
        short=gettext(MAIN.get(one.name, measure_title(one.name))),
        unit=scale.unit,
        mean=scale.number(one.mean),
        interval=_interval(scale, one.ci95),
        left="" if left is None else scale.number(left.mean),
        right="" if right is None else scale.number(right.mean),
        symmetry="" if one.symmetry is None else f"{100.0 * one.symmetry:+z.1f} %",
        n=one.n,
    )


def reference_rows(summary: GaitReportSummary) -> tuple[BesideGroup, ...]:
    """The person beside the reference group, in the order of ``MEASURE_TITLES``; empty without a group."""
    rows = []
    for one in sorted(summary.reference, key=_place_in_table):
        scale = measure_scale(one.name, one.unit)
        deviation = "" if one.between_sd is None else f" ± {scale.number(one.between_sd)}"
        few = one.n_people < FEW_PEOPLE
        interval, score = _interval(scale, one.ci95), _interval(_SCORE, one.z_ci95)
        rows.append(
            BesideGroup(
                name=one.name,
                title=gettext(measure_title(one.name)),
                unit=scale.unit,
                value=scale.number(one.value),
                group=f"{scale.number(one.mean)}{deviation}",
                n_people=one.n_people,
                difference="" if one.difference is None else scale.signed(one.difference),
                interval=gettext(NO_MEANING) if interval and few else interval,
                z="" if one.z is None else _SCORE.signed(one.z),
                z_interval=gettext(NO_MEANING) if score and few else score,
            )
        )
    return tuple(rows)


def change_rows(summary: GaitReportSummary) -> tuple[BeforeAfter, ...]:
    """The change since the earlier recordings, in the order of ``MEASURE_TITLES``; empty without any."""
    rows = []
    for one in sorted(summary.changes, key=_place_in_table):
        scale = measure_scale(one.name, one.unit)
        before, after = scale.number(one.before), scale.number(one.after)
        interval = _interval(scale, one.ci95)
        zero = one.ci95 is not None and one.ci95[0] <= 0.0 <= one.ci95[1]
        rows.append(
            BeforeAfter(
                name=one.name,
                title=gettext(measure_title(one.name)),
                unit=scale.unit,
                before=before,
                after=after,
                n=f"{one.n_before}, {one.n_after}",
                change=scale.signed(one.change),
                interval=interval,
                is_clear=bool(interval) and not zero,
            )
        )
    return tuple(rows)


def _place_in_table(one: ReferenceValue | ChangeValue) -> int:
    order = list(MEASURE_TITLES)
    return order.index(one.name) if one.name in order else len(order)


def _interval(scale: MeasureScale, bounds: Bounds | None) -> str:
    return scale.interval(bounds).replace(" to ", gettext(" to "))


def measures_headline(summary: GaitMeasuresSummary) -> str:
    """The steps, their speed and their margin of stability sideways as one sentence."""
    rows = {row.name: row for row in measure_rows(summary)}
    known = []
    if speed := rows.get("walking_speed"):
        known.append(gettext("at %(speed)s", speed=_with_interval(speed)))
    if margin := rows.get("margin_of_stability_ml_min"):
        known.append(gettext("with a margin of stability of %(margin)s sideways", margin=_with_interval(margin)))
    steps = gettext(
        "%(steps)s in %(recordings)s",
        steps=ngettext("%(num)s step", "%(num)s steps", summary.steps),
        recordings=ngettext("%(num)s recording", "%(num)s recordings", summary.n_recordings),
    )
    sentence = gettext("%(facts)s.", facts=" ".join([steps, *known]))
    few = gettext("Few steps: the intervals below are wide.") if summary.steps < MIN_STEPS else ""
    return f"{sentence} {few}".strip()


def steps_by_side(summary: GaitMeasuresSummary) -> str:
    """The measured steps of each foot; a foot without one is named with the reason, in place of a zero."""
    left, right = summary.sides.get("left", 0), summary.sides.get("right", 0)
    if left and right:
        return gettext("%(left)s left, %(right)s right", left=left, right=right)
    if not left and not right:
        return gettext("none measured")
    one_foot = any(one.code == ONE_FOOT for one in summary.warnings)
    if left:
        steps = ngettext("left foot only: %(num)s step", "left foot only: %(num)s steps", left)
        why = gettext("the right foot is not marked") if one_foot else gettext("none of the right foot is measured")
    else:
        steps = ngettext("right foot only: %(num)s step", "right foot only: %(num)s steps", right)
        why = gettext("the left foot is not marked") if one_foot else gettext("none of the left foot is measured")
    return f"{steps}; {why}"


def _with_interval(row: Row) -> str:
    value = f"{row.mean} {row.unit}".strip()
    return f"{value} ({row.interval}, 95 %)" if row.interval and row.n >= MIN_STEPS else value
