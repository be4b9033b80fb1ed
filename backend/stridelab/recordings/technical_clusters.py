"""Technical clusters: markers without an anatomical name that move with a thigh or a shank (CAST, Cappozzo 1995).

A laboratory that uses clusters marks the joints in the static trial only and follows the segment by at least three
other markers, under names of its own. These are found from both trials: they lie along the segment in the static trial,
and keep their distances from one another through the walk and between the two trials.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from stridelab.conventions import Points, Vector3
from stridelab.recordings.recording import Recording

SEGMENT_REACH_M: Final = 0.15
"""Largest distance of a technical marker from the line between the ends of its segment: skin, and wands of 10 cm."""
RIGID_M: Final = 0.02
"""Largest change of a distance within a cluster: markers on skin, as between trials of one body (``static_pose``)."""
MIN_CLUSTER: Final = 3
_LINES: Final[Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "thigh": (("trochanter", "hip_centre", "asis"), ("knee_lateral", "knee_centre")),
    "shank": (("knee_lateral", "knee_centre"), ("ankle_lateral", "ankle_centre")),
    "foot": (("heel",), ("mt2", "mt5", "toe")),
}
"""Landmarks at either end of a segment, the preferred one first."""
_NAMED: Final[Mapping[str, tuple[str, ...]]] = {
    "thigh": ("trochanter", "knee_lateral", "knee_medial"),
    "shank": ("knee_lateral", "knee_medial", "fibula_head", "tibial_tuberosity", "ankle_lateral", "ankle_medial"),
}
"""Landmarks that may carry others of their segment; a foot has its landmarks in the walk."""
_NAMES: Final = ("t1", "t2", "t3", "t4")


def technical_landmarks(
    recording: Recording, landmarks: Mapping[str, str], static: Recording, static_landmarks: Mapping[str, str]
) -> dict[str, str]:
    """Labels of technical markers by landmark (``l_thigh_t1``, ...) of segments that the named markers do not carry.

    ``landmarks`` and ``static_landmarks`` map landmark to label of the walk and of its static trial. A segment with a
    landmark that only the static trial has, and fewer than three named markers to carry it, gets up to four others; a
    cluster that then has fewer than three is left out.
    """
    named = {*landmarks.values(), *static_landmarks.values()}
    common = [label for label in recording.markers_m if label in static.markers_m and label not in named]
    at = {label: _median_position(static.markers_m[label]) for label in (*common, *static_landmarks.values())}
    lines = {
        f"{side}_{segment}": (_end_of(side, upper, static_landmarks, at), _end_of(side, lower, static_landmarks, at))
        for side in "lr"
        for segment, (upper, lower) in _LINES.items()
    }
    nearest: dict[str, list[str]] = {}
    for label in common:
        away = {name: _distance_from_line(at[label], *ends) for name, ends in lines.items()}
        name = min(away, key=lambda one: away[one])
        if away[name] <= SEGMENT_REACH_M and name[2:] in _NAMED:
            nearest.setdefault(name, []).append(label)
    found: dict[str, str] = {}
    for name, labels in nearest.items():
        names = {*(name[:2] + mark for mark in _NAMED[name[2:]]), *(f"{name}_{t}" for t in _NAMES)}
        shared = [landmarks[mark] for mark in sorted(names & landmarks.keys()) if landmarks[mark] in static.markers_m]
        lacking = names & (static_landmarks.keys() - landmarks.keys())
        if len(shared) >= MIN_CLUSTER or not lacking:
            continue
        cluster = rigid_subset(labels, recording, static, shared)
        free = [f"{name}_{t}" for t in _NAMES if f"{name}_{t}" not in landmarks]
        if len(cluster) + len(shared) >= MIN_CLUSTER:
            found |= dict(zip(free, cluster, strict=False))
    return found


def rigid_subset(
    labels: Sequence[str], recording: Recording, static: Recording, fixed: Sequence[str] = ()
) -> list[str]:
    """The labels without those whose distances change by more than ``RIGID_M``, the worst first.

    Distances are those from one another and from the markers ``fixed``, which are of the segment by their name.
    """
    kept = list(labels)
    pairs = [(a, b) for a, b in combinations((*kept, *fixed), 2) if a in kept]
    loose = [pair for pair in pairs if not _distance_change_m(pair, recording, static) <= RIGID_M]
    while bad := [pair for pair in loose if pair[0] in kept and pair[1] in (*kept, *fixed)]:
        kept.remove(max(kept, key=lambda label: sum(label in pair for pair in bad)))
    return kept


def _distance_change_m(pair: tuple[str, str], recording: Recording, static: Recording) -> float:
    """Largest change of a distance: 95 % of the frames of the walk against the median of the static trial."""
    here, there = (
        np.linalg.norm(one.markers_m[pair[0]] - one.markers_m[pair[1]], axis=1) for one in (recording, static)
    )
    if not (np.isfinite(here).any() and np.isfinite(there).any()):
        return np.inf
    return float(np.nanpercentile(np.abs(here - np.nanmedian(there)), 95.0))


def _median_position(track: Points) -> Vector3:
    seen = track[np.isfinite(track).all(axis=1)]
    return np.median(seen, axis=0) if len(seen) else np.full(3, np.nan)


def _end_of(side: str, names: Sequence[str], landmarks: Mapping[str, str], at: Mapping[str, Vector3]) -> Vector3:
    labels = [landmarks[f"{side}_{name}"] for name in names if f"{side}_{name}" in landmarks]
    return next((at[label] for label in labels if np.isfinite(at[label]).all()), np.full(3, np.nan))


def _distance_from_line(point: Vector3, start: Vector3, end: Vector3) -> float:
    """Distance of a point from the line between two others; infinite where one of them is unknown (NaN)."""
    along = end - start
    share = np.clip((point - start) @ along / np.maximum(along @ along, 1e-12), 0.0, 1.0)
    away = float(np.linalg.norm(start + share * along - point))
    return away if np.isfinite(away) else np.inf
