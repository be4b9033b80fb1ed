"""Hand load: the force on a hand as a share of what its arm can carry.

With the torques ``tau_0 = tau + J' f`` that the arm would need without the force ``f`` on its hand, in the same posture
and motion, the force can grow to ``lambda f`` until the first joint of the arm reaches its limit,

    |tau_0 - lambda J' f| <= tau_max ,

and the share is ``1 / lambda``: 1 if a joint is at its limit.
"""

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Check, WorstValues
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
