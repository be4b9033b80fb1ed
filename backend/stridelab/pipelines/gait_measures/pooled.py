"""Measures of gait of one or more recordings, calibrated by their sessions and pooled."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.errors import Fault, NotEstimable, StridelabError
from stridelab.estimation.quality.assessment import CONTRADICTED
from stridelab.measures.foot_placement import LEAST_STEPS, foot_placement
from stridelab.measures.local_stability import LEAST_STRIDES, longest_run_s
from stridelab.measures.measure import Measure, summarise, symmetry_index
from stridelab.pipelines.estimate_com import worst_quality
from stridelab.pipelines.gait_measures.recording import (
    ONE_FOOT,
    SIDES,
    WEIGHT_BESIDE,
    MeasuredRecording,
    measure_recording,
    measure_steps,
    measure_without_plates,
)
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import session_differences
from stridelab.schemas import base
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import GaitMeasuresSummary, GaitMeasuresTask, MeasuresMember, MeasureValue, NotMeasured
from stridelab.schemas.population import LeftOut
from stridelab.walking.event_calibration import EventDifferences, PlateDifference

REFERENCES: Final = ("hof2005", "donelan2002", "cavagna1976", "herr2008", "wang2014", "rosenstein1993", "bruijn2009")
SIGNED: Final = frozenset(
    {"margin_of_stability_ap_contact", "capture_point_offset_ap", "capture_point_offset_ml", "step_width"}
)
"""Measures that may be zero or negative, for which a ratio of the sides says nothing; nor does one of unlike signs."""
NEED_BOTH_FEET: Final = (
    *("step_length", "step_width", "step_time", "margin_of_stability_ml_min", "cycloid_wheel_radius"),
    *("angular_momentum_range_x", "limb_work_left_positive", "limb_work_right_positive", "foot_placement_residual"),
)
"""Measures that are refused with the code ``ONE_FOOT``; others follow from them, as a cadence from a step time."""
SUPPORT_BESIDE: Final = "support_beside_feet"
SAME_HEIGHT_M: Final = 0.03
SAME_MASS: Final = 0.15
"""Differences of the stated height, and of the body mass in relation to the smallest, beyond those of one person."""
SEVERAL_PEOPLE: Final = base.Remark(
    code="several-people",
    message="Height or body mass differ between the recordings more than those of one person do: report people one by "
    "one.",
)
SPEEDS_MIXED: Final = "speeds-mixed"
MAX_SPEED_SPREAD: Final = 0.25
"""Range of the speeds of the recordings over their mean above which conditions are mixed."""


@dataclass(frozen=True)
class GaitMeasuresResult:
    """Measures of all recordings and their summary; ``pooled`` are measures over all recordings together."""

    recordings: tuple[MeasuredRecording, ...]
    pooled: tuple[Measure, ...]
    summary: GaitMeasuresSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the methods used."""
        used = (
            key for one in self.recordings for key in (*one.prepared.geometric.references, *one.estimate.references)
        )
        return tuple(dict.fromkeys((*REFERENCES, *used)))


def gait_measures(task: GaitMeasuresTask, folder: Path, progress: ProgressCallback) -> GaitMeasuresResult:
    """Measure every recording of ``task``, whose files are in sub-folders of ``folder``; 0.0 to 0.95 of the progress.

    Recordings that cannot be measured, or whose sensors contradict each other, are listed with the reason, the static
    trial of the others as such (``static-trial``), and a copy of another one (``recording-twice``). Where the plates
    carry too little weight for the body, as with a walking aid, the measures are those of the markers alone. The plates
    of the other recordings of a session (``MeasuresMember.session_id``) calibrate its events by markers.

    Raises ``NotEstimable`` (``nothing-measured``) if no recording of several has a whole step; the error of a single
    one is raised as it is.
    """
    measured: list[MeasuredRecording] = []
    left_out: list[LeftOut] = []
    name_of: dict[str, str] = {}
    static_ids = {one.task.session.static_recording_id for one in task.members if one.task.session is not None}
    for index, member in enumerate(task.members):
        progress(0.95 * index / len(task.members), member.task.recording.filename)
        identity = {"recording_id": member.recording_id, "filename": member.task.recording.filename}
        content = _content_key(member, folder)
        if content in name_of:
            message = f"This is the same file as {name_of[content]}: a recording counts once."
            left_out.append(LeftOut(**identity, code="recording-twice", message=message))
            continue
        name_of[content] = member.task.recording.filename
        try:
            one = measure_recording(member.recording_id, member.task, folder / member.folder)
        except StridelabError as error:
            if len(task.members) == 1:
                raise
            code, message = error.code, error.message
            if member.recording_id in static_ids:
                code, message = "static-trial", "This is the static trial of the other recordings, without steps."
            left_out.append(LeftOut(**identity, code=code, message=message))
            continue
        if one.quality.quality.verdict == CONTRADICTED:
            one = measure_without_plates(one, member, folder) or one
        if one.quality.quality.verdict == CONTRADICTED:
            wrong = [check.message for check in one.quality.quality.checks if not check.passed]
            message = f"The sensors of this recording contradict each other. {' '.join(wrong)}"
            left_out.append(LeftOut(**identity, code=CONTRADICTED, message=message))
            continue
        measured.append(one)
    if not measured:
        faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in left_out]
        raise NotEstimable("nothing-measured", "No recording has a whole step that can be measured.", faults)
    measured = _calibrate_events(task.members, measured)
    pooled = tuple(foot_placement([(one.motion, one.steps) for one in measured]))
    return GaitMeasuresResult(tuple(measured), pooled, _summary(measured, pooled, left_out))


