"""Thirteen limbs of a moving person: masses, lengths and directions; the rest of a body drawn for judging estimators.

Every limb is a rod from a proximal joint along a unit vector. Angles over a stride follow the normative curves of gait
analysis (hip, knee, ankle; Winter 1991, rounded); arms swing against the legs. Nothing here is shared with the segment
model, the robot model or an estimator.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from stridelab.conventions import Points, Series

LIMBS: Final[Mapping[str, tuple[float, float, float]]] = {
    "pelvis": (0.142, 0.060, 0.50),
    "trunk": (0.355, 0.288, 0.45),
    "head": (0.081, 0.182, 0.60),
    "l_arm": (0.028, 0.186, 0.44),
    "r_arm": (0.028, 0.186, 0.44),
    "l_forearm": (0.022, 0.254, 0.46),
    "r_forearm": (0.022, 0.254, 0.46),
    "l_thigh": (0.100, 0.245, 0.43),
    "r_thigh": (0.100, 0.245, 0.43),
    "l_shank": (0.0465, 0.246, 0.43),
    "r_shank": (0.0465, 0.246, 0.43),
    "l_foot": (0.0145, 0.110, 0.45),
    "r_foot": (0.0145, 0.110, 0.45),
}
"""Mass fraction, length over stature, and centre of mass along the length (Winter 2009, table 4.1)."""
GYRATION: Final = 0.29
"""Radius of gyration of a limb about its centre over its length, a slender rod's."""
HIP_HALF_WIDTH, SHOULDER_HALF_WIDTH = 0.048, 0.115
_CYCLE: Final = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CURVES: Final[Mapping[str, tuple[float, ...]]] = {
    "walk hip": (30, 26, 17, 6, -4, -10, -3, 14, 27, 32, 30),
    "walk knee": (5, 15, 16, 9, 5, 11, 38, 61, 48, 15, 5),
    "walk ankle": (0, -3, 3, 7, 10, 4, -17, -4, 1, 1, 0),
    "run hip": (40, 36, 22, 6, -6, -8, 8, 28, 44, 46, 40),
    "run knee": (18, 40, 38, 24, 20, 45, 85, 95, 65, 25, 18),
    "run ankle": (5, 18, 20, 5, -18, -15, -5, 0, 3, 5, 5),
}


@dataclass(frozen=True)
class Posture:
    """Centres of mass (relative to the pelvis), unit vectors and lengths of the limbs by name."""

    centre_m: Mapping[str, Points]
    along: Mapping[str, Points]
    length_m: Mapping[str, float]


@dataclass(frozen=True)
class Angles:
    """Inclinations in radians per sample: positive forwards (``lean``, ``thigh``, ``arm``), or to the left (``roll``).

    Pairs are left, right. ``turn`` is the rotation of the pelvis about the vertical; the shoulders turn against it.
    """

    lean: Series
    roll: Series
    turn: Series
    thigh: tuple[Series, Series]
    knee: tuple[Series, Series]
    ankle: tuple[Series, Series]
    arm: tuple[Series, Series]
    elbow: tuple[Series, Series]


def stride_curve(name: str, stride: Series) -> Series:
    """Angle in radians over strides (0 to 1 is one stride), periodic and smooth."""
    return np.asarray(np.deg2rad(CubicSpline(_CYCLE, _CURVES[name], bc_type="periodic")(np.mod(stride, 1.0))))


def limb_posture(angles: Angles, height_m: float) -> Posture:
    """Place all limbs about the pelvis."""
    length = {name: share * height_m for name, (_, share, _) in LIMBS.items()}
    up = _unit_vectors(angles.lean, angles.roll, 1.0)
    origin = np.zeros_like(up)
    start = {"pelvis": origin, "trunk": origin + length["pelvis"] / 2 * up}
    along = {"pelvis": up, "trunk": up, "head": up}
    start["head"] = start["trunk"] + length["trunk"] * up
    for k, (side, left) in enumerate((("l", 1.0), ("r", -1.0))):
        hip = left * HIP_HALF_WIDTH * height_m * _leftwards(angles.turn)
        shoulder = start["head"] - 0.04 * height_m * up
        start[f"{side}_arm"] = shoulder + left * SHOULDER_HALF_WIDTH * height_m * _leftwards(-0.7 * angles.turn)
        along[f"{side}_arm"] = _unit_vectors(angles.arm[k], left * 0.12 + 0.0 * angles.roll, -1.0)
        along[f"{side}_forearm"] = _unit_vectors(angles.arm[k] + angles.elbow[k], 0.05 * left + 0.0 * angles.roll, -1.0)
        along[f"{side}_thigh"] = _unit_vectors(angles.thigh[k], -0.03 * left - 0.3 * angles.roll, -1.0)
        shank = angles.thigh[k] - angles.knee[k]
        along[f"{side}_shank"] = _unit_vectors(shank, 0.0 * angles.roll, -1.0)
        along[f"{side}_foot"] = _unit_vectors(shank + angles.ankle[k] + np.pi / 2 - 0.2, 0.0 * angles.roll, -1.0)
        start[f"{side}_thigh"] = hip
        for upper, lower in (("arm", "forearm"), ("thigh", "shank"), ("shank", "foot")):
            start[f"{side}_{lower}"] = start[f"{side}_{upper}"] + length[f"{side}_{upper}"] * along[f"{side}_{upper}"]
    centre = {name: start[name] + LIMBS[name][2] * length[name] * along[name] for name in LIMBS}
    return Posture(centre, along, length)


def _unit_vectors(forwards: Series, leftwards: Series, up: float) -> Points:
    u = np.column_stack([np.sin(forwards), np.sin(leftwards), up * np.cos(forwards) * np.cos(leftwards)])
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


def _leftwards(turn: Series) -> Points:
    return np.column_stack([-np.sin(turn), np.cos(turn), 0.0 * turn])
