"""Tasks of the hierarchy as rows ``A a = b`` on the joint acceleration (section 4.6).

Every motion task drives its error to zero like a damped spring around the planned acceleration,

    J a + dJ v = x''_ref + kp (x_ref - x) + kd (x'_ref - x').

Positions, velocities and accelerations are in world axes, rotations as rotation vectors of ``R_ref R'``.

Contact forces: a surface has one force per corner of its rectangle, a point contact has one. The pyramid

    |f_x|, |f_y| <= mu / sqrt(2) f_n ,    f_n >= 0

is inscribed in the exact cone ``|f_t| <= mu f_n``. Forces are in world axes, x, y and n are axes of the contact frame.

Reference orientation of the base: upright, with the heading of the feet.

At the start of every phase the heading is that of its soles (``ContactSequence.headings_rad``); it is interpolated to
that of the next phase by the quintic with zero rates at both ends,
``s(x) = x^3 (10 - 15 x + 6 x^2)``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.centroidal.plan import Reference
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import Angles, Points, Rotation, Rotations, Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import FrameState, RigidBody

Weight = float | Float[np.ndarray, "_"]
"""One for all rows, or one per row."""


RANGE_AHEAD_S = 0.1
"""Time by which the distance of a joint from the end of its range is predicted."""


class Gain(NamedTuple):
    """Stiffness (1/s^2) and damping (1/s) of an error."""

    kp: float
    kd: float

    @staticmethod
    def critically_damped(kp: float) -> "Gain":
        """Critical damping: ``kd = 2 sqrt(kp)``."""
        return Gain(kp, 2.0 * float(np.sqrt(kp)))


def rotation_error(reference: Rotation, actual: Rotation) -> Vector3:
    """Rotation vector in world axes that turns ``actual`` into ``reference``."""
    return np.asarray(pin.log3(reference @ actual.T))


def contact_task(frame: FrameState, placement: Placement, surface: bool, gain: Gain) -> Rows:
    """Contact fixed at its planned placement: six rows for a surface, three for a point."""
    e = placement.position_m - frame.position_m
    if surface:
        e = np.concatenate([e, rotation_error(placement.rotation, frame.rotation)])
    k = len(e)
    return Rows(frame.J[:k], gain.kp * e - gain.kd * frame.velocity[:k] - frame.drift[:k])


def com_task(body: RigidBody, reference: Reference, gain: Gain) -> Rows:
    """CoM tracking by the linear rows of the centroidal map (4.3): ``A_G a + dA_G v = m c''``."""
    e, e_v = reference.com_m - body.com_m, reference.com_v_m_s - body.com_v_m_s
    c_a = reference.com_a_m_s2 + gain.kp * e + gain.kd * e_v
    return Rows(body.A_g[:3] / body.mass_kg, c_a - body.A_g_drift[:3] / body.mass_kg)


def momentum_task(body: RigidBody, reference: Reference, gain_per_s: float) -> Rows:
    """Tracking of the angular momentum about the CoM, first order: ``dL = dL_ref + k (L_ref - L)``."""
    l_rate = reference.l_rate_nm + gain_per_s * (reference.l_nms - body.l_nms)
    return Rows(body.A_g[3:], l_rate - body.A_g_drift[3:])


def position_task(frame: FrameState, p_m: Vector3, v_m_s: Vector3, a_m_s2: Vector3, gain: Gain) -> Rows:
    """Position tracking of a frame's origin."""
    e, e_v = p_m - frame.position_m, v_m_s - frame.velocity[:3]
    return Rows(frame.J[:3], a_m_s2 + gain.kp * e + gain.kd * e_v - frame.drift[:3])


def orientation_task(frame: FrameState, R: Rotation, w_rad_s: Vector3, w_rate_rad_s2: Vector3, gain: Gain) -> Rows:
    """Orientation tracking of a frame, with angular velocity ``w`` and acceleration."""
    e, e_v = rotation_error(R, frame.rotation), w_rad_s - frame.velocity[3:]
    return Rows(frame.J[3:], w_rate_rad_s2 + gain.kp * e + gain.kd * e_v - frame.drift[3:])


def posture_task(body: RigidBody, angles_rad: Angles, gain: Gain) -> Rows:
    """Actuated joints at rest at ``angles_rad`` ``(na,)``."""
    return Rows(_select_last(len(angles_rad), 6), gain.kp * (angles_rad - body.q[7:]) - gain.kd * body.v[6:])


