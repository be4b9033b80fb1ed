"""Segment model of the CoM, c = sum_s m_s p_s: input (i) of section 2.4.1 of the thesis.

Segment frames: origin, axes (X forwards, Y upwards, Z rightwards) and length, to which a segment table refers.

A limb's frame lies at its upper joint P with the lower joint D:

    Y = (P - D) / |P - D|,   X = Y x z / |Y x z|,   Z = X x Y,   length = median |P - D|

where z points roughly to the right (from the inner and outer landmark of the lower joint, else from pelvis or trunk).
Frames: pelvis (origin lumbar joint), torso (cervical joint), head (cervical joint), ``*_upper_arm``, ``*_forearm``,
``*_hand``, ``*_thigh``, ``*_shank``, ``*_foot`` (origin ankle, X along heel -> forefoot, length ankle to forefoot) as
in Dumas and Wojtusch 2018; trunk (mid-shoulder to mid-hip), head_neck (C7 to vertex), ``*_whole_foot`` (heel to toe
tip) as in de Leva 1996.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from stridelab.body import segment_tables
from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.body.joint_centres import (
    Joints,
    Tracks,
    has_landmarks,
    joint_centres,
    pelvis_axes,
    shank_length_m,
    with_pelvis,
)
from stridelab.body.segment_tables import Anthropometry, SegmentTable, load_anthropometry
from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.recordings.foot_contact import walking_surface_m_s
from stridelab.recordings.gap_filling import CLUSTERS, Shapes, bridge_segment_gaps, rebuild_markers
from stridelab.recordings.marker_sets import Substitute, all_substitutes, identify
from stridelab.recordings.orientation import component_along, cross, median_distance_m, median_or_nan, unit
from stridelab.recordings.recording import Recording, Remark, Sex, Subject

SEX_UNKNOWN: Final = Substitute(
    code="sex-unknown",
    message="The sex of the subject is not stated: the mean of the female and the male body is used",
    landmarks=(),
    horizontal_mm=2.0,
    vertical_mm=5.0,
)
SHANK_SHARE: Final = 0.246
"""Shank over stature (Drillis and Contini 1966; Winter 2009)."""
POSSIBLE_STATURE: Final = (0.7, 1.4)
"""Stated stature over that of the legs: 1.4 is a shank of 0.34 of the stature, 0.7 one of 0.17."""


def applied_substitutes(codes: Iterable[str]) -> tuple[Substitute, ...]:
    """The substitutes with these codes; a larger gap replaces the smaller ones in it."""
    codes = frozenset(codes)
    known = all_substitutes()
    return tuple(known[code] for code in known if code in codes and not codes & set(known[code].hidden_by))


def widened_sd_m(sd_m: tuple[float, float, float], gaps: Iterable[Substitute]) -> tuple[float, float, float]:
    """Table error and the errors of the substitutes added in quadrature, per world axis."""
    gaps = tuple(gaps)
    horizontal = sum((gap.horizontal_mm / 1e3) ** 2 for gap in gaps)
    vertical = sum((gap.vertical_mm / 1e3) ** 2 for gap in gaps)
    x, y, z = sd_m
    return (x * x + horizontal) ** 0.5, (y * y + horizontal) ** 0.5, (z * z + vertical) ** 0.5


@dataclass(frozen=True)
class Frame:
    """Axes of a segment over time and its constant length."""

    origin_m: Points
    X: Points
    Y: Points
    Z: Points
    length_m: float

    def point_at(self, k: tuple[float, float, float]) -> Points:
        """World position of the point with coordinates ``k`` (forwards, upwards, rightwards) per length."""
        return self.origin_m + self.length_m * (k[0] * self.X + k[1] * self.Y + k[2] * self.Z)


def segment_frames(p: Tracks, joints: Joints, body: Anthropometry) -> dict[str, Frame]:
    """Frames of all segments by name."""
    c, z = joints.centres, joints.rightward
    X, Y, Z = pelvis_axes(p)
    hips = (c["l_hip"] + c["r_hip"]) / 2
    shoulders = (c["l_shoulder"] + c["r_shoulder"]) / 2
    to_hips = hips - c["lumbar"]
    sagittal = to_hips - component_along(to_hips, Z)
    nape = p.get("c7", c["cervical"])
    frames = {
        "pelvis": Frame(c["lumbar"], X, Y, Z, median_or_nan(np.linalg.norm(sagittal, axis=1))),
        "torso": limb_frame(c["cervical"], c["lumbar"], z["torso"]),
        "head": _upward_frame(c["cervical"], c["vertex"], z["head"]),
        "trunk": limb_frame(shoulders, hips, z["torso"]),
        "head_neck": _upward_frame(nape, c["vertex"], z["head"]),
    }
    for s in "lr":
        frames[f"{s}_upper_arm"] = limb_frame(c[f"{s}_shoulder"], c[f"{s}_elbow"], z[f"{s}_upper_arm"])
        frames[f"{s}_forearm"] = limb_frame(c[f"{s}_elbow"], c[f"{s}_wrist"], z[f"{s}_forearm"])
        frames[f"{s}_hand"] = _hand_frame(s, joints, frames[f"{s}_forearm"], body)
        frames[f"{s}_thigh"] = limb_frame(c[f"{s}_hip"], c[f"{s}_knee"], z[f"{s}_thigh"])
        frames[f"{s}_shank"] = limb_frame(c[f"{s}_knee"], c[f"{s}_ankle"], z[f"{s}_shank"])
        frames[f"{s}_foot"] = foot = _foot_frame(p, s, joints, frames[f"{s}_shank"], body)
        frames[f"{s}_whole_foot"] = _whole_foot_frame(p, s, foot, frames[f"{s}_shank"], body)
    return frames


def limb_frame(proximal: Points, distal: Points, rightward: Points) -> Frame:
    """Frame at ``proximal`` with Y from ``distal`` to ``proximal``."""
    Y = unit(proximal - distal)
    X = unit(cross(Y, rightward))
    return Frame(proximal, X, Y, cross(X, Y), median_distance_m(proximal, distal))


def _upward_frame(base: Points, top: Points, rightward: Points) -> Frame:
    frame = limb_frame(top, base, rightward)
    return Frame(base, frame.X, frame.Y, frame.Z, frame.length_m)


def _hand_frame(s: str, joints: Joints, forearm: Frame, body: Anthropometry) -> Frame:
    """Hand from wrist to knuckles; without knuckles it continues the forearm with a proportional length."""
    c, wrist = joints.centres, joints.centres[f"{s}_wrist"]
    if has_landmarks(c, f"{s}_knuckles"):
        return limb_frame(wrist, c[f"{s}_knuckles"], joints.rightward.get(f"{s}_hand", forearm.Z))
    length = forearm.length_m * body.length_m["hand"] / body.length_m["forearm"]
    return Frame(wrist, forearm.X, forearm.Y, forearm.Z, length)


def _foot_frame(p: Tracks, s: str, joints: Joints, shank: Frame, body: Anthropometry) -> Frame:
    """Foot with X from heel to forefoot (or toe, or 5th metatarsal); without them it is perpendicular to the shank."""
    c, ankle = joints.centres, joints.centres[f"{s}_ankle"]
    tip = c.get(f"{s}_forefoot", p.get(f"{s}_toe", p.get(f"{s}_mt5")))
    length = shank.length_m * body.length_m["foot"] / body.length_m["shank"]
    if has_landmarks(c, f"{s}_forefoot"):
        length = median_distance_m(ankle, c[f"{s}_forefoot"])
    if tip is None or not has_landmarks(p, f"{s}_heel"):
        return Frame(ankle, shank.X, shank.Y, shank.Z, length)
    sole = limb_frame(p[f"{s}_heel"], tip, joints.rightward.get(f"{s}_foot", shank.Z))
    return Frame(ankle, -sole.Y, sole.X, sole.Z, length)


def _whole_foot_frame(p: Tracks, s: str, foot: Frame, shank: Frame, body: Anthropometry) -> Frame:
    """Foot from heel to toe tip; the tip is not marked, so the length is a mean proportion of the shank."""
    length = shank.length_m * body.length_m["whole_foot"] / body.length_m["shank"]
    heel = p.get(f"{s}_heel", foot.origin_m - 0.25 * length * foot.X)
    return Frame(heel, foot.X, foot.Y, foot.Z, length)


TableName = Literal["auto", "dumas2007", "deleva1996", "carried"]

_MIN_VISIBLE_SHARE: Final = 0.5
"""A landmark visible in a smaller share of the frames with a visible pelvis counts as not marked."""

MARKER_RADIUS_M: Final = 0.007
"""Added on both sides to a joint width measured with a calliper: the marker centres lie off the skin."""

CARRIED: Final = "carried"

MODEL_SD_M: Final = (0.015, 0.015, 0.025)
"""Prior error of a centre of mass that the recording's own body model gives (x, y, z of the world frame).

