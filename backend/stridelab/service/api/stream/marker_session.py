"""Session of a stream of markers: from the bytes of a frame to its answer. Runs in the child process of the stream."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from pydantic import ValidationError

from stridelab.conventions import Points, Vector3
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.estimation.complementary.transfer_functions import AUTO_HIGH_HZ, AUTO_LOW_HZ
from stridelab.estimation.online.balance import BalanceSample, BalanceSetup, OnlineBalance
from stridelab.estimation.online.foot_support import LOADED_N, PlateReading
from stridelab.pipelines.progress import ProgressCallback
from stridelab.recordings.foot_contact import FOOT_LANDMARKS, SIDES
from stridelab.recordings.gap_filling import mark_missing
from stridelab.recordings.marker_sets import (
    KNEES,
    MarkerSet,
    MarkerSetMatch,
    absent_landmarks,
    identify,
    marker_set_of_labels,
    marker_sets,
)
from stridelab.recordings.orientation import rotation_to_z_up
from stridelab.recordings.recording import Recording, Subject
from stridelab.schemas.base import Remark
from stridelab.schemas.streams import (
    FrameBridged,
    FrameContact,
    FrameEstimate,
    FrameMargin,
    MarkerFrame,
    MarkerStreamReady,
    MarkerStreamTask,
    PlateForce,
    Triple,
)
from stridelab.service.api.stream.messages import TEXT, Parcel

PICTURE_S: Final = 0.0199
"""Shortest time between two pictures for those who watch."""
NEWEST: Final = 2
"""Of frames that wait together, those that are computed: a service that falls behind skips frames, not time."""
_SHOWN_FAULTS: Final = 20
BODY_M: Final = (0.25, 3.0)
"""Smallest and largest extent of the marked body between its 10th and 90th percentile: beyond it, units are wrong."""
_SIZE_IMPLAUSIBLE: Final = "size-implausible"
_AXIS_IMPLAUSIBLE: Final = "axis-implausible"
_HIDDEN: Final = (math.nan, math.nan, math.nan)
_FEET_NOT_MARKED: Final = Remark(
    code="feet-not-marked",
    message="A foot has no heel or forefoot marker: there is no base of support and no margin; forces are not used.",
)
_MASS_NOT_STATED: Final = Remark(
    code="mass-not-stated", message="The mass of the person is not stated: the forces of the plates are not used."
)


class MarkerSession:
    """Estimator of one stream; ``ready`` is the answer to its header, without the id of the stream.

    Raises ``InvalidInput`` (``marker-set-unknown``, ``marker-map-invalid``) and ``NotEstimable``
    (``unknown-marker-set``, ``knee-markers-missing``) for markers from which no centre of mass can be computed.
    """

    def __init__(self, task: MarkerStreamTask) -> None:
        stated = task.configuration
        match, self._labels = _recognise_markers(task)
        self._scale = 1.0 if stated.units == "m" else 1e-3
        self._R = rotation_to_z_up(stated.up_axis)
        self._n_plates = len(stated.plates)
        index = {label: k for k, label in enumerate(self._labels)}
        self._columns = [index[label] for label in match.landmarks.values()]
        subject = Subject(height_m=stated.person.height_m, mass_kg=stated.person.mass_kg, sex=stated.person.sex)
        pose = {label: self._to_world(np.array(p) * self._scale) for label, p in stated.static_pose.items()}
        pose |= {label: np.array(p) for label, p in task.static_world_m.items()}
        static = _static_recording(pose, subject) if pose else None
        static_landmarks = {**identify(list(pose)).landmarks, **match.landmarks} if pose else None
        if absent_landmarks(KNEES, match.landmarks) and static is None:
            raise NotEstimable(
                "knee-markers-missing",
                "The knees are not marked; send a static pose of the same person that marks them.",
                [Fault("static_pose", "missing")],
            )
        self._balance = OnlineBalance(
            BalanceSetup(
                match.landmarks,
                subject,
                stated.rate_hz,
                [self._to_world(np.array(plate.corners) * self._scale) for plate in stated.plates],
                stated.belt_speed_m_s,
                static,
                static_landmarks,
            )
        )
        self._pictured_s = -math.inf
        self._has_stood = False
        self.ready = self._describe(match, stated.person.mass_kg)

    def _describe(self, match: MarkerSetMatch, mass_kg: float | None) -> MarkerStreamReady:
        remarks = [Remark(code=remark.code, message=remark.message) for remark in match.degraded]
        feet = all(
            any(prefix + name in match.landmarks for name in ("heel", "ankle_lateral"))
            and any(prefix + name in match.landmarks for name in FOOT_LANDMARKS[1:])
            for _, prefix in SIDES
        )
        remarks += [] if feet else [_FEET_NOT_MARKED]
        remarks += [_MASS_NOT_STATED] if self._n_plates and mass_kg is None else []
        used = set(match.landmarks.values())
        return MarkerStreamReady(
            stream_id="",
            marker_set=match.name or "",
            labels=list(self._labels),
            landmarks=dict(match.landmarks),
            unused=[label for label in self._labels if label not in used],
            missing=list(match.missing),
            remarks=remarks,
            force_used=bool(self._n_plates and feet and mass_kg is not None),
            low_hz=AUTO_LOW_HZ,
            high_hz=AUTO_HIGH_HZ,
            references=["carpentier2017thesis", "carpentier2016spectral", "hof2005"],
        )

    def answer_frames(self, contents: Sequence[bytes]) -> list[Parcel]:
        """Estimates at frames that wait together: at the last ``NEWEST`` of them, as the others are overtaken.

        Raises ``InvalidInput`` (``invalid-frame``) if one is no frame.
        """
        frames = [parse_frame(content, len(self._labels), self._n_plates) for content in contents]
        answers = [
            self._answer(BalanceSample(frame.t_s, reason="overtaken", margin_reason="overtaken"))
            for frame in frames[:-NEWEST]
        ]
        overtaken = [Parcel(TEXT, answer.model_dump_json().encode(), 1) for answer in answers]
        return [*overtaken, *(self._answer_frame(frame) for frame in frames[-NEWEST:])]

    def _answer_frame(self, frame: MarkerFrame) -> Parcel:
        points = np.array([_HIDDEN if m is None else [math.nan if x is None else x for x in m] for m in frame.markers])
        points = self._to_world(mark_missing(points[None])[0] * self._scale)
        if not _is_as_large_as_a_person(points[self._columns]):
            implausible = BalanceSample(frame.t_s, reason=_SIZE_IMPLAUSIBLE, margin_reason=_SIZE_IMPLAUSIBLE)
            return Parcel(TEXT, self._answer(implausible).model_dump_json().encode(), 1)
        plates = frame.plates or [None] * self._n_plates
        with np.errstate(all="ignore"):  # hidden markers are NaN
            sample = self._balance.step(frame.t_s, points[self._columns], [self._reading(plate) for plate in plates])
        self._has_stood = self._has_stood or _stands_along_z(sample.joint_centres_m)
        if sample.com is not None and not self._has_stood:
            sample = _without_estimate(sample, _AXIS_IMPLAUSIBLE)
        answer = self._answer(sample)
        picture = ""
        if abs(frame.t_s - self._pictured_s) >= PICTURE_S:
            self._pictured_s = frame.t_s
            picture = json.dumps(_picture(sample, points, answer), allow_nan=False)
        return Parcel(TEXT, answer.model_dump_json().encode(), 1, picture)

    def _reading(self, plate: PlateForce | None) -> PlateReading | None:
        """Force and moment in the world frame; None if they are not known."""
        if plate is None:
            return None
        force, cop, moment = (_vector(v) for v in (plate.force_n, plate.cop, plate.moment_nm))
        if force is None:
            return None
        if moment is None and cop is not None:
            moment = np.cross(self._scale * cop, force)
        if moment is None:
            if np.linalg.norm(force) > LOADED_N:
                return None
            moment = np.zeros(3)
        return PlateReading(self._R @ force, self._R @ moment)

    def _answer(self, sample: BalanceSample) -> FrameEstimate:
        com = sample.com
        bridged = {name: value for name, value in asdict(sample.bridged).items() if name != "hidden"}
        ap, ml = sample.margin_ap_m, sample.margin_ml_m
        return FrameEstimate(
            t_s=sample.time_s,
            com_m=None if com is None else self._to_file(com.com_m),
            com_sd_m=None if com is None else _triple(np.abs(self._R.T) @ com.sd_m),
            velocity_m_s=None if com is None else self._to_file(com.velocity_m_s),
            xcom_m=None if sample.xcom_m is None else self._to_file(sample.xcom_m),
            height_m=sample.height_m,
            speed_m_s=sample.speed_m_s,
            reason=sample.reason,
            margin_m=None if ap is None or ml is None else FrameMargin(ap=ap, ml=ml),
            margin_reason=sample.margin_reason,
            contact=FrameContact(left=sample.contact.get("left"), right=sample.contact.get("right")),
            bridged=FrameBridged(markers_hidden=list(sample.bridged.hidden), **bridged),
        )

    def _to_world(self, points_m: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        return np.asarray(points_m @ self._R.T)

    def _to_file(self, vector: Vector3) -> Triple:
        return _triple(self._R.T @ vector)


class MarkerStreamAnswerer:
    """The work of a stream's child: its first task is the header, every other one the frames that wait."""

    def __init__(self) -> None:
        self._session: MarkerSession | None = None

    def __call__(self, task: dict[str, Any], _folder: Path | None, _progress: ProgressCallback) -> dict[str, Any]:
        """Answer a ``MarkerStreamTask`` (``header``) or parcels (``frames``) as JSON. Raises as ``MarkerSession``."""
        if self._session is not None:
            contents = [Parcel.from_json(frame).content for frame in task["frames"]]
            return {"answers": [answer.to_json() for answer in self._session.answer_frames(contents)]}
        self._session = MarkerSession(MarkerStreamTask.model_validate(task["header"]))
        return Parcel(TEXT, self._session.ready.model_dump_json().encode()).to_json()


