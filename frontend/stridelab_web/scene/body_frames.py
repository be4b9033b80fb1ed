"""The body of a recorded person: solids of revolution about the lines between joint centres of the segment model."""

from typing import Final, NamedTuple

import numpy as np

from stridelab_web.parquet import Columns, xyz_columns
from stridelab_web.scene.frames import Sheet, Stick

BODY: Final = "/body/"
PERSON: Final = "/person/"
"""Limbs of the person whose walk a robot imitates."""
JOINT: Final = "joint_"
"""Beginning of the columns of a joint centre in ``tracks.parquet``."""
Profile = tuple[tuple[float, float], ...]
"""Places along the line and radii there, both as shares of its length."""


class Limb(NamedTuple):
    """A solid about the line from joint ``start`` to joint ``end``; ``*`` stands for either side."""

    start: str
    end: str
    profile: Profile


LIMBS: Final = {
    "thigh": Limb("*_hip", "*_knee",
                  ((-0.16, 0.0), (-0.1, 0.13), (0.05, 0.2), (0.4, 0.18), (0.9, 0.125), (1.0, 0.12))),
    "shank": Limb("*_knee", "*_ankle",
                  ((-0.1, 0.0), (-0.05, 0.1), (0.05, 0.125), (0.3, 0.13), (0.8, 0.075), (1.0, 0.075), (1.08, 0.0))),
    "foot": Limb("*_ankle", "*_forefoot",
                 ((-0.35, 0.0), (-0.3, 0.2), (0.0, 0.28), (0.7, 0.22), (1.1, 0.16), (1.3, 0.1), (1.35, 0.0))),
    "upper_arm": Limb("*_shoulder", "*_elbow",
                      ((-0.2, 0.0), (-0.15, 0.13), (0.0, 0.2), (0.4, 0.165), (1.0, 0.13), (1.1, 0.0))),
    "forearm": Limb("*_elbow", "*_wrist",
                    ((-0.1, 0.0), (0.0, 0.15), (0.25, 0.165), (0.9, 0.1), (1.0, 0.1), (1.1, 0.0))),
    "hand": Limb("*_wrist", "*_knuckles", ((-0.2, 0.0), (0.0, 0.32), (0.9, 0.42), (1.8, 0.25), (2.1, 0.0))),
    "flank": Limb("*_hip", "*_shoulder",
                  ((-0.1, 0.0), (-0.05, 0.12), (0.1, 0.18), (0.45, 0.16), (0.75, 0.18), (0.95, 0.1), (1.0, 0.0))),
    "pelvis": Limb("l_hip", "r_hip", ((-0.6, 0.0), (-0.5, 0.35), (0.0, 0.6), (1.0, 0.6), (1.5, 0.35), (1.6, 0.0))),
    "trunk": Limb("lumbar", "cervical",
                  ((-0.1, 0.0), (0.0, 0.22), (0.5, 0.23), (0.75, 0.25), (0.95, 0.16), (1.0, 0.1))),
    "shoulders": Limb("l_shoulder", "r_shoulder", ((-0.1, 0.0), (0.0, 0.14), (0.5, 0.2), (1.0, 0.14), (1.1, 0.0))),
    "head": Limb("cervical", "vertex",
                 ((0.0, 0.22), (0.3, 0.2), (0.4, 0.27), (0.6, 0.33), (0.8, 0.31), (0.95, 0.18), (1.0, 0.0))),
}  # fmt: skip
"""Chosen by eye, for the picture alone; nothing is computed from them."""


def body_sticks(tracks: Columns, sheet: Sheet, group: str = BODY, before: str = JOINT) -> tuple[Stick, ...]:
    """Limbs whose joint centres are in ``tracks``, in columns that begin with ``before``, as nodes of ``group``.

    Empty for recordings whose ``tracks.parquet`` was stored without them.
    """
    at_of: dict[str, int] = {}
    sticks: list[Stick] = []
    for name, limb in LIMBS.items():
        for side in ("l", "r") if "*" in limb.start else ("",):
            joints = [joint.replace("*", side) for joint in (limb.start, limb.end)]
            for joint in joints:
                centre_m = None if joint in at_of else xyz_columns(tracks, f"{before}{joint}_", "_m")
                if centre_m is not None and np.isfinite(centre_m).any():
                    at_of[joint] = sheet.add_block(centre_m)
            if at_of.keys() >= set(joints):
                sticks.append(Stick(f"{group}{name}{side and '/'}{side}", *(at_of[joint] for joint in joints)))
    return tuple(sticks)


def foot_places_m(tracks: Columns) -> dict[str, np.ndarray]:
    """Middles ``(frames, 3)`` of ankle and forefoot of the sides that have both."""
    places_m = {}
    for side in "lr":
        ankle_m, forefoot_m = (xyz_columns(tracks, f"{JOINT}{side}_{end}_", "_m") for end in ("ankle", "forefoot"))
        if ankle_m is not None and forefoot_m is not None:
            places_m[side] = (ankle_m + forefoot_m) / 2
    return places_m


def profile_of(stick: Stick) -> Profile | None:
    """The profile of a stick of ``body_sticks``; None for other sticks."""
    limb = LIMBS.get(stick.name.removeprefix(BODY).removeprefix(PERSON).partition("/")[0])
    return None if limb is None else limb.profile


def median_length_m(values: np.ndarray, stick: Stick) -> float:
    """Median distance of the ends of ``stick``; NaN if they are never seen together."""
    ends = values[:, stick.end : stick.end + 3] - values[:, stick.start : stick.start + 3]
    lengths = np.linalg.norm(ends, axis=1)
    seen = lengths[np.isfinite(lengths)]
    return float(np.median(seen)) if len(seen) else float("nan")
