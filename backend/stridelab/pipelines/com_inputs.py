"""Common first stage of all jobs on a recording: computes the estimators' inputs from the files of a task.

    file -> Recording -> landmarks -> GeometricCom -> WrenchTrack -> latency

``estimate-com`` and ``compare-estimators`` share this stage and therefore use identical inputs.

Requirements of ``estimate-com`` on the request and the recording, with their error messages.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.estimation.differentiation import SHORTEST_WINDOW_S
from stridelab.pipelines.mass_and_latency import (
    BodyMass,
    LatencyChoice,
    body_mass,
    choose_latency,
    session_mass_remarks,
    session_masses,
    standing_masses,
)
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import Trial, assign_static_landmarks, examine_trial, read_static
from stridelab.recordings import force_windows as measured
from stridelab.recordings.clipped_force import FORCE_CLIPPED
from stridelab.recordings.foot_contact import find_feet, is_treadmill, stated_belts_m_s
from stridelab.recordings.gap_filling import MAX_GAP_S, true_runs
from stridelab.recordings.marker_sets import WAYS_TO_NAME_MARKERS, MarkerSetMatch
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.recording import Remark, Subject, Window, WrenchTrack
from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import SubjectFields, TreadmillBelts
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

    def treadmill(self, frame: Literal["laboratory", "belt"]) -> TreadmillBelts | None:
        """Belts of the recording for a result whose positions are in ``frame``; None for a walk over ground."""
        recording = self.trial.recording
        if not is_treadmill(recording):
            return None
        feet = {foot.side: foot.ground_m_s for foot in find_feet(recording, self.trial.match.landmarks)}
        left, right = (float(np.linalg.norm(feet.get(side, self.geometric.ground_m_s))) for side in ("left", "right"))
        source = "stated" if stated_belts_m_s(recording) else "feet"
        return TreadmillBelts(left_m_s=left, right_m_s=right, source=source, frame=frame)


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
    source = task.recording.model_copy(update={"static_labels": static_labels})
    trial = examine_trial(source, folder, static_file.trial, task.session)
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
    mass = replace(mass, remarks=(*mass.remarks, *session_mass_remarks(session, trial.masses)))
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
    windows, cut = cut_to_geometry(windows, geometric)
    geometric = replace(geometric, remarks=(*geometric.remarks, *cut))

    def wrench_at(latency_s: float) -> WrenchTrack:
        return wrench_track(recording, windows, latency_s=latency_s)

    latency = choose_latency(request.latency, geometric, wrench_at, mass.mass_kg, session)
    wrench = replace(wrench_at(latency.applied_s), clocks_compared=True, clock_sd_s=latency.remaining_sd_s)
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

    The run lies within ``interval``, if given. The zeros only satisfy the estimators' interface and do not
    affect any reported number. Raises ``NotEstimable`` (``window-too-short``, ``recording-too-short``) if the longest
    run is shorter than ``SHORTEST_WINDOW_S`` or has too few frames.
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
        use = " The recording can serve as a static trial." if seen.all() and interval is None else ""
        raise NotEstimable("window-too-short", f"{message}; at least {SHORTEST_WINDOW_S} s are needed.{use}")
    measured.require_frames(stop - start)
    complete = np.zeros(len(time_s), dtype=bool)
    complete[start:stop] = True
    window = Window(float(time_s[start]), float(time_s[stop - 1]))
    nothing = np.zeros((len(time_s), 3))
    return WrenchTrack(time_s, nothing, nothing, complete, (window,))


def cut_to_geometry(
    windows: tuple[Window, ...], geometric: GeometricCom
) -> tuple[tuple[Window, ...], tuple[Remark, ...]]:
    """Restrict the windows to frames with a geometric CoM; adds a remark for each window that is cut.

    A window from which no part of at least ``SHORTEST_WINDOW_S`` remains stays whole and is rejected by the estimators.
    Up to ``MAX_GAP_S`` at an end is trimmed as ``window-cut-to-markers``: gaps of that length are interpolated inside a
    recording, but cannot be at its ends. Longer ones are ``geometry-gaps``.
    """
    time_s = geometric.time_s
    seen = np.isfinite(geometric.com_m).all(axis=1)
    cut, remarks = [], []
    for window in windows:
        inside = (time_s >= window.start_s - 1e-9) & (time_s <= window.end_s + 1e-9)
        if seen[inside].all():
            cut.append(window)
            continue
        runs = [(float(time_s[i]), float(time_s[j - 1])) for i, j in true_runs(seen & inside)]
        parts = [Window(start_s, end_s) for start_s, end_s in runs if end_s - start_s >= SHORTEST_WINDOW_S - 1e-9]
        cut += parts or [window]
        if not parts:
            continue
        ends_s = parts[0].start_s - window.start_s, window.end_s - parts[-1].end_s
        code = "window-cut-to-markers" if len(runs) == 1 and max(ends_s) <= MAX_GAP_S + 1e-9 else "geometry-gaps"
        used = " and ".join(f"{part.start_s:.2f} to {part.end_s:.2f} s" for part in parts)
        message = (
            f"Of the interval from {window.start_s:.2f} to {window.end_s:.2f} s, {used} are used: markers that the "
            "segment model needs are missing in the rest."
        )
        remarks.append(Remark(code, message))
    return tuple(cut), tuple(remarks)


def _has_estimable_window(windows: tuple[Window, ...], trial: Trial) -> bool:
    """Whether any window lies within a measured window and is long enough for an estimate."""
    frame_s = 1.0 / trial.recording.marker_rate_hz
    return any(
        w.duration_s >= SHORTEST_WINDOW_S
        and any(m.start_s - frame_s <= w.start_s and w.end_s <= m.end_s + frame_s for m in trial.windows)
        for w in windows
    )


def _require_unclipped_time(trial: Trial) -> None:
    """Raise ``NotEstimable`` (``window-too-short``) with the cause if an overloaded plate leaves too short windows."""
    clipped = [remark.message for remark in trial.recording.remarks if remark.code == FORCE_CLIPPED]
    longest_s = max((window.duration_s for window in trial.windows), default=0.0) + 1.0 / trial.recording.marker_rate_hz
    if clipped and longest_s < SHORTEST_WINDOW_S:
        message = f"All contact force is measured for {longest_s:.2f} s at a time; at least {SHORTEST_WINDOW_S} s are"
        raise NotEstimable("window-too-short", f"{message} needed. {' '.join(clipped)}")


def require_method(method: str) -> str:
    """Return ``method``. Raises ``NotEstimable`` (``method-unavailable``) if this version does not have it."""
    if method not in METHODS:
        raise NotEstimable(
            "method-unavailable",
            f"This version has no {method} estimator; it has: {', '.join(METHODS)}.",
            [Fault("method", f"{method} is not available")],
        )
    return method


_ONE_LEG_SHARE: Final = 0.5
"""Share of the landmarks of pelvis and legs that a set requires, above which missing ones of one side are named."""


def require_marker_set(match: MarkerSetMatch, labels: Sequence[str]) -> None:
    """Raise ``NotEstimable`` (``unknown-marker-set``) with the labels and the missing markers of the closest set."""
    if match.name is not None:
        return
    nearest = ", ".join(f"{name} ({share:.0%} of what it requires)" for name, share in match.nearest if share)
    faults = [
        Fault(f"nearest set {name}", f"missing: {', '.join(match.needed.get(name, ()))}")
        for name, share in match.nearest[:1]
        if share
    ]
    faults.append(Fault("labels found", ", ".join(labels) or "none"))
    finding = f"belong to no known marker set; nearest: {nearest or 'none'}"
    if match.nearest and match.nearest[0][1] >= _ONE_LEG_SHARE:
        lacking = {entry[:2] for entry in match.needed[match.nearest[0][0]]}
        if lacking in ({"l_"}, {"r_"}):
            finding += f". Only the {'right' if lacking == {'l_'} else 'left'} leg is marked; both legs are needed"
    if match.rivals:
        finding = f"fit several marker sets that take a label for different landmarks: {', '.join(match.rivals)}"
    raise NotEstimable(
        "unknown-marker-set",
        f"The {len(labels)} marker labels {finding}. {WAYS_TO_NAME_MARKERS}",
        faults,
    )


def require_windows(trial: Trial, window_s: tuple[float, float] | None, *, needs_force: bool) -> tuple[Window, ...]:
    """The windows to use: the measured ones, or the requested interval.

    Raises ``NotEstimable`` (``single-frame``, ``no-plates``, ``plates-switched-off``, ``plates-unloaded``,
    ``forces-and-markers-apart``, ``no-measured-window``, ``window-too-short``) where no force can be used,
    ``InvalidInput`` (``window-outside-recording``, ``window-not-measured``) where the requested interval is not inside
    the recording or a measured window.
    """
    if needs_force and not trial.windows:
        measured.require_windows(trial.recording, trial.match.landmarks, trial.motion, stated_kg=trial.stated_kg)
    if needs_force:
        _require_unclipped_time(trial)
    if window_s is None:
        return trial.windows
    start_s, end_s = window_s
    frame_s = 1.0 / trial.recording.marker_rate_hz
    duration_s = trial.recording.duration_s
    if not -frame_s <= start_s < end_s <= duration_s + frame_s:
        raise InvalidInput(
            "window-outside-recording",
            f"The recording lasts from 0 to {duration_s:.2f} s; there is no interval from {start_s:g} to {end_s:g} s.",
            [Fault("window_s", f"{start_s:g} to {end_s:g} s")],
        )
    whole = (Window(0.0, duration_s),)
    allowed = trial.windows if needs_force else whole
    if not any(w.start_s - frame_s <= start_s < end_s <= w.end_s + frame_s for w in allowed):
        listed = ", ".join(f"{w.start_s:.2f} to {w.end_s:.2f} s" for w in allowed)
        raise InvalidInput(
            "window-not-measured",
            f"The interval from {start_s:g} to {end_s:g} s is not inside a window in which all contact force is "
            f"measured; there is: {listed}.",
            [Fault("window_s", f"{start_s:g} to {end_s:g} s")],
        )
    return (Window(start_s, end_s),)
