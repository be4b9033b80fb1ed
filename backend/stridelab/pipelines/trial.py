"""Reading of a stored file: recording, marker set, measured windows and body mass.

Shared by the parsing of uploads and the estimation, so that both use the same facts. Also the static trial of a
recording, given by the user or selected from the session: reading and landmark assignment. An unusable static trial
raises an error if the user gave it, and adds a remark if it was selected from the session.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel, without_foreign_subject
from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.estimation.latency import estimate_latency
from stridelab.recordings.body_mass import MassEstimate, VerticalMotion, best_mass, vertical_motion, weigh
from stridelab.recordings.force_plates import with_session_zeros
from stridelab.recordings.force_windows import find_windows
from stridelab.recordings.marker_sets import MarkerSetMatch, identify, marker_set_of_labels
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.proposed_set import propose_marker_set
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import PlateSwitches, Recording, Remark, Subject, Window
from stridelab.recordings.static_pose import SAME_BODY_M, body_difference, stands_still
from stridelab.recordings.technical_clusters import technical_landmarks
from stridelab.schemas.recordings import EventDelay, EventDelays, PlateSwitch, SubjectFields, TrialClock
from stridelab.schemas.sessions import SessionValues
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.walking.event_calibration import EventDifferences, mean_differences


@dataclass(frozen=True)
class Trial:
    """A recording with all facts that follow from the file and its plate switches.

    ``masses`` are the masses estimated from the force, at most one of each kind. ``motion`` and ``stated_kg`` (the
    user's mass, else the file's) are the inputs of the window search. ``joint_centres_m`` are those of the segment
    model by name, shape (n, 3), for drawing the body; empty if the segments cannot be placed.
    """

    recording: Recording
    match: MarkerSetMatch
    windows: tuple[Window, ...]
    masses: tuple[MassEstimate, ...]
    remarks: tuple[Remark, ...]
    motion: VerticalMotion | None = None
    stated_kg: float | None = None
    joint_centres_m: Mapping[str, Points] = field(default_factory=dict)

    @property
    def force_mass(self) -> MassEstimate | None:
        """The most accurate mass estimate from the force."""
        return best_mass(self.masses)

    @property
    def force_mass_kg(self) -> float | None:
        """Value of ``force_mass`` in kilograms."""
        return None if self.force_mass is None else self.force_mass.mass_kg


def read_source(source: RecordingSource, folder: Path) -> Recording:
    """Read the file of a source with the user's marker map and plate switches.

    Raises ``UnreadableFile`` or ``InvalidInput``; messages name the uploaded file, not its copy in ``folder``. The map
    may also contain labels of the static trial (``source.static_labels``).
    """
    static_labels = frozenset(source.static_labels)
    own = {landmark: label for landmark, label in source.marker_map.items() if label not in static_labels}
    try:
        path, plates = folder / source.file, reader_switches(source.plates)
        return read_recording(path, name=source.filename, marker_map=own, plate_switches=plates)
    except StridelabError as error:
        raise _with_uploaded_name(error, source.file, source.filename) from error


def examine_trial(
    source: RecordingSource,
    folder: Path,
    static: "Trial | None" = None,
    session: SessionValues | None = None,
    *,
    propose: bool = True,
) -> Trial:
    """Read a source; identify its marker set, measured windows and the masses estimated from the force.

    ``static`` is its static trial, which names labels of a walk whose own set is unknown, and technical clusters.
    ``session`` gives the zeros of plates that are never unloaded in this trial. With ``propose``, labels that neither a
    set nor a user names are named by ``propose_marker_set``.
    """
    recording = with_session_zeros(read_source(source, folder), {} if session is None else session.plate_zeros)
    match = identify_source(source, recording, map_of_present_labels(source.marker_map, recording))
    match = named_by_static(match, recording, static)
    if propose and match.name is None and not match.rivals and source.shipped_sets and not source.marker_map:
        match = propose_marker_set(recording) or match
    recording = without_foreign_subject(recording, match.landmarks)
    body, body_remarks = _place_body(recording, match)
    com_m = body.com_m if body is not None and recording.plates else None
    motion = vertical_motion(recording, match.landmarks, com_m)
    stated_kg = source.subject.mass_kg or recording.subject.mass_kg
    search = find_windows(recording, match.landmarks, motion, stated_kg=stated_kg)
    remarks = (*recording.remarks, *match.degraded, *body_remarks, *search.remarks)
    masses = weigh(recording, search.windows, motion)
    joint_centres_m = {} if body is None else body.joint_centres_m
    return Trial(recording, match, search.windows, masses, remarks, motion, stated_kg, joint_centres_m)


def identify_source(source: RecordingSource, recording: Recording, marker_map: Mapping[str, str]) -> MarkerSetMatch:
    """Identify the marker set of ``recording`` among the shipped ones and those of users in ``source``.

    A recording of a body model needs no landmarks: with unknown names of bodies its set is ``BODY_MODEL``.
    """
    own_sets = [marker_set_of_labels(own.name, own.labels_of(), own.required or ()) for own in source.marker_sets]
    match = identify(tuple(recording.markers_m), marker_map, own_sets, shipped=source.shipped_sets)
    if not recording.segments:
        return match
    return replace(match, name=match.name or BODY_MODEL, missing=(), degraded=(), rivals=())


def named_by_static(match: MarkerSetMatch, recording: Recording, static: "Trial | None") -> MarkerSetMatch:
    """``match`` with the names that the static trial gives to labels of ``recording``; unchanged without any.

    A recording of an unknown set takes the names of the static trial's set. The markers that move with a thigh or a
    shank become its technical cluster, which carries the landmarks that only the static trial has.
    """
    if static is None or static.match.name is None:
        return match
    name, landmarks, remarks = match.name, dict(match.landmarks), match.degraded
    if name is None:
        shared = {mark: label for mark, label in static.match.landmarks.items() if label in recording.markers_m}
        if not shared:
            return match
        name, landmarks = static.match.name, shared | landmarks
        message = f"The markers are named by the static trial, whose set is {name}: {', '.join(shared.values())}."
        remarks = (*remarks, Remark("named-by-static", message))
    technical = technical_landmarks(recording, landmarks, static.recording, static.match.landmarks)
    if technical:
        clusters = ", ".join(f"{label} ({mark})" for mark, label in technical.items())
        message = (
            f"Markers that move with a segment in both trials carry the landmarks of the static trial: {clusters}."
        )
        remarks = (*remarks, Remark("technical-clusters", message))
    return replace(match, name=name, landmarks=landmarks | technical, degraded=remarks)


def _place_body(recording: Recording, match: MarkerSetMatch) -> tuple[GeometricCom | None, tuple[Remark, ...]]:
    """Segments and geometric CoM, which gives the velocity; None if the segments cannot be placed.

    A remark says that left and right are exchanged, which no static trial mends, unlike a hidden marker.
    """
    if match.name is None or recording.n_frames < 2:
        return None, ()
    try:
        return SegmentModel().com(recording, match.landmarks, subject=recording.subject), ()
    except StridelabError as error:
        return None, (Remark(error.code, error.message),) if error.code == SIDES_SWAPPED else ()


def map_of_present_labels(marker_map: Mapping[str, str], recording: Recording) -> dict[str, str]:
    """The entries of a map (landmark to label) whose label is in the recording."""
    return {landmark: label for landmark, label in marker_map.items() if label in recording.markers_m}


def reader_switches(plates: Mapping[int, PlateSwitch]) -> dict[int, PlateSwitches]:
    """Convert plate switches from the request schema to those of the reader."""
    return {index: PlateSwitches(**switch.model_dump(exclude_none=True)) for index, switch in plates.items()}


def subject_fields(subject: Subject) -> SubjectFields:
    """Convert the subject of a file to the response schema; implausible values were removed by the reader."""
    return SubjectFields(
        height_m=subject.height_m, mass_kg=subject.mass_kg, sex=subject.sex, age_years=subject.age_years
    )


def _with_uploaded_name(error: StridelabError, stored: str, uploaded: str) -> StridelabError:
    faults = [Fault(uploaded if fault.where == stored else fault.where, fault.message) for fault in error.faults]
    return type(error)(error.code, error.message, faults)


SIDES_SWAPPED: Final = "sides-swapped"
"""Code of the remark, and of the error of every method, if markers of the right side lie on the left."""
BODY_MODEL: Final = "body-model"
"""Marker set of a recording whose body model has bodies of unknown names: its feet are then unknown, too."""
MIN_SHARED_LABELS: Final = 0.5
"""Minimum share of the recording's landmark labels in the static trial; below it a remark is added."""
MIN_LANDMARKS: Final = 4
"""Size of a marker cluster: three visible markers and the one reconstructed from them."""


