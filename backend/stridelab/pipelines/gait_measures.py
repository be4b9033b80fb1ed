"""Measures of gait of one or more recordings, pooled.

file -> Prepared -> ComEstimate -> contacts, steps -> WalkMotion -> measures -> summaries
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, NotEstimable, StridelabError
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.quality.assessment import CONTRADICTED
from stridelab.measures.angular_momentum import angular_momentum_ranges
from stridelab.measures.energy_exchange import energy_exchange
from stridelab.measures.extrapolated_com import ExtrapolatedCom, extrapolated_com
from stridelab.measures.foot_placement import LEAST_STEPS, foot_placement
from stridelab.measures.limb_work import limb_work
from stridelab.measures.local_stability import LEAST_STRIDES, local_stability, longest_run_s
from stridelab.measures.margin_of_stability import margins_of_stability
from stridelab.measures.measure import Measure, summarise, symmetry_index
from stridelab.measures.rolling_wheel import rolling_wheel
from stridelab.measures.spatiotemporal import spatiotemporal
from stridelab.measures.stated_errors import calibrate_errors
from stridelab.measures.walk_motion import WalkMotion, walk_motion
from stridelab.pipelines.com_inputs import ComInputs, prepare_com_inputs
from stridelab.pipelines.estimate_com import assess_estimate, estimate_with_fallback, quality_schema, worst_quality
from stridelab.pipelines.progress import ProgressCallback
from stridelab.recordings.foot_contact import find_marked_feet
from stridelab.recordings.recording import Recording, Remark, Side
from stridelab.schemas import base
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import GaitMeasuresSummary, GaitMeasuresTask, MeasuresMember, MeasureValue, NotMeasured
from stridelab.schemas.population import LeftOut
from stridelab.schemas.quality import TrialQuality
from stridelab.schemas.tasks import EstimateComTask
from stridelab.walking.gait_events import Contact, find_contacts
from stridelab.walking.preconditions import require_walk
from stridelab.walking.steps import GaitStep, find_one_sided_steps, find_steps

REFERENCES: Final = ("hof2005", "donelan2002", "cavagna1976", "herr2008", "wang2014", "rosenstein1993", "bruijn2009")
SIDES: Final[tuple[Side, ...]] = ("left", "right")
SIGNED: Final = frozenset(
    {"margin_of_stability_ap_contact", "capture_point_offset_ap", "capture_point_offset_ml", "step_width"}
)
"""Measures that may be zero or negative, for which a ratio of the sides says nothing."""
LEAST_WEIGHT_SHARE: Final = 0.96
"""Share of the weight on the plates below which something else carries the person: limit of ``mass_from_motion``."""
ONE_FOOT: Final = "one-foot-marked"
"""Code of the remark, and of the reason why what needs the other foot is not measured."""
NEED_BOTH_FEET: Final = (
    *("step_length", "step_width", "step_time", "margin_of_stability_ml_min", "cycloid_wheel_radius"),
    *("angular_momentum_range_x", "limb_work_left_positive", "limb_work_right_positive", "foot_placement_residual"),
)
"""Measures that are refused with the code ``ONE_FOOT``; others follow from them, as a cadence from a step time."""
AID_WORDS: Final = re.compile(
    r"(?<![a-z])[lr]?(cane|crutch|stick|rollator|walker|handrail|rail)(?![a-z]{2})", re.IGNORECASE
)
"""In the label of a marker on a walking aid, behind the name of its subject."""
SUPPORT_BESIDE: Final = "support_beside_feet"
WEIGHT_BESIDE: Final = "weight-beside-plates"
"""Code of the remark, and of the reason why the work of the legs is not measured."""


@dataclass(frozen=True)
class MeasuredRecording:
    """Measures of one recording with the motion and steps they are computed from."""

    recording_id: str
    filename: str
    motion: WalkMotion
    contacts: tuple[Contact, ...]
    steps: tuple[GaitStep, ...]
    measures: tuple[Measure, ...]
    xcom: ExtrapolatedCom
    prepared: ComInputs
    estimate: ComEstimate
    quality: TrialQuality


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
    trial of the others as such (``static-trial``). Where the plates carry too little weight for the body, as with a
    walking aid, the measures are those of the markers alone.

    Raises ``NotEstimable`` (``nothing-measured``) if no recording of several has a whole step; the error of a single
    one is raised as it is.
    """
    measured: list[MeasuredRecording] = []
    left_out: list[LeftOut] = []
    static_ids = {one.task.session.static_recording_id for one in task.members if one.task.session is not None}
    for index, member in enumerate(task.members):
        progress(0.95 * index / len(task.members), member.task.recording.filename)
        identity = {"recording_id": member.recording_id, "filename": member.task.recording.filename}
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
            one = _without_plates(one, member, folder) or one
        if one.quality.quality.verdict == CONTRADICTED:
            wrong = [check.message for check in one.quality.quality.checks if not check.passed]
            message = f"The sensors of this recording contradict each other. {' '.join(wrong)}"
            left_out.append(LeftOut(**identity, code=CONTRADICTED, message=message))
            continue
        measured.append(one)
    if not measured:
        faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in left_out]
        raise NotEstimable("nothing-measured", "No recording has a whole step that can be measured.", faults)
    pooled = tuple(foot_placement([(one.motion, one.steps) for one in measured]))
    return GaitMeasuresResult(tuple(measured), pooled, _summary(measured, pooled, left_out))


