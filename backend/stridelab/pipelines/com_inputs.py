"""Common first stage of all jobs on a recording: computes the estimators' inputs from the files of a task.

    file -> Recording -> landmarks -> GeometricCom -> WrenchTrack -> latency

``estimate-com`` and ``compare-estimators`` share this stage and therefore use identical inputs.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.errors import NotEstimable
from stridelab.estimation.time_span import SHORTEST_WINDOW_S
from stridelab.pipelines.body_mass import BodyMass, body_mass, session_masses, standing_masses
from stridelab.pipelines.latency_policy import LatencyChoice, choose_latency
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.requirements import require_marker_set, require_windows
from stridelab.pipelines.static_trial import assign_static_landmarks, read_static
from stridelab.pipelines.trial import Trial, examine_trial
from stridelab.recordings.gap_filling import MAX_GAP_S, true_runs
from stridelab.recordings.recording import Remark, Subject, Window, WrenchTrack
from stridelab.recordings.total_wrench import wrench_track
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.sessions import SessionValues
from stridelab.schemas.tasks import EstimateComTask


@dataclass(frozen=True)
class ComInputs:
    """Inputs of the estimators: geometric CoM, latency-corrected wrench, mass.

    ``windows`` is empty if the force is not used: no plates, no mass, or no window of at least ``SHORTEST_WINDOW_S``
    in which all contact force is measured. ``remarks`` collects the remarks of all steps so far. ``standing_mass_kg``
    is the mass measured in the static trial, None unless the subject stands still on the plates there. ``session``
    holds the session values that were used.
    """

    trial: Trial
    windows: tuple[Window, ...]
    geometric: GeometricCom
    wrench: WrenchTrack
    mass: BodyMass
    latency: LatencyChoice
    standing_mass_kg: float | None = None
    session: SessionValues | None = None
    static_remarks: tuple[Remark, ...] = ()

    @property
    def all_remarks(self) -> tuple[Remark, ...]:
        own = (*self.trial.remarks, *self.static_remarks, *self.geometric.remarks)
        return (*own, *self.mass.remarks, *self.latency.remarks)


def prepare_com_inputs(
    task: EstimateComTask, folder: Path, progress: ProgressCallback, *, needs_force: bool
) -> ComInputs:
    """Read the recording of ``task`` in ``folder`` and place the body segments; covers 0.02 to 0.7 of the progress.

    Raises ``UnreadableFile``, ``InvalidInput`` or ``NotEstimable`` for an unusable file, value or recording.
    """
    request = task.input
    progress(0.02, "reading the recording")
    static_file = read_static(task, folder)
    static_labels = [] if static_file.recording is None else list(static_file.recording.markers_m)
    trial = examine_trial(task.recording.model_copy(update={"static_labels": static_labels}), folder)
    recording = trial.recording
    require_marker_set(trial.match, tuple(recording.markers_m))
    windows = require_windows(trial, request.window_s, needs_force=needs_force)
    requested = Window(*request.window_s) if request.window_s is not None else None
    stated_subject = task.recording.subject
    standing = standing_masses(static_file.trial)
    standing_kg = standing[0].mass_kg if standing else None
    session = task.session
    session_mass = session_masses(session)
    mass = body_mass(
        stated_subject.mass_kg,
        recording.subject.mass_kg,
        session_mass or trial.masses,
        () if session_mass else standing,
        required=needs_force,
    )
    if session is not None and session_mass and mass.source == "force" and mass.stated_kg is None:
        message = (
            f"No mass is stated; the plates measure {mass.mass_kg:.1f} ± {mass.sd_kg:.1f} kg over "
            f"{session.mass_n_trials} trials of the session."
        )
        mass = replace(mass, remarks=(Remark("mass-from-session", message),))
    if not needs_force and not (mass.source and _has_estimable_window(windows, trial)):
        windows = ()

    progress(0.3, "placing the body segments")
    static, static_remarks = None, static_file.unusable
    if static_file.recording is not None:
        static, static_remarks = assign_static_landmarks(task, static_file.recording, recording, trial.match.landmarks)
    if session is not None and static is None:
        session = session.model_copy(update={"static_recording_id": None})
    subject = merged_subject(stated_subject, recording.subject, mass.known_kg)
    geometric = SegmentModel(table=request.segment_table).com(
        recording,
        trial.match.landmarks,
        subject=subject,
        static=None if static is None else static.recording,
        static_landmarks=None if static is None else static.landmarks,
    )

    progress(0.6, "comparing the clocks of force and markers")
    if not windows:
        wrench, latency = zero_wrench(geometric, requested), LatencyChoice(None, 0.0)
        return ComInputs(trial, windows, geometric, wrench, mass, latency, standing_kg, session, static_remarks)
    windows, cut = trim_missing_ends(windows, geometric)
    geometric = replace(geometric, remarks=(*geometric.remarks, *cut))

    def wrench_at(latency_s: float) -> WrenchTrack:
        return wrench_track(recording, windows, latency_s=latency_s)

    latency = choose_latency(request.latency, geometric, wrench_at, mass.mass_kg, session)
    wrench = wrench_at(latency.applied_s)
    return ComInputs(trial, windows, geometric, wrench, mass, latency, standing_kg, session, static_remarks)


def merged_subject(stated: SubjectFields, in_file: Subject, mass_kg: float | None) -> Subject:
    """Data on the subject; the user's values take precedence over the file's."""
    return Subject(
        height_m=stated.height_m or in_file.height_m,
        mass_kg=mass_kg,
        sex=stated.sex or in_file.sex,
        age_years=in_file.age_years if stated.age_years is None else stated.age_years,
    )


def zero_wrench(geometric: GeometricCom, interval: Window | None = None) -> WrenchTrack:
    """Zero wrench over the longest gap-free run of the geometric CoM.

    The run lies within the interval ``asked``, if given. The zeros only satisfy the estimators' interface and do not
    affect any reported number. Raises ``NotEstimable`` (``window-too-short``) if the longest run is shorter than
    ``SHORTEST_WINDOW_S``.
    """
    time_s = geometric.time_s
    seen = np.isfinite(geometric.com_m).all(axis=1)
    if interval is not None:
        seen &= (time_s >= interval.start_s - 1e-9) & (time_s <= interval.end_s + 1e-9)
    start, stop = max(true_runs(seen), key=lambda run: run[1] - run[0], default=(0, 0))
    lasts_s = (stop - start) * (float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0)
    if lasts_s < SHORTEST_WINDOW_S:
        where = "" if interval is None else " in the requested interval"
        message = f"The markers give a centre of mass for {lasts_s:.2f} s at a time{where}"
        raise NotEstimable("window-too-short", f"{message}; at least {SHORTEST_WINDOW_S} s are needed.")
    complete = np.zeros(len(time_s), dtype=bool)
    complete[start:stop] = True
    window = Window(float(time_s[start]), float(time_s[stop - 1]))
    nothing = np.zeros((len(time_s), 3))
    return WrenchTrack(time_s, nothing, nothing, complete, (window,))


def trim_missing_ends(
    windows: tuple[Window, ...], geometric: GeometricCom
) -> tuple[tuple[Window, ...], tuple[Remark, ...]]:
    """Trim frames without a geometric CoM from the ends of the windows; adds a remark for each trimmed window.

    At most ``MAX_GAP_S`` is trimmed at each end: gaps up to that length are interpolated inside a recording but cannot
    be at its ends. A longer gap stays in the window and is rejected by the estimators.
    """
    time_s = geometric.time_s
    seen = np.isfinite(geometric.com_m).all(axis=1)
    trimmed, remarks = [], []
    for window in windows:
        inside = np.flatnonzero((time_s >= window.start_s - 1e-9) & (time_s <= window.end_s + 1e-9))
        visible = inside[seen[inside]]
        start_s, end_s = window.start_s, window.end_s
        if len(visible) and visible[0] > inside[0] and time_s[visible[0]] - time_s[inside[0]] <= MAX_GAP_S:
            start_s = float(time_s[visible[0]])
        if len(visible) and visible[-1] < inside[-1] and time_s[inside[-1]] - time_s[visible[-1]] <= MAX_GAP_S:
            end_s = float(time_s[visible[-1]])
        trimmed.append(Window(start_s, end_s))
        if trimmed[-1] != window:
            message = (
                f"Of the interval from {window.start_s:.2f} to {window.end_s:.2f} s, {start_s:.2f} to {end_s:.2f} s"
            )
            message += " are used: needed markers are missing at its ends."
            remarks.append(Remark("window-cut-to-markers", message))
    return tuple(trimmed), tuple(remarks)


def _has_estimable_window(windows: tuple[Window, ...], trial: Trial) -> bool:
    """Whether any window lies within a measured window and is long enough for an estimate."""
    frame_s = 1.0 / trial.recording.marker_rate_hz
    return any(
        w.duration_s >= SHORTEST_WINDOW_S
        and any(m.start_s - frame_s <= w.start_s and w.end_s <= m.end_s + frame_s for m in trial.windows)
        for w in windows
    )
