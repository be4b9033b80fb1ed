"""Writes the numbers of the measures as the texts of the report, in its language."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

import stridelab
from stridelab.measures.gait_cycle import CURVE_NAMES, CurveName, CycleCurve, MeanCurve, mean_curve
from stridelab.pipelines.gait_measures.pooled import GaitMeasuresResult, speed_m_s_of
from stridelab.pipelines.gait_measures.recording import SIDES, MeasuredRecording
from stridelab.pipelines.gait_report.content import (
    Cell,
    Change,
    Curve,
    Label,
    Panel,
    ReportContent,
    Row,
    Tile,
    TrialRow,
)
from stridelab.pipelines.gait_report.literature import reference_text
from stridelab.pipelines.gait_report.logo import Logo
from stridelab.pipelines.gait_report.reasons import CAUTIONS, cautions_of, missing_measures, missing_reason
from stridelab.schemas.base import Remark
from stridelab.schemas.measures import (
    FEW_PEOPLE,
    MEASURE_TITLES,
    ChangeValue,
    GaitReportSummary,
    GaitReportTask,
    MeasureScale,
    MeasureValue,
    ReferenceValue,
    measure_scale,
    measure_title,
)
from stridelab.schemas.population import LeftOut
from stridelab.schemas.quality import QualityCheck, check_value_text
from stridelab.translations.catalogue import ENGLISH, current_language, gettext, ngettext, translate_sentence

TILES: Final[Mapping[str, str]] = {
    "walking_speed": "Speed",
    "cadence": "Cadence",
    "step_length": "Step length",
    "margin_of_stability_ml_min": "Margin of stability, sideways",
    "margin_of_stability_ap_contact": "Margin of stability, ahead",
    "com_vertical_excursion": "Centre of mass, up and down",
    "com_lateral_excursion": "Centre of mass, sideways",
    "energy_recovery": "Recovery of energy",
}
PANELS: Final[Mapping[CurveName, tuple[str, str]]] = {
    "com_vertical": ("Height of the centre of mass", "mm above its mean over the cycle"),
    "com_lateral": ("Centre of mass sideways", "mm from its mean, towards the foot of the cycle"),
    "margin_of_stability_ml": ("Margin of stability sideways", "mm, in the stance of the foot of the cycle"),
    "margin_of_stability_ap": ("Margin of stability ahead", "mm, in the stance of the foot of the cycle"),
}
"""Title and caption of every chart."""
MASS_SOURCES: Final = {"stated": "as stated", "file": "from the file", "force": "measured by the force plates"}


def report_content(
    task: GaitReportTask,
    result: GaitMeasuresResult,
    summary: GaitReportSummary,
    curves: Sequence[CycleCurve],
    reference_curves: Mapping[CurveName, MeanCurve],
    logo: Logo | None,
) -> ReportContent:
    """Texts of the report in the current language; ``curves`` are the person's, ``reference_curves`` the people's."""
    quality = summary.quality
    wrong = dict.fromkeys(
        _check_text(check) for trial in summary.trials for check in trial.quality.checks if not check.passed
    )
    left, right = (summary.sides.get(side, 0) for side in SIDES)
    steps = gettext("%(number)s (left %(left)s, right %(right)s)", number=summary.steps, left=left, right=right)
    passed = gettext("%(number)s checks of the sensors against each other passed.", number=len(quality.checks))
    rows = _rows(summary)
    return ReportContent(
        language=task.input.language,
        title=task.input.title or gettext("Gait report"),
        lab_name=task.lab_name,
        logo=logo,
        created_on=task.created_on.isoformat(),
        version=f"stridelab {stridelab.__version__}",
        verdict=quality.verdict,
        verdict_note=" ".join(wrong) or passed,
        cautions=cautions_of(summary),
        facts=(
            (gettext("Steps"), steps),
            (gettext("Recordings"), str(summary.n_recordings)),
            (gettext("Body mass"), mass_text(result.recordings)),
            (gettext("Height"), height_text(result.recordings)),
        ),
        tiles=tuple(_tile(name, gettext(title), summary) for name, title in TILES.items()),
        panels=tuple(_panel(name, curves, reference_curves.get(name)) for name in CURVE_NAMES),
        panel_note=_panel_note(curves, summary.reference_people),
        rows=rows,
        table_note=gettext(
            "Mean ± standard deviation between the steps, 95 % interval of the mean, and number n of steps or strides. "
            "The interval also has the measurement error; two steps have none. "
            "Symmetry: (left - right) / mean of both sides. "
            "A step has the side of the foot that swings. In the margins the edge of the foot is "
            "known to about 1 cm, the same in all steps, which the interval does not contain."
        ),
        reference_note=_reference_note(summary),
        changes=tuple(_change(one) for one in sorted(summary.changes, key=_place_in_table)),
        change_note=_change_note(summary.changes),
        missing=missing_measures(summary),
        left_out=_left_out(summary.left_out),
        remarks=_remarks([one for one in summary.warnings if one.code not in CAUTIONS]),
        trials=tuple(_trial(one) for one in result.recordings),
        settings=_settings(result),
        references=tuple(reference_text(key) for key in result.citation_keys),
    )


def _left_out(recordings: Sequence[LeftOut]) -> tuple[tuple[str, str], ...]:
    """Names of files joined by the reason."""
    grouped: dict[str, list[str]] = {}
    for one in recordings:
        grouped.setdefault(_translate_sentence(one.message), []).append(one.filename)
    return tuple((", ".join(names), reason) for reason, names in grouped.items())


def mass_text(recordings: Sequence[MeasuredRecording]) -> str:
    """Body mass with its source; of recordings that differ by 0.1 kg or more, the range."""
    masses = [one.prepared.mass for one in recordings]
    known = [mass.known_kg for mass in masses if mass.known_kg is not None]
    if not known:
        return gettext("not known: neither stated, nor in the files, nor measured by force plates")
    sources = ", ".join(dict.fromkeys(gettext(MASS_SOURCES[mass.source]) for mass in masses if mass.source is not None))
    if max(known) - min(known) < 0.1:
        sd = max(mass.sd_kg for mass in masses if mass.source is not None)
        return f"{np.mean(known):.1f} ± {sd:.1f} kg, {sources}"
    return f"{_translated_range(f'{min(known):.1f} to {max(known):.1f}')} kg, {sources}"


def height_text(recordings: Sequence[MeasuredRecording]) -> str:
    """Stated height; of recordings that differ by 1 cm or more, the range."""
    known = [one.motion.stature_m for one in recordings if one.motion.stature_m is not None]
    if not known:
        return gettext("not known")
    is_one = max(known) - min(known) < 0.01
    return f"{known[0]:.2f} m" if is_one else _translated_range(f"{min(known):.2f} to {max(known):.2f} m")


def _tile(name: str, title: str, summary: GaitReportSummary) -> Tile:
    found = {one.side: one for one in summary.measures if one.name == name}
    both = found.get(None)
    if both is None:
        return Tile(name, title, reason=missing_reason(name, summary))
    scale = measure_scale(name, both.unit)
    sides = [
        f"{gettext(side)} {scale.number(found[side].mean) if side in found else gettext('not measured')}"
        for side in SIDES
    ]
    has_sides = any(side in found for side in SIDES)
    no_interval = gettext("n %(number)s: no 95 %% interval", number=both.n)
    percent = "" if both.symmetry is None else f"{100.0 * both.symmetry:+z.1f}"
    return Tile(
        name,
        title,
        value=f"{scale.number(both.mean)} {scale.unit}".strip(),
        interval=f"95 %: {interval}" if (interval := _interval(both)) else no_interval,
        sides=" · ".join(sides) if has_sides else "",
        symmetry=percent and gettext("symmetry %(percent)s %%", percent=percent),
    )


def _interval(one: MeasureValue) -> str:
    """Interval of the mean; empty if it is not known, and for two values: Student's quantile is then 12.7."""
    if one.ci95 is None or one.n == 2:
        return ""
    return _translated_range(measure_scale(one.name, one.unit).interval(one.ci95))