@dataclass(frozen=True)
class StaticTrial:
    """A static trial with its landmarks (landmark to label) and remarks."""

    recording: Recording
    landmarks: Mapping[str, str]
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class StaticFile:
    """A static trial as read, before landmarks are assigned; ``unusable`` explains why it cannot be used."""

    trial: Trial | None
    unusable: tuple[Remark, ...] = ()

    @property
    def recording(self) -> Recording | None:
        """The recording of the trial; None without one."""
        return None if self.trial is None else self.trial.recording


def read_static(task: EstimateComTask, folder: Path) -> StaticFile:
    """Read the static trial of ``task``, if any.

    Errors of reading propagate if the user gave the trial; for a trial selected from the session they become a remark.
    """
    if task.static is None:
        return StaticFile(None)
    try:
        return StaticFile(examine_trial(task.static, folder, session=task.session, propose=False))
    except StridelabError as error:
        if not _selected_from_session(task):
            raise
        return StaticFile(None, (_not_used_remark(task.static, error.message),))


def assign_static_landmarks(
    task: EstimateComTask, static: Recording, recording: Recording, landmarks: Mapping[str, str]
) -> tuple[StaticTrial | None, tuple[Remark, ...]]:
    """Assign landmarks to ``static``, or explain in a remark why it is not used.

    ``landmarks`` are those of ``recording``. A static trial with movement, of a different body or with different labels
    is used with a remark. A label denotes the landmark that it has in the recording, else in the marker maps, else in
    the marker set of the static trial. Raises ``InvalidInput`` (``static-unusable``) if a static trial given by the
    user has fewer than ``MIN_LANDMARKS`` landmarks.
    """
    source = task.static
    if source is None:
        return None, ()
    stated = {
        **map_of_present_labels(source.marker_map, static),
        **map_of_present_labels(task.recording.marker_map, static),
    }
    match = identify_source(source, static, stated)
    shared = {name: label for name, label in landmarks.items() if label in static.markers_m}
    named = {**match.landmarks, **stated, **shared}
    if len(named) < MIN_LANDMARKS:
        labels = ", ".join(static.markers_m)
        why = f"its {len(static.markers_m)} labels belong to no known marker set and are not those of this recording"
        if _selected_from_session(task):
            return None, (_not_used_remark(source, why),)
        raise InvalidInput(
            "static-unusable",
            f"The static trial {source.filename} cannot be used: {why}. Map its labels to landmarks.",
            [Fault("labels found", labels or "none")],
        )
    remarks: tuple[Remark, ...] = ()
    if _selected_from_session(task):
        message = f"{source.filename} is motionless and of the same session: it is used as the static trial."
        remarks = (Remark("static-from-session", message),)
    if match.name is None:
        message = (
            f"The marker set of the static trial {source.filename} is not recognised: only the {len(named)} landmarks "
            "that it shares with this recording, or that were mapped, are used."
        )
        remarks = (*remarks, Remark("static-set-unknown", message))
    elif len(shared) < MIN_SHARED_LABELS * len(landmarks):
        message = (
            f"The static trial {source.filename} has {len(shared)} of the {len(landmarks)} labels that are landmarks "
            f"in this recording; its other landmarks are those of its own marker set, {match.name}."
        )
        remarks = (*remarks, Remark("static-labels-differ", message))
    if not stands_still(static):
        message = f"The subject moves in the static trial {source.filename}: the body dimensions are less certain."
        remarks = (*remarks, Remark("static-not-still", message))
    remarks = (*remarks, *_other_body_remarks(source, static, named, recording, landmarks))
    return StaticTrial(static, named, remarks), remarks


