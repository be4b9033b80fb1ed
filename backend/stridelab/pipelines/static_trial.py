"""The static trial of a recording: stated, or found in its session; read, and its labels named as landmarks.

What cannot be used is never left out silently: a stated trial is refused, one that was found is a remark.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.pipelines.trial import Trial, examine, map_within
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording, Remark
from stridelab.recordings.same_body import SAME_BODY_M, body_difference
from stridelab.recordings.standing import stands_still
from stridelab.schemas.tasks import EstimateComTask, RecordingSource

LABELS_SHARED: Final = 0.5
"""Share of the recording's labels below which the static trial is said to have others."""
LEAST_LANDMARKS: Final = 4
"""A cluster has four markers: three that are seen, and the one that they rebuild."""


@dataclass(frozen=True)
class StaticTrial:
    """A static trial with its landmarks (landmark to label), and what should be known about it."""

    recording: Recording
    landmarks: Mapping[str, str]
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class StaticFile:
    """A static trial that was read, before its labels are named; ``unusable`` says why it cannot be used."""

    trial: Trial | None
    unusable: tuple[Remark, ...] = ()

    @property
    def recording(self) -> Recording | None:
        """Its recording."""
        return None if self.trial is None else self.trial.recording


def read_static(task: EstimateComTask, folder: Path) -> StaticFile:
    """Read the static trial of ``task``, if it has one.

    Raises what reading raises for one that was stated; of the session's own choice that is a remark.
    """
    if task.static is None:
        return StaticFile(None)
    try:
        return StaticFile(examine(task.static, folder))
    except StridelabError as error:
        if not _chosen(task):
            raise
        return StaticFile(None, (_not_used(task.static, error.message),))


def named_static(
    task: EstimateComTask, static: Recording, recording: Recording, landmarks: Mapping[str, str]
) -> tuple[StaticTrial | None, tuple[Remark, ...]]:
    """``static`` with its landmarks, or the remark why it is not used; ``landmarks`` are those of ``recording``.

    A static trial in which nobody stands still, of another body or of other labels is used with a remark.

    A label means what it means in the trial, else what the marker maps say, else what the static trial's own marker
    set says. Raises ``InvalidInput`` (``static-unusable``) where fewer than ``LEAST_LANDMARKS`` of a stated static
    trial are known.
    """
    source = task.static
    if source is None:
        return None, ()
    stated = {**map_within(source.marker_map, static), **map_within(task.recording.marker_map, static)}
    match = identify(tuple(static.markers_m), stated)
    shared = {name: label for name, label in landmarks.items() if label in static.markers_m}
    named = {**match.landmarks, **stated, **shared}
    if len(named) < LEAST_LANDMARKS:
        labels = ", ".join(static.markers_m)
        why = f"its {len(static.markers_m)} labels belong to no known marker set and are not those of this recording"
        if _chosen(task):
            return None, (_not_used(source, why),)
        raise InvalidInput(
            "static-unusable",
            f"The static trial {source.filename} cannot be used: {why}. Map its labels to landmarks.",
            [Fault("labels found", labels or "none")],
        )
    remarks: tuple[Remark, ...] = ()
    if _chosen(task):
        message = f"{source.filename} stands still and is of the same session: it is used as the static trial."
        remarks = (Remark("static-from-session", message),)
    if match.name is None:
        message = (
            f"The marker set of the static trial {source.filename} is not recognised: only the {len(named)} landmarks "
            "that it shares with this recording, or that were mapped, are used."
        )
        remarks = (*remarks, Remark("static-set-unknown", message))
    elif len(shared) < LABELS_SHARED * len(landmarks):
        message = (
            f"The static trial {source.filename} has {len(shared)} of the {len(landmarks)} labels that are landmarks "
            f"in this recording; its other landmarks are those of its own marker set, {match.name}."
        )
        remarks = (*remarks, Remark("static-labels-differ", message))
    if not stands_still(static):
        message = f"Nobody stands still in the static trial {source.filename}: the shape of the body is less certain."
        remarks = (*remarks, Remark("static-not-still", message))
    remarks = (*remarks, *_of_another_body(source, static, named, recording, landmarks))
    return StaticTrial(static, named, remarks), remarks


def _of_another_body(
    source: RecordingSource,
    static: Recording,
    named: Mapping[str, str],
    recording: Recording,
    landmarks: Mapping[str, str],
) -> tuple[Remark, ...]:
    """A remark where markers of one segment are not as far apart as in the recording."""
    found = body_difference(static, named, recording, landmarks)
    if found is None or found.difference_m <= SAME_BODY_M:
        return ()
    first, second = found.landmarks
    message = (
        f"The static trial {source.filename} shows another body than this recording: {first} and {second} are "
        f"{1000.0 * found.one_m:.0f} mm apart there and {1000.0 * found.other_m:.0f} mm here. It is of another person, "
        "or markers were moved."
    )
    return (Remark("static-other-body", message),)


def _chosen(task: EstimateComTask) -> bool:
    """Whether the static trial was found in the session, not stated."""
    return task.session is not None and task.session.static_recording_id is not None


def _not_used(source: RecordingSource, why: str) -> Remark:
    return Remark("static-not-used", f"{source.filename} of the same session stands still, but is not used: {why}.")
