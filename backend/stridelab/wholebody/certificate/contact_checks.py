"""Hand load: the force on a hand as a share of what its arm can carry.

With the torques ``tau_0 = tau + J' f`` that the arm would need without the force ``f`` on its hand, in the same posture
and motion, the force can grow to ``lambda f`` until the first joint of the arm reaches its limit,

    |tau_0 - lambda J' f| <= tau_max ,

and the share is ``1 / lambda``: 1 if a joint is at its limit.

Touch-downs: position, angle and speed with which an effector meets its surface, and its drift afterwards.

``speed`` is the largest speed of the contact points at the last sample in the air.
"""

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Check, WorstValues
from stridelab.wholebody.certificate.inverse_dynamics import Recomputed
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.motion import WholeBodyMotion

_MIN_FORCE_N = 1.0
"""Hands with smaller forces are ignored."""


def hand_loads(
    robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, chosen: slice, worst: WorstValues
) -> tuple[Check, ...]:
    """Largest share over the ``chosen`` samples, which are those of ``worst``; empty without hands."""
    hands = tuple(name for name in sequence.effectors if robot.effectors[name].kind == "point")
    if not hands:
        return ()
    posed, limits = LimbKinematics(robot, hands), robot.model.effortLimit[6:]
    samples = range(len(motion.time_s))[chosen]
    shares = np.full((len(samples), len(hands)), -np.inf)
    for row, i in enumerate(samples):
        forces = {name: motion.forces_n[name][i].sum(axis=0) for name in hands}
        if max(np.linalg.norm(f) for f in forces.values()) < _MIN_FORCE_N:
            continue
        posed.set_configuration(motion.q[i])
        for column, name in enumerate(hands):
            if np.linalg.norm(forces[name]) >= _MIN_FORCE_N:
                limb = posed.limb[name]
                load_nm = posed.torques_nm(name, forces[name])
                reserve_nm = limits[limb] + np.sign(load_nm) * (motion.tau_nm[i, limb] + load_nm)
                shares[row, column] = np.max(np.abs(load_nm) / np.maximum(reserve_nm, 1e-9))
    return (worst.at_most("hand_load_share_max", shares, "1", 1.0, hands),)


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
        touch_down: int | None = None
        landed = np.full(shape[0], -1)  # the sample of the touch-down, after it
        for i in range(shape[0]):
            contact = sequence.phases[recomputed.phase[i]].contacts.get(name)
            if contact is None:
                touch_down = None
            elif touch_down is None:
                touch_down = i
                planned_m = contact.placement.act(motion.points_m[name])
                landing[i, column] = np.linalg.norm(points[i] - planned_m, axis=1).max()
                if is_surface:
                    angle[i, column] = _rotation_angle(points[i], planned_m)
                if i:
                    travelled_m = np.linalg.norm(points[i] - points[i - 1], axis=1).max()
                    speed[i, column] = travelled_m * motion.rate_hz
            else:
                landed[i] = touch_down
        stays = landed >= 0
        drift[stays, column] = np.linalg.norm(points[stays] - points[landed[stays]], axis=2).max(axis=1, initial=0.0)
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
