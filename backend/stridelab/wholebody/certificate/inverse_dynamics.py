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
from stridelab.conventions import Points, Series, Vector3, g
from stridelab.dynamics.spatial import length_of
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
    """Recompute all quantities in one pass over the samples."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    mass = float(pin.computeTotalMass(model))
    n, na = len(motion.time_s), model.nv - 6
    com, com_v, l = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    points = {name: np.empty((n, *p.shape)) for name, p in motion.points_m.items()}
    newton_euler, torque_gap, integration_gap = np.empty(n), np.empty((n, na)), np.zeros(n)
    no_forces = [pin.Force.Zero() for _ in range(model.njoints)]
    dt = 1.0 / motion.rate_hz
    for i in range(n):
        q, v, a = motion.q[i], motion.v[i], motion.a[i]
        pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)
        com[i], l[i] = data.com[0], data.hg.angular
        com_v[i] = data.hg.linear / mass
        force_gap, moment_gap = data.dhg.linear - mass * g, data.dhg.angular.copy()
        external = list(no_forces)
        for name, in_contact_frame in motion.points_m.items():
            placement = pin.updateFramePlacement(model, data, frames[name])
            p = in_contact_frame @ placement.rotation.T + placement.translation
            points[name][i] = p
            f = motion.forces_n[name][i]
            total = f.sum(axis=0)
            force_gap = force_gap - total
            moment_gap = moment_gap - _total_moment(p - com[i], f)
            joint = model.frames[frames[name]].parentJoint
            external[joint] = external[joint] + data.oMi[joint].actInv(pin.Force(total, _total_moment(p, f)))
        newton_euler[i] = max(length_of(force_gap), length_of(moment_gap))
        torque_gap[i] = pin.rnea(model, data, q, v, a, external)[6:] - motion.tau_nm[i]
        if i:
            step = dt * motion.v[i - 1] + 0.5 * dt**2 * motion.a[i - 1]
            q_gap = pin.difference(model, pin.integrate(model, motion.q[i - 1], step), q)
            v_gap = motion.v[i - 1] + dt * motion.a[i - 1] - v
            integration_gap[i] = max(np.abs(q_gap).max(), np.abs(v_gap).max())
    return Recomputed(
        phase=phase_of_samples(sequence, motion.time_s),
        com_m=com,
        com_v_m_s=com_v,
        l_nms=l,
        contact_points_m=points,
        newton_euler=newton_euler,
        torque_gap_nm=torque_gap,
        integration_gap=integration_gap,
    )


def _total_moment(p_m: Points, f_n: Points) -> Vector3:
    """``sum p x f``, computed as the antisymmetric part of ``sum p f'``, which is faster than many cross products."""
    S = p_m.T @ f_n
    return np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
