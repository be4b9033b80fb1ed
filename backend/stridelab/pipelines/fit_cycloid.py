"""Cycloid fit of every step of one recording; shared by ``fit-cycloid`` and ``study-population``.

file -> Prepared -> ComEstimate -> steps -> StepFits -> summary
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Vector3
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.pipelines.com_inputs import ComInputs, prepare_com_inputs
from stridelab.pipelines.cycloid_summary import cycloid_summary
from stridelab.pipelines.estimate_com import assess_estimate, estimate_with_fallback, requested_method
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import examine_trial, read_static
from stridelab.recordings.foot_contact import find_feet, ground_of_feet_m_s
from stridelab.recordings.recording import Remark, Window
from stridelab.schemas.cycloid import FitCycloidSummary, FitCycloidTask
from stridelab.walking.gait_events import find_contacts
from stridelab.walking.preconditions import require_steps, require_walk
from stridelab.walking.step_fit import StepFit, fit_steps
from stridelab.walking.step_variability import step_scatter, strike_to_strike
from stridelab.walking.steps import GaitStep, find_steps

REFERENCES: Final = ("carpentier2017thesis",)


@dataclass(frozen=True)
class CycloidResult:
    """Cycloid fits of a recording with the CoM estimate and steps they are computed from.

    ``estimate`` is relative to the walking surface: on a treadmill the belt motion is removed. ``all_steps`` are all
    complete steps and ``fits`` the fitted ones, in chronological order.
    """

    prepared: ComInputs
    estimate: ComEstimate
    floor_m_s: Vector3
    ahead: Vector3
    all_steps: tuple[GaitStep, ...]
    fits: tuple[StepFit, ...]
    summary: FitCycloidSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the methods used."""
        used = (*self.prepared.geometric.references, *self.estimate.references, *REFERENCES)
        return tuple(dict.fromkeys(used))


def fit_cycloid_of_recording(
    task: FitCycloidTask, folder: Path, progress: ProgressCallback, *, rivals: bool = True
) -> CycloidResult:
    """Fit a cycloid to every step of ``task.recording`` in ``folder``; covers 0.02 to 0.95 of the progress.

    Without ``rivals`` the simpler curves are not fitted, which halves the time.

    Raises the errors of ``estimate-com``, and ``NotEstimable`` if the model does not apply (``require_walk``) or no
    step is measured (``require_steps``).
    """
    request = task.input
    method = requested_method(request)
    try:
        prepared = prepare_com_inputs(task, folder, progress, needs_force=method != GeometryOnly.name)
    except NotEstimable:
        _require_walk_recording(task, folder)
        raise
    recording, landmarks = prepared.trial.recording, prepared.trial.match.landmarks
    latency_s = prepared.latency.applied_s
    contacts = find_contacts(recording, landmarks, latency_s=latency_s)
    require_walk(recording, landmarks, contacts)

    windows = prepared.windows or (Window(0.0, recording.duration_s),)
    seen = find_steps(recording, landmarks, windows, contacts=contacts)
    wanted = [step for step in seen if step.measured or request.steps == "all"]
    require_steps(recording, seen, wanted, windows)

    progress(0.7, "estimating the centre of mass")
    floor = ground_of_feet_m_s(find_feet(recording, landmarks))
    in_place = estimate_with_fallback(method, request, prepared, beyond_window=request.window_s is None)
    quality = assess_estimate(prepared, in_place)
    estimate = _relative_to_floor(in_place, floor)

    progress(0.85, "fitting the wheel of every step")
    ahead = recording.walking_direction
    if ahead is None:
        ahead = walk_frame(estimate.velocity_m_s)[0]
    fits = fit_steps(estimate, wanted, ahead, windows)
    overlaps = strike_to_strike(estimate, seen, windows, ahead)
    between = step_scatter(fits, overlaps)
    summary = cycloid_summary(prepared, estimate, quality, ahead, seen, fits, overlaps, between, rivals=rivals)
    return CycloidResult(prepared, estimate, floor, ahead, seen, fits, summary)


def _require_walk_recording(task: FitCycloidTask, folder: Path) -> None:
    """Raise the error of ``require_walk`` if the recording is not a walk, before reporting missing inputs."""
    trial = examine_trial(task.recording, folder, read_static(task, folder).trial, task.session)
    if trial.match.name is not None:
        landmarks = trial.match.landmarks
        require_walk(trial.recording, landmarks, find_contacts(trial.recording, landmarks))


def _relative_to_floor(estimate: ComEstimate, floor_m_s: Vector3) -> ComEstimate:
    """Position and velocity relative to the walking surface."""
    if not floor_m_s.any():
        return estimate
    message = f"Treadmill: the belt speed of {np.linalg.norm(floor_m_s):.2f} m/s is added to the motion."
    return replace(
        estimate,
        com_m=estimate.com_m - floor_m_s * estimate.time_s[:, None],
        velocity_m_s=estimate.velocity_m_s - floor_m_s,
        remarks=(*estimate.remarks, Remark("belt-added", message)),
    )
