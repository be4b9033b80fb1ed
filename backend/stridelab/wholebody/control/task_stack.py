"""The hierarchy of one contact phase: which rows on which level (section 4.6 of the thesis).

Unknowns ``z = (a, f)``: joint accelerations ``(nv,)`` and one force per contact point, world axes.

    level 0   base rows of  M a + h = S' tau + J' f ;  fixed contacts
    level 1   CoM on the plan ; effectors in the air on their curves
    level 2   angular momentum, upright base, posture, collision avoidance, ankles inside their ranges,
              planned forces, orientation of hands                                               (weighted)
    always    friction pyramids ;  |tau| <= tau_max ;  acceleration bounds from the joint limits

The actuated rows of the equations of motion, apart from those of the base (2.2), give the torques,
``tau = M_a a + h_a - J_a' f``, without unknowns.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.native.availability import NativeSolver, native_availability
from stridelab.centroidal.plan import Reference
from stridelab.contacts.sequence import Contact
from stridelab.contacts.swing import SwingCurve, SwingPoint
from stridelab.conventions import Angles, Points, Rotation, Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control import tasks
from stridelab.wholebody.control.collision_avoidance import AvoidanceSettings, CollisionAvoidance
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.native_rows import NativeRows, SwingTarget
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.swing_detour import (
    CLOSES,
    HAND_CLOSES,
    HAND_OPENS,
    AnkleRelief,
    Offset,
    SwingDetour,
    ankle_columns,
)
from stridelab.wholebody.control.tasks import Gain, force_jacobian, friction_pyramid

FIRM, PROMPT, MIDDLE, GENTLE = (Gain.critically_damped(kp) for kp in (400.0, 200.0, 60.0, 30.0))
STIFF = Gain(1600.0, FIRM.kd)
"""As much damping as ``FIRM``: a hand that still moves when it touches is not stopped by a larger force."""


@dataclass(frozen=True)
class Settings:
    """Gains, weights and margins of the hierarchy (tuned on TALOS, but not specific to a robot).

    ``hand_contact`` is stiffer than ``contact``: a hand that holds a rail turns at up to 2 rad/s about its contact
    point, and the steps of the integration then move the point.
    ``posture_weight`` is per group of joints; arms without contact or swing get ``free_arm`` times the weight.
    ``contact_margin_m`` shrinks the rectangle of a surface, so that the centre of pressure stays inside the real sole.
    ``force_weight`` is that of the planned forces on soles, ``hand_force_weight`` that of those on hands: the angular
    momentum is an error of the whole body's limbs, which soles correct by their centre of pressure. A hand that
    corrects it takes its arm to the limits of its torques, from one sample to the next (docs/theory/whole-body.md).
    ``ankle_acts_rad`` is the distance from the end of an ankle's range at which the rest of the body begins to make
    room for it (``tasks.range_task``).
    ``range_share``, ``joint_margin_rad``, ``velocity_share`` and ``torque_share`` keep the motion inside the limits
    that the certificate checks. ``barrier_per_s`` and ``velocity_rate_per_s`` are the constants of ``joint_limits``.
    """

    contact: Gain = FIRM
    hand_contact: Gain = STIFF
    effector: Gain = FIRM
    com: Gain = PROMPT
    base: Gain = MIDDLE
    posture: Gain = GENTLE
    hand: Gain = GENTLE
    ankle: Gain = MIDDLE
    momentum_per_s: float = 8.0
    momentum_weight: float = 0.05
    base_weight: float = 2.0
    posture_weight: Mapping[str, float] | None = None
    free_arm: float = 4.0
    force_weight: float = 1e-3
    hand_force_weight: float = 1.0
    hand_weight: float = 0.3
    ankle_weight: float = 4.0
    ankle_acts_rad: float = 0.1
    contact_margin_m: float = 0.01
    range_share: float = 0.02
    joint_margin_rad: float = 0.005
    velocity_share: float = 0.94
    torque_share: float = 0.94
    barrier_per_s: float = 25.0
    velocity_rate_per_s: float = 50.0
    acceleration_rad_s2: float = 300.0
    avoid: AvoidanceSettings | None = field(default_factory=AvoidanceSettings)

    def posture_weights(self, robot: Robot, busy: Iterable[str] = ()) -> Angles:
        """Weight of every actuated joint ``(na,)``; ``busy`` are the effectors in contact or swinging."""
        weights = self.posture_weight or {"leg": 0.03, "torso": 0.5, "arm": 0.25, "head": 0.25}
        model = robot.model
        ends = [model.frames[model.getFrameId(robot.effectors[name].frame)].parentJoint for name in busy]
        occupied = {str(model.names[joint]) for end in ends for joint in model.supports[end]}
        free = {joint for joint in robot.joint_names if robot.group[joint] == "arm" and joint not in occupied}
        return np.array(
            [weights[robot.group[joint]] * (self.free_arm if joint in free else 1.0) for joint in robot.joint_names]
        )


@dataclass(frozen=True, eq=False)
class SampleTargets:
    """Targets of one sample: the plan's reference and forces, and the base's orientation with its rates.

    ``forces_n`` are those of all contact points, in the order of ``PhaseHierarchy.stack_forces_n``.
    """

    time_s: float
    reference: Reference
    base: tuple[Rotation, Vector3, Vector3]
    forces_n: Float[np.ndarray, "nf"]


class PhaseHierarchy:
    """Builds the rows of one phase; arrays are allocated once and refilled at every sample.

    ``row_names`` describe the limit of every inequality, as "kind of name".
    """

    def __init__(
        self,
        robot: Robot,
        body: RigidBody,
        contacts: Mapping[str, Contact],
        swings: Mapping[str, SwingCurve],
        settings: Settings,
        avoidance: CollisionAvoidance | None = None,
        rate_hz: float = 250.0,
    ) -> None:
        self._avoidance = avoidance
        self._body, self._contacts, self._swings, self._settings = body, contacts, swings, settings
        self._surface = {name: robot.effectors[name].kind == "surface" for name in (*contacts, *swings)}
        ends = {True: (CLOSES, None), False: (HAND_CLOSES, HAND_OPENS)}
        self._detours = {
            name: SwingDetour(curve, 1.0 / rate_hz, *ends[self._surface[name]]) for name, curve in swings.items()
        }
        if avoidance is not None:
            avoidance.watch_hands(swings)
        self._points = {name: robot.effectors[name].points_m(settings.contact_margin_m) for name in contacts}
        self._limits = JointLimits.of_model(body.model).with_margins(
            settings.range_share, settings.joint_margin_rad, settings.velocity_share, settings.torque_share
        )
        self._reliefs = {name: AnkleRelief.of_sole(robot, name, self._limits) for name in swings if self._surface[name]}
        self._ankles = ankle_columns(robot, (*contacts, *swings))
        self._rest = robot.q_reference[7:]
        self._posture_weights = settings.posture_weights(robot, self._surface)
        nv, na = body.model.nv, body.model.nv - 6
        cones = [friction_pyramid(contact, len(self._points[name])) for name, contact in contacts.items()]
        nf = sum(cone.G.shape[1] for cone in cones)
        n_cone = sum(len(cone.upper) for cone in cones)
        self._nv, self._nz = nv, nv + nf
        self._torque = slice(n_cone, n_cone + na)
        self._joint = slice(n_cone + na, n_cone + 2 * na)
        self._G = np.zeros((n_cone + 2 * na, nv + nf))
        self._lower = np.full(n_cone + 2 * na, -np.inf)
        self._upper = np.zeros(n_cone + 2 * na)
        self._force_weights = np.empty(nf)
        row, column = 0, nv
        for name, cone in zip(contacts, cones, strict=True):
            m, n = cone.G.shape
            weight = settings.force_weight if self._surface[name] else settings.hand_force_weight
            self._force_weights[column - nv : column - nv + n] = weight
            self._G[row : row + m, column : column + n] = cone.G
            self._upper[row : row + m] = cone.upper
            row, column = row + m, column + n
        self._G[self._joint, 6:nv] = np.eye(na)
        self.row_names = (
            *(f"friction of {name}" for name, cone in zip(contacts, cones, strict=True) for _ in cone.upper),
            *(f"torque of {joint}" for joint in robot.joint_names),
            *(f"range or speed of {joint}" for joint in robot.joint_names),
        )

    def build_rows(self, instant: SampleTargets) -> tuple[Rows, list[Rows], Inequalities]:
        """Equality, levels 1 and 2, inequalities at the body's state."""
        body, nv = self._body, self._nv
        if self._avoidance is not None:
            self._avoidance.update(body)
        if self._native_rows is not None:
            avoidance = None if self._avoidance is None else self._avoidance.task_rows()
            swings = [self._native_target(name, curve, instant.time_s) for name, curve in self._swings.items()]
            return self._native_rows.build_rows(instant, swings, instant.forces_n, avoidance)
        J = [force_jacobian(body.frame_state(name), points) for name, points in self._points.items()]
        J_f = np.concatenate(J) if J else np.zeros((0, nv))
        return self._level_0(J_f), [self._level_1(instant), self._level_2(instant)], self._inequality_rows(J_f)

    @cached_property
    def _native_rows(self) -> NativeRows | None:
        """The same rows by the C++ module, where that is available."""
        if not isinstance(native_availability(), NativeSolver):
            return None
        joints = {
            "rest_rad": self._rest,
            "posture_weight": self._posture_weights,
            "force_weight": self._force_weights,
            "ankles": list(self._ankles),
        }
        swings = {name: self._surface[name] for name in self._swings}
        bounds = Inequalities(self._G, self._lower, self._upper)
        return NativeRows(
            self._body,
            self._settings,
            self._contacts,
            self._points,
            swings,
            self._limits,
            joints,
            bounds,
            self._torque.start,
        )

    def torques_nm(self, z: Float[np.ndarray, "nz"]) -> Angles:
        """Actuator torques of a solution; valid after ``rows`` at the same state."""
        return np.asarray(self._G[self._torque] @ z + self._body.h[6:])

    def forces_n(self, z: Float[np.ndarray, "nz"]) -> dict[str, Points]:
        """Forces ``(k, 3)`` per effector in contact."""
        forces: dict[str, Points] = {}
        column = self._nv
        for name, points in self._points.items():
            forces[name] = z[column : column + 3 * len(points)].reshape(-1, 3)
            column += 3 * len(points)
        return forces

    @cached_property
    def hand_rows(self) -> Mapping[str, slice]:
        """The rows of the equality that hold the contact point of each hand in contact."""
        ends = np.cumsum([6, *(6 if self._surface[name] else 3 for name in self._contacts)])
        return {
            name: slice(int(end) - 3, int(end))
            for name, end in zip(self._contacts, ends[1:], strict=True)
            if not self._surface[name]
        }

    def hand_velocities_m_s(self, a: Float[np.ndarray, "nv"], dt_s: float) -> dict[str, Vector3]:
        """Velocities of the hands in contact after ``dt_s`` with the acceleration that they have now."""
        frames = {name: self._body.frame_state(name) for name in self.hand_rows}
        return {name: frame.velocity[:3] + dt_s * (frame.J[:3] @ a + frame.drift[:3]) for name, frame in frames.items()}

    def stack_forces_n(self, forces_n: Mapping[str, Float[np.ndarray, "n k 3"]]) -> Float[np.ndarray, "n nf"]:
        """Forces of ``n`` samples ``(n, k, 3)`` per effector, those of the contacts side by side."""
        n = len(next(iter(forces_n.values()), ()))
        return np.concatenate([np.zeros((n, 0)), *(forces_n[name].reshape(n, -1) for name in self._contacts)], axis=1)

    def stack_unknowns(self, a: Float[np.ndarray, "nv"], forces_n: Mapping[str, Points]) -> Float[np.ndarray, "nz"]:
        """``z`` of an acceleration and of forces; missing effectors get zero force."""
        f = [forces_n[name].ravel() if name in forces_n else np.zeros(3 * len(p)) for name, p in self._points.items()]
        return np.concatenate([a, *f])

    def _level_0(self, J_f: Float[np.ndarray, "nf nv"]) -> Rows:
        body, nv = self._body, self._nv
        gains = {True: self._settings.contact, False: self._settings.hand_contact}
        rows = [
            tasks.contact_task(body.frame_state(name), contact.placement, surface, gains[surface])
            for name, contact in self._contacts.items()
            for surface in (self._surface[name],)
        ]
        A = np.zeros((6 + sum([len(r.b) for r in rows]), self._nz))
        A[:6, :nv] = body.M[:6]
        A[:6, nv:] = -J_f[:, :6].T
        if rows:
            np.concatenate([r.A for r in rows], out=A[6:, :nv])
        return Rows(A, np.concatenate([-body.h[:6], *(r.b for r in rows)]))

    def _level_1(self, instant: SampleTargets) -> Rows:
        body, gain = self._body, self._settings.effector
        rows = [tasks.com_task(body, instant.reference, self._settings.com)]
        for name, curve in self._swings.items():
            target = self._swing_target(name, curve, instant.time_s)
            frame = body.frame_state(name)
            p = target.placement
            rows.append(tasks.position_task(frame, p.position_m, target.velocity_m_s, target.acceleration_m_s2, gain))
            if self._surface[name]:
                w, w_rate = target.angular_velocity_rad_s, target.angular_acceleration_rad_s2
                rows.append(tasks.orientation_task(frame, p.rotation, w, w_rate, gain))
        return tasks.stack_weighted([(1.0, r) for r in rows], self._nz)

    def _swing_target(self, name: str, curve: SwingCurve, time_s: float) -> SwingPoint:
        """The target of an effector on its curve, with its detour."""
        avoidance = self._avoidance
        if avoidance is None:
            return curve.state_at(time_s - curve.starts_s)
        relief = self._reliefs.get(name)

        def push() -> Offset:
            if relief is None:
                return np.append(avoidance.hand_push_m_s2(name), np.zeros(3))
            pushed = relief.push(self._body, name)
            pushed[:3] += avoidance.push_m_s2(name)
            return pushed

        return self._detours[name].next_state(time_s, push)

    def _native_target(self, name: str, curve: SwingCurve, time_s: float) -> SwingTarget:
        """The target of an effector on its curve; the orientation of a hand has no detour."""
        target = self._swing_target(name, curve, time_s)
        turning = target
        if not self._surface[name] and self._detours[name].offset.any():
            turning = curve.state_at(time_s - curve.starts_s)
        moving = target.placement.position_m, target.velocity_m_s, target.acceleration_m_s2
        w, w_rate = turning.angular_velocity_rad_s, turning.angular_acceleration_rad_s2
        return *moving, turning.placement.rotation, w, w_rate

    def _level_2(self, instant: SampleTargets) -> Rows:
        body, s = self._body, self._settings
        weighted: list[tuple[tasks.Weight, Rows]] = [
            (s.momentum_weight, tasks.momentum_task(body, instant.reference, s.momentum_per_s)),
            (s.base_weight, tasks.orientation_task(body.frame_state("base"), *instant.base, s.base)),
            (self._posture_weights, tasks.posture_task(body, self._rest, s.posture)),
        ]
        if self._avoidance is not None:
            rows, weights = self._avoidance.task_rows()
            weighted.append((weights, rows))
        if self._ankles:
            weights, rows = tasks.range_task(body, self._limits, self._ankles, s.ankle, s.ankle_acts_rad)
            weighted.append((s.ankle_weight * weights, rows))
        zero = np.zeros(3)
        for name, contact in self._contacts.items():
            if not self._surface[name]:
                rows = tasks.orientation_task(body.frame_state(name), contact.placement.rotation, zero, zero, s.hand)
                weighted.append((s.hand_weight, rows))
        for name, curve in self._swings.items():
            if not self._surface[name]:
                target = curve.state_at(instant.time_s - curve.starts_s)
                w, w_rate = target.angular_velocity_rad_s, target.angular_acceleration_rad_s2
                rows = tasks.orientation_task(body.frame_state(name), target.placement.rotation, w, w_rate, s.hand)
                weighted.append((s.hand_weight, rows))
        weighted.append((self._force_weights, tasks.force_task(instant.forces_n, self._nv)))
        return tasks.stack_weighted(weighted, self._nz)

    def _inequality_rows(self, J_f: Float[np.ndarray, "nf nv"]) -> Inequalities:
        body, s, nv = self._body, self._settings, self._nv
        self._G[self._torque, :nv] = body.M[6:]
        self._G[self._torque, nv:] = -J_f[:, 6:].T
        self._upper[self._torque] = self._limits.torque_nm - body.h[6:]
        self._lower[self._torque] = -self._limits.torque_nm - body.h[6:]
        self._lower[self._joint], self._upper[self._joint] = self._limits.acceleration_bounds(
            body.q[7:], body.v[6:], s.barrier_per_s, s.velocity_rate_per_s, s.acceleration_rad_s2
        )
        return Inequalities(self._G, self._lower, self._upper)