def parse_frame(content: bytes, n_markers: int, n_plates: int) -> MarkerFrame:
    """Parse a frame. Raises ``InvalidInput`` (``invalid-frame``) naming the field."""
    try:
        frame = MarkerFrame.model_validate_json(content, strict=True)
    except ValidationError as error:
        faults = [
            Fault(".".join(str(part) for part in item["loc"])[:100] or "message", item["msg"][:200])
            for item in error.errors(include_url=False, include_input=False, include_context=False)[:_SHOWN_FAULTS]
        ]
        message = 'A frame must have the form {"t_s": ..., "markers": [[x, y, z] or null, ...], "plates": [...]}.'
        raise InvalidInput("invalid-frame", message, faults) from error
    counts = {"markers": (len(frame.markers), n_markers)}
    if frame.plates is not None:
        counts["plates"] = (len(frame.plates), n_plates)
    faults = [Fault(name, f"{n} instead of {due}") for name, (n, due) in counts.items() if n != due]
    if faults:
        wrong = " and ".join(f"{fault.message} {fault.where}" for fault in faults)
        raise InvalidInput(
            "invalid-frame", f"The frame at {frame.t_s:g} s has {wrong}, as stated in the header.", faults
        )
    return frame


def _is_as_large_as_a_person(points_m: Points) -> bool:
    """Whether the body may be a person's; True where more than half of its markers are hidden."""
    visible = points_m[np.isfinite(points_m).all(axis=1)]
    if 2 * len(visible) < len(points_m):
        return True
    low, high = np.quantile(visible, (0.1, 0.9), axis=0)
    return bool(BODY_M[0] <= float((high - low).max()) <= BODY_M[1])