def measure_recording(recording_id: str, task: EstimateComTask, folder: Path) -> MeasuredRecording:
    """Measures of one recording.

    Without plates, body mass or an interval with all force on plates the CoM is that of the geometry alone, unless a
    method is requested. Raises the errors of ``estimate-com``, and ``NotEstimable`` if the recording is no walk
    (``require_walk``) or contains no whole step (``no-steps``).
    """
    request = task.input
    prepared, estimate = _estimate(task, folder)
    recording, landmarks = prepared.trial.recording, prepared.trial.match.landmarks
    feet = find_marked_feet(recording, landmarks)
    both = len(feet) == len(SIDES)
    contacts = find_contacts(recording, landmarks, latency_s=prepared.latency.applied_s, plates=both, feet=feet)
    require_walk(recording, landmarks, contacts, feet)
    if both:
        steps = find_steps(recording, landmarks, prepared.windows, contacts=contacts)
    else:
        steps = find_one_sided_steps(recording, contacts)
    motion = walk_motion(
        recording,
        landmarks,
        estimate,
        prepared.geometric,
        contacts,
        mass_kg=prepared.mass.known_kg,
        stature_m=task.recording.subject.height_m or recording.subject.height_m,
        latency_s=prepared.latency.applied_s,
        feet=feet,
    )
    if not steps or motion is None:
        raise NotEstimable("no-steps", "The recording contains no whole step of a marked foot.")
    measures = (
        *spatiotemporal(motion, steps),
        *margins_of_stability(motion, steps),
        *energy_exchange(motion, steps),
        *rolling_wheel(motion, steps),
        *(angular_momentum_ranges(motion, steps) if both else ()),
        *limb_work(motion, contacts, steps),
        *local_stability(motion, steps),
    )
    quality = TrialQuality(
        recording_id=request.recording_id,
        filename=task.recording.filename,
        quality=quality_schema(assess_estimate(prepared, estimate)),
    )
    return MeasuredRecording(
        recording_id,
        task.recording.filename,
        motion,
        contacts,
        steps,
        tuple(calibrate_errors(motion, steps, measures)),
        extrapolated_com(motion),
        prepared,
        replace(estimate, remarks=(*estimate.remarks, *_support_remarks(recording, [foot.side for foot in feet]))),
        quality,
    )


