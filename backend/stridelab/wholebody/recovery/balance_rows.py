"""The whole body at one sample of a recovery: one weighted problem under the equations of motion and all limits.

    exactly    base rows of the equations of motion ;  soles in contact do not accelerate
    weighted   CoM ;  swinging sole ;  upright base ;  angular momentum ;  posture ;  collision avoidance ;  forces
    bounds     those of ``task_stack``

Unlike in the strict hierarchy of a planned motion, a CoM that the soles cannot move as wished yields to nothing else:
with strict levels the body would whirl its arms and trunk for the last newton.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import GRAVITY_M_S2, Angles, Rotation, Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control import tasks
from stridelab.wholebody.control.collision_avoidance import CollisionAvoidance
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows, solve_hierarchy
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.task_stack import PhaseHierarchy, Settings
from stridelab.wholebody.control.tasks import Gain
from stridelab.wholebody.recovery.driven_joints import DrivenJoints
from stridelab.wholebody.recovery.swing_aim import AimedSwing

_FREE = 1e5
"""Bound of a limit that is given up."""


@dataclass(frozen=True)
class BalanceWeights:
    """Weights and gains of the tasks of a recovery; a weight multiplies the rows, so that its square is in the cost."""

    com: float = 12.0
    height: float = 8.0
    swing: float = 4.0
    swing_turn: float = 2.0
    base: float = 1.5
    momentum: float = 0.05
    force: float = 2e-3
    swing_gain: Gain = field(default_factory=lambda: Gain.critically_damped(900.0))
    base_gain: Gain = field(default_factory=lambda: Gain.critically_damped(80.0))
    height_gain: Gain = field(default_factory=lambda: Gain.critically_damped(60.0))
    momentum_per_s: float = 5.0


@dataclass(frozen=True, eq=False)
class BalanceTargets:
    """Targets of one sample; ``swings`` are the references of the soles in the air, ``base`` and ``sole`` headings."""

    com_a_m_s2: Float[np.ndarray, "2"]
    height_m: float
    height_rate_m_s: float
    base: "LevelHeading"
    sole: "LevelHeading"
    swings: Mapping[str, AimedSwing]


class LevelHeading(NamedTuple):
    """A level orientation that turns about the vertical axis."""

    yaw_rad: float
    rate_rad_s: float = 0.0

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """The forward and left axes as columns."""
        x, y = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[x, -y], [y, x]])

    @property
    def rotation(self) -> Rotation:
        """The orientation in the world."""
        R = np.eye(3)
        R[:2, :2] = self.axes
        return R

    @property
    def velocity_rad_s(self) -> Vector3:
        """Angular velocity in the world."""
        return np.array([0.0, 0.0, self.rate_rad_s])


class Balance(NamedTuple):
    """Accelerations and torques; ``within_limits`` says whether joint ranges, speeds and torques hold."""

    a: Float[np.ndarray, "nv"]
    tau_nm: Angles
    within_limits: bool


class BalanceRows(PhaseHierarchy):
    """Rows of one set of contacts; ``driven`` joints move by their own servo."""

    def __init__(
        self,
        robot: Robot,
        body: RigidBody,
        contacts: Mapping[str, Contact],
        weights: BalanceWeights,
        settings: Settings,
        avoidance: CollisionAvoidance | None,
        driven: DrivenJoints | None = None,
    ) -> None:
        super().__init__(robot, body, contacts, {}, settings, avoidance)
        self._weights, self._driven = weights, driven
        if driven is not None:
            self._posture_weights[driven.at] = 0.0
        n = sum(len(points) for points in self._points.values())
        even_n = np.zeros((n, 3))
        even_n[:, 2] = GRAVITY_M_S2 * robot.mass_kg / max(n, 1)
        self._even_n = even_n.ravel()

    def solve_sample(self, targets: BalanceTargets) -> Balance:
        """Solve at the body's state; limits of joints, then of torques are given up where they leave no solution."""
        J = [tasks.force_jacobian(self._body.frame_state(name), points) for name, points in self._points.items()]
        J_f = np.vstack(J)
        equality, level, bounds = self._level_0(J_f), self._weighted_rows(targets), self._inequality_rows(J_f)
        result = solve_hierarchy(equality, [level], bounds)
        given_up = 0
        for rows in (self._joint, self._torque):
            if result.failure is None:
                break
            given_up += 1
            lower, upper = bounds.lower.copy(), bounds.upper.copy()
            lower[rows], upper[rows] = -_FREE, _FREE
            bounds = Inequalities(bounds.G, lower, upper)
            result = solve_hierarchy(equality, [level], bounds)
        return Balance(result.z[: self._nv], self.torques_nm(result.z), given_up == 0)

    def _level_0(self, J_f: Float[np.ndarray, "nf nv"]) -> Rows:
        rows = super()._level_0(J_f)
        if self._driven is None:
            return rows
        driven = self._driven.motion_rows(self._body, self._nz)
        return Rows(np.vstack([rows.A, driven.A]), np.concatenate([rows.b, driven.b]))

    def _inequality_rows(self, J_f: Float[np.ndarray, "nf nv"]) -> Inequalities:
        bounds = super()._inequality_rows(J_f)
        if self._driven is not None:
            for rows in (self._torque, self._joint):
                at = rows.start + self._driven.at
                bounds.lower[at], bounds.upper[at] = -_FREE, _FREE
        return bounds

    def _weighted_rows(self, targets: BalanceTargets) -> Rows:
        body, w, zero = self._body, self._weights, np.zeros(3)
        kp, kd = w.height_gain
        up = kp * (targets.height_m - body.com_m[2]) + kd * (targets.height_rate_m_s - body.com_v_m_s[2])
        R, sole = targets.base.rotation, targets.sole
        A, drift = body.A_g[:3] / body.mass_kg, body.A_g_drift[:3] / body.mass_kg
        weighted: list[tuple[tasks.Weight, Rows]] = [
            (w.com, Rows(A[:2], targets.com_a_m_s2 - drift[:2])),
            (w.height, Rows(A[2:], up - drift[2:])),
            (
                w.base,
                tasks.orientation_task(body.frame_state("base"), R, targets.base.velocity_rad_s, zero, w.base_gain),
            ),
            (w.momentum, Rows(body.A_g[3:], -w.momentum_per_s * body.l_nms - body.A_g_drift[3:])),
            (self._posture_weights, tasks.posture_task(body, self._rest, self._settings.posture)),
            (w.force, tasks.force_task(self._even_n, self._nv)),
        ]
        for name, swing in targets.swings.items():
            frame, gain = body.frame_state(name), w.swing_gain
            p, v, a = swing.position_m, swing.velocity_m_s, swing.acceleration_m_s2
            weighted.append((w.swing, tasks.position_task(frame, p, v, a, gain)))
            turn = tasks.orientation_task(frame, sole.rotation, sole.velocity_rad_s, zero, gain)
            weighted.append((w.swing_turn, turn))
        if self._avoidance is not None:
            self._avoidance.update(body)
            rows, weights = self._avoidance.task_rows()
            if self._driven is not None:  # the body does not flee from joints that come near on their own
                weights = weights * ~np.any(rows.A[:, 6 + self._driven.at] != 0.0, axis=1)
            weighted.append((weights, rows))
        return tasks.stack_weighted(weighted, self._nz)


def recovery_settings() -> Settings:
    """Settings of the rows: the limits of the robot itself, without the margins of a planned motion."""
    return Settings(
        contact=Gain(0.0, 30.0),
        range_share=0.0,
        velocity_share=1.0,
        torque_share=0.98,
        contact_margin_m=0.004,
        avoid=None,
    )
