"""The simulated marker set: the ISB full body with a head, as laboratories label it (marker set ``isb-head``).

Markers have no diameter and sit exactly on the landmarks of the segment table, so that a segment model with the right
table computes the true centre of mass from noise-free markers.

On people markers move with the skin relative to the bones, with a frequency content similar to that of the bones and
not reproducibly between people, most at the thigh (Leardini et al. 2005). In walking the largest displacements within a
rigid segment were 27 mm at thigh and 24 mm at shank, mainly as translation and rotation of the whole cluster (Andersen
et al. 2012, bone pins; Barré et al. 2017); with six knee prostheses the clusters moved by 18 and 17 mm, single markers
beside them by 4 to 16 mm (fluoroscopy, PMC8631460). Markers of the foot moved by at most 1.8 mm at the metatarsals
and 4.3 mm at the heel (Tranberg and Karlsson 1998), markers of hip and thigh over 3 to 54 mm (Fiorentino et al. 2017),
the dimples of the sacrum by 1.5 mm with 10 degrees of pelvic tilt (Drerup and Hierholzer 1987), markers of the back by
9 to 11 mm between full extension and flexion (Zemp et al. 2014), of which walking is a few degrees.
``skin_displacements`` draws such motions.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy.random import Generator

from stridelab.conventions import Points, Series
from stridelab.simulation.human.body_model import AnthropometricBody, Configurations, landmark_tracks

_UNPAIRED: Final[Mapping[str, str]] = {
    "c7": "CV7",
    "t8": "TV8",
    "t10": "TV10",
    "jugular_notch": "SJN",
    "xiphoid": "SXS",
}
_PAIRED: Final[Mapping[str, str]] = {
    "asis": "IAS",
    "psis": "IPS",
    "trochanter": "FTC",
    "knee_lateral": "FLE",
    "knee_medial": "FME",
    "fibula_head": "FAX",
    "tibial_tuberosity": "TTC",
    "ankle_lateral": "FAL",
    "ankle_medial": "TAM",
    "heel": "FCC",
    "mt1": "FM1",
    "mt2": "FM2",
    "mt5": "FM5",
    "acromion": "SAE",
    "elbow_lateral": "HLE",
    "elbow_medial": "HME",
    "wrist_radial": "RSP",
    "wrist_ulnar": "UHE",
    "mc2": "HM2",
    "mc5": "HM5",
    "head_front": "HDF",
    "head_back": "HDB",
}

LABELS: Final[Mapping[str, str]] = {
    **_UNPAIRED,
    **{f"{side}_{name}": f"{side.upper()}_{label}" for side in "lr" for name, label in _PAIRED.items()},
}
"""Landmark to label."""


def marker_tracks(body: AnthropometricBody, q: Configurations) -> Mapping[str, Points]:
    """Tracks of the markers by label over the configurations ``q``."""
    landmarks = landmark_tracks(body, q)
    return {label: landmarks[name] for name, label in LABELS.items()}


SKIN_MOTION_SD_M: Final[Mapping[str, float]] = {
    "thigh": 0.005,
    "shank": 0.004,
    "pelvis": 0.003,
    "trunk": 0.002,
    "upper_arm": 0.003,
    "forearm": 0.002,
    "foot": 0.001,
    "hand": 0.001,
    "head": 0.001,
}
"""Standard deviation per axis of the displacement that the markers of a segment share while a person walks.

Those of thigh and shank give peaks of 15 to 27 mm and those of the foot up to 4 mm, as published; the others are
assumed, smaller where bone is near. With these and ``SKIN_DEFORMATION_SHARE`` the distances between two pelvis markers
vary by 2 mm, and on 72 people by 1.0 to 2.6 mm (medians of six pairs).
"""
SKIN_DEFORMATION_SHARE: Final = 0.5
"""Standard deviation of the own displacement of a marker over that of its segment: deformations are smaller."""
SKIN_SIZE_SPREAD: Final = 0.35
"""Standard deviation of the logarithm of the size of all displacements between people."""
_SEGMENTS: Final[Mapping[str, str]] = {
    "trochanter": "thigh",
    "knee_lateral": "thigh",
    "knee_medial": "thigh",
    "fibula_head": "shank",
    "tibial_tuberosity": "shank",
    "ankle_lateral": "shank",
    "ankle_medial": "shank",
    "heel": "foot",
    "mt1": "foot",
    "mt2": "foot",
    "mt5": "foot",
    "asis": "pelvis",
    "psis": "pelvis",
    "elbow_lateral": "upper_arm",
    "elbow_medial": "upper_arm",
    "wrist_radial": "forearm",
    "wrist_ulnar": "forearm",
    "mc2": "hand",
    "mc5": "hand",
    "head_front": "head",
    "head_back": "head",
}
"""Segments of paired landmarks; all others are of the trunk."""
_UNDIVIDED: Final = ("pelvis", "trunk", "head")
_HARMONICS: Final = np.array([1.0, 2.0, 3.0])


def skin_displacements(stride_phase: Series, rng: Generator) -> Mapping[str, Points]:
    """Displacement of each marker by label, m, in the axes of the walk (x ahead, y to the left).

    ``stride_phase`` counts strides of the left foot at each instant. Every displacement is a sum of the first three
    harmonics of the stride, drawn once: the same in all strides of a person, another one in each person. Left and right
    have half of their variance in common, mirrored and half a stride apart.
    """
    size = rng.lognormal(0.0, SKIN_SIZE_SPREAD)
    shared = {name: [_periodic_pattern(rng) for _ in range(3)] for name in SKIN_MOTION_SD_M}
    moved = {}
    for name, label in LABELS.items():
        side, twin = (name[0], name[2:]) if name[1] == "_" else ("", name)
        segment = _SEGMENTS.get(twin, "trunk")
        common, left, right = shared[segment]
        if segment in _UNDIVIDED:
            track = _displacement_at(common, stride_phase)
        elif side == "l":
            track = np.sqrt(0.5) * (_displacement_at(common, stride_phase) + _displacement_at(left, stride_phase))
        else:
            mirrored = _displacement_at(common, stride_phase + 0.5) * [1.0, -1.0, 1.0]
            track = np.sqrt(0.5) * (mirrored + _displacement_at(right, stride_phase))
        track = track + SKIN_DEFORMATION_SHARE * _displacement_at(_periodic_pattern(rng), stride_phase)
        moved[label] = size * SKIN_MOTION_SD_M[segment] * track
    return moved


def _periodic_pattern(rng: Generator) -> Float[np.ndarray, "2 3 3"]:
    """Cosine and sine coefficients of three harmonics along three axes; the variance of a track is 1."""
    weight = 1.0 / _HARMONICS
    return rng.normal(size=(2, 3, 3)) * (weight / np.linalg.norm(weight))[:, None]


def _displacement_at(pattern: Float[np.ndarray, "2 3 3"], stride_phase: Series) -> Points:
    angle = 2.0 * np.pi * stride_phase[:, None] * _HARMONICS
    return np.asarray(np.cos(angle) @ pattern[0] + np.sin(angle) @ pattern[1])
