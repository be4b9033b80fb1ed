"""Measures of gait of one recording.

file -> ComInputs -> ComEstimate -> contacts, steps -> WalkMotion -> measures
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import NotEstimable, StridelabError
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.measures.angular_momentum import angular_momentum_ranges
from stridelab.measures.energy_exchange import energy_exchange
from stridelab.measures.extrapolated_com import ExtrapolatedCom, extrapolated_com
from stridelab.measures.limb_work import limb_work
from stridelab.measures.local_stability import local_stability
from stridelab.measures.margin_of_stability import margins_of_stability
from stridelab.measures.measure import Measure
from stridelab.measures.rolling_wheel import rolling_wheel
from stridelab.measures.spatiotemporal import spatiotemporal
from stridelab.measures.stated_errors import calibrate_errors
from stridelab.measures.walk_motion import WalkMotion, walk_motion
from stridelab.pipelines.com_inputs import ComInputs, prepare_com_inputs
from stridelab.pipelines.estimate_com import assess_estimate, estimate_with_fallback, quality_schema
from stridelab.recordings.foot_contact import find_marked_feet
from stridelab.recordings.recording import Recording, Remark, Side
from stridelab.schemas.measures import MeasuresMember
from stridelab.schemas.quality import TrialQuality
from stridelab.schemas.tasks import EstimateComTask
from stridelab.walking.event_calibration import EventDifferences
from stridelab.walking.gait_events import Contact, find_contacts
from stridelab.walking.preconditions import require_walk
from stridelab.walking.steps import GaitStep, find_one_sided_steps, find_steps

SIDES: Final[tuple[Side, ...]] = ("left", "right")
LEAST_WEIGHT_SHARE: Final = 0.96
"""Share of the weight on the plates below which something else carries the person: limit of ``mass_from_motion``."""
ONE_FOOT: Final = "one-foot-marked"
"""Code of the remark, and of the reason why what needs the other foot is not measured."""
AID_WORDS: Final = re.compile(
    r"(?<![a-z])[lr]?(cane|crutch|stick|rollator|walker|handrail|rail)(?![a-z]{2})", re.IGNORECASE
)
"""In the label of a marker on a walking aid, behind the name of its subject."""
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


def measure_recording(
    recording_id: str, task: EstimateComTask, folder: Path, *, level: bool = True
) -> MeasuredRecording:
    """Measures of one recording; without ``level`` also of a walk on stairs, where margins and energies mean nothing.

    Without plates, body mass or an interval with all force on plates the CoM is that of the geometry alone, unless a
    method is requested. Raises the errors of ``estimate-com``, and ``NotEstimable`` if the recording is no walk
    (``require_walk``) or contains no whole step (``no-steps``).
    """
    prepared, estimate = _estimate_com(task, folder)
    recording, landmarks = prepared.trial.recording, prepared.trial.match.landmarks
    feet = find_marked_feet(recording, landmarks)
    remarks = _support_remarks(recording, [foot.side for foot in feet])
    quality = TrialQuality(
        recording_id=task.input.recording_id,
        filename=task.recording.filename,
        quality=quality_schema(assess_estimate(prepared, estimate)),
    )
    return measure_steps(
        recording_id,
        task,
        prepared,
        replace(estimate, remarks=(*estimate.remarks, *remarks)),
        quality,
        mass_kg=prepared.mass.known_kg,
        level=level,
    )


def measure_steps(
    recording_id: str,
    task: EstimateComTask,
    prepared: ComInputs,
    estimate: ComEstimate,
    quality: TrialQuality,
    *,
    mass_kg: float | None,
    session: Sequence[EventDifferences] = (),
    level: bool = True,
) -> MeasuredRecording:
    """Contacts, steps and measures of an estimate; ``session`` as in ``find_contacts``. Raises as above."""
    recording, landmarks = prepared.trial.recording, prepared.trial.match.landmarks
    feet = find_marked_feet(recording, landmarks)
    both = len(feet) == len(SIDES)
    contacts = find_contacts(
        recording, landmarks, latency_s=prepared.latency.applied_s, plates=both, feet=feet, session=session
    )
    require_walk(recording, landmarks, contacts, feet, level=level)
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
        mass_kg=mass_kg,
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
        *(() if _weight_is_beside(estimate) else limb_work(motion, contacts, steps)),
        *local_stability(motion, steps),
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
        estimate,
        quality,
    )


def _weight_is_beside(estimate: ComEstimate) -> bool:
    """Whether something beside the plates carries weight, so that they do not measure the work of the legs."""
    return any(remark.code == WEIGHT_BESIDE for remark in estimate.remarks)


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


def measure_without_plates(one: MeasuredRecording, member: MeasuresMember, folder: Path) -> MeasuredRecording | None:
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


def _estimate_com(task: EstimateComTask, folder: Path) -> tuple[ComInputs, ComEstimate]:
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