def _rows(summary: GaitReportSummary) -> tuple[Row, ...]:
    """Measured ones in the order of ``MEASURE_TITLES``; the work of both legs in one row."""
    found = {(one.name, one.side): one for one in summary.measures}
    reference = {one.name: one for one in summary.reference}
    rows = []
    for name in dict.fromkeys([*MEASURE_TITLES, *(name for name, _ in found)]):
        if match := re.fullmatch(r"limb_work_(left|right)_(positive|negative)", name):
            if match[1] == "left":
                works = [found.get((f"limb_work_{side}_{match[2]}", None)) for side in SIDES]
                if any(works):
                    title = f"{match[2].capitalize()} work of the leg"
                    rows.append(Row(name, gettext(title), "J/kg", _cell(works[0]), _cell(works[1]), None))
            continue
        both = found.get((name, None))
        if both is None:
            continue
        scale, group = measure_scale(name, both.unit), reference.get(name)
        rows.append(
            Row(
                name=name,
                title=gettext(measure_title(name)),
                unit=scale.unit,
                left=_cell(found.get((name, "left"))),
                right=_cell(found.get((name, "right"))),
                both=_cell(both),
                symmetry="" if both.symmetry is None else f"{100.0 * both.symmetry:+z.1f} %",
                **({} if group is None else _beside_group(scale, group)),
            )
        )
    return tuple(rows)


