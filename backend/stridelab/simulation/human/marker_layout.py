"""The simulated marker set: the ISB full body with a head, as laboratories label it (marker set ``isb-head``).

Markers have no diameter and sit exactly on the landmarks of the segment table, so that a segment model with the right
table computes the true centre of mass from noise-free markers.
"""

from collections.abc import Mapping
from typing import Final

from stridelab.conventions import Points
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
