"""The whole body at one sample of a recovery: one weighted problem under the equations of motion and all limits.

    exactly    base rows of the equations of motion ;  soles in contact do not accelerate
    weighted   CoM ;  swinging sole ;  upright base ;  angular momentum ;  posture ;  collision avoidance ;  forces
    bounds     those of ``task_stack``

Unlike in the strict hierarchy of a planned motion, a CoM that the soles cannot move as wished yields to nothing else:
with strict levels the body would whirl its arms and trunk for the last newton.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Angles, Rotation, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.control import tasks
from stridelab.wholebody.control.collision_avoidance import CollisionAvoidance
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows, solve_hierarchy
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.task_stack import PhaseHierarchy, Settings
from stridelab.wholebody.control.tasks import Gain


@dataclass(frozen=True)
class BalanceWeights:
    """Weights and gains of the tasks of a recovery."""

    com: float = float(os.environ.get('WC','4'))
    height: float = float(os.environ.get('WH','8'))
    swing: float = float(os.environ.get('WS','4'))
    swing_turn: float = 2.0
    base: float = float(os.environ.get('WB','1.5'))
    momentum: float = 0.05
    force: float = 2e-3
    swing_gain: Gain = field(default_factory=lambda: Gain.critically_damped(900.0))
    base_gain: Gain = field(default_factory=lambda: Gain.critically_damped(80.0))
    height_gain: Gain = field(default_factory=lambda: Gain.critically_damped(60.0))
    momentum_per_s: float = 5.0


@dataclass(frozen=True, eq=False)
class SwingTarget:
    """Target of a swinging sole: placement, velocity, acceleration."""

    placement: Placement
    velocity_m_s: Vector3
    acceleration_m_s2: Vector3


@dataclass(frozen=True, eq=False)
class BalanceTargets:
    """Targets of one sample: horizontal acceleration of the CoM, its height and rate, heading, swinging soles."""

    com_a_m_s2: Float[np.ndarray, "2"]
    height_m: float
    height_rate_m_s: float
    base: Rotation
    swings: Mapping[str, SwingTarget]


class BalanceRows(PhaseHierarchy):
    """Rows of one set of contacts."""

    def __init__(
        self,
        robot: Robot,
        body: RigidBody,
        contacts: Mapping[str, Contact],
        weights: BalanceWeights,
        settings: Settings,
        avoidance: CollisionAvoidance | None,
    ) -> None:
        super().__init__(robot, body, contacts, {}, None, settings, avoidance)  # type: ignore[arg-type]
        self._weights = weights
        self._n_points = {name: len(points) for name, points in self._points.items()}
        self._weight_n = 9.81 * robot.mass_kg

    def solve(self, targets: BalanceTargets) -> tuple[np.ndarray, Angles, bool]:
        """Accelerations, torques, and whether a solution within all limits was found."""
        J = [tasks.force_jacobian(self._body.frame_state(name), points) for name, points in self._points.items()]
        J_f = np.vstack(J) if J else np.zeros((0, self._nv))
        equality, bounds = self._level_0(J_f), self._inequality_rows(J_f)
        level = self._weighted(targets)
        result = solve_hierarchy(equality, [level], bounds)
        met = result.failure is None
        if not met:
            lower, upper = bounds.lower.copy(), bounds.upper.copy()
            lower[self._joint], upper[self._joint] = -1e4, 1e4
            result = solve_hierarchy(equality, [level], Inequalities(bounds.G, lower, upper))
            if result.failure is not None:
                lower[self._torque], upper[self._torque] = -1e5, 1e5
                result = solve_hierarchy(equality, [level], Inequalities(bounds.G, lower, upper))
        self.last_forces = self.forces_n(result.z)
        return result.z[: self._nv], self.torques_nm(result.z), met

    def _weighted(self, t: BalanceTargets) -> Rows:
        body, w, s = self._body, self._weights, self._settings
        com = Rows(body.A_g[:2] / body.mass_kg, t.com_a_m_s2 - body.A_g_drift[:2] / body.mass_kg)
        kp, kd = w.height_gain
        z_a = kp * (t.height_m - body.com_m[2]) + kd * (t.height_rate_m_s - body.com_v_m_s[2])
        height = Rows(body.A_g[2:3] / body.mass_kg, np.array([z_a - body.A_g_drift[2] / body.mass_kg]))
        zero = np.zeros(3)
        weighted: list[tuple[tasks.Weight, Rows]] = [
            (w.com, com),
            (w.height, height),
            (w.base, tasks.orientation_task(body.frame_state("base"), t.base, zero, zero, w.base_gain)),
            (w.momentum, Rows(body.A_g[3:], -w.momentum_per_s * body.l_nms - body.A_g_drift[3:])),
            (self._posture_weights, tasks.posture_task(body, self._rest, s.posture)),
        ]
        for name, swing in t.swings.items():
            frame = body.frame_state(name)
            p = swing.placement
            weighted.append((
                w.swing,
                tasks.position_task(frame, p.position_m, swing.velocity_m_s, swing.acceleration_m_s2, w.swing_gain),
            ))
            weighted.append((w.swing_turn, tasks.orientation_task(frame, p.rotation, zero, zero, w.swing_gain)))
        if self._avoidance is not None:
            rows, weights = self._avoidance.task_rows(body)
            weighted.append((weights, rows))
        n = sum(self._n_points.values())
        even = np.zeros((n, 3))
        even[:, 2] = self._weight_n / max(n, 1)
        weighted.append((w.force, tasks.force_task(even.ravel(), self._nv)))
        return tasks.stack_weighted(weighted, self._nz)


def recovery_settings(settings: Settings | None = None) -> Settings:
    """Settings of the rows: limits of the robot itself, without the margins of a certificate."""
    return replace(
        settings or Settings(),
        contact=Gain(0.0, 30.0),
        range_share=0.0,
        joint_margin_rad=0.005,
        velocity_share=1.0,
        torque_share=0.98,
        contact_margin_m=0.004,
        avoid=None,
    )
