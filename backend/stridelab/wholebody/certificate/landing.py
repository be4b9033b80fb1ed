"""Touch-downs: position, angle and speed with which an effector meets its surface, and its drift afterwards.

``speed`` is the largest speed of the contact points at the last sample in the air.
"""

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Check, WorstValues
from stridelab.wholebody.certificate.inverse_dynamics import Recomputed
from stridelab.wholebody.motion import WholeBodyMotion

LANDING_ERROR_M = 5e-4
LANDING_ANGLE_RAD = float(np.deg2rad(0.1))
TOUCH_DOWN_M_S = 0.02
CONTACT_DRIFT_M = 5e-4


def touch_downs(
    robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, recomputed: Recomputed, worst: WorstValues
) -> tuple[Check, Check, Check, Check]:
    """Position error, angle and speed at touch-down, and drift of the contact points afterwards."""
    names = sequence.effectors
    shape = (len(motion.time_s), len(names))
    landing, angle, speed, drift = (np.full(shape, -np.inf) for _ in range(4))
    for column, name in enumerate(names):
        points, is_surface = recomputed.contact_points_m[name], robot.effectors[name].kind == "surface"
        touch_down_m = None
        for i in range(shape[0]):
            contact = sequence.phases[recomputed.phase[i]].contacts.get(name)
            if contact is None:
                touch_down_m = None
            elif touch_down_m is None:
                touch_down_m = points[i]
                planned_m = contact.placement.act(motion.points_m[name])
                landing[i, column] = np.linalg.norm(points[i] - planned_m, axis=1).max()
                if is_surface:
                    angle[i, column] = _rotation_angle(points[i], planned_m)
                if i:
                    travelled_m = np.linalg.norm(points[i] - points[i - 1], axis=1).max()
                    speed[i, column] = travelled_m * motion.rate_hz
            else:
                drift[i, column] = np.linalg.norm(points[i] - touch_down_m, axis=1).max()
    return (
        worst.at_most("landing_error_max", landing, "m", LANDING_ERROR_M, names),
        worst.at_most("landing_angle_max", angle, "rad", LANDING_ANGLE_RAD, names),
        worst.at_most("touch_down_speed_max", speed, "m/s", TOUCH_DOWN_M_S, names),
        worst.at_most("contact_drift_max", drift, "m", CONTACT_DRIFT_M, names),
    )


def _rotation_angle(points_m: np.ndarray, place_m: np.ndarray) -> float:
    """Rotation angle (rad) between two rectangles of points of the same size."""
    a, b = ((p - p.mean(axis=0)) for p in (points_m, place_m))
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = (U * [1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arcsin(min(1.0, float(np.linalg.norm(axis)) / 2.0)))