The centre of mass of scaled OpenSim models lies 6 mm forwards and 2 mm sideways (rms, 18 walks of 13 adults) and 11 mm
upwards (35 walks of 18 adults) from that of Dumas 2007, whose own error is 8, 8 and 20 mm; the masses of scaled models
are not measured.
"""

COMPUTED_COM: Final = re.compile(r"cent(re|er)ofmass", re.IGNORECASE)
"""Label of a centre of mass that the program of the laboratory computed."""


@dataclass(frozen=True)
class SegmentModel:
    """CoM from markers and a segment table.

    ``table`` "auto" uses the body model of the recording or the table embedded in a simulated one ("carried"), else
    Dumas 2007. "carried" also uses the CoM that the laboratory's program computed and stored (``COMPUTED_COM``).
    """

    table: TableName = "auto"

    def com(
        self,
        recording: Recording,
        landmarks: Mapping[str, str],
        *,
        subject: Subject,
        static: Recording | None = None,
        static_landmarks: Mapping[str, str] | None = None,
    ) -> GeometricCom:
        """CoM at the marker instants of ``recording``; NaN where a segment cannot be formed.

        ``landmarks`` maps landmark to label (``recordings.marker_sets.identify``). A ``static`` trial of the same
        subject gives joint widths and is used to rebuild missing markers; ``static_landmarks`` are its landmarks, by
        default identified from its labels. Raises ``NotEstimable`` if pelvis or legs cannot be located,
        ``InvalidInput`` for a table that does not exist.
        """
        if recording.segments and self.table in ("auto", CARRIED):
            return _own_com(recording, landmarks, _model_segments(recording))
        computed = [label for label in recording.model_points_m if COMPUTED_COM.fullmatch(label)]
        if self.table == CARRIED and computed and not recording.carried:
            whole = {"body": SegmentTrack(1.0, recording.model_points_m[computed[0]])}
            return _own_com(recording, landmarks, whole)
        shapes = {} if static is None else _static_tracks(static, landmarks, static_landmarks)
        p, rebuilt = _complete_tracks(_landmark_tracks(recording, landmarks), shapes, recording.marker_rate_hz)
        table = self._select_table(recording, subject.sex)
        body = replace(load_anthropometry(subject.sex), height_m=subject.height_m)
        p, pelvis = with_pelvis(p, body)
        joints = joint_centres(p, body, _widths_m(recording, shapes))
        segments = _segment_tracks(table, segment_frames(p, joints, body))
        com_m = np.sum([s.mass_fraction * s.com_m for s in segments.values()], axis=0)
        _require_visible(com_m, p)
        gaps = applied_substitutes(joints.substitutes | pelvis)
        sd_m = widened_sd_m(_sd_along_world_m(table.sd_m, joints.centres), gaps)
        remarks = [gap.remark for gap in gaps]
        if rebuilt:
            remarks.append(Remark("markers-rebuilt", f"Rebuilt from their rigid neighbours: {', '.join(rebuilt)}."))
        if subject.sex is None and table.name != CARRIED:
            sd_m = widened_sd_m(sd_m, (SEX_UNKNOWN,))
            remarks.append(SEX_UNKNOWN.remark)
        return GeometricCom(
            time_s=recording.time_s,
            com_m=com_m,
            table=table.name,
            segments=segments,
            joint_centres_m=joints.centres,
            sd_m=sd_m,
            remarks=tuple(remarks),
            references=tuple(sorted({*table.references, *body.references})),
            ground_m_s=walking_surface_m_s(recording, landmarks),
        )

    def _select_table(self, recording: Recording, sex: Sex | None) -> SegmentTable:
        carried = recording.carried.get("segment_table")
        if self.table == "carried" and carried is None:
            raise InvalidInput("segment-table-not-carried", "This recording contains no segment table of its own.")
        if carried is not None and self.table in ("auto", "carried"):
            return replace(segment_tables.from_json(carried), name=CARRIED)
        return segment_tables.load_table("dumas2007" if self.table == "auto" else self.table, sex)


def without_foreign_subject(recording: Recording, landmarks: Mapping[str, str]) -> Recording:
    """``recording`` without height, mass, sex and age of its file if its legs cannot be those of that height."""
    stated_m = recording.subject.height_m
    tracks = {name: recording.markers_m[label] for name, label in landmarks.items() if label in recording.markers_m}
    legs_m = shank_length_m(tracks) / SHANK_SHARE
    if stated_m is None or not legs_m > 0.0 or POSSIBLE_STATURE[0] < stated_m / legs_m < POSSIBLE_STATURE[1]:
        return recording
    mass = "" if recording.subject.mass_kg is None else f" and {recording.subject.mass_kg:g} kg"
    message = (
        f"The file states a subject of {stated_m:.2f} m{mass}, and its markers show the legs of a person of about "
        f"{legs_m:.2f} m: height, mass, sex and age in the file are those of somebody else, or in another unit, and "
        "are not used."
    )
    remarks = (*recording.remarks, Remark("subject-of-another-body", message))
    return replace(recording, subject=Subject(), remarks=remarks)


def _model_segments(recording: Recording) -> dict[str, SegmentTrack]:
    """Segments of the recording's own body model, with their shares of its mass."""
    mass_kg = sum(segment.mass_kg for segment in recording.segments.values())
    return {name: SegmentTrack(s.mass_kg / mass_kg, s.com_m) for name, s in recording.segments.items()}


