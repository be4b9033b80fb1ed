"""A made-up body with the landmarks of a full marker set, walking in place; its sides are mirror images."""

from dataclasses import replace

import numpy as np

from stridelab.recordings.recording import Recording, Subject

RATE_HZ = 100.0

_MEDIAN = {
    "sacrum": (-0.10, 1.02),
    "c7": (-0.07, 1.50),
    "t10": (-0.11, 1.28),
    "jugular_notch": (0.06, 1.42),
    "xiphoid": (0.10, 1.25),
    "head_top": (0.00, 1.75),
}
_LEFT = {
    "asis": (0.09, 0.12, 1.00),
    "psis": (-0.10, 0.04, 1.02),
    "trochanter": (0.01, 0.17, 0.92),
    "knee_lateral": (0.00, 0.15, 0.50),
    "knee_medial": (0.00, 0.05, 0.50),
    "fibula_head": (-0.02, 0.14, 0.45),
    "tibial_tuberosity": (0.05, 0.10, 0.45),
    "ankle_lateral": (-0.01, 0.14, 0.08),
    "ankle_medial": (0.00, 0.06, 0.09),
    "heel": (-0.07, 0.10, 0.04),
    "mt1": (0.13, 0.06, 0.04),
    "mt2": (0.14, 0.09, 0.04),
    "mt5": (0.11, 0.14, 0.03),
    "clavicle": (0.06, 0.02, 1.42),
    "acromion": (-0.02, 0.18, 1.43),
    "elbow_lateral": (-0.03, 0.29, 1.12),
    "elbow_medial": (-0.03, 0.21, 1.12),
    "wrist_radial": (0.13, 0.24, 0.93),
    "wrist_ulnar": (0.08, 0.25, 0.91),
    "mc2": (0.18, 0.24, 0.86),
    "mc5": (0.13, 0.26, 0.84),
    "head_front": (0.09, 0.06, 1.64),
    "head_back": (-0.09, 0.06, 1.64),
}
_SWINGING = {
    "knee": 0.10,
    "ankle": 0.20,
    "heel": 0.20,
    "mt": 0.20,
    "fibula": 0.12,
    "tibial": 0.12,
    "wrist": -0.15,
    "mc": -0.18,
}


def landmarks(n_frames: int = 5) -> dict[str, np.ndarray]:
    """Tracks (n, 3) of all landmarks; the legs swing fore and aft, the arms against them."""
    phase = np.sin(np.linspace(0.0, 2.0, n_frames))
    tracks = {}
    for name, (x, z) in _MEDIAN.items():
        tracks[name] = np.tile([x, 0.0, z], (n_frames, 1))
    for name, (x, y, z) in _LEFT.items():
        swing = next((share for part, share in _SWINGING.items() if name.startswith(part)), 0.0)
        for side, sign in (("l", 1.0), ("r", -1.0)):
            track = np.tile([x, sign * y, z], (n_frames, 1))
            track[:, 0] += sign * swing * phase
            tracks[f"{side}_{name}"] = track
    return tracks


def recording(tracks: dict[str, np.ndarray], **fields: object) -> Recording:
    """A recording whose labels are the landmark names."""
    bare = Recording(
        markers_m=tracks,
        marker_rate_hz=RATE_HZ,
        force_rate_hz=1000.0,
        plates=(),
        subject=Subject(height_m=1.75, mass_kg=70.0, sex="male"),
        events=(),
        up_axis="+z",
        walking_direction=None,
    )
    return replace(bare, **fields)  # type: ignore[arg-type]


def mirrored(tracks: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The body seen in a mirror: y changes sign, sides swap names."""
    other = {"l_": "r_", "r_": "l_"}
    return {other.get(name[:2], name[:2]) + name[2:]: track * [1.0, -1.0, 1.0] for name, track in tracks.items()}
