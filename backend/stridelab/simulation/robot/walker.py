"""Simulated walking of a robot: whole-body motion with exact centre of mass, momentum and contact wrench.

1. footsteps, load, zero-moment point                               (``gait_plan``)
2. the soles on swing curves, arm and torso swing                   (``contacts.swing``)
3. the CoM by Kajita's preview control of the zero-moment point     (``centroidal.special_cases.preview_control``)
4. base and legs by second-order inverse kinematics                 (``trajectory_ik``)
5. CoM, momentum and their rates from q, q', q'' (Pinocchio); wrench by Newton and Euler (4.2a), (4.2b)

Steps 3 to 5 are repeated: the error of the zero-moment point, which the cart-table model does not predict (height and
angular momentum), is fed back to the same preview controller (Kajita's dynamic filter).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from numpy.random import Generator
from scipy.interpolate import make_interp_spline

from stridelab.centroidal.special_cases.preview_control import PreviewControl
from stridelab.contacts.effector_geometry import FOOT_CLEARANCE_M, foot_clearance_m
from stridelab.contacts.swing import SwingCurve
from stridelab.conventions import Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.dynamics.wrench import zmp_of_motion
from stridelab.recordings.recording import Side
from stridelab.robots.inverse_kinematics import stand
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.simulation.ground_truth import TrueMotion, motion_truth
from stridelab.simulation.human.body_proportions import SIDES, side_sign
from stridelab.simulation.human.gait_plan import GaitPlan
from stridelab.simulation.human.load_transfer import LoadPlan, Plane
from stridelab.simulation.human.upper_body_motion import stride_clock
from stridelab.simulation.robot.anatomy import RobotAnatomy
from stridelab.simulation.robot.gait_plan import LEAD_S, ArmSwing, RobotGait, plan_load, plan_walk
from stridelab.simulation.robot.trajectory_ik import JointPath, PointPath, RobotMotion, Task, WholeBody

RATE_HZ: Final = 200.0
Column = Float[np.ndarray, "n 1"]
Heights = tuple[Column, Column, Column]
"""Height of the CoM and its two derivatives over time."""
_VERTICAL: Final = 0.9
"""Cosine to the vertical from which an axis counts as one of yaw."""
_PASSES: Final = 6
"""Passes of the dynamic filter; the remaining error is at most 2 mm (robot) and 8 mm (human cadence)."""


@dataclass(frozen=True, eq=False)
class RobotWalk:
    """A motion at ``RATE_HZ``, its plan, its exact mechanics and the ``load`` of the feet.

    It starts ``LEAD_S`` before the first instant (0) of the recording and ends as long after its last.
    """

    robot: Robot
    plan: GaitPlan
    motion: RobotMotion
    truth: TrueMotion
    load: LoadPlan


@lru_cache(maxsize=8)
def simulate_walk(gait: RobotGait, seed: int = 0, robot_name: str = "talos") -> RobotWalk:
    """Simulate a walk. The result is deterministic, cached and shared: do not modify it.

    Raises ``NotEstimable`` (``robot-out-of-reach``) if the legs do not reach the footprints, ``InvalidInput``
    (``robot-not-recordable``).
    """
    rngs = [np.random.default_rng([seed, part]) for part in range(3)]
    robot, plan = load_robot(robot_name), plan_walk(gait, rngs[0])
    time_s = np.arange(round((gait.duration_s + 2 * LEAD_S) * RATE_HZ)) / RATE_HZ - LEAD_S
    load = plan_load(plan, time_s, rngs[1])
    rise_m = foot_clearance_m(gait.com_height_m)
    feet = {side: sole_path(plan, side, time_s, rise_m) for side in SIDES}
    body, control = WholeBody(robot), PreviewControl(height_m=gait.com_height_m, dt_s=1.0 / RATE_HZ)
    upper = swing_arms(robot, body.upper, gait.arms, plan, time_s, rngs[2])
    height = _com_height(gait, plan, time_s)
    start = first_posture(robot, feet, _initial_com(feet, height))
    target_zmp_m = load.zmp_m.copy()
    for _ in range(_PASSES):
        motion = body.solve(time_s, Task.from_paths(feet, _com_path(control, target_zmp_m, height), upper), start)
        truth = motion_truth(body.model, time_s, motion.q, motion.v, motion.a)
        zmp_m = zmp_of_motion(truth.com_m, truth.acceleration_m_s2, truth.momentum_rate_nm, truth.mass_kg)
        target_zmp_m = target_zmp_m + load.zmp_m - zmp_m
    return RobotWalk(robot, plan, motion, truth, load)


def _com_path(control: PreviewControl, zmp_m: Plane, height: Heights) -> PointPath:
    """CoM by preview control, started one horizon early so that its transient decays, with the given height."""
    early = len(control.gains.preview)
    cart = control.follow(np.vstack([np.repeat(zmp_m[:1], early, axis=0), zmp_m]))
    planes = (cart.com_m, cart.velocity_m_s, cart.acceleration_m_s2)
    return PointPath(*(np.column_stack([plane[early:], z]) for plane, z in zip(planes, height, strict=True)))


def sole_path(plan: GaitPlan, side: Side, time_s: Series, rise_m: float = FOOT_CLEARANCE_M) -> PointPath:
    """Path of the middle of one sole: constant in stance, on swing curves in between."""
    stances = [stance for stance in plan.stances if stance.side == side]
    path = [np.zeros((len(time_s), 3)) for _ in range(3)]
    path[0][:] = [stances[0].x_m, stances[0].y_m, 0.0]
    for before, after in pairwise(stances):
        start, end = (Placement.from_wxyz((s.x_m, s.y_m, 0.0)) for s in (before, after))
        curve = SwingCurve(start, end, after.strike_s - before.off_s, "surface", before.off_s, rise_m)
        for k in np.flatnonzero((time_s >= before.off_s) & (time_s < after.strike_s)):
            point = curve.state_at(float(time_s[k]) - before.off_s)
            path[0][k] = point.placement.position_m
            path[1][k], path[2][k] = point.velocity_m_s, point.acceleration_m_s2
        path[0][time_s >= after.strike_s] = [after.x_m, after.y_m, 0.0]
    return PointPath(*path)


def swing_arms(
    robot: Robot, upper: Int[np.ndarray, "k"], arms: ArmSwing, plan: GaitPlan, time_s: Series, rng: Generator
) -> JointPath:
    """Swing of shoulders, elbows and torso as quintic splines; amplitudes vary by 10 % with the seed.

    A shoulder swings about its lateral axis and the reference posture. Without one it is the first of the arm, about
    zero: that of TALOS rotates about the vertical, and with an abducted arm it moves the hand forwards. Amplitudes end
    at the ranges of the joints. ``upper`` are the indices of the prescribed joints in ``v``.
    """
    vary = 1.0 + 0.1 * np.clip(rng.standard_normal(3), -2.0, 2.0)
    clock = stride_clock(plan, time_s)
    forward = -np.cos(clock.phi) * clock.vigour
    anatomy, centre_rad = RobotAnatomy.of_robot(robot), robot.q_reference[7:].copy()
    for side in SIDES:
        chain = anatomy.arm[side]
        if chain and not any(anatomy.is_pitch(joint) for joint in chain[:3]):
            centre_rad[chain[0] - 2] = 0.0
    q = np.tile(centre_rad, (len(time_s), 1))
    for joint, amplitude, share in _swinging_joints(anatomy, arms, vary.tolist()):
        k = joint - 2
        q[:, k] = centre_rad[k] + share * min(amplitude, _room_rad(robot, k, centre_rad[k])) * forward
    spline = make_interp_spline(time_s, q[:, upper - 6], k=5)
    return JointPath(*(np.ascontiguousarray(spline(time_s, nu=order)) for order in range(3)))


def _swinging_joints(
    anatomy: RobotAnatomy, arms: ArmSwing, vary: Sequence[float]
) -> Iterator[tuple[int, float, float]]:
    """Joint, amplitude and signed factor of everything that swings; the arms swing in opposition."""
    model, group = anatomy.robot.model, anatomy.robot.group
    for joint in range(2, model.njoints):
        if group[model.names[joint]] == "torso" and abs(anatomy.joint_axis(joint)[2]) > _VERTICAL:
            yield joint, arms.yaw_rad, vary[0] * float(np.sign(anatomy.joint_axis(joint)[2]))
            break
    for side in SIDES:
        chain, sign = anatomy.arm[side], side_sign(side)
        if chain:
            pitches = [joint for joint in chain[:3] if anatomy.is_pitch(joint)]
            shoulder = pitches[0] if pitches else chain[0]
            yield shoulder, arms.arm_rad, -sign * vary[1] * float(np.sign(anatomy.hand_rate_m(side, shoulder)[0]))
        if len(chain) > 3:
            k = model.joints[chain[3]].idx_q
            bent = float(np.sign(model.lowerPositionLimit[k] + model.upperPositionLimit[k]))
            yield chain[3], arms.elbow_rad, sign * bent * vary[2]


def _room_rad(robot: Robot, k: int, angle_rad: float) -> float:
    """Distance of the actuated joint ``k`` at ``angle_rad`` from the nearer end of its range."""
    low, high = robot.model.lowerPositionLimit[7 + k], robot.model.upperPositionLimit[7 + k]
    return max(0.0, float(min(angle_rad - low, high - angle_rad)))


def _com_height(gait: RobotGait, plan: GaitPlan, time_s: Series) -> Heights:
    """Height of the CoM ``(n, 1)``, lowest in the middle of double support, and its two derivatives."""
    clock = stride_clock(plan, time_s)
    z = gait.com_height_m - gait.bob_m * clock.vigour * np.cos(2.0 * clock.phi_double)
    spline = make_interp_spline(time_s, z[:, None], k=5)
    at, rate, second = (np.ascontiguousarray(spline(time_s, nu=order)) for order in range(3))
    return at, rate, second


def _initial_com(feet: Mapping[Side, PointPath], height: Heights) -> Vector3:
    """Initial CoM above the first footprints."""
    x, y, _ = np.mean([path.position_m[0] for path in feet.values()], axis=0)
    return np.array([x, y, height[0][0, 0]])


def first_posture(robot: Robot, feet: Mapping[Side, PointPath], com_m: Vector3) -> Float[np.ndarray, "nq"]:
    """Posture on the first footprints with the CoM at ``com_m``, the initial guess of the first sample."""
    places = {f"{side}_foot": Placement.from_wxyz(path.position_m[0].tolist()) for side, path in feet.items()}
    return stand(robot, places, com_m).q
