"""Static trial of a recording, given by the user or selected from the session: reading and landmark assignment.

An unusable static trial raises an error if the user gave it, and adds a remark if it was selected from the session.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.pipelines.trial import Trial, examine_trial, map_of_present_labels
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording, Remark
from stridelab.recordings.same_body import SAME_BODY_M, body_difference
from stridelab.recordings.standing import stands_still
from stridelab.schemas.tasks import EstimateComTask, RecordingSource

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
        return StaticFile(examine_trial(task.static, folder))
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
    user has fewer than ``LEAST_LANDMARKS`` landmarks.
    """
    source = task.static
    if source is None:
        return None, ()
    stated = {
        **map_of_present_labels(source.marker_map, static),
        **map_of_present_labels(task.recording.marker_map, static),
    }
    match = identify(tuple(static.markers_m), stated)
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