def _stands_along_z(joints_m: Mapping[str, Vector3]) -> bool:
    """Whether z is the axis, of six, that is nearest to the body's, from the ankles to the neck (else to the hips).

    False where these are hidden. A person who lies or sits on the floor cannot be distinguished from a wrong axis, so
    that only a stream whose body has never stood along its axis has no estimate.
    """
    upper = ["cervical"] if "cervical" in joints_m else ["l_hip", "r_hip"]
    if not joints_m.keys() >= {"l_ankle", "r_ankle", *upper}:
        return False
    ankles_m = np.mean([joints_m["l_ankle"], joints_m["r_ankle"]], axis=0)
    x, y, z = (np.mean([joints_m[name] for name in upper], axis=0) - ankles_m).tolist()
    return bool(z >= max(abs(x), abs(y)))


def _without_estimate(sample: BalanceSample, reason: str) -> BalanceSample:
    """The sample with the reason in place of the centre of mass and all that follows from it."""
    return replace(
        sample,
        com=None,
        xcom_m=None,
        height_m=None,
        speed_m_s=None,
        margin_ap_m=None,
        margin_ml_m=None,
        reason=reason,
        margin_reason=reason,
    )


def _recognise_markers(task: MarkerStreamTask) -> tuple[MarkerSetMatch, list[str]]:
    """The marker set of a header, and the labels in the order of the frames."""
    stated = task.configuration
    own = [marker_set_of_labels(known.name, known.labels_of(), known.required or ()) for known in task.marker_sets]
    named: MarkerSet | None = None
    if stated.marker_set is not None:
        by_name = {**marker_sets(), **{known.name: known for known in own}}
        named = by_name.get(stated.marker_set)
        if named is None:
            raise InvalidInput(
                "marker-set-unknown",
                f"There is no marker set {stated.marker_set!r}; there are: {', '.join(by_name)}.",
                [Fault("marker_set", "unknown")],
            )
    labels = stated.labels
    if labels is None:
        labels = [] if named is None else [names[0] for names in named.labels.values()]
    match = identify(labels, stated.marker_map, own if named is None else [named], shipped=named is None)
    if match.name is None:
        from stridelab.pipelines.com_inputs import require_marker_set  # imports every estimator

        require_marker_set(match, labels)
    return match, labels