def _content_key(member: MeasuresMember, folder: Path) -> str:
    """Equal for recordings with the same file and settings; unique for a file that is not there."""
    source = member.task.recording
    try:
        with (folder / member.folder / source.file).open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
    except OSError:
        digest = member.folder
    return digest + source.model_dump_json(exclude={"file", "filename"})


def may_be_several_people(recordings: Sequence[MeasuredRecording]) -> bool:
    """Whether heights or masses differ by more than those of one person do."""
    heights_m = [one.motion.stature_m for one in recordings if one.motion.stature_m is not None]
    masses_kg = [mass for one in recordings if (mass := one.prepared.mass.known_kg) is not None]
    return (len(heights_m) > 1 and max(heights_m) - min(heights_m) > SAME_HEIGHT_M) or (
        len(masses_kg) > 1 and max(masses_kg) > (1.0 + SAME_MASS) * min(masses_kg)
    )


def speed_m_s_of(one: MeasuredRecording) -> float | None:
    """Mean walking speed over the steps of a recording."""
    speeds = [measure.value for measure in one.measures if measure.name == "walking_speed"]
    return float(np.mean(speeds)) if speeds else None


def speed_remarks(recordings: Sequence[MeasuredRecording]) -> tuple[base.Remark, ...]:
    """A remark (``speeds-mixed``) if the speeds of the recordings are of several conditions."""
    speeds = [speed for one in recordings if (speed := speed_m_s_of(one)) is not None]
    if not speeds or max(speeds) - min(speeds) <= MAX_SPEED_SPREAD * float(np.mean(speeds)):
        return ()
    low_m_s, high_m_s = min(speeds), max(speeds)
    message = (
        f"The recordings have speeds from {low_m_s:.2f} to {high_m_s:.2f} m/s. Most measures depend on the speed: "
        "report the conditions one by one."
    )
    return (base.Remark(code=SPEEDS_MIXED, message=message),)


def _calibrate_events(
    members: Sequence[MeasuresMember], measured: Sequence[MeasuredRecording]
) -> list[MeasuredRecording]:
    """Measure again, with the events by markers calibrated by the plates of the other recordings of the session."""
    member_of = {one.recording_id: one for one in members}
    differences = {
        one.recording_id: session_differences(one.prepared.trial, one.prepared.latency.applied_s)
        for one in measured
        if member_of[one.recording_id].session_id
    }
    calibrated = []
    for one in measured:
        member, own = member_of[one.recording_id], differences.get(one.recording_id, {})
        candidates = [of for name, of in differences.items() if member_of[name].session_id == member.session_id]
        candidates += _stored_differences(member)
        others: list[EventDifferences] = []
        for other in candidates if member.session_id else ():
            if any(other.values()) and other not in (own, *others):  # copies count once
                others.append(other)
        if others and any("markers" in (c.strike_source, c.lift_off_source) for c in one.contacts):
            one = measure_steps(
                one.recording_id,
                member.task,
                one.prepared,
                one.estimate,
                one.quality,
                mass_kg=one.motion.mass_kg,
                session=others,
            )
        calibrated.append(one)
    return calibrated


def _stored_differences(member: MeasuresMember) -> list[EventDifferences]:
    return [
        {
            "strike": [PlateDifference(one.late_s, one.sd_s) for one in (delays.strike,) if one is not None],
            "lift_off": [PlateDifference(one.late_s, one.sd_s) for one in (delays.lift_off,) if one is not None],
        }
        for delays in member.session_delays
    ]


