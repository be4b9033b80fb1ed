"""Closed-form inverse kinematics of the legs, all samples at once.

Hip ball joint, knee hinge about y, ankle flexion about y then inversion about x, all axes of a joint meeting in a
point: six angles for the six coordinates of the foot. With ``r`` the vector from ankle to hip in the foot's frame,

    inversion  phi2 = atan2(r_y, r_z)                       (the shank's plane contains the hip)
    knee       cos(theta) = (|r|^2 - L_t^2 - L_s^2) / (2 L_t L_s)
    flexion    phi1 = angle of (-L_t sin theta, L_s + L_t cos theta) minus that of (r_x, sqrt(r_y^2 + r_z^2))

and the hip takes what is left.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stridelab.conventions import Points, Series
from stridelab.experiments.body_proportions import Proportions


@dataclass(frozen=True)
class LegAngles:
    """Hip (yaw, pitch, roll), knee, ankle flexion and inversion, in radians."""

    hip_rad: Points
    knee_rad: Series
    flexion_rad: Series
    inversion_rad: Series


def about_y(angle_rad: Series) -> Rotation:
    """Rotations about y, one per angle."""
    return Rotation.from_rotvec(np.outer(angle_rad, [0.0, 1.0, 0.0]))


def leg_angles(p: Proportions, hip_m: Points, pelvis: Rotation, ankle_m: Points, foot: Rotation) -> LegAngles:
    """Angles that hold the foot at its pose; a leg too short for it stays straight and points there."""
    r = foot.inv().apply(hip_m - ankle_m)
    inversion = np.arctan2(r[:, 1], r[:, 2])
    reach = np.linalg.norm(r, axis=1)
    cosine = (reach**2 - p.thigh_m**2 - p.shank_m**2) / (2.0 * p.thigh_m * p.shank_m)
    knee = np.arccos(np.clip(cosine, -1.0, 1.0))
    in_shank = np.arctan2(-p.thigh_m * np.sin(knee), p.shank_m + p.thigh_m * np.cos(knee))
    flexion = in_shank - np.arctan2(r[:, 0], np.hypot(r[:, 1], r[:, 2]))
    shank = foot * Rotation.from_rotvec(np.outer(-inversion, [1.0, 0.0, 0.0])) * about_y(-flexion)
    thigh = shank * about_y(-knee)
    return LegAngles((pelvis.inv() * thigh).as_euler("ZYX"), knee, flexion, inversion)
