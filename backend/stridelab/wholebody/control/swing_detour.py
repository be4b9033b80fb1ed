"""Detours of a swing: around the other leg and edges of the terrain, off a rail, and tilts that relieve an ankle.

The curve of a sole (``contacts.swing``) knows soles and boxes, but neither shanks nor joints. While foot or shank come
close to another part of the body or to a box, or the ankle to an end of its range, a push ``p`` moves the target of
the sole by ``w(u) o``, with

    o'' = p - 2 sqrt(k) o' - k o ,      w = 1 - s((u - u_1) / (u_2 - u_1)) ,

the quintic s of the curve and the share u of the swing. ``o`` stacks a translation (m) and a rotation vector (rad) in
world axes. The detour returns slowly (``k``) where nothing pushes, and w closes it with zero velocity and acceleration
before the sole lands. Without a push the curve is unchanged.

The translation is pushed by the collision avoidance, the rotation by the ankle: with the axis a and the distance d of
a joint from the end of its range, ``p = k_a max(0, d_a - d - T d') a`` turns the sole away from that end, as a heel
that leaves the ground first does. A joint that meets its bound while the sole keeps its orientation would take torques,
arms and CoM with it, since the sole is a task above them.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.swing import SwingCurve, SwingPoint, Window, quintic_scaling
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import RigidBody

Offset = Float[np.ndarray, "6"]
CLOSES: Final = (0.65, 0.96)
"""Shares of the swing during which a detour of a sole ends."""
HAND_CLOSES: Final = (0.82, 0.96)
"""Shares of the swing during which a detour of a hand ends; an eighth before its end the hand has to be clear."""
HAND_OPENS: Final = (0.0, 0.04)
"""Shares of the swing during which pushes on a hand begin."""
STIFFNESS_S2: Final = 30.0
MAX_DETOUR_M: Final = 0.10
MAX_TILT_RAD: Final = 0.9
"""Largest detour and tilt; pushes that would lead beyond them are ignored."""
ANKLE_ACTS_RAD: Final = 0.2
"""Distance of an ankle joint from the end of its range at which the sole begins to tilt."""
ANKLE_AHEAD_S: Final = 0.1
"""Time by which the distance is predicted."""
ANKLE_STIFFNESS_S2: Final = 200.0
SHOE_SHARE: Final = 1.25
"""Length of a shoe before and behind the middle of its sole, as a share of half the contact rectangle."""


@dataclass
class SwingDetour:
    """Detour of one swing, integrated sample by sample with ``dt_s``.

    ``closes`` is the share of the swing during which it ends, ``opens`` that during which pushes rise from zero.
    """

    curve: SwingCurve
    dt_s: float
    closes: Window = CLOSES
    opens: Window | None = None
    offset: Offset = field(default_factory=lambda: np.zeros(6))
    rate: Offset = field(default_factory=lambda: np.zeros(6))

    def next_state(self, time_s: float, push: Callable[[], Offset]) -> SwingPoint:
        """State of the sole's target at ``time_s``; advances the detour by one sample."""
        t = time_s - self.curve.starts_s
        target = self.curve.state_at(t)
        if t >= self.closes[1] * self.curve.duration_s:
            return target
        o, v, p = self.offset, self.rate, push()
        if self.opens is not None:
            p = p * quintic_scaling(t, self.opens, self.curve.duration_s)[0]
        if self.curve.kind == "point":
            p[:3] = self._without_inward_push(p[:3], t)
        if not (p.any() or o.any()):
            return target
        for part, most in ((slice(0, 3), MAX_DETOUR_M), (slice(3, 6), MAX_TILT_RAD)):
            stops = o[part] + v[part] / (2.0 * math.sqrt(STIFFNESS_S2))  # not nearer than where it would stop
            if float(np.linalg.norm(stops)) > most and float(p[part] @ stops) > 0.0:
                p[part] = 0.0
        a = p - 2.0 * math.sqrt(STIFFNESS_S2) * v - STIFFNESS_S2 * o
        w, w_v, w_a = _closing_window(t, self.closes, self.curve.duration_s)
        self.offset = o + self.dt_s * v + 0.5 * self.dt_s**2 * a
        self.rate = v + self.dt_s * a
        x, x_v, x_a = w * o, w * v + w_v * o, w * a + 2.0 * w_v * v + w_a * o
        place = target.placement
        return replace(
            target,
            placement=Placement(place.position_m + x[:3], pin.exp3(x[3:]) @ place.rotation),
            velocity_m_s=target.velocity_m_s + x_v[:3],
            acceleration_m_s2=target.acceleration_m_s2 + x_a[:3],
            angular_velocity_rad_s=target.angular_velocity_rad_s + x_v[3:],
            angular_acceleration_rad_s2=target.angular_acceleration_rad_s2 + x_a[3:],
        )

    def _without_inward_push(self, push_m_s2: Vector3, time_s: float) -> Vector3:
        """A push on a hand without the part that moves its contact point into the surface that it leaves or nears."""
        nearer = self.curve.start if 2.0 * time_s < self.curve.duration_s else self.curve.end
        normal = nearer.rotation[:, 2]
        return np.asarray(push_m_s2 - min(0.0, float(push_m_s2 @ normal)) * normal)


@dataclass(frozen=True, eq=False)
class AnkleRelief:
    """The push of one sole's ankle joints, at ``columns`` of the velocity, within ``limits``.

    A sole that tilts rises by ``lever_m`` times its tilt, so that its toe and heel do not come lower.
    """

    columns: tuple[int, ...]
    limits: JointLimits
    lever_m: float

    @staticmethod
    def of_sole(robot: Robot, effector: str, limits: JointLimits) -> "AnkleRelief":
        """The ankle of a sole; without effect for a robot whose card names none."""
        sole = robot.effectors[effector]
        return AnkleRelief(
            ankle_columns(robot, (effector,)), limits, SHOE_SHARE * (sole.contact_half_size_m or (0.0, 0.0))[0]
        )

    def push(self, body: RigidBody, effector: str) -> Offset:
        """Acceleration of the offset that turns the sole away from the ends of the ankle's range, and raises it."""
        push = np.zeros(6)
        for column in self.columns:
            angle = float(body.q[column + 1] + ANKLE_AHEAD_S * body.v[column])
            below = ANKLE_ACTS_RAD - (angle - float(self.limits.lower_rad[column - 6]))
            above = ANKLE_ACTS_RAD - (float(self.limits.upper_rad[column - 6]) - angle)
            pushed = ANKLE_STIFFNESS_S2 * (max(0.0, below) - max(0.0, above))
            if pushed != 0.0:
                push[2] += self.lever_m * abs(pushed)
                push[3:] += pushed * body.frame_state(effector).J[3:, column]
        return push


def ankle_columns(robot: Robot, effectors: Iterable[str]) -> tuple[int, ...]:
    """Columns of the velocity that belong to the ankle joints of some effectors."""
    joints = (name for effector in effectors for name in robot.effectors[effector].ankle or ())
    return tuple(6 + robot.joint_names.index(name) for name in joints)


def _closing_window(t_s: float, closes: Window, duration_s: float) -> tuple[float, float, float]:
    """``w`` and its first two time derivatives."""
    s, s_v, s_a = quintic_scaling(t_s, closes, duration_s)
    return 1.0 - s, -s_v, -s_a
