"""The tour of a public benchmark of G1 walking policies, for a controller of ours in MuJoCo on the processor.

Course, random streams and rules are those that the text of ``rhoyn/teleop-walking-benchmark`` states (MIT licence; see
NOTICE and docs/theory/steered-walking.md, which also says what differs); the code is ours. From the release on there
are 18 waypoints of 5 s each. A waypoint is a place in a disc and a heading, relative to the released robot. 0.1 s after
its start a punch of 0.08 s hits a random joint in a random direction. Meanwhile a servo moves the arms at random.

A run id and the number of a stream seed the Mersenne twister through the seed sequence of the C++ standard
([rand.util.seedseq]), so that a run id draws the same numbers there and here:

    x in [0, 1)   the upper 24 bits of a word over 2^24
    i below n     a word over floor(2^32 / n); drawn again from n floor(2^32 / n) on
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, UInt32

from stridelab.robots.robot import Robot
from stridelab.wholebody.recovery.driven_joints import DrivenJoints
from stridelab.wholebody.replay.disturbances import Push

WAYPOINTS: Final = 18
SEGMENT_S: Final = 5.0
PERIOD_S: Final = 0.02
"""Of commands and arms."""
CENTRE_M, RADIUS_M = (0.3, 0.0), 0.75
MOST_N: Final = 500.0
RAMP_FROM, RAMP_S = 1.0 / 3.0, 60.0
PUNCH_AT_S, PUNCH_S = 0.1, 0.08
LOW_PELVIS_M: Final = 0.20
GAIN_PER_S: Final = 1.5
"""Commanded velocity per distance from the waypoint, and per angle from its heading."""
NEAR_M, AWAY_M, FACED_RAD, TURNED_RAD = 0.10, 0.20, 0.05, 0.12
"""Where a waypoint counts as reached, and where no longer."""
ARM_STEP_RAD, ARM_S, ARM_DRAWS = 0.06, 0.5, 8
ARM_PARTS: Final = (
    "shoulder_pitch",
    "shoulder_roll",
    "shoulder_yaw",
    "elbow",
    "wrist_roll",
    "wrist_pitch",
    "wrist_yaw",
)
ARM_START_RAD: Final = np.array([0.2, 0.2, 0.0, 0.6, 0.0, 0.0, 0.0])
MIRROR: Final = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
ARM_ROTORS_KG_M2: Final = np.array([*[0.003609725] * 5, 0.00425, 0.00425])
ARM_RATE_PER_S, ARM_DAMPING_RATIO = 20.0 * math.pi, 2.0
_TOUR, _PUNCHES, _ARMS = 2, 3, 4


class Waypoint(NamedTuple):
    """A place (m) and a heading (rad) in the axes of the released robot."""

    x_m: float
    y_m: float
    yaw_rad: float


class Stream:
    """Random numbers of one run and purpose."""

    def __init__(self, run_id: int, purpose: int) -> None:
        self._words = np.random.MT19937()
        key = seed_words((run_id, purpose), 624)
        self._words.state = {"bit_generator": "MT19937", "state": {"key": key, "pos": 624}}

    def between(self, low: float, high: float, n: int | None = None) -> Float[np.ndarray, "..."]:
        """Uniform numbers."""
        unit = (np.asarray(self._words.random_raw(n), dtype=np.uint64) >> np.uint64(8)).astype(float) / 2.0**24
        return np.asarray(low + (high - low) * unit)

    def below(self, bound: int) -> int:
        """A uniform integer below ``bound``."""
        span = 2**32 // bound
        while (word := int(self._words.random_raw())) >= span * bound:
            pass
        return word // span


def seed_words(values: tuple[int, ...], n: int) -> UInt32[np.ndarray, "n"]:
    """The first ``n`` words, at least 623, that the standard's seed sequence of ``values`` generates."""
    s, t = len(values), 11
    p = (n - t) // 2
    q, m, b = p + t, max(s + 1, n), [0x8B8B8B8B] * n
    for k in range(m):
        x = b[k % n] ^ b[(k + p) % n] ^ b[(k - 1) % n]
        first = 1664525 * (x ^ (x >> 27)) & 0xFFFFFFFF
        second = first + (s if k == 0 else k % n + (values[k - 1] if k <= s else 0)) & 0xFFFFFFFF
        b[(k + p) % n] = b[(k + p) % n] + first & 0xFFFFFFFF
        b[(k + q) % n] = b[(k + q) % n] + second & 0xFFFFFFFF
        b[k % n] = second
    for k in range(m, m + n):
        x = b[k % n] + b[(k + p) % n] + b[(k - 1) % n] & 0xFFFFFFFF
        third = 1566083941 * (x ^ (x >> 27)) & 0xFFFFFFFF
        fourth = third - k % n & 0xFFFFFFFF
        b[(k + p) % n] ^= third
        b[(k + q) % n] ^= fourth
        b[k % n] = fourth
    return np.array(b, dtype=np.uint32)