def _support_remarks(recording: Recording, marked: Sequence[Side]) -> tuple[Remark, ...]:
    """Remarks about a foot that is not marked, and about a walking aid that is."""
    remarks: list[Remark] = []
    if len(marked) == 1:
        hidden = "right" if marked[0] == "left" else "left"
        message = (
            f"Only the {marked[0]} foot is marked: strides and the margins at its strikes are those of this foot. When "
            f"the {hidden} foot stands is unknown, so that nothing that needs it is measured."
        )
        remarks.append(Remark(ONE_FOOT, message))
    aids = sorted(label for label in recording.markers_m if AID_WORDS.search(label.rpartition(":")[2]))
    if aids:
        message = (
            f"The labels {', '.join(aids[:8])} name a walking aid or a rail. What it carries is not measured, and the "
            "base of support that the margins end at is that of the feet alone."
        )
        remarks.append(Remark("walking-aid-marked", message))
    return tuple(remarks)


def _without_plates(one: MeasuredRecording, member: MeasuresMember, folder: Path) -> MeasuredRecording | None:
    """Measures by the markers alone of a recording whose plates carry too little of the weight; else None.

    None as well if a method is requested. The share of the weight is the mean vertical force over that which the motion
    of the markers needs, m (g + a_z). A verdict of contradicted markers remains.
    """
    wrench, mass_kg = one.prepared.wrench, one.prepared.mass.stated_kg or one.prepared.mass.known_kg
    if member.task.input.method is not None or mass_kg is None or not wrench.complete.any():
        return None
    request = member.task.input.model_copy(update={"method": GeometryOnly.name})
    task = member.task.model_copy(update={"input": request})
    try:
        again = measure_recording(member.recording_id, task, folder / member.folder)
    except StridelabError:
        return None
    used = wrench.complete & np.isin(wrench.time_s, again.estimate.time_s)
    if not used.any():
        return None
    rising_m_s2 = again.estimate.acceleration_m_s2[np.isin(again.estimate.time_s, wrench.time_s[used]), 2]
    share = float(wrench.force_n[used, 2].mean() / (mass_kg * (GRAVITY_M_S2 + rising_m_s2.mean())))
    if share >= LEAST_WEIGHT_SHARE:
        return None
    remark = Remark(
        WEIGHT_BESIDE,
        f"The plates carry {100.0 * share:.0f} % of the body weight. A walking aid, a rail or another person may carry "
        "the rest, or the mass is wrong. The force is not used: the centre of mass is that of the markers alone, and "
        "the work of the legs is not measured.",
    )
    return replace(
        again,
        motion=replace(again.motion, mass_kg=mass_kg),
        measures=tuple(measure for measure in again.measures if not measure.name.startswith("limb_work")),
        estimate=replace(again.estimate, remarks=(*again.estimate.remarks, remark)),
    )


def _estimate(task: EstimateComTask, folder: Path) -> tuple[ComInputs, ComEstimate]:
    """Estimate over the whole recording; markers alone if the default method is not applicable."""
    request = task.input

    def estimate_by(method: str | None) -> tuple[ComInputs, ComEstimate]:
        prepared = prepare_com_inputs(task, folder, _no_progress, needs_force=method != GeometryOnly.name)
        return prepared, estimate_with_fallback(method, request, prepared, beyond_window=True)

    try:
        return estimate_by(request.method)
    except NotEstimable as refusal:
        if request.method is not None:
            raise
        prepared, estimate = estimate_by(GeometryOnly.name)
        remark = Remark("force-not-used", f"The centre of mass is that of the markers alone: {refusal.message}")
        return prepared, replace(estimate, remarks=(*estimate.remarks, remark))


def _no_progress(_fraction: float, _message: str) -> None:
    """Progress is reported per recording."""


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
        warnings=[base.Remark(code=r.code, message=r.message) for r in dict.fromkeys(remarks)],
    )


def _pooled_values(measures: Sequence[Measure]) -> list[MeasureValue]:
    summaries = summarise(measures)
    means = {(one.name, one.side): one.mean for one in summaries}
    values = []
    for one in summaries:
        left, right = means.get((one.name, "left")), means.get((one.name, "right"))
        symmetry = None
        if one.side is None and left is not None and right is not None and one.name not in SIGNED:
            symmetry = symmetry_index(left, right)
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
        "The force is measured throughout no stride; between the plates the velocity is too uncertain for energies.",
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
