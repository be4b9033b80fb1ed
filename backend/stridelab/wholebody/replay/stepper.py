"""The replay sample by sample: sensors, stabiliser or recovery, joint control, and the steps of the simulator.

``PhysicsReplay.run`` and a live session advance the same stepper.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Angles
from stridelab.dynamics.spatial import length_of
from stridelab.errors import InvalidInput
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import MotionArrival, WholeBodyMotion
from stridelab.wholebody.recovery.driven_joints import DrivenJoints
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.recovery.recovery import JointCommand, Recovery, RecoveryRun
from stridelab.wholebody.recovery.walking import WalkCommand, WalkRun
from stridelab.wholebody.replay.dcm_feedback import size_share
from stridelab.wholebody.replay.disturbances import Disturbances, Push
from stridelab.wholebody.replay.log import LOADED_N, LeftPlan, Replay, ReplayLog, TorquePeak
from stridelab.wholebody.replay.mujoco_model import build_simulation
from stridelab.wholebody.replay.replay_control import DelayPredictor, ReplayControl, joint_inertias
from stridelab.wholebody.replay.resumption import MAX_RESUMPTIONS, JointBlend, NotResumed, Resume, Resumption
from stridelab.wholebody.replay.sensors import JointReadings, SensedState, SimulatedSensors, StateObserver
from stridelab.wholebody.replay.simulation import Simulation
from stridelab.wholebody.replay.stabiliser import StabiliserRun
from stridelab.wholebody.replay.step_adjustment import ConstantClock

FALL_COM_ERROR_M: Final = 0.25
"""CoM error beyond which a robot counts as fallen, in proportion for small ones (``size_share``)."""
HOLD_S: Final = 1.0
"""Duration of the last posture, to detect falls right after the end of the motion."""


class ReplayStepper:
    """State of one replay; ``advance`` carries out one sample of the motion's rate.

    ``standing`` is False after a fall; ``recovering`` is the recovery that left the plan, if any; ``samples`` counts
    the samples. ``motion`` is the plan's, after a resumption the new one. Raises as ``PhysicsReplay.run``.
    """

    def __init__(
        self,
        physics: ReplayControl,
        robot: Robot,
        sequence: ContactSequence,
        motion: WholeBodyMotion,
        observe: StateObserver,
        disturbances: Disturbances,
    ) -> None:
        self._physics, self._robot, self._sequence, self.motion = physics, robot, sequence, motion
        self._observe, self._disturbances = observe, disturbances
        terrain = disturbances.disturbed_terrain(sequence)
        built = build_simulation(robot, terrain, sequence.friction, sequence.effectors, disturbances)
        self.simulation = Simulation(built, motion.q[0])
        self._pushed: list[tuple[int, Push]] = []
        for push in disturbances.pushes:
            self.add_push(push)
        self._substeps = _substep_count(motion.rate_hz, self.simulation.timestep_s)
        self._kp, self._kd, self._locked_kp, self._locked_kd = physics.gains_with_locked(robot, built)
        self.log, self.torque_peak = ReplayLog(robot, sequence), TorquePeak()
        self.stabilising = None if physics.stabiliser is None else StabiliserRun(physics.stabiliser, robot, motion)
        self._sensors = SimulatedSensors(self.simulation, disturbances, self._substeps)
        self._joints = JointReadings(self.simulation, disturbances.joint_delay_s)
        self._predictor = self._new_predictor(physics.expected_delay_s)
        self._rng = np.random.default_rng(disturbances.seed)
        self._last_sample, self._dt_s = len(motion.time_s) - 1, 1.0 / motion.rate_hz
        self.samples, self._hold_samples = 0, 0
        self._pace = ConstantClock(self._last_sample) if self.stabilising is None else self.stabilising.pace
        self._legs = LegGeometry.of_robot(robot)
        self.standing = True
        self._fall_error_m = size_share(robot) * FALL_COM_ERROR_M
        self.recovering: RecoveryRun | None = None
        self._left: LeftPlan | None = None
        self._resumption: Resumption | None = None
        self._resumptions = 0
        self._blend: JointBlend | None = None
        self._last_nm = np.zeros(len(self._kp))
        self._driven: DrivenJoints | None = None

    @property
    def time_s(self) -> float:
        """Time since the start of the replay."""
        return self.samples / self.motion.rate_hz

    @property
    def sample_index(self) -> int:
        """Index of the followed motion's nearest sample."""
        return self._pace.sample_index

    @property
    def plan_time_s(self) -> float:
        """Time of the plan, whose clock the stabiliser may change."""
        own_s = float(self.motion.time_s[self._pace.sample_index])
        return own_s if self._resumption is None else self._resumption.plan_time_s(own_s)

    @property
    def rests(self) -> bool:
        """Whether a recovery has ended at rest, so that the plan can be resumed."""
        return self.standing and self.recovering is not None and self.recovering.at_rest

    @property
    def has_ended(self) -> bool:
        """Whether a replay ends here: after a fall, at rest after a recovery, or after holding the last posture."""
        return not self.standing or self.rests or self._hold_samples >= round(HOLD_S * self.motion.rate_hz)

    def add_push(self, push: Push) -> None:
        """Add a push. Raises ``InvalidInput`` (``link-not-found``) for a link that the robot lacks."""
        self._pushed.append((self.simulation.built.body_of(push.link), push))

    def drop_ended_pushes(self) -> None:
        """Remove pushes that have ended."""
        self.simulation.apply_forces([(body, np.zeros(3)) for body, _ in self._pushed])
        self._pushed = [(body, push) for body, push in self._pushed if push.end_s > self.time_s]

    def set_delay(self, delay_s: float, expected_delay_s: float = 0.0) -> None:
        """Let stabiliser and joint control read everything ``delay_s`` late from now on, or predict it."""
        self._physics = replace(self._physics, expected_delay_s=expected_delay_s)
        self._predictor = self._new_predictor(expected_delay_s)
        self._disturbances = replace(self._disturbances, delay_s=delay_s, joint_delay_s=delay_s)
        self._sensors = SimulatedSensors(self.simulation, self._disturbances, self._substeps)
        self._joints = JointReadings(self.simulation, delay_s)

    def renew_recovery(self) -> None:
        """Begin the recovery anew on the loaded soles, so that a robot at rest goes on standing."""
        if self._physics.recovery is None or self._legs is None:
            return
        measured = self.measured_state()
        contacts = {name: one for phase in self._sequence.phases for name, one in phase.contacts.items()}
        soles = {name: contacts[name] for name in self._legs.side if name in contacts}
        self.recovering = RecoveryRun(
            self._physics.recovery, self._robot, self._legs, self._sequence, soles, measured, self._dt_s
        )

    def steer(self, command: WalkCommand) -> None:
        """Walk at a commanded velocity from now on; the first command leaves the plan.

        Raises ``InvalidInput`` (``robot-cannot-steer``) for a robot without two soles on legs, or without recovery.
        """
        if not isinstance(self.recovering, WalkRun):
            if self._physics.recovery is None or self._legs is None or self.stabilising is None:
                raise InvalidInput("robot-cannot-steer", "Only a robot that walks on two soles can be steered.")
            measured = self.measured_state()
            self.recovering = WalkRun(*self._recovery_arguments(self._physics.recovery, self._legs, measured))
            self.recovering.leave_joints(self._driven)
        self.recovering.command = command

    def leave_joints(self, driven: DrivenJoints | None) -> None:
        """Leave joints to their own servo from now on, which a steered walk takes into account."""
        self._driven = driven
        if self.recovering is not None:
            self.recovering.leave_joints(driven)

    def measured_state(self) -> SensedState:
        """What the sensors and the state estimator say now."""
        return self._observe(self._sensors.read_state(self.time_s))

    def resume_plan(self, resume: Resume, *, limited: bool = True) -> bool:
        """Go on to where the plan ends, from where the recovery rests; the robot stands still while it plans.

        Returns False where that is not possible; ``LeftPlan.not_resumed`` says why. With ``limited``, at most
        ``MAX_RESUMPTIONS`` times.
        """
        if self.recovering is None or self._left is None or self._physics.stabiliser is None:
            return False
        measured = self.measured_state()
        found: Resumption | NotResumed = NotResumed(f"the plan was resumed {MAX_RESUMPTIONS} times already")
        if not limited or self._resumptions < MAX_RESUMPTIONS:
            found = resume(self.plan_time_s, measured)
        if isinstance(found, NotResumed):
            self._left = replace(self._left, not_resumed=found.reason)
            return False
        motion = found.motion
        self.motion, self._sequence, self._resumption = motion, motion.sequence, found
        self._resumptions += 1
        steps, resumed_s = self._left.steps + self.recovering.steps, self.time_s
        self._left = replace(self._left, steps=steps, rested=True, resumed_s=resumed_s)
        self.stabilising = StabiliserRun(self._physics.stabiliser, self._robot, motion)
        self._predictor = self._new_predictor(self._physics.expected_delay_s)
        self._pace, self._last_sample = self.stabilising.pace, len(motion.time_s) - 1
        self._blend = JointBlend(measured.q[7:] - motion.q[0][7:], self._last_nm - motion.tau_nm[0])
        self.recovering, self._hold_samples = None, 0
        self.log.follow_sequence(motion.sequence)
        return True

    def collapse(self) -> None:
        """Carry out one sample without control: the joints are damped only. Nothing is recorded."""
        still = np.zeros(len(self._kp))
        self._control_joints(still, still, still, JointCommand(still, still, still))
        self.simulation.refresh_derived()
        self.samples += 1

    def advance(self) -> int:
        """Carry out one sample; returns its index in the motion."""
        motion, simulation = self.motion, self.simulation
        if motion.arrival is not None:
            self._receive_motion(motion.arrival)
        i, rate = self._pace.sample_index, self._pace.rate * float(self._pace.sample_index < self._last_sample)
        forward, v_target = motion.tau_nm[i], rate * motion.v[i][6:]
        q_target = motion.q[i][7:] + (self._pace.sample - i) * self._dt_s * motion.v[i][6:]
        if self._blend is not None and self.recovering is None:
            off_rad, v_target, off_nm = self._blend.advance(self._dt_s)
            q_target, forward = q_target + off_rad, forward + off_nm
        command = None
        if self.stabilising is not None:
            measured = self.measured_state()
            if self.recovering is None:
                angles, added = self.stabilising.compute_corrections(measured)
                q_target, forward = q_target + angles, forward + added
                self._leave_plan_if_needed(self.stabilising, measured)
            if self.recovering is not None:
                command = self.recovering.compute_command(measured)
                self._last_nm = command.tau_nm
        self._control_joints(q_target, v_target, forward, command)
        simulation.refresh_derived()
        if self._blend is not None and (self._blend.has_ended or self.recovering is not None):
            self._blend = None
        elif self.recovering is None and self._blend is None:
            self._pace.advance()
        self.samples, self._hold_samples = self.samples + 1, self._hold_samples + int(i == self._last_sample)
        com_m, _ = simulation.com_state()
        error_m = length_of(com_m - motion.com_reference_m[self._pace.sample_index])
        left = self.recovering is not None
        times_s = self.time_s, self.plan_time_s, float(self.motion.time_s[self._pace.sample_index])
        self.log.record_sample(simulation, times_s, com_m, error_m, left)
        self.standing = error_m < self._fall_error_m if self.recovering is None else not self.recovering.has_fallen
        return i

    def to_replay(self, took_s: float) -> Replay:
        """The result of all samples, which took ``took_s``."""
        left = self._left
        if left is not None and self.recovering is not None:
            left = replace(left, steps=left.steps + self.recovering.steps, rested=self.standing)
        elif left is not None:
            left = replace(left, missed_m=self._distance_from_end_m())
        return self.log.to_replay(not self.standing, self.torque_peak, took_s, left)

    def _receive_motion(self, arrival: MotionArrival) -> None:
        """Wait for the part of a motion that the next sample needs."""
        if self.stabilising is None:
            arrival.wait_for_samples(self._pace.sample_index + 2)
        else:
            self.stabilising.receive_motion(arrival)

    def _new_predictor(self, expected_delay_s: float) -> DelayPredictor | None:
        """A predictor without a past; None where no delay is expected."""
        timestep_s = self.simulation.timestep_s
        if round(expected_delay_s / timestep_s) == 0:
            return None
        return DelayPredictor(self._kp, self._kd, joint_inertias(self._robot), expected_delay_s, timestep_s)

    def _distance_from_end_m(self) -> float:
        """Largest distance of an effector from its place at the end of the plan; infinite while it is in the air."""
        last, forces = self._sequence.phases[-1].contacts, self.simulation.forces_n()
        missed_m = np.inf if self._pace.sample_index < self._last_sample else 0.0
        for name, contact in last.items():
            is_loaded = float(np.linalg.norm(forces[name])) > LOADED_N
            away_m = self.simulation.contact_placement(name).position_m - contact.placement.position_m
            missed_m = max(missed_m, float(np.linalg.norm(away_m)) if is_loaded else np.inf)
        return missed_m

    def _recovery_arguments(self, recovery: Recovery, legs: LegGeometry, measured: SensedState) -> Any:
        """Arguments of a recovery that begins now, on the soles that the plan has on the ground."""
        own_s = float(self.motion.time_s[self._pace.sample_index])
        planned = self._sequence.phases[self._sequence.phase_at(own_s + 1e-9)].contacts
        return recovery, self._robot, legs, self._sequence, planned, measured, self._dt_s

    def _leave_plan_if_needed(self, stabilising: StabiliserRun, measured: SensedState) -> None:
        """Begin a recovery if the capture point's error exceeds what the soles can correct."""
        recovery = self._physics.recovery
        if recovery is None or self._legs is None or stabilising.pace.excess_m <= recovery.takeover_m:
            return
        self.recovering = RecoveryRun(*self._recovery_arguments(recovery, self._legs, measured))
        if self._left is None:
            self._left = LeftPlan(measured.time_s, 0, rested=False)

    def _control_joints(
        self, q_target: Angles, v_target: Angles, forward: Angles, command: JointCommand | None
    ) -> None:
        """Joint control and steps of the simulator during one sample."""
        simulation, physics, noise = self.simulation, self._physics, self._disturbances.torque_noise
        damping_share = 0.0 if physics.recovery is None else physics.recovery.damping
        start_s, dt_s = self.time_s, simulation.timestep_s
        for j in range(self._substeps):
            q_command = q_target + j * dt_s * v_target
            q_read, v_read = self._joints.read_joints()
            if self._predictor is None:
                tau = self._kp * (q_command - q_read) + self._kd * (v_target - v_read) + forward
            else:
                tau = forward + self._predictor.feedback_nm(q_command, v_target, q_read, v_read)
            if command is not None:
                v_command = command.v_rad_s + j * dt_s * command.a_rad_s2
                tau = command.tau_nm + damping_share * self._kd * (v_command - v_read)
            if self._driven is not None:
                tau[self._driven.at] = self._driven.torques_nm(q_read, v_read)
            if noise:
                tau = tau * (1.0 + noise * self._rng.normal(size=len(tau)))
            if self._pushed:
                time_s = start_s + j * dt_s
                forces = [(body, push.force_n(time_s)) for body, push in self._pushed]
                simulation.apply_forces(forces, [push.at_joint for _, push in self._pushed])
            locked_tau = simulation.locked_torques_nm(self._locked_kp, self._locked_kd)
            ratio, end_s = simulation.step(tau, locked_tau), start_s + (j + 1) * dt_s
            if ratio > self.torque_peak.ratio:
                self.torque_peak = TorquePeak(ratio, self._robot.joint_names[simulation.strained_joint], end_s)
            self.log.record_step(simulation, end_s)
            self._sensors.after_step(j + 1, end_s)


def _substep_count(rate_hz: float, timestep_s: float) -> int:
    substeps = round(1.0 / (rate_hz * timestep_s))
    if substeps < 1 or not np.isclose(substeps * timestep_s * rate_hz, 1.0):
        raise InvalidInput("replay-rate", f"A motion at {rate_hz:g} Hz does not fit steps of {timestep_s:g} s.")
    return substeps
