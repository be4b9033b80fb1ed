"""Segment model of the CoM, c = sum_s m_s p_s: input (i) of section 2.4.1 of the thesis."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from stridelab.body import missing_markers, segment_tables
from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.body.joint_centres import Tracks, has_landmarks, joint_centres, with_pelvis
from stridelab.body.segment_frames import Frame, segment_frames
from stridelab.body.segment_tables import SegmentTable, load_anthropometry
from stridelab.body.vectors import median_distance_m
from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.recordings.foot_contact import walking_surface_m_s
from stridelab.recordings.gap_filling import bridge_segment_gaps
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Recording, Remark, Sex, Subject

TableName = Literal["auto", "dumas2007", "deleva1996", "carried"]

_MIN_VISIBLE_SHARE: Final = 0.5
"""A landmark visible in a smaller share of the frames with a visible pelvis counts as not marked."""

MARKER_RADIUS_M: Final = 0.007
"""Added on both sides to a joint width measured with a calliper: the marker centres lie off the skin."""

CARRIED: Final = "carried"


@dataclass(frozen=True)
class SegmentModel:
    """CoM from markers and a segment table.

    ``table`` "auto" uses the table embedded in a simulated recording ("carried"), else Dumas 2007.
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
        shapes = {} if static is None else _static_tracks(static, landmarks, static_landmarks)
        p, rebuilt = _complete_tracks(_landmark_tracks(recording, landmarks), shapes, recording.marker_rate_hz)
        table = self._select_table(recording, subject.sex)
        body = replace(load_anthropometry(subject.sex), height_m=subject.height_m)
        p, pelvis = with_pelvis(p, body)
        joints = joint_centres(p, body, _widths_m(recording, shapes))
        segments = _segment_tracks(table, segment_frames(p, joints, body))
        com_m = np.sum([s.mass_fraction * s.com_m for s in segments.values()], axis=0)
        _require_visible(com_m, p)
        gaps = missing_markers.applied_substitutes(joints.substitutes | pelvis)
        sd_m = missing_markers.widened_sd_m(table.sd_m, gaps)
        remarks = [gap.remark for gap in gaps]
        if rebuilt:
            remarks.append(Remark("markers-rebuilt", f"Rebuilt from their rigid neighbours: {', '.join(rebuilt)}."))
        if subject.sex is None and table.name != CARRIED:
            sd_m = missing_markers.widened_sd_m(sd_m, (missing_markers.SEX_UNKNOWN,))
            remarks.append(missing_markers.SEX_UNKNOWN.remark)
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


def _landmark_tracks(recording: Recording, landmarks: Mapping[str, str]) -> dict[str, Points]:
    return {name: recording.markers_m[label] for name, label in landmarks.items() if label in recording.markers_m}


def _static_tracks(
    static: Recording, landmarks: Mapping[str, str], named: Mapping[str, str] | None
) -> dict[str, Points]:
    """Landmarks of the static trial by its own set, overridden by the labels of the walking trial."""
    own = identify(list(static.markers_m)).landmarks if named is None else named
    shared = {name: label for name, label in landmarks.items() if label in static.markers_m}
    return _landmark_tracks(static, {**own, **shared})


def _complete_tracks(
    tracks: Tracks, shapes: missing_markers.Shapes, rate_hz: float
) -> tuple[dict[str, Points], tuple[str, ...]]:
    """Tracks with gaps filled by rigid clusters, first shaped as in the static trial, then as in the trial itself.

    Short gaps in clusters of which too few markers are visible are bridged (``bridge_segment_gaps``).
    Landmarks visible in less than half of the frames with a visible pelvis are removed.
    """
    p, from_static = missing_markers.rebuild_markers(tracks, shapes)
    p, from_itself = missing_markers.rebuild_markers(p, p)
    bridged: set[str] = set()
    for cluster in missing_markers.CLUSTERS:
        filled = bridge_segment_gaps({name: p[name] for name in cluster if name in p}, rate_hz)
        bridged |= {name for name, track in filled.items() if track is not p[name]}
        p |= filled
    pelvis = [np.isfinite(p[name]).all(axis=1) for name in ("l_asis", "r_asis") if name in p]
    if pelvis:
        frames = np.logical_and.reduce(pelvis)
        enough = _MIN_VISIBLE_SHARE * max(int(frames.sum()), 1)
        p = {name: track for name, track in p.items() if np.isfinite(track[frames]).all(axis=1).sum() >= enough}
    return p, tuple(sorted((from_static | from_itself | bridged) & p.keys()))


def _widths_m(recording: Recording, shapes: missing_markers.Shapes) -> dict[str, float]:
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