def _summary(
    measured: Sequence[MeasuredRecording], pooled: Sequence[Measure], left_out: Sequence[LeftOut]
) -> GaitMeasuresSummary:
    measures = [measure for one in measured for measure in one.measures] + list(pooled)
    values = _pooled_values(measures)
    remarks = (remark for one in measured for remark in (*one.prepared.all_remarks, *one.estimate.remarks))
    methods = {one.estimate.method for one in measured}
    swings = [step.side for one in measured for step in one.steps]
    speeds = [measure.value for measure in measures if measure.name == "walking_speed"]
    first = measured[0].motion
    return GaitMeasuresSummary(
        steps=len(swings),
        sides={side: swings.count(side) for side in SIDES},
        measures=values,
        not_measured=_not_measured(measured, {value.name for value in values}, len(swings)),
        left_out=list(left_out),
        n_recordings=len(measured),
        method=EstimateComInput(recording_id="any", method=methods.pop()).method if len(methods) == 1 else None,
        mass_kg=first.mass_kg,
        height_m=first.stature_m,
        speed_m_s=float(np.mean(speeds)) if speeds else None,
        quality=worst_quality([one.quality.quality for one in measured]),
        trials=[one.quality for one in measured],
        warnings=[
            *([SEVERAL_PEOPLE] if may_be_several_people(measured) else ()),
            *speed_remarks(measured),
            *(base.Remark(code=r.code, message=r.message) for r in dict.fromkeys(remarks)),
        ],
    )


def _pooled_values(measures: Sequence[Measure]) -> list[MeasureValue]:
    summaries = summarise(measures)
    means = {(one.name, one.side): one.mean for one in summaries}
    values = []
    for one in summaries:
        left, right = means.get((one.name, "left")), means.get((one.name, "right"))
        symmetry = None
        if one.side is None and left is not None and right is not None and left * right > 0.0:
            symmetry = None if one.name in SIGNED else symmetry_index(left, right)
        values.append(
            MeasureValue(
                name=one.name,
                unit=one.unit,
                side=one.side,
                n=one.n,
                mean=one.mean,
                between_sd=one.between_sd,
                error_sd=one.error_sd,
                ci95=one.ci95,
                symmetry=symmetry,
            )
        )
    return values


_STRIDE_REASON: Final = ("no-whole-stride", "No stride from strike to strike of one foot lies within the estimate.")
_FORCE_REASON: Final = (
    "no-separate-forces",
    "No whole stance of this foot is measured on plates of its own, or the body mass is not known.",
)
_EXPECTED: Final[Mapping[str, tuple[str, str]]] = {
    "margin_of_stability_ml_min": ("no-whole-step", "No single support lies within the estimate with the foot marked."),
    "step_time": ("no-prior-strike", "No step has a strike of each foot within the recording."),
    "stride_length": _STRIDE_REASON,
    "cycloid_wheel_radius": ("no-whole-step", "No step within the estimate is a curtate cycloid of a walker."),
    "energy_recovery": (
        "velocity-uncertain",
        "The force is measured throughout no stride; elsewhere the velocity is too uncertain for energies.",
    ),
    "angular_momentum_range_x": _STRIDE_REASON,
    "limb_work_left_positive": _FORCE_REASON,
    "limb_work_right_positive": _FORCE_REASON,
}


def _not_measured(measured: Sequence[MeasuredRecording], given: set[str], n_steps: int) -> list[NotMeasured]:
    missing = {name: reason for name, reason in _EXPECTED.items() if name not in given}
    if "angular_momentum_range_x" in missing and all(one.motion.stature_m is None for one in measured):
        missing["angular_momentum_range_x"] = ("no-stature", "State the stature, by which the momentum is scaled.")
    if all(any(remark.code == WEIGHT_BESIDE for remark in one.estimate.remarks) for one in measured):
        reason = (
            WEIGHT_BESIDE,
            "The plates do not carry the whole weight: the force of a leg on them is not all of it.",
        )
        missing |= {name: reason for name in missing if name.startswith("limb_work")}
    if not any(one.prepared.windows for one in measured):
        message = (
            "Whether a cane, a rail or another person carries a part of the weight is seen by plates under all feet "
            "only. Here no instant has them: the margins hold if the feet are the only support."
        )
        missing[SUPPORT_BESIDE] = ("no-measured-force", message)
    if "foot_placement_residual" not in given:
        message = f"{n_steps} steps; the regression needs at least {LEAST_STEPS} within the estimates."
        missing["foot_placement_residual"] = ("too-few-steps", message)
    if "local_dynamic_stability" not in given:
        most = max(0, *(len(longest_run_s(one.motion, one.steps)) - 1 for one in measured))
        message = f"{most} strides in a row; the exponent needs at least {LEAST_STRIDES} of one recording."
        missing["local_dynamic_stability"] = ("too-few-strides", message)
    one_sided = [remark for one in measured for remark in one.estimate.remarks if remark.code == ONE_FOOT]
    if len(one_sided) == len(measured):
        missing |= {name: (ONE_FOOT, one_sided[0].message) for name in NEED_BOTH_FEET if name not in given}
    return [NotMeasured(name=name, code=code, message=message) for name, (code, message) in missing.items()]
