"""Touch-downs: where, how level and how fast an effector meets its surface, and whether it then stays.

``speed`` is that of the contact points at the last sample in the air, the largest of them.
"""

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Check, Worst
from stridelab.wholebody.certificate.inverse_dynamics import Recomputed
from stridelab.wholebody.motion import WholeBodyMotion

LANDING_ERROR_M = 5e-4
LANDING_ANGLE_RAD = float(np.deg2rad(0.1))
TOUCH_DOWN_M_S = 0.02
CONTACT_DRIFT_M = 5e-4


def touch_downs(
    robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, found: Recomputed, worst: Worst
) -> tuple[Check, Check, Check, Check]:
    """Contact points against their places at touch-down, angle and speed there, and drift ever after."""
    names = sequence.effectors
    shape = (len(motion.time_s), len(names))
    landing, angle, speed, drift = (np.full(shape, -np.inf) for _ in range(4))
    for column, name in enumerate(names):
        points, surface = found.contact_points_m[name], robot.effectors[name].kind == "surface"
        touched = None
        for i in range(shape[0]):
            contact = sequence.phases[found.phase[i]].contacts.get(name)
            if contact is None:
                touched = None
            elif touched is None:
                touched = points[i]
                place = contact.placement.act(motion.points_m[name])
                landing[i, column] = np.linalg.norm(points[i] - place, axis=1).max()
                if surface:
                    angle[i, column] = _angle(points[i], place)
                if i:
                    travelled_m = np.linalg.norm(points[i] - points[i - 1], axis=1).max()
                    speed[i, column] = travelled_m * motion.rate_hz
            else:
                drift[i, column] = np.linalg.norm(points[i] - touched, axis=1).max()
    return (
        worst.at_most("landing_error_max", landing, "m", LANDING_ERROR_M, names),
        worst.at_most("landing_angle_max", angle, "rad", LANDING_ANGLE_RAD, names),
        worst.at_most("touch_down_speed_max", speed, "m/s", TOUCH_DOWN_M_S, names),
        worst.at_most("contact_drift_max", drift, "m", CONTACT_DRIFT_M, names),
    )


def _angle(points_m: np.ndarray, place_m: np.ndarray) -> float:
    """Angle (rad) by which a rectangle of points is turned against another of the same size."""
    a, b = ((p - p.mean(axis=0)) for p in (points_m, place_m))
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = (U * [1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    turned = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arcsin(min(1.0, float(np.linalg.norm(turned)) / 2.0)))