def _own_com(recording: Recording, landmarks: Mapping[str, str], segments: Mapping[str, SegmentTrack]) -> GeometricCom:
    """CoM of segments whose own CoM the recording contains, c = sum_s m_s p_s."""
    tracks = _landmark_tracks(recording, landmarks)
    return GeometricCom(
        time_s=recording.time_s,
        com_m=np.sum([s.mass_fraction * s.com_m for s in segments.values()], axis=0),
        table=CARRIED,
        segments=segments,
        joint_centres_m={
            name.removesuffix("_centre"): track for name, track in tracks.items() if name.endswith("_centre")
        },
        sd_m=MODEL_SD_M,
        ground_m_s=walking_surface_m_s(recording, landmarks),
    )


def _sd_along_world_m(sd_m: tuple[float, float, float], centres: Mapping[str, Points]) -> tuple[float, float, float]:
    """Error of a table (forwards, sideways, upwards) along the axes of the world, by the mean direction of the hips."""
    forwards, sideways, up = sd_m
    across = (centres["l_hip"] - centres["r_hip"])[:, :2]
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    share = np.nanmean(across**2, axis=0) if np.isfinite(across).any() else np.full(2, 0.5)
    x, y = np.sqrt(forwards**2 * (1.0 - share) + sideways**2 * share)
    return float(x), float(y), up