def draw_waypoints(run_id: int) -> list[Waypoint]:
    """The waypoints of a run."""
    draws, waypoints = Stream(run_id, _TOUR), []
    for _ in range(WAYPOINTS):
        radius_m = RADIUS_M * math.sqrt(draws.between(0.0, 1.0))
        bearing, yaw = (float(draws.between(0.0, math.tau)) for _ in range(2))
        x, y = CENTRE_M[0] + radius_m * math.cos(bearing), CENTRE_M[1] + radius_m * math.sin(bearing)
        waypoints.append(Waypoint(x, y, math.remainder(yaw, math.tau)))
    return waypoints


def draw_punches(run_id: int, robot: Robot) -> list[Push]:
    """The punches of a run, one per waypoint, with times from the release on; each hits the joint of its link."""
    draws, punches = Stream(run_id, _PUNCHES), []
    for k in range(WAYPOINTS):
        joint = robot.joint_names[draws.below(len(robot.joint_names))]
        up, bearing = float(draws.between(-1.0, 1.0)), float(draws.between(0.0, math.tau))
        level = math.sqrt(max(0.0, 1.0 - up * up))
        ceiling_n = MOST_N * (RAMP_FROM + (1.0 - RAMP_FROM) * min(k * SEGMENT_S / RAMP_S, 1.0))
        size_ns = ceiling_n * float(draws.between(0.5, 1.0)) * PUNCH_S
        x, y, z = size_ns * level * math.cos(bearing), size_ns * level * math.sin(bearing), size_ns * up
        punches.append(Push(PUNCH_AT_S + k * SEGMENT_S, (x, y, z), PUNCH_S, moved_link(robot, joint), at_joint=True))
    return punches


def moved_link(robot: Robot, joint: str) -> str:
    """The first link that a joint moves."""
    index = robot.model.getJointId(joint)
    return str(next(f.name for f in robot.model.frames if f.parentJoint == index and f.type == pin.FrameType.BODY))


class ArmWalk:
    """The arms: every half second a new posture within 25 random changes, approached at a constant rate.

    The right arm mirrors the left one. A drawn posture is refused if a hand would be behind the hands' place at the
    start or above the lowest point of the head; after eight refusals the arms stay.
    """

    def __init__(self, run_id: int, robot: Robot) -> None:
        self._draws, self._robot, self._data = Stream(run_id, _ARMS), robot, robot.model.createData()
        names = [f"{side}_{part}_joint" for side in ("left", "right") for part in ARM_PARTS]
        kp = np.tile(ARM_ROTORS_KG_M2, 2) * ARM_RATE_PER_S**2
        self.servo = DrivenJoints(
            robot, names, kp, 2.0 * ARM_DAMPING_RATIO * kp / ARM_RATE_PER_S, both_arms(ARM_START_RAD)
        )
        at = self.servo.at[: len(ARM_PARTS)]
        model = robot.model
        self._low_rad, self._high_rad = model.lowerPositionLimit[7:][at], model.upperPositionLimit[7:][at]
        self._hands = [
            (model.getFrameId(f"{side}_wrist_yaw_link"), mesh_corners_m(robot, f"{side}_rubber_hand"))
            for side in ("left", "right")
        ]
        self._torso = model.getFrameId("torso_link")
        self._front_m = min(corners[:, 0].min() for corners in self._hands_m(ARM_START_RAD))
        self._head_m = lowest_of_head_m(robot)
        self._from_rad = self._to_rad = self._now_rad = ARM_START_RAD
        self._window = -1

    def advance(self, elapsed_s: float) -> None:
        """Move the servo's target to where it is ``elapsed_s`` after the release."""
        window = int(elapsed_s / ARM_S + 1e-9)
        if window != self._window:
            self._window, self._from_rad = window, self._now_rad
            self._to_rad = self._drawn_posture()
        share = min(max((elapsed_s - window * ARM_S + PERIOD_S) / ARM_S, 0.0), 1.0)
        self._now_rad = self._from_rad + share * (self._to_rad - self._from_rad)
        self.servo.target_rad = both_arms(self._now_rad)

    def _drawn_posture(self) -> Float[np.ndarray, "7"]:
        for _ in range(ARM_DRAWS):
            posture = self._from_rad
            changes = ARM_STEP_RAD * self._draws.between(-1.0, 1.0, round(ARM_S / PERIOD_S) * len(ARM_PARTS))
            for change in changes.reshape(-1, len(ARM_PARTS)):
                posture = np.clip(posture + change, self._low_rad, self._high_rad)
            hands_m = np.vstack(self._hands_m(posture))
            if hands_m[:, 0].min() >= self._front_m and hands_m[:, 2].max() <= self._head_m:
                return posture
        return self._from_rad

    def _hands_m(self, left_rad: Float[np.ndarray, "7"]) -> list[Float[np.ndarray, "8 3"]]:
        """Corners of the hands' boxes in the axes of the torso."""
        q = self._robot.q_reference.copy()
        q[7 + self.servo.at] = both_arms(left_rad)
        pin.framesForwardKinematics(self._robot.model, self._data, q)
        torso = self._data.oMf[self._torso].inverse()
        return [np.array([(torso * self._data.oMf[wrist]).act(p) for p in corners]) for wrist, corners in self._hands]