def _cell(one: MeasureValue | None) -> Cell | None:
    if one is None:
        return None
    scale = measure_scale(one.name, one.unit)
    sd = "" if one.between_sd is None else _spread(scale, one.between_sd)
    return Cell(scale.number(one.mean), sd, _interval(one), one.n)


def _beside_group(scale: MeasureScale, group: ReferenceValue) -> dict[str, Any]:
    """Fields of a row about the reference group; intervals of few people have no numbers."""
    sd = "" if group.between_sd is None else _spread(scale, group.between_sd)
    few = group.n_people < FEW_PEOPLE
    interval = _translated_range(scale.interval(group.ci95))
    score = "" if group.z_ci95 is None else _translated_range(f"{group.z_ci95[0]:+z.1f} to {group.z_ci95[1]:+z.1f}")
    no_meaning = gettext("means nothing")
    return {
        "reference": Cell(scale.number(group.mean), sd, "", group.n_people),
        "difference": "" if group.difference is None else scale.signed(group.difference),
        "difference_interval": f"{interval}: {no_meaning}" if interval and few else interval,
        "z": "" if group.z is None else f"{group.z:+z.1f}",
        "z_interval": no_meaning if score and few else score,
    }


def _spread(scale: MeasureScale, sd: float) -> str:
    """A standard deviation; of one that is rounded to zero, the limit below which it is."""
    text = scale.number(sd)
    return text if float(text) else f"<{10.0**-scale.digits:.{scale.digits}f}"


def _reference_note(summary: GaitReportSummary) -> str:
    people = summary.reference_people
    if not people:
        return ""
    note = ngettext(
        "Reference group: %(num)s person, counted once; mean ± standard deviation between the people, and "
        "z = (value - mean) / standard deviation. The difference is that of a mixed model over all steps; its 95 %% "
        "interval contains zero for 95 %% of the people of such a group. The interval of z says how precisely the "
        "score is known.",
        "Reference group: %(num)s people, each counted once; mean ± standard deviation between them, and "
        "z = (value - mean) / standard deviation. The difference is that of a mixed model over all steps; its 95 %% "
        "interval contains zero for 95 %% of the people of such a group. The interval of z says how precisely the "
        "score is known.",
        people,
    )
    if people >= FEW_PEOPLE:
        return note
    few = gettext("Intervals and scores of fewer than %(number)s people mean nothing.", number=FEW_PEOPLE)
    return f"{note} {few}"


def _place_in_table(one: ChangeValue) -> int:
    names = list(MEASURE_TITLES)
    return names.index(one.name) if one.name in names else len(names)


def _change(one: ChangeValue) -> Change:
    scale = measure_scale(one.name, one.unit)
    before, after = (
        f"{scale.number(value)} (n {n})" for value, n in ((one.before, one.n_before), (one.after, one.n_after))
    )
    change = scale.signed(one.change)
    interval = _translated_range(scale.interval(one.ci95))
    return Change(one.name, gettext(measure_title(one.name)), scale.unit, before, after, change, interval)


def _change_note(changes: Sequence[ChangeValue]) -> str:
    if not changes:
        return ""
    note = gettext(
        "n recordings. Levels, change and its 95 % interval are those of a mixed model over all steps with a random "
        "intercept per recording; of the means of the recordings (Welch) where steps do not repeat."
    )
    if any(one.ci95 is None for one in changes):
        without = gettext("Without an interval: it needs two recordings before and two after.")
        return f"{note} {without}"
    return note


