"""Computes the values of checks that need markers only: hull of the body, lengths of the legs, proportions, its axis.

A convex combination of points of a body lies in the convex hull of the body. The markers are on the skin, so their
hull covers the body except for its unmarked parts. Thigh and shank have constant length.

Also the share of the legs in the mass of a body model.
"""

import itertools
import re
from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points
from stridelab.estimation.quality.plate_checks import has_no_trunk
from stridelab.recordings.recording import SegmentMotion

NAN: Final = float("nan")
MAX_FRAMES: Final = 60
"""Maximum number of evaluated frames: a body moves by 3 cm between them in a walk of 2 s."""

Clouds = Float[np.ndarray, "frames points 3"]


def distance_outside_m(com_m: Points, body_m: Clouds) -> Float[np.ndarray, " looked"]:
    """Distance of ``com_m`` (n x 3) outside the convex hull of ``body_m`` (n x points x 3, NaN where hidden).

    It is the largest distance beyond the plane of a face of the hull: 0 inside, and a lower bound near an edge. NaN if
    fewer than four points are visible or all are coplanar. Of long recordings ``MAX_FRAMES`` evenly spread frames are
    evaluated and returned.
    """
    frames = np.unique(np.linspace(0, len(com_m) - 1, min(MAX_FRAMES, len(com_m))).round().astype(int))
    return np.array([_distance_outside_m(com_m[i], body_m[i]) for i in frames])


def _distance_outside_m(point: Float[np.ndarray, "3"], cloud: Float[np.ndarray, "points 3"]) -> float:
    seen = cloud[np.isfinite(cloud).all(axis=1)]
    if len(seen) < 4 or not np.isfinite(point).all():
        return float("nan")
    try:
        faces = ConvexHull(seen).equations
    except QhullError:
        return float("nan")
    return max(0.0, float((faces[:, :3] @ point + faces[:, 3]).max()))


LEG: Final = ("hip", "knee", "ankle")
_MIN_FRAMES = 10


def length_change(joint_centres_m: Mapping[str, Points]) -> tuple[str, float] | None:
    """The thigh or shank whose length changes most: its name, and its 5 to 95 % length range over the median.

    None if no segment of the legs has both of its joints in ten frames.
    """
    changes: list[tuple[float, str]] = []
    for side, (upper, lower) in itertools.product("lr", itertools.pairwise(LEG)):
        one, other = joint_centres_m.get(f"{side}_{upper}"), joint_centres_m.get(f"{side}_{lower}")
        if one is None or other is None:
            continue
        lengths = np.linalg.norm(one - other, axis=1)
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) < _MIN_FRAMES or np.median(lengths) <= 0.0:
            continue
        low, high = np.percentile(lengths, (5.0, 95.0))
        name = f"{'left' if side == 'l' else 'right'} {'thigh' if upper == 'hip' else 'shank'}"
        changes.append((float((high - low) / np.median(lengths)), name))
    if not changes:
        return None
    change, name = max(changes)
    return name, change


def thigh_over_trunk(geometric: GeometricCom, used: slice) -> float:
    """Length of the thighs over the distance of the hips' middle from the cervical joint, medians over ``used``.

    NaN where the neck is not marked: it is then placed by proportions.
    """
    joints = geometric.joint_centres_m
    if has_no_trunk(geometric) or not joints.keys() >= _TRUNK:
        return NAN
    hips_m = (joints["l_hip"] + joints["r_hip"])[used] / 2.0
    trunk_m = np.linalg.norm(hips_m - joints["cervical"][used], axis=1)
    thighs_m = np.linalg.norm([joints[f"{s}_hip"][used] - joints[f"{s}_knee"][used] for s in "lr"], axis=2)
    seen = np.isfinite(trunk_m) & np.isfinite(thighs_m).all(axis=0)
    if np.count_nonzero(seen) < _MIN_FRAMES:
        return NAN
    return float(np.median(thighs_m[:, seen]) / max(float(np.median(trunk_m[seen])), 1e-3))


_TRUNK: Final = frozenset({"l_hip", "r_hip", "l_knee", "r_knee", "cervical"})
_LEG: Final = re.compile(r"femur|thigh|tibia|shank|shin|fibula|patella|talus|calc|foot|toe|metatars|leg", re.IGNORECASE)
_ABOVE: Final = re.compile(
    r"torso|trunk|thorax|spine|lumbar|rib|head|clavic|scapula|humer|arm|ulna|radius|hand", re.IGNORECASE
)


def leg_mass_share(segments: Mapping[str, SegmentMotion]) -> float | None:
    """Share of the segments named as parts of the legs in the mass of a body model.

    None without a model; NaN where no name is known as a part of a leg, of the trunk or of an arm.
    """
    if not segments:
        return None
    if not any(_LEG.search(name) or _ABOVE.search(name) for name in segments):
        return NAN
    legs_kg = sum(segment.mass_kg for name, segment in segments.items() if _LEG.search(name))
    return legs_kg / sum(segment.mass_kg for segment in segments.values())


def mean_body_axis(geometric: GeometricCom, used: slice) -> tuple[float, str]:
    """Angle (degrees) from the vertical of the mean axis of the body over ``used``, and its upper end.

    The axis leads from the middle of the ankles to the neck, or to the hips where no marker shows how the trunk leans.
    NaN where these are not visible in ten frames.
    """
    joints = geometric.joint_centres_m
    upper_end = "hips" if has_no_trunk(geometric) or "cervical" not in joints else "neck"
    if not joints.keys() >= {f"{side}_{joint}" for side, joint in itertools.product("lr", ("hip", "ankle"))}:
        return NAN, upper_end
    upper_m = joints["cervical"] if upper_end == "neck" else (joints["l_hip"] + joints["r_hip"]) / 2.0
    axis_m = (upper_m - (joints["l_ankle"] + joints["r_ankle"]) / 2.0)[used]
    seen = np.isfinite(axis_m).all(axis=1)
    if np.count_nonzero(seen) < _MIN_FRAMES:
        return NAN, upper_end
    x, y, z = axis_m[seen].mean(axis=0)
    return float(np.degrees(np.arctan2(np.hypot(x, y), z))), upper_end