def both_arms(left_rad: Float[np.ndarray, "7"]) -> Float[np.ndarray, "14"]:
    """Angles of the left arm and of the right one, which mirrors it."""
    return np.concatenate([left_rad, MIRROR * left_rad])


def mesh_corners_m(robot: Robot, link: str) -> Float[np.ndarray, "8 3"]:
    """Corners of the box around a link's mesh, in the mesh's own axes."""
    shape = next(g for g in robot.full_collision.geometryObjects if g.name.startswith(f"{link}_")).geometry
    shape.computeLocalAABB()
    low, high = np.asarray(shape.aabb_local.min_), np.asarray(shape.aabb_local.max_)
    corners = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)])
    return np.where(corners == 1, high, low)


def lowest_of_head_m(robot: Robot) -> float:
    """Height of the lowest point of the head over the torso's frame."""
    head = next(g for g in robot.full_collision.geometryObjects if g.name.startswith("head_link_"))
    joint = robot.model.frames[robot.model.getFrameId("torso_link")].placement
    corners = mesh_corners_m(robot, "head_link")
    return float(min((joint.inverse() * head.placement).act(p)[2] for p in corners))


@dataclass
class TourSteering:
    """Commands that lead to the waypoints, from the pose ``(x, y, yaw)`` of the pelvis (m, rad).

    The velocity is ``GAIN_PER_S`` times the distance, in the axes of the robot, within ``limits`` (ahead and back,
    left, turn; m/s, rad/s). Position and heading are commanded until they are reached.
    """

    waypoints: list[Waypoint]
    start: Float[np.ndarray, "3"]
    limits: tuple[float, float, float]
    index: int = -1
    off_m: float = 0.0
    off_rad: float = 0.0
    _is_near: bool = False
    _is_faced: bool = False

    def command(self, elapsed_s: float, pose: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
        """Velocity ahead, to the left (m/s), and of the heading (rad/s)."""
        index = min(int(elapsed_s / SEGMENT_S + 1e-9), len(self.waypoints) - 1)
        if index != self.index:
            self.index, self._is_near, self._is_faced = index, False, False
        goal = self.waypoints[index]
        c, s = math.cos(self.start[2]), math.sin(self.start[2])
        x, y = self.start[0] + c * goal.x_m - s * goal.y_m, self.start[1] + s * goal.x_m + c * goal.y_m
        dx, dy = x - pose[0], y - pose[1]
        self.off_m, self.off_rad = math.hypot(dx, dy), math.remainder(self.start[2] + goal.yaw_rad - pose[2], math.tau)
        self._is_near = self.off_m <= AWAY_M if self._is_near else self.off_m < NEAR_M
        self._is_faced = abs(self.off_rad) <= TURNED_RAD if self._is_faced else abs(self.off_rad) < FACED_RAD
        c, s = math.cos(pose[2]), math.sin(pose[2])
        ahead, left = (0.0, 0.0) if self._is_near else (GAIN_PER_S * (c * dx + s * dy), GAIN_PER_S * (c * dy - s * dx))
        turn = 0.0 if self._is_faced else GAIN_PER_S * self.off_rad
        a, b, w = (min(max(v, -most), most) for v, most in zip((ahead, left, turn), self.limits, strict=True))
        return a, b, w