def range_task(
    body: RigidBody, limits: JointLimits, columns: Sequence[int], gain: Gain, acts_rad: float
) -> tuple[Angles, Rows]:
    """Weights and rows that push joints at ``columns`` of the velocity away from the nearer ends of their ranges.

    With the distance d from that end, predicted ``RANGE_AHEAD_S`` ahead, the weight is ``(1 - d / acts_rad)^2``, zero
    from ``acts_rad`` on, so that accelerations are continuous. A joint that meets its bound instead is locked: the
    other joints then have to follow the CoM at once, with the momentum of the arms.
    """
    at = np.asarray(columns, dtype=int)
    q, v = body.q[at + 1], body.v[at]
    to_lower, to_upper = q - limits.lower_rad[at - 6], limits.upper_rad[at - 6] - q
    away = np.where(to_lower < to_upper, 1.0, -1.0)
    distance = np.minimum(to_lower, to_upper)
    nearest = np.minimum(distance, distance + RANGE_AHEAD_S * away * v)
    weights = np.minimum(np.maximum(1.0 - nearest / acts_rad, 0.0), 1.0) ** 2
    A = np.zeros((len(at), body.model.nv))
    A[np.arange(len(at)), at] = away
    return weights, Rows(A, gain.kp * np.maximum(0.0, acts_rad - distance) - gain.kd * away * v)


def force_task(planned_n: Float[np.ndarray, "nf"], nv: int) -> Rows:
    """Tracking of planned forces, which follow the ``nv`` accelerations among the unknowns."""
    return Rows(_select_last(len(planned_n), nv), planned_n)


@cache
def _select_last(n: int, before: int) -> Float[np.ndarray, "n m"]:
    """Matrix that selects the last ``n`` of ``before + n`` unknowns."""
    S = np.zeros((n, before + n))
    S[:, before:] = np.eye(n)
    S.flags.writeable = False
    return S


def stack_weighted(weighted: list[tuple[Weight, Rows]], nz: int) -> Rows:
    """Stack rows multiplied by their weights (one per task or per row), padded with zero columns to ``nz``."""
    m = sum([len(rows.b) for _, rows in weighted])
    A, b = np.zeros((m, nz)), np.empty(m)
    at = 0
    for weight, rows in weighted:
        k, n = rows.A.shape
        np.multiply(rows.A, weight if isinstance(weight, float) else weight[:, None], out=A[at : at + k, :n])
        np.multiply(rows.b, weight, out=b[at : at + k])
        at += k
    return Rows(A, b)


_PYRAMID_MARGIN_N = 1e-3
"""Margin to the pyramid's faces that absorbs the solver's tolerance."""


def friction_pyramid(contact: Contact, points: int) -> Inequalities:
    """Five rows per contact point on the ``3 points`` components of its forces."""
    x, y, n = contact.placement.rotation.T
    mu = contact.friction / np.sqrt(2.0)
    one = np.array([x - mu * n, -x - mu * n, y - mu * n, -y - mu * n, -n])
    upper = np.full(5 * points, -_PYRAMID_MARGIN_N)
    return Inequalities(np.kron(np.eye(points), one), np.full(5 * points, -np.inf), upper)


def force_jacobian(frame: FrameState, points_m: Points) -> Float[np.ndarray, "m nv"]:
    """Jacobian ``(3 k, nv)`` of contact points given in the contact frame: ``J_p = J_v - [R p]x J_w``."""
    x, y, z = frame.rotation @ points_m.T
    lever = np.zeros((len(points_m), 3, 6))
    lever[:, 0, 0] = lever[:, 1, 1] = lever[:, 2, 2] = 1.0
    lever[:, 0, 4], lever[:, 0, 5] = z, -y
    lever[:, 1, 3], lever[:, 1, 5] = -z, x
    lever[:, 2, 3], lever[:, 2, 4] = y, -x
    return np.asarray(lever.reshape(-1, 6) @ frame.J)


@dataclass(frozen=True, eq=False)
class Heading:
    """Yaw (rad, unwrapped) at every phase boundary ``(n_phases + 1,)``."""

    sequence: ContactSequence
    yaw_rad: Float[np.ndarray, "n"]

    @staticmethod
    def of_sequence(sequence: ContactSequence) -> "Heading":
        """Headings of the phases; the last one holds until the end."""
        return Heading(sequence, np.append(sequence.headings_rad, sequence.headings_rad[-1]))

    def orientations_at(self, phase: Int[np.ndarray, "m"], time_s: Series) -> tuple[Rotations, Points, Points]:
        """Rotations ``(m, 3, 3)``, angular velocities and accelerations ``(m, 3)`` in world axes."""
        T = np.array([one.duration_s for one in self.sequence.phases])[phase]
        x = np.clip((time_s - self.sequence.starts_s[phase]) / T, 0.0, 1.0)
        turn = self.yaw_rad[phase + 1] - self.yaw_rad[phase]
        yaw = self.yaw_rad[phase] + turn * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        R, rate, rate_rate = np.zeros((len(x), 3, 3)), np.zeros((len(x), 3)), np.zeros((len(x), 3))
        R[:, 0, 0] = R[:, 1, 1] = np.cos(yaw)
        R[:, 1, 0] = np.sin(yaw)
        R[:, 0, 1] = -R[:, 1, 0]
        R[:, 2, 2] = 1.0
        rate[:, 2] = turn * 30.0 * x**2 * (1.0 - x) ** 2 / T
        rate_rate[:, 2] = turn * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / T**2
        return R, rate, rate_rate
