"""What is missing in the report and why, and what to know before its numbers."""

from collections.abc import Mapping
from typing import Final

from stridelab.pipelines.gait_measures.pooled import SEVERAL_PEOPLE, SPEEDS_MIXED
from stridelab.pipelines.gait_measures.recording import SIDES
from stridelab.schemas.measures import MEASURE_TITLES, REASON_OF, GaitReportSummary, measure_title
from stridelab.translations.catalogue import gettext, ngettext, translate_sentence

FEW_STEPS: Final = 6
CAUTIONS: Final = ("force-not-used", SEVERAL_PEOPLE.code, SPEEDS_MIXED)
"""Codes of the remarks that stand before the numbers."""
SIGNIFICANT_Z: Final = 2.0
NO_STEP: Final[Mapping[str, str]] = {
    "left": "No whole step of the left foot is measured.",
    "right": "No whole step of the right foot is measured.",
}
STEP_NOT_ALLOWING: Final[Mapping[str, str]] = {
    "left": "No step of the left foot allows it.",
    "right": "No step of the right foot allows it.",
}
WHOLE_STEP_NOT_ALLOWING: Final[Mapping[str, str]] = {
    "left": "No whole step of the left foot allows it.",
    "right": "No whole step of the right foot allows it.",
}


def cautions_of(summary: GaitReportSummary) -> tuple[str, ...]:
    """What a reader should know before the numbers."""
    cautions = [translate_sentence(one.message) or one.message for one in summary.warnings if one.code in CAUTIONS]
    missing = [side for side in SIDES if not summary.sides.get(side)]
    cautions += [gettext(NO_STEP[side]) for side in missing]
    if summary.steps < FEW_STEPS and not missing:
        cautions.append(
            ngettext(
                "Only %(num)s step is measured: symmetry and scatter between the steps are uncertain.",
                "Only %(num)s steps are measured: symmetry and scatter between the steps are uncertain.",
                summary.steps,
            )
        )
    apart = next((one for one in summary.reference if one.name == "walking_speed"), None)
    if apart is not None and apart.z is not None and abs(apart.z) > SIGNIFICANT_Z:
        cautions.append(
            gettext(
                "The person walks at another speed than the reference group (z = %(score)s); other differences may "
                "follow from that.",
                score=f"{apart.z:+.1f}",
            )
        )
    return tuple(dict.fromkeys(cautions))


def missing_measures(summary: GaitReportSummary) -> tuple[tuple[str, str], ...]:
    """Measures, or their sides, that are missing: titles joined by the reason."""
    given = {(one.name, one.side) for one in summary.measures}
    grouped: dict[str, list[str]] = {}
    for name in MEASURE_TITLES:
        if (name, None) not in given:
            grouped.setdefault(missing_reason(name, summary), []).append(gettext(measure_title(name)))
            continue
        if name.startswith("limb_work_") or not {(name, side) for side in SIDES} & given:
            continue
        for side in SIDES:
            if (name, side) not in given:
                reason = gettext((STEP_NOT_ALLOWING if summary.sides.get(side) else WHOLE_STEP_NOT_ALLOWING)[side])
                grouped.setdefault(reason, []).append(f"{gettext(measure_title(name))}, {gettext(side)}")
    return tuple(("; ".join(titles), reason) for reason, titles in grouped.items())


def missing_reason(name: str, summary: GaitReportSummary) -> str:
    """Why a measure is missing in the summary."""
    reasons = {one.name: one.message for one in summary.not_measured}
    given = reasons.get(name) or reasons.get(REASON_OF.get(name, ""))
    if given:
        return translate_sentence(given) or given
    return gettext("No step of the recordings allows it: a marker is hidden or the estimate does not cover it.")
