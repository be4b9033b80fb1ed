"""Physics replay of a motion: joint position control, feed-forward torques and the stabiliser.

The simulation receives the plan only through the joint commands. Torques are clipped at the robot's limits. The
stabiliser's input comes from ``observe``, by default the sensed state; a caller may pass a state estimator.
"""

import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Progress
from stridelab.errors import InvalidInput
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.recovery.recovery import Recovery, RecoveryRun
from stridelab.wholebody.replay.disturbances import UNDISTURBED, Disturbances
from stridelab.wholebody.replay.log import LeftPlan, Replay, ReplayLog
from stridelab.wholebody.replay.mujoco_model import build_simulation
from stridelab.wholebody.replay.sensors import JointReadings, SimulatedSensors, StateObserver, as_sensed
from stridelab.wholebody.replay.simulation import Simulation
from stridelab.wholebody.replay.stabiliser import Stabiliser, StabiliserRun
from stridelab.wholebody.replay.step_adjustment import ConstantClock

__all__ = ["PhysicsReplay", "Replay", "replay_with_defaults"]

FALL_COM_ERROR_M: Final = 0.25
"""CoM error beyond which the robot counts as fallen."""
HOLD_S: Final = 1.0
"""Duration of the last posture, to detect falls right after the end of the motion."""
PROGRESS_INTERVAL: Final = 100
FULL_SIZE_NM: Final = 776.0
"""Weight times CoM height of TALOS, from which a robot gets the full stiffness."""