def _other_body_remarks(
    source: RecordingSource,
    static: Recording,
    named: Mapping[str, str],
    recording: Recording,
    landmarks: Mapping[str, str],
) -> tuple[Remark, ...]:
    """A remark if distances between markers of one segment differ from those in the recording."""
    difference = body_difference(static, named, recording, landmarks)
    if difference is None or difference.difference_m <= SAME_BODY_M:
        return ()
    first, second = difference.landmarks
    message = (
        f"The static trial {source.filename} shows a different body from this recording: {first} and {second} are "
        f"{1000.0 * difference.one_m:.0f} mm apart there and {1000.0 * difference.other_m:.0f} mm here. It is of "
        "another subject, or markers were moved."
    )
    return (Remark("static-other-body", message),)


def _selected_from_session(task: EstimateComTask) -> bool:
    """Whether the static trial was selected from the session rather than given by the user."""
    return task.session is not None and task.session.static_recording_id is not None


def _not_used_remark(source: RecordingSource, why: str) -> Remark:
    return Remark("static-not-used", f"{source.filename} of the same session is motionless, but is not used: {why}.")


def clock_of(trial: Trial) -> TrialClock | None:
    """Latency of the force in this trial; None if it cannot be estimated.

    Uses the mass in the file, else the mass from the plates, but no value given by the user. Errors return None, so
    that they do not prevent an upload.
    """
    recording, mass_kg = trial.recording, trial.recording.subject.mass_kg or trial.force_mass_kg
    if trial.match.name is None or not trial.windows or mass_kg is None:
        return None
    in_file = recording.subject
    subject = Subject(in_file.height_m, mass_kg, in_file.sex, in_file.age_years)
    try:
        geometric = SegmentModel().com(recording, trial.match.landmarks, subject=subject)
        latency = estimate_latency(
            geometric, lambda latency_s: wrench_track(recording, trial.windows, latency_s=latency_s), mass_kg
        )
    except (StridelabError, ArithmeticError, ValueError):
        return None
    return TrialClock(latency_s=latency.latency_s, sd_s=latency.sd_s)


def session_differences(trial: Trial, latency_s: float) -> EventDifferences:
    """Mean differences of marker events from plate events of a recording with the latency ``latency_s`` of its force.

    Empty if one foot is marked: the other may load its plate.
    """
    # It imports scipy.signal, which takes longer than the estimation of a walk.
    from stridelab.walking.gait_events import plate_differences

    return mean_differences(plate_differences(trial.recording, trial.match.landmarks, latency_s=latency_s))


def event_delays_of(trial: Trial, clock: TrialClock | None) -> EventDelays:
    """``session_differences`` as facts, which hold for any latency of the force; nothing instead of errors."""
    latency_s = 0.0 if clock is None else clock.latency_s
    try:
        means = session_differences(trial, latency_s)
    except (StridelabError, ArithmeticError, ValueError):
        return EventDelays()
    return EventDelays.model_validate(
        {kind: EventDelay(late_s=one.late_s - latency_s, sd_s=one.own_s) for kind, of in means.items() for one in of}
    )
