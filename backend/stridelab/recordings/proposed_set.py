"""A marker set for labels of no known set, where their words and the places of the markers agree.

It is narrower than the proposed map of ``marker_proposal``, which a person checks: a landmark whose label is unlike all
known ones, or whose place is unusual, is left out, and no set is proposed if that leaves out pelvis, knees or ankles.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from stridelab.recordings.marker_proposal import MarkerFeatures, marker_features, propose_from_features
from stridelab.recordings.marker_sets import (
    LANDMARKS,
    LOCOMOTION,
    PROPOSED,
    MarkerSetMatch,
    absent_landmarks,
    match_of_landmarks,
    substitutes_for,
)
from stridelab.recordings.recording import Recording
from stridelab.recordings.remark import Remark

MARKER_SET_PROPOSED: Final = "marker-set-proposed"
"""Code of its remark."""
MIN_LIKENESS: Final = 0.3
"""Least likeness of a label to the known labels and words of its landmark, from 0 to 1."""
MAX_MISFIT: Final = 10.0
"""Largest cost of a marker's place, motion and distances; about that of three standard deviations in three axes."""
MAX_MISFIT_OF_KNOWN_LABEL: Final = 15.0
"""The same for a label that shipped sets know: its meaning is evidence, and on stairs the places are unusual."""
_KNOWN: Final = 0.999
"""Likeness from which a label equals a known one."""
MAX_PELVIS_DEPTH: Final = 1.3
"""Largest distance of the front from the back of the pelvis, in distances of the iliac spines from one another.

In 91 public recordings it is 0.59 to 1.22, with a median of 0.77. The hips are placed by both: with markers inside the
iliac spines they are too far forward.
"""
_UPPER_BODY: Final = 1.15
"""Height, in heights of the ASIS, above which markers are on trunk, arms or head."""
_MOST_MARKERS: Final = 250
"""More are no labels of a person, and take minutes."""
_TRUNK_MISSING: Final = "trunk-missing"


def propose_marker_set(recording: Recording) -> MarkerSetMatch | None:
    """The proposed set of a recording whose labels no set knows, or None where labels and places do not agree.

    None, too, where the pelvis is too deep for its width to place the hips, and where markers on the upper body name
    neither the shoulders nor C7: an upright trunk would stand in for one that is marked.
    """
    if len(recording.markers_m) > _MOST_MARKERS:
        return None
    features = marker_features(recording)
    if len(features.labels) < len(LOCOMOTION):
        return None
    landmarks = {
        landmark: proposed.label
        for landmark, proposed in propose_from_features(features).items()
        if landmark in LANDMARKS
        and proposed.likeness >= MIN_LIKENESS
        and proposed.misfit <= (MAX_MISFIT_OF_KNOWN_LABEL if proposed.likeness >= _KNOWN else MAX_MISFIT)
    }
    if absent_landmarks(LOCOMOTION, landmarks):
        return None
    if _pelvis_depth(features, landmarks) > MAX_PELVIS_DEPTH:
        return None
    codes = {substitute.code for substitute in substitutes_for(landmarks)}
    if _TRUNK_MISSING in codes and _has_upper_body(features, landmarks["l_asis"], landmarks["r_asis"]):
        return None
    listed = ", ".join(f"{landmark} {label}" for landmark, label in landmarks.items())
    message = (
        "The labels belong to no known marker set. They were named from their likeness to known labels and from their "
        f"places on the body: {listed}. Check them on the body."
    )
    return match_of_landmarks(PROPOSED, landmarks, (Remark(MARKER_SET_PROPOSED, message),))


def _has_upper_body(features: MarkerFeatures, left_asis: str, right_asis: str) -> bool:
    """Whether two markers or more lie above the pelvis."""
    heights_m = dict(zip(features.labels, features.mean_m[:, 2], strict=True))
    limit_m = _UPPER_BODY * 0.5 * (heights_m[left_asis] + heights_m[right_asis])
    return bool(np.sum(features.mean_m[:, 2] > limit_m) > 1)


def _pelvis_depth(features: MarkerFeatures, landmarks: Mapping[str, str]) -> float:
    """Distance of the middle of the ASIS from that of the PSIS, or the sacrum, over that of the two ASIS; 0 without."""
    mean_m = dict(zip(features.labels, features.mean_m, strict=True))
    back = [name for name in ("l_psis", "r_psis") if name in landmarks]
    back = back if len(back) == 2 else [name for name in ("sacrum",) if name in landmarks]
    if not back or not {"l_asis", "r_asis"} <= landmarks.keys():
        return 0.0
    left, right = (mean_m[landmarks[f"{side}_asis"]] for side in "lr")
    behind = np.mean([mean_m[landmarks[name]] for name in back], axis=0)
    return float(np.linalg.norm((left + right) / 2.0 - behind) / max(float(np.linalg.norm(left - right)), 1e-3))