@dataclass(frozen=True)
class PhysicsReplay:
    """Joint control of stiffness (N m/rad) and damping (N m s/rad) in legs and torso, ``arm_share`` of it in the arms.

    A rotor inertia of 0.1 kg m^2 and 3000 N m/rad give 28 Hz, well above the motion and well below the 1 kHz steps. For
    robots with ``m g h`` below ``FULL_SIZE_NM`` the stiffness is reduced proportionally. The damping of a joint is
    limited to ``I / dt``, which stops it within one step; ``I`` is its inertia with all other joints free. Beyond twice
    that value the control is unstable. Where the stabiliser cannot undo a push, ``recovery`` leaves the plan and steps;
    it needs a stabiliser.
    """

    stiffness: float = 3000.0
    damping: float = 100.0
    arm_share: float = 0.1
    stabiliser: Stabiliser | None = field(default_factory=Stabiliser)
    recovery: Recovery | None = field(default_factory=Recovery)

    def run(
        self,
        robot: Robot,
        sequence: ContactSequence,
        motion: WholeBodyMotion,
        progress: Progress,
        observe: StateObserver = as_sensed,
        disturbances: Disturbances = UNDISTURBED,
    ) -> Replay:
        """Replay ``motion`` with the given disturbances and hold its last posture.

        Raises ``InvalidInput``: ``replay-rate`` for a rate that the simulator's time step does not divide,
        ``link-not-found`` for a push on a link that the robot lacks.
        """
        terrain = disturbances.disturbed_terrain(sequence)
        built = build_simulation(robot, terrain, sequence.friction, sequence.effectors, disturbances)
        simulation = Simulation(built, motion.q[0])
        pushed = [(built.body_of(push.link), push) for push in disturbances.pushes]
        substeps = _substep_count(motion.rate_hz, simulation.timestep_s)
        kp, kd = self._joint_gains(robot, simulation.timestep_s)
        log, torque_ratio = ReplayLog(robot, sequence), 0.0
        stabilising = None if self.stabiliser is None else StabiliserRun(self.stabiliser, robot, motion)
        sensors = SimulatedSensors(simulation, disturbances, substeps)
        damping_share = 0.0 if self.recovery is None else self.recovery.damping
        joints, rng = JointReadings(simulation, disturbances.joint_delay_s), np.random.default_rng(disturbances.seed)
        last_sample, dt_s, k, hold_samples = len(motion.time_s) - 1, 1.0 / motion.rate_hz, 0, 0
        pace = ConstantClock(last_sample) if stabilising is None else stabilising.pace
        legs = LegGeometry.of_robot(robot)
        started, standing, recovering = time.perf_counter(), True, None
        while standing and hold_samples < round(HOLD_S * motion.rate_hz):
            i, rate = pace.sample_index, pace.rate * float(pace.sample_index < last_sample)
            forward, v_target = motion.tau_nm[i], rate * motion.v[i][6:]
            q_target = motion.q[i][7:] + (pace.sample - i) * dt_s * motion.v[i][6:]
            command = None
            if stabilising is not None:
                measured = observe(sensors.read_state(k / motion.rate_hz))
                if recovering is None:
                    angles, added = stabilising.compute_corrections(measured)
                    q_target, forward = q_target + angles, forward + added
                    if (
                        self.recovery is not None
                        and legs is not None
                        and stabilising.pace.excess_m > self.recovery.takeover_m
                    ):
                        planned = sequence.phases[sequence.phase_at(float(motion.time_s[i]) + 1e-9)].contacts
                        recovering = RecoveryRun(self.recovery, robot, legs, sequence, planned, measured, dt_s)
                if recovering is not None:
                    command = recovering.compute_command(measured)
            for j in range(substeps):
                q_command = q_target + j * simulation.timestep_s * v_target
                q_read, v_read = joints.read_joints()
                tau = kp * (q_command - q_read) + kd * (v_target - v_read) + forward
                if command is not None:
                    v_command = command.v_rad_s + j * simulation.timestep_s * command.a_rad_s2
                    tau = command.tau_nm + damping_share * kd * (v_command - v_read)
                if disturbances.torque_noise:
                    tau = tau * (1.0 + disturbances.torque_noise * rng.normal(size=len(tau)))
                if pushed:
                    time_s = k / motion.rate_hz + j * simulation.timestep_s
                    simulation.apply_forces([(body, push.force_n(time_s)) for body, push in pushed])
                locked_tau = simulation.locked_torques_nm(
                    self.arm_share * self.stiffness, self.arm_share * self.damping
                )
                torque_ratio = max(torque_ratio, simulation.step(tau, locked_tau))
                log.record_step(simulation, k / motion.rate_hz + (j + 1) * simulation.timestep_s)
                sensors.after_step(j + 1, k / motion.rate_hz + (j + 1) * simulation.timestep_s)
            simulation.refresh_derived()
            if recovering is None:
                pace.advance()
            k, hold_samples = k + 1, hold_samples + int(i == last_sample)
            com_m, _ = simulation.com_state()
            error_m = float(np.linalg.norm(com_m - motion.com_reference_m[pace.sample_index]))
            log.record_sample(
                simulation,
                k / motion.rate_hz,
                float(motion.time_s[pace.sample_index]),
                com_m,
                error_m,
                recovering is not None,
            )
            standing = error_m < FALL_COM_ERROR_M if recovering is None else not recovering.has_fallen
            if recovering is not None and recovering.at_rest:
                break
            if i % PROGRESS_INTERVAL == 0:
                progress(i / (last_sample + 1), f"replay: {motion.time_s[i]:.1f} of {motion.time_s[-1]:.1f} s")
        left = None if recovering is None else LeftPlan(recovering.left_plan_s, recovering.steps, standing)
        return log.to_replay(not standing, torque_ratio, time.perf_counter() - started, left)

    def _joint_gains(self, robot: Robot, timestep_s: float) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        joints, data = robot.joint_names, robot.model.createData()
        share = np.array([self.arm_share if robot.group[joint] in ("arm", "head") else 1.0 for joint in joints])
        ankles = {joint for effector in robot.effectors.values() for joint in effector.ankle or ()}
        ankle_share = self.stabiliser.ankle_stiffness if self.stabiliser is not None else 1.0
        ankle = np.array([ankle_share if joint in ankles else 1.0 for joint in joints])
        height_m = pin.centerOfMass(robot.model, data, robot.q_reference)[2]  # the soles are on z = 0
        size = min(1.0, robot.mass_kg * GRAVITY_M_S2 * height_m / FULL_SIZE_NM)
        pin.crba(robot.model, data, robot.q_reference)
        M = np.triu(data.M) + np.triu(data.M, 1).T
        inertia = 1.0 / np.diag(np.linalg.inv(M))[6:]
        kp = self.stiffness * size * share * ankle
        return kp, np.minimum(self.damping * size * share * np.sqrt(ankle), inertia / timestep_s)


def replay_with_defaults(
    robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, progress: Progress
) -> Replay:
    """``PhysicsReplay`` with its defaults."""
    return PhysicsReplay().run(robot, sequence, motion, progress)


def _substep_count(rate_hz: float, timestep_s: float) -> int:
    substeps = round(1.0 / (rate_hz * timestep_s))
    if substeps < 1 or not np.isclose(substeps * timestep_s * rate_hz, 1.0):
        raise InvalidInput("replay-rate", f"A motion at {rate_hz:g} Hz does not fit steps of {timestep_s:g} s.")
    return substeps
