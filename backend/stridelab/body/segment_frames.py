"""Segment frames: origin, axes (X forwards, Y upwards, Z rightwards) and length, to which a segment table refers.

A limb's frame lies at its upper joint P with the lower joint D:

    Y = (P - D) / |P - D|,   X = Y x z / |Y x z|,   Z = X x Y,   length = median |P - D|

where z points roughly to the right (from the inner and outer landmark of the lower joint, else from pelvis or trunk).
Frames: pelvis (origin lumbar joint), torso (cervical joint), head (cervical joint), ``*_upper_arm``, ``*_forearm``,
``*_hand``, ``*_thigh``, ``*_shank``, ``*_foot`` (origin ankle, X along heel -> forefoot, length ankle to forefoot) as
in Dumas and Wojtusch 2018; trunk (mid-shoulder to mid-hip), head_neck (C7 to vertex), ``*_whole_foot`` (heel to toe
tip) as in de Leva 1996.
"""

from dataclasses import dataclass

import numpy as np

from stridelab.body.joint_centres import Joints, Tracks, has_landmarks, pelvis_axes
from stridelab.body.segment_tables import Anthropometry
from stridelab.body.vectors import component_along, median_distance_m, median_or_nan, unit
from stridelab.conventions import Points


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
    X = unit(np.cross(Y, rightward))
    return Frame(proximal, X, Y, np.cross(X, Y), median_distance_m(proximal, distal))


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
