"""From the centroidal plan to joint motion and torques by a task hierarchy at every sample (section 4.6).

The body starts at rest on the contacts of the first phase, with its CoM at the start of the plan. At every sample the
hierarchy gives accelerations and forces, which are constant until the next one:

    q <- q (+) (v dt + a dt^2 / 2) ,     v <- v + a dt .

A hand that touches stays where it has touched. Its arm is free to turn about the contact point, and the next sample
gets what the velocity of the point has missed, ``x'* - x'`` with ``x'* = x' + dt (J a + dJ v)`` of the sample before.

A sample without a solution reuses the acceleration and forces of the previous sample and is counted in ``failures``
(the certificate allows none); its effect on the dynamics shows in the certificate's residual. After
``failures_in_a_row`` or ``failures_in_all`` of them, or when the body diverges from the plan, the run ends with an
error.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.sequence_swings import swing_of
from stridelab.contacts.swing import SwingCurve
from stridelab.conventions import Points, Progress, Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.robots.inverse_kinematics import stand
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_avoidance import CollisionAvoidance
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows, minimum_violations, solve_hierarchy
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.control.task_stack import PhaseHierarchy, SampleTargets, Settings
from stridelab.wholebody.control.tasks import Heading
from stridelab.wholebody.motion import LEVELS, MotionWatcher, SolverFailure, WholeBodyMotion, WholeBodyStopped

_CENTROIDAL = ("com_m", "com_v_m_s", "l_nms", "com_reference_m", "com_v_reference_m_s", "l_reference_nms")
_MAX_SPEED_RAD_S = 30.0
_MAX_COM_ERROR_M = 0.3
_VELOCITY_DAMPING = 1e-9
Allocate = Callable[[tuple[int, ...]], Float[np.ndarray, "..."]]
"""Makes an array of zeros of a shape."""
_REPORT_SAMPLES = 25
"""Progress and new samples are reported after this many samples."""


@dataclass(frozen=True)
class WholeBodyController:
    """Whole-body controller: settings; ``run`` may be called repeatedly."""

    rate_hz: float = 250.0
    settings: Settings = field(default_factory=Settings)
    failures_in_a_row: int = 5
    failures_in_all: int = 20

    def run(
        self,
        robot: Robot,
        sequence: ContactSequence,
        plan: CentroidalPlan,
        progress: Progress | None = None,
        watch: MotionWatcher | None = None,
        begin: Callable[[WholeBodyMotion], None] | None = None,
        allocate: Allocate = np.zeros,
    ) -> WholeBodyMotion:
        """Follow ``plan`` over ``sequence``; deterministic. ``watch`` receives the samples as they are solved.

        ``begin`` receives the motion before its first sample; its arrays, which ``allocate`` has made, are filled then.

        Raises ``InvalidInput`` (``sample-time``) if the sequence is shorter than a sample, ``NotEstimable``
        (``stance-unreachable``) if no posture stands on the first contacts, and ``WholeBodyStopped`` with time, phase,
        the violated level, the exhausted limits and the motion until then.
        """
        started = time.process_time()
        run = ControllerRun(self, robot, sequence, plan, allocate)
        n = len(run.times)
        if begin is not None:
            begin(run.recorded_motion(0.0))
        for i in range(n):
            run.run_sample(i)
            if progress is not None and i % _REPORT_SAMPLES == 0:
                progress(i / n, f"whole body at {run.times[i]:.1f} s of {sequence.duration_s:.1f} s")
            if watch is not None and (i % _REPORT_SAMPLES == 0 or i == n - 1):
                watch(*run.samples_until(i + 1))
        return run.recorded_motion(time.process_time() - started)


class _Solution(NamedTuple):
    a: np.ndarray
    forces_n: dict[str, Points]


class ControllerRun:
    """State of one run, sample by sample; ``times`` (s) are those of the samples.

    ``span`` are the first and the last phase that are followed, by default all. A run that begins later than the first
    phase starts from a posture on the contacts there, at the speed of the plan. Raises ``InvalidInput``
    (``sample-time``) if they are shorter than one sample. ``avoidance``, if given, is one of this robot, terrain and
    settings whose last run is over (``begin_run``).
    """

    def __init__(
        self,
        controller: WholeBodyController,
        robot: Robot,
        sequence: ContactSequence,
        plan: CentroidalPlan,
        allocate: Allocate = np.zeros,
        span: tuple[int, int] | None = None,
        avoidance: CollisionAvoidance | None = None,
    ) -> None:
        self._controller, self._robot, self._sequence = controller, robot, sequence
        first, last = (0, len(sequence.phases) - 1) if span is None else span
        starts_s, ends_s = float(sequence.starts_s[first]), float(sequence.ends_s[last])
        n = round((ends_s - starts_s) * controller.rate_hz) + 1
        if n < 2:
            raise InvalidInput(
                "sample-time", f"{ends_s - starts_s} s are shorter than one sample at {controller.rate_hz} Hz"
            )
        self.times = starts_s + np.arange(n) / controller.rate_hz
        self._body = RigidBody(robot)
        self._phases = sequence.phases_at(self.times + 1e-9)
        self._bases = Heading.of_sequence(sequence).orientations_at(self._phases, self.times)
        avoid = controller.settings.avoid
        if avoidance is None and avoid is not None:
            avoidance = CollisionAvoidance(robot, sequence.terrain, avoid)
        self._avoidance = avoidance
        self._q, self._v = _initial_posture(robot, sequence, plan, controller.settings, first), np.zeros(robot.model.nv)
        if first > 0:
            self._v = self._initial_velocity(first, plan.reference_at(starts_s).com_v_m_s)
        self._phase = -1
        self._in_a_row = 0
        self._failures: list[SolverFailure] = []
        self._exhausted: list[str] = []
        self._level = 0
        nv = robot.model.nv
        margin = controller.settings.contact_margin_m
        self._points = {name: robot.effectors[name].points_m(margin) for name in sequence.effectors}
        self._last = _Solution(np.zeros(nv), {})
        widths = {"q": robot.model.nq, "v": nv, "a": nv, "tau_nm": nv - 6, **dict.fromkeys(_CENTROIDAL, 3)}
        self._record = {name: allocate((n, width)) for name, width in widths.items()}
        self._forces = {name: allocate((n, len(points), 3)) for name, points in self._points.items()}
        self._references, self._planned_n = plan.references_at(self.times), plan.forces_over(self.times)
        self._record["com_reference_m"][:], self._record["l_reference_nms"][:] = (
            self._references.com_m,
            self._references.l_nms,
        )
        self._record["com_v_reference_m_s"][:] = self._references.com_v_m_s
        self._reported = 0
        self._hands_v_m_s: dict[str, Vector3] = {}
        self._touched_m: dict[str, Vector3] = {}

    def run_sample(self, i: int) -> None:
        """Solve sample ``i``, store it, integrate to the next one."""
        t, body = float(self.times[i]), self._body
        body.update(self._q, self._v)
        phase = int(self._phases[i])
        if phase != self._phase:
            self._enter_phase(phase, t)
        reference, (R, w, w_rate) = self._references[i], self._bases
        self._check_divergence(i, reference.com_m)
        targets = SampleTargets(t, reference, (R[i], w[i], w_rate[i]), self._phase_forces_n[i])
        rows = self._programme.build_rows(targets)
        self._compensate_integration(rows[0])
        result = solve_hierarchy(*rows)
        if result.failure is None:
            z = result.z
            self._in_a_row = 0
            self._last = _Solution(z[: body.model.nv], self._programme.forces_n(z))
        else:
            self._in_a_row += 1
            if self._in_a_row == 1:
                self._exhausted = self._exhausted_limits(rows[0], rows[2])
                # the bounds are the same on all levels: a failure on level 1 means that level 0 violates them
                self._level = result.failure.level if result.failure.level > 1 else 0
            self._failures.append(SolverFailure(t, phase, result.failure.level, result.failure.reason))
            if self._in_a_row > self._controller.failures_in_a_row:
                raise self._stop_error(
                    i, f"{self._in_a_row} samples in a row had no solution", self._level, self._exhausted
                )
            if len(self._failures) > self._controller.failures_in_all:
                raise self._stop_error(
                    i, f"{len(self._failures)} samples had no solution", self._level, self._exhausted
                )
            z = self._programme.stack_unknowns(self._last.a, self._last.forces_n)
        self._store_sample(i, z)
        dt = 1.0 / self._controller.rate_hz
        a = self._last.a
        self._hands_v_m_s = self._programme.hand_velocities_m_s(a, dt)
        self._q = pin.integrate(body.model, self._q, dt * self._v + 0.5 * dt**2 * a)
        self._v = self._v + dt * a

    def _compensate_integration(self, level_0: Rows) -> None:
        """Add to the accelerations of held hands what the integration of the last sample missed."""
        for name, rows in self._programme.hand_rows.items():
            if name in self._hands_v_m_s:
                missed_m_s = self._hands_v_m_s[name] - self._body.frame_state(name).velocity[:3]
                level_0.b[rows] += missed_m_s * self._controller.rate_hz

    def samples_until(self, n: int) -> tuple[Series, Float[np.ndarray, "k nq"]]:
        """Times and postures of the first ``n`` samples, without those that an earlier call has returned."""
        new, self._reported = slice(self._reported, n), n
        return self.times[new], self._record["q"][new]

    def recorded_motion(self, solve_time_s: float, n: int | None = None) -> WholeBodyMotion:
        """The recorded motion, or its first ``n`` samples."""
        return WholeBodyMotion(
            sequence=self._sequence,
            rate_hz=self._controller.rate_hz,
            time_s=self.times[:n],
            forces_n={name: forces[:n] for name, forces in self._forces.items()},
            points_m=self._points,
            failures=tuple(self._failures),
            solve_time_s=solve_time_s,
            arrival=None,
            **{name: values[:n] for name, values in self._record.items()},
        )

    def _initial_velocity(self, phase: int, com_v_m_s: Vector3) -> Float[np.ndarray, "nv"]:
        """Smallest joint velocities with contacts at rest, the CoM and swinging effectors at the speed of the plan."""
        body, sequence = self._body, self._sequence
        body.update(self._q, self._v)
        rows, speeds = [pin.jacobianCenterOfMass(body.model, body.data, self._q)], [com_v_m_s]
        for name in sequence.effectors:
            is_held = name in sequence.phases[phase].contacts
            curve = None if is_held else self._swing_curve(name, phase, self.times[0])
            if not is_held and curve is None:
                continue
            size = 6 if self._robot.effectors[name].kind == "surface" else 3
            swing = None if curve is None else curve.state_at(self.times[0] - curve.starts_s)
            twist = np.zeros(6) if swing is None else np.r_[swing.velocity_m_s, swing.angular_velocity_rad_s]
            rows.append(body.frame_state(name).J[:size])
            speeds.append(twist[:size])
        rows.append(body.frame_state("base").J[3:])
        speeds.append(self._bases[1][0])
        J = np.vstack(rows)
        return np.asarray(J.T @ np.linalg.solve(J @ J.T + _VELOCITY_DAMPING * np.eye(len(J)), np.concatenate(speeds)))

    def _enter_phase(self, phase: int, t: float) -> None:
        """Set up the hierarchy of the phase that begins; hands stay where they have touched."""
        contacts = self._sequence.phases[phase].contacts
        self._touched_m = {
            name: self._touched_m.get(name, self._body.frame_state(name).position_m)
            for name, contact in contacts.items()
            if contact.kind == "point"
        }
        swings = {
            name: curve
            for name in self._sequence.effectors
            if name not in contacts and (curve := self._swing_curve(name, phase, t)) is not None
        }
        settings = self._controller.settings
        held = {
            name: replace(contact, placement=replace(contact.placement, position_m=self._touched_m[name]))
            if name in self._touched_m
            else contact
            for name, contact in contacts.items()
        }
        self._programme = PhaseHierarchy(
            self._robot, self._body, held, swings, settings, self._avoidance, self._controller.rate_hz
        )
        self._phase_forces_n = self._programme.stack_forces_n(self._planned_n)
        self._phase = phase

    def _swing_curve(self, name: str, phase: int, t: float) -> SwingCurve | None:
        """Swing curve of an effector in the air; None if only its posture is controlled.

        An effector without a previous contact moves to its first contact during the phase before it, from its current
        placement.
        """
        landing = self._sequence.next_contact(name, phase)
        if landing is None:
            return None
        if self._sequence.last_contact(name, phase) is not None:
            return swing_of(self._sequence, name, phase)
        if name not in self._sequence.phases[phase + 1].contacts:
            return None
        frame = self._body.frame_state(name)
        duration_s = float(self._sequence.ends_s[phase]) - t
        kind = self._robot.effectors[name].kind
        start, rise_m = Placement(frame.position_m, frame.rotation), self._sequence.foot_clearance_m
        return SwingCurve(start, landing.placement, duration_s, kind, t, rise_m)

    def _store_sample(self, i: int, z: np.ndarray) -> None:
        body, record = self._body, self._record
        record["q"][i], record["v"][i], record["a"][i] = self._q, self._v, self._last.a
        record["tau_nm"][i] = self._programme.torques_nm(z)
        record["com_m"][i], record["com_v_m_s"][i], record["l_nms"][i] = body.com_m, body.com_v_m_s, body.l_nms
        for name, forces_n in self._programme.forces_n(z).items():
            self._forces[name][i] = forces_n

    def _check_divergence(self, i: int, com_reference_m: Vector3) -> None:
        """Stop the run if the state has diverged from the plan."""
        v = self._v
        is_slow = v.dot(v) <= _MAX_SPEED_RAD_S**2  # of all joints together; false for NaN, as below
        if not is_slow and not (np.abs(v[6:]).max() <= _MAX_SPEED_RAD_S and np.isfinite(v[:6]).all()):
            speed = np.abs(v[6:])
            joint = self._robot.joint_names[int(np.argmax(np.nan_to_num(speed, nan=np.inf)))]
            raise self._stop_error(i, f"{joint} moves at more than {_MAX_SPEED_RAD_S:g} rad/s", 0, [joint])
        away_m = math.dist(self._body.com_m.tolist(), com_reference_m.tolist())
        if away_m > _MAX_COM_ERROR_M:
            raise self._stop_error(i, f"the centre of mass is {away_m:.2f} m away from the plan", 1, ["centre of mass"])

    def _exhausted_limits(self, equality: Rows, bounds: Inequalities) -> list[str]:
        """Names of the exhausted limits: of one kind, if relaxing it is sufficient, otherwise of all kinds."""
        names = np.array(self._programme.row_names)
        kinds = np.array([name.partition(" of ")[0] for name in names])
        choices = [kinds == kind for kind in ("torque", "friction", "range or speed")]
        for soft in (*choices, np.ones(len(names), dtype=bool)):
            violation = minimum_violations(equality, bounds, soft)
            if violation is not None and violation.max() > 0.0:
                order = [k for k in np.argsort(-violation) if violation[k] > 0.1 * violation.max()]
                return list(dict.fromkeys(str(names[k]) for k in order))[:4]
        return ["no single limit"]

    def _stop_error(self, i: int, reason: str, level: int, exhausted: list[str]) -> WholeBodyStopped:
        t = float(self.times[i])
        phase = int(self._phases[i])
        message = (
            f"The whole body cannot follow the plan beyond {t:.2f} s (phase {phase}): {reason}; the first level "
            "that is "
            f"violated is {level} ({LEVELS[level]}); exhausted limits: {', '.join(exhausted)}."
        )
        faults = [Fault(f"phases[{phase}]", f"at {t:.2f} s: {name}") for name in exhausted]
        if i == 0:
            self._record["q"][0] = self._q  # the start posture is the only sample of the motion
        return WholeBodyStopped(message, faults, self.recorded_motion(0.0, max(i, 1)), phase, level, exhausted)


def _initial_posture(
    robot: Robot, sequence: ContactSequence, plan: CentroidalPlan, settings: Settings, phase: int = 0
) -> np.ndarray:
    """Posture on the contacts at the start of ``phase``, with the CoM of the plan; swings are on their curves."""
    placements = {name: contact.placement for name, contact in sequence.phases[phase].contacts.items()}
    starts_s = float(sequence.starts_s[phase])
    for name in sequence.effectors if phase > 0 else ():
        if name not in placements and sequence.last_contact(name, phase) and sequence.next_contact(name, phase):
            curve = swing_of(sequence, name, phase)
            points, rotations = curve.poses_at(np.array([(starts_s - curve.starts_s) / curve.duration_s]))
            placements[name] = Placement(points[0], rotations[0])
    margins_rad = JointLimits.of_model(robot.model).margins_rad(settings.range_share, settings.joint_margin_rad)
    com_m = plan.reference_at(starts_s).com_m
    posture = stand(robot, placements, com_m, margins_rad=margins_rad, is_quick=phase > 0)
    if not posture.converged:
        where = "the first contacts" if phase == 0 else f"the contacts of phase {phase}"
        miss = f"{posture.worst} misses by {posture.error_m:.3f} m"
        message = f"No posture of {robot.title} stands on {where}: {miss}."
        raise NotEstimable(
            "stance-unreachable", message, [Fault(f"phases[{phase}].contacts[{posture.worst}]", message)]
        )
    return posture.q
