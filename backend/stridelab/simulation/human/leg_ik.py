"""Closed-form inverse kinematics of the legs, all samples at once.

Hip ball joint, knee hinge about y, ankle flexion about y then inversion about x, all axes of a joint meeting in a
point: six angles for the six coordinates of the foot. With ``r`` the vector from ankle to hip in the foot's frame,

    inversion  phi2 = atan2(r_y, r_z)                       (the shank's plane contains the hip)
    knee       cos(theta) = (|r|^2 - L_t^2 - L_s^2) / (2 L_t L_s)
    flexion    phi1 = angle of (-L_t sin theta, L_s + L_t cos theta) minus that of (r_x, sqrt(r_y^2 + r_z^2))

and the rotation of the hip is ``R_pelvis^T R_foot R_x(-phi2) R_y(-(phi1 + theta))``.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stridelab.conventions import Points, Rotations, Series
from stridelab.simulation.human.body_proportions import Proportions


@dataclass(frozen=True)
class LegAngles:
    """Hip (yaw, pitch, roll), knee, ankle flexion and inversion, in radians."""

    hip_rad: Points
    knee_rad: Series
    flexion_rad: Series
    inversion_rad: Series


def leg_angles(p: Proportions, hip_m: Points, pelvis: Rotation, ankle_m: Points, foot: Rotation) -> LegAngles:
    """Angles that place the foot at its pose; a leg that is too short stays straight and points towards it."""
    R_foot = foot.as_matrix()
    r = np.einsum("nji,nj->ni", R_foot, hip_m - ankle_m)
    inversion = np.arctan2(r[:, 1], r[:, 2])
    reach = np.linalg.norm(r, axis=1)
    cosine = (reach**2 - p.thigh_m**2 - p.shank_m**2) / (2.0 * p.thigh_m * p.shank_m)
    knee = np.arccos(np.clip(cosine, -1.0, 1.0))
    in_shank = np.arctan2(-p.thigh_m * np.sin(knee), p.shank_m + p.thigh_m * np.cos(knee))
    flexion = in_shank - np.arctan2(r[:, 0], np.hypot(r[:, 1], r[:, 2]))
    hip = _hip_rad(pelvis.as_matrix().swapaxes(1, 2) @ R_foot, inversion, flexion + knee)
    return LegAngles(hip, knee, flexion, inversion)


def _hip_rad(foot_in_pelvis: Rotations, inversion_rad: Series, bend_rad: Series) -> Points:
    """Yaw, pitch and roll of the hip, from the required entries of the product."""
    x, y, z = np.moveaxis(foot_in_pelvis, 2, 0)
    c, s = np.cos(inversion_rad)[:, None], np.sin(inversion_rad)[:, None]
    y, z = c * y - s * z, s * y + c * z
    c, s = np.cos(bend_rad)[:, None], np.sin(bend_rad)[:, None]
    x, z = c * x + s * z, c * z - s * x
    yaw, roll = np.arctan2(x[:, 1], x[:, 0]), np.arctan2(y[:, 2], z[:, 2])
    return np.column_stack([yaw, np.arcsin(np.clip(-x[:, 2], -1.0, 1.0)), roll])
