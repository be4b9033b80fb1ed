"""Inverse dynamics of a motion from ``q, v, a, tau`` and the contact forces, independent of the controller.

The external forces enter the recursive Newton-Euler algorithm per link, without contact Jacobians; the centroidal
side is the time derivative of the body's momentum,

    m (c'' - g) = sum f ,      L_c' = sum (p - c) x f .                        (4.2a), (4.2b)
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Points, Series, g
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion


@dataclass(frozen=True, eq=False)
class Recomputed:
    """Per sample: CoM (m), its velocity, angular momentum, contact points, residuals of the dynamics.

    ``contact_points_m`` are per effector ``(n, k, 3)`` in the world; ``newton_euler`` ``(n,)`` is the larger norm of
    the gaps in force (N) and moment (N m); ``torque_gap_nm`` ``(n, na)`` the inverse dynamics minus ``tau``;
    ``integration_gap`` ``(n,)`` the gap between ``(q, v)`` and the integral from the previous sample (m, rad and their
    rates).
    """

    phase: Int[np.ndarray, "n"]
    com_m: Points
    com_v_m_s: Points
    l_nms: Points
    contact_points_m: Mapping[str, Float[np.ndarray, "n k 3"]]
    newton_euler: Series
    torque_gap_nm: Float[np.ndarray, "n na"]
    integration_gap: Series


def phase_of_samples(sequence: ContactSequence, time_s: Series) -> Int[np.ndarray, "n"]:
    """Contact phase of every sample; a boundary belongs to the following phase."""
    following = np.searchsorted(sequence.ends_s, time_s + 1e-9, side="right")
    return np.minimum(following, len(sequence.phases) - 1)


def recompute_dynamics(robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion) -> Recomputed:
    """Recompute all quantities: the kinematics of all samples, the contact wrenches, then the inverse dynamics."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    mass = float(pin.computeTotalMass(model))
    n, na = len(motion.time_s), model.nv - 6
    com, l, momentum = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    linear_rate, angular_rate = np.empty((n, 3)), np.empty((n, 3))
    names, joints = tuple(motion.points_m), [model.frames[frames[name]].parentJoint for name in motion.points_m]
    frame_R, joint_R = (np.empty((len(names), n, 3, 3)) for _ in range(2))
    frame_p, joint_p = (np.empty((len(names), n, 3)) for _ in range(2))
    for i in range(n):
        pin.computeCentroidalMomentumTimeVariation(model, data, motion.q[i], motion.v[i], motion.a[i])
        com[i], momentum[i], l[i] = data.com[0], data.hg.linear, data.hg.angular
        linear_rate[i], angular_rate[i] = data.dhg.linear, data.dhg.angular
        for row, name in enumerate(names):
            placement, joint = pin.updateFramePlacement(model, data, frames[name]), data.oMi[joints[row]]
            frame_R[row, i], frame_p[row, i] = placement.rotation, placement.translation
            joint_R[row, i], joint_p[row, i] = joint.rotation, joint.translation
    force_gap, moment_gap = linear_rate - mass * g, angular_rate
    points: dict[str, Float[np.ndarray, "n k 3"]] = {}
    on_joint = np.zeros((model.njoints, n, 6))
    for row, name in enumerate(names):
        p, f = motion.points_m[name] @ frame_R[row].swapaxes(1, 2) + frame_p[row][:, None], motion.forces_n[name]
        total = f.sum(axis=1)
        force_gap, moment_gap = force_gap - total, moment_gap - np.cross(p - com[:, None], f).sum(axis=1)
        moment = np.cross(p - joint_p[row][:, None], f).sum(axis=1)
        on_joint[joints[row]] += np.hstack([_in_frame(joint_R[row], total), _in_frame(joint_R[row], moment)])
        points[name] = p
    torque_gap, integration_gap = np.empty((n, na)), np.zeros(n)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    dt = 1.0 / motion.rate_hz
    steps = dt * motion.v + 0.5 * dt**2 * motion.a
    v_gap = np.abs(motion.v[:-1] + dt * motion.a[:-1] - motion.v[1:]).max(axis=1, initial=0.0)
    for i in range(n):
        for joint in joints:
            external[joint] = pin.Force(on_joint[joint, i])
        torque_gap[i] = pin.rnea(model, data, motion.q[i], motion.v[i], motion.a[i], external)[6:]
        if i:
            q_gap = pin.difference(model, pin.integrate(model, motion.q[i - 1], steps[i - 1]), motion.q[i])
            integration_gap[i] = max(np.abs(q_gap).max(), v_gap[i - 1])
    return Recomputed(
        phase=phase_of_samples(sequence, motion.time_s),
        com_m=com,
        com_v_m_s=momentum / mass,
        l_nms=l,
        contact_points_m=points,
        newton_euler=np.maximum(np.linalg.norm(force_gap, axis=1), np.linalg.norm(moment_gap, axis=1)),
        torque_gap_nm=torque_gap - motion.tau_nm,
        integration_gap=integration_gap,
    )


def _in_frame(rotations: Float[np.ndarray, "n 3 3"], vectors: Points) -> Points:
    """World vectors in the axes of frames: ``R' v``."""
    return np.asarray(np.einsum("nij,ni->nj", rotations, vectors))