def _landmark_tracks(recording: Recording, landmarks: Mapping[str, str]) -> dict[str, Points]:
    return {name: recording.markers_m[label] for name, label in landmarks.items() if label in recording.markers_m}


def _static_tracks(
    static: Recording, landmarks: Mapping[str, str], named: Mapping[str, str] | None
) -> dict[str, Points]:
    """Landmarks of the static trial by its own set, overridden by the labels of the walking trial."""
    own = identify(list(static.markers_m)).landmarks if named is None else named
    shared = {name: label for name, label in landmarks.items() if label in static.markers_m}
    return _landmark_tracks(static, {**own, **shared})


def _complete_tracks(tracks: Tracks, shapes: Shapes, rate_hz: float) -> tuple[dict[str, Points], tuple[str, ...]]:
    """Tracks with gaps filled by rigid clusters, first shaped as in the static trial, then as in the trial itself.

    Short gaps in clusters of which too few markers are visible are bridged (``bridge_segment_gaps``).
    Landmarks visible in less than half of the frames with a visible pelvis are removed.
    """
    p, from_static = rebuild_markers(tracks, shapes)
    p, from_itself = rebuild_markers(p, p)
    bridged: set[str] = set()
    for cluster in CLUSTERS:
        filled = bridge_segment_gaps({name: p[name] for name in cluster if name in p}, rate_hz)
        bridged |= {name for name, track in filled.items() if track is not p[name]}
        p |= filled
    pelvis = [np.isfinite(p[name]).all(axis=1) for name in ("l_asis", "r_asis") if name in p]
    if pelvis:
        frames = np.logical_and.reduce(pelvis)
        enough = _MIN_VISIBLE_SHARE * max(int(frames.sum()), 1)
        p = {name: track for name, track in p.items() if np.isfinite(track[frames]).all(axis=1).sum() >= enough}
    return p, tuple(sorted((from_static | from_itself | bridged) & p.keys()))


def _widths_m(recording: Recording, shapes: Shapes) -> dict[str, float]:
    """Joint widths between marker centres: measured with a calliper, else from the static trial."""
    seen = {
        f"{s}_{joint}": median_distance_m(shapes[f"{s}_{joint}_lateral"], shapes[f"{s}_{joint}_medial"])
        for s in "lr"
        for joint in ("knee", "ankle", "elbow")
        if has_landmarks(shapes, f"{s}_{joint}_lateral", f"{s}_{joint}_medial")
    }
    measured = {name: width + 2 * MARKER_RADIUS_M for name, width in recording.joint_widths_m.items()}
    return {name: width for name, width in {**seen, **measured}.items() if np.isfinite(width)}


def _segment_tracks(table: SegmentTable, frames: Mapping[str, Frame]) -> dict[str, SegmentTrack]:
    unknown = sorted(table.segments.keys() - frames.keys())
    if unknown:
        raise InvalidInput("segment-table-invalid", f"No such segment: {', '.join(unknown)}.")
    return {
        name: SegmentTrack(row.mass_fraction, frames[name].point_at(row.com)) for name, row in table.segments.items()
    }


def _require_visible(com_m: Points, p: Tracks) -> None:
    if np.isfinite(com_m).all(axis=1).any():
        return
    worst = sorted((float(np.isfinite(track).all(axis=1).mean()), name) for name, track in p.items())[:3]
    raise NotEstimable(
        "markers-never-together",
        "In no frame are all needed markers visible at once.",
        [Fault(name, f"Visible in {share:.0%} of the frames.") for share, name in worst],
    )