def _panel(name: CurveName, curves: Sequence[CycleCurve], reference: MeanCurve | None) -> Panel:
    title, caption = PANELS[name]
    drawn = []
    for side in SIDES:
        mean = mean_curve(curve.value_m for curve in curves if curve.name == name and curve.side == side)
        if mean is not None:
            drawn.append(_curve(side, mean))
    return Panel(
        name,
        gettext(title),
        gettext(caption),
        tuple(drawn),
        None if reference is None else _curve("reference", reference),
    )


def _curve(label: Label, mean: MeanCurve) -> Curve:
    return Curve(label, mean.n, 1e3 * mean.mean_m, None if mean.sd_m is None else 1e3 * mean.sd_m)


def _panel_note(curves: Sequence[CycleCurve], people: int) -> str:
    first = CURVE_NAMES[0]
    counts = [sum(curve.side == side and curve.name == first for curve in curves) for side in SIDES]
    if not any(counts):
        return gettext("No cycle from strike to strike of one foot lies within an estimate, so there are no curves.")
    note = gettext(
        "Mean over %(left)s left and %(right)s right cycles, from strike to strike of the foot; bands: one standard "
        "deviation between the cycles.",
        left=counts[0],
        right=counts[1],
    )
    if not people:
        return note
    grey = ngettext(
        "Grey: mean and standard deviation of %(num)s person of the reference group.",
        "Grey: mean and standard deviation of %(num)s people of the reference group.",
        people,
    )
    return f"{note} {grey}"


def _remarks(remarks: Sequence[Remark]) -> tuple[str, ...]:
    """One text per code: the first, and the number of others that differ from it, usually in their numbers only."""
    by_code: dict[str, dict[str, None]] = {}
    for one in remarks:
        by_code.setdefault(one.code, {})[one.message] = None
    texts = []
    for messages in by_code.values():
        first, *others = messages
        similar = gettext("(Similar remarks of other recordings: %(number)s.)", number=len(others))
        texts.append(f"{_translate_sentence(first)} {similar}" if others else _translate_sentence(first))
    return tuple(texts)


def _translate_sentence(sentence: str) -> str:
    """A sentence of the pipelines in the language of the report; itself where there is no translation."""
    return translate_sentence(sentence) or sentence


def _check_text(check: QualityCheck) -> str:
    """The finding of a failed check; in other languages than its own, the check with its value and its limit."""
    if current_language() == ENGLISH:
        return check.message
    name = gettext(check.name.replace("_", " "))
    return gettext(
        "%(check)s: %(value)s, at most %(limit)s expected.",
        check=name[:1].upper() + name[1:],
        value=check_value_text(check, check.value),
        limit=check_value_text(check, check.limit),
    )


def _translated_range(text: str) -> str:
    """Two numbers with a "to" between them."""
    return text.replace(" to ", gettext(" to "))


def _trial(one: MeasuredRecording) -> TrialRow:
    wrong = " ".join(_check_text(check) for check in one.quality.quality.checks if not check.passed)
    sides = [sum(step.side == side for step in one.steps) for side in SIDES]
    speed_m_s = speed_m_s_of(one)
    return TrialRow(
        filename=one.filename,
        recorded_on=one.prepared.trial.recording.recorded_on or gettext("not known"),
        steps=gettext("%(left)s left, %(right)s right", left=sides[0], right=sides[1]),
        speed=gettext("not known") if speed_m_s is None else f"{speed_m_s:.2f} m/s",
        method=one.estimate.method,
        verdict=gettext(one.quality.quality.verdict),
        note=wrong,
    )


def _settings(result: GaitMeasuresResult) -> tuple[tuple[str, str], ...]:
    methods = ", ".join(dict.fromkeys(one.estimate.method for one in result.recordings))
    tables = ", ".join(dict.fromkeys(one.prepared.geometric.table for one in result.recordings))
    sets = ", ".join(dict.fromkeys(one.prepared.trial.match.name or gettext("not known") for one in result.recordings))
    return (
        (gettext("Estimator of the centre of mass"), methods),
        (gettext("Segment table"), tables),
        (gettext("Marker set"), sets),
        (gettext("Version"), f"stridelab {stridelab.__version__}"),
    )