def _static_recording(pose_m: Mapping[str, Vector3], subject: Subject) -> Recording:
    """A static trial of one frame."""
    return Recording({label: p[None] for label, p in pose_m.items()}, 1.0, 1.0, (), subject, (), "+z", None)


def _picture(sample: BalanceSample, points_m: Points, answer: FrameEstimate) -> dict[str, Any]:
    """What those who watch draw: positions in metres with z up, and the answer."""

    def rounded(points: Points) -> list[list[float] | None]:
        return [None if not np.isfinite(p).all() else [round(float(x), 4) for x in p] for p in points]

    com = sample.com
    return {
        "markers": rounded(points_m),
        "joints": {name: rounded(centre[None])[0] for name, centre in sample.joint_centres_m.items()},
        "com": None if com is None else rounded(com.com_m[None])[0],
        "xcom": None if sample.xcom_m is None else rounded(sample.xcom_m[None])[0],
        "base": rounded(sample.base_m),
        "ahead": None if sample.ahead is None else rounded(sample.ahead[None])[0],
        "answer": answer.model_dump(mode="json"),
    }


def _vector(values: tuple[float | None, float | None, float | None] | None) -> Vector3 | None:
    """An array, or None unless all three are finite."""
    if values is None or any(x is None or not math.isfinite(x) for x in values):
        return None
    return np.array(values, dtype=np.float64)


def _triple(vector: Vector3) -> Triple:
    x, y, z = vector.tolist()
    return (x, y, z)
