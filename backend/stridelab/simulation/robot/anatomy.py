"""The body of a robot as a marker set sees it: hips, knees, shoulders, and which segment a link belongs to.

Legs and arms are the joints of the card's groups between an effector and the trunk. Joint centres are those of the
reference posture: the point nearest to the axes that a joint of a person replaces, for a hip all three. Where the axes
do not meet, as in the hips of G1, the segment that hangs there is not rigid in its frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import pinocchio as pin

from stridelab.conventions import Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Side
from stridelab.robots.robot import Robot
from stridelab.simulation.human.body_proportions import SIDES, side_prefix
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.recovery.walking import TALOS_COM_HEIGHT_M

LEG_JOINTS: Final = 6
MIN_MASS_KG: Final = 20.0
"""Lightest robot; sums of plates below 100 N count as unloaded in the analysis of recordings."""
_LEG_SEGMENTS: Final = ("thigh", "thigh", "thigh", "shank", "foot", "foot")
_ARM_SEGMENTS: Final = ("upper_arm", "upper_arm", "upper_arm", "forearm", "forearm")
_LATERAL: Final = 0.7
"""Cosine to the lateral direction from which an axis counts as one of pitch."""


@dataclass(frozen=True, eq=False)
class RobotAnatomy:
    """Joints (indices in ``robot.model``) of legs and arms by side, from the trunk outwards.

    ``trunk`` is the joint that moves the link of the shoulders, 1 for a body without a waist. ``size`` is the height of
    the CoM over that of TALOS, ``spacing_m`` the distance of the soles, ``leg_m`` the length of a straight leg.
    """

    robot: Robot
    leg: Mapping[Side, tuple[int, ...]]
    arm: Mapping[Side, tuple[int, ...]]
    trunk: int
    size: float
    spacing_m: float
    leg_m: float

    @staticmethod
    def of_robot(robot: Robot) -> "RobotAnatomy":
        """Raises ``InvalidInput`` (``robot-not-recordable``) for a robot without two legs of six joints.

        Arms without a hand among the effectors belong to the trunk.
        """
        legs = LegGeometry.of_robot(robot)
        if legs is None or legs.side.keys() != {"left_foot", "right_foot"}:
            raise _not_recordable(robot, "it does not stand on two soles at the ends of legs")
        leg = {side: _limb_joints(robot, f"{side}_foot", "leg") for side in SIDES}
        if any(len(chain) != LEG_JOINTS for chain in leg.values()):
            raise _not_recordable(robot, f"its legs need {LEG_JOINTS} joints each")
        arm = {side: _limb_joints(robot, f"{side}_hand", "arm") for side in SIDES}
        if not all(arm.values()):
            arm = dict.fromkeys(SIDES, ())
        torso = [j for j in range(2, robot.model.njoints) if robot.group[robot.model.names[j]] == "torso"]
        trunk = robot.model.parents[arm["left"][0]] if arm["left"] else (torso[-1] if torso else 1)
        size = round(legs.com_height_m / TALOS_COM_HEIGHT_M, 2)
        return RobotAnatomy(robot, leg, arm, int(trunk), size, round(legs.spacing_m, 3), legs.leg_m)

    @cached_property
    def _reference_data(self) -> pin.Data:
        data = self.robot.model.createData()
        pin.computeJointJacobians(self.robot.model, data, self.robot.q_reference)
        pin.updateFramePlacements(self.robot.model, data)
        return data

    def joint_axis(self, joint: int) -> Vector3:
        """Axis of a joint in the reference posture, in the world."""
        return np.asarray(self._reference_data.J[3:, self.robot.model.joints[joint].idx_v]).copy()

    def centre_m(self, joints: Sequence[int]) -> Vector3:
        """The point nearest to the axes of ``joints`` in the world; along a single axis that of the joint's origin."""
        origins = [self._reference_data.oMi[j].translation for j in joints]
        planes = [np.eye(3) - np.outer(self.joint_axis(j), self.joint_axis(j)) for j in joints]
        normal = sum(planes, 1e-6 * np.eye(3))
        right = sum((P @ p for P, p in zip(planes, origins, strict=True)), 1e-6 * np.mean(origins, axis=0))
        return np.asarray(np.linalg.solve(normal, right))

    def origin_m(self, joint: int) -> Vector3:
        """Origin of a joint in the world, in the reference posture."""
        return np.asarray(self._reference_data.oMi[joint].translation).copy()

    def nearest_m(self, joint: int, start_m: Vector3, end_m: Vector3) -> Vector3:
        """The point of a joint's axis nearest to the line from ``start_m`` to ``end_m``."""
        origin, axis = self._reference_data.oMi[joint].translation, self.joint_axis(joint)
        along = (end_m - start_m) / max(float(np.linalg.norm(end_m - start_m)), 1e-9)
        across = axis - (axis @ along) * along
        reach = float(across @ (start_m - origin)) / max(float(across @ axis), 1e-6)
        return np.asarray(origin + reach * axis)

    def effector_m(self, name: str, offset_m: Vector3) -> Vector3:
        """The point ``offset_m`` of an effector's contact frame in the world."""
        effector = self.robot.effectors[name]
        link = self._reference_data.oMf[self.robot.model.getFrameId(effector.frame)]
        return np.asarray(link.act(effector.T_frame_contact.act(offset_m[None])[0]))

    def in_link(self, joint: int, point_m: Vector3) -> Vector3:
        """A point of the world in the frame of the link that ``joint`` moves, in the reference posture."""
        return np.asarray(self._reference_data.oMi[joint].actInv(point_m))

    @cached_property
    def top_m(self) -> float:
        """Height of the highest collision shape above the soles in the reference posture."""
        geometry = self.robot.full_collision
        placed = pin.GeometryData(geometry)
        pin.updateGeometryPlacements(self.robot.model, self._reference_data, geometry, placed)
        tops = [self.centre_m([1])[2]] if not geometry.geometryObjects else []
        for part, at in zip(geometry.geometryObjects, placed.oMg, strict=True):
            part.geometry.computeLocalAABB()
            box = part.geometry.aabb_local
            middle, half = (np.array(box.max_) + box.min_) / 2, (np.array(box.max_) - box.min_) / 2
            tops.append(float(at.act(middle)[2] + np.abs(at.rotation[2]) @ half))
        return float(max(tops))

    def segment_of(self) -> list[str]:
        """Segment of the table by joint, from joint 1 on: that of its limb, else that of the link that carries it.

        The first link of a leg is a part of the pelvis unless it turns with the pitch of the thigh.
        """
        model = self.robot.model
        names = {1: "pelvis"} | {j: "torso" for j in range(2, model.njoints) if self._is_torso(j)}
        for side in SIDES:
            s = side_prefix(side)
            first = "thigh" if self.is_pitch(self.leg[side][0]) else None
            for j, name in zip(self.leg[side], (first, *_LEG_SEGMENTS[1:]), strict=True):
                names[j] = f"{s}{name}" if name else "pelvis"
            for k, j in enumerate(self.arm[side]):
                names[j] = f"{s}{_ARM_SEGMENTS[k] if k < len(_ARM_SEGMENTS) else 'hand'}"
        for j in range(2, model.njoints):
            names.setdefault(j, names[model.parents[j]])
        return [names[j] for j in range(1, model.njoints)]

    def is_pitch(self, joint: int) -> bool:
        """Whether the axis of a joint is lateral in the reference posture."""
        return abs(float(self.joint_axis(joint)[1])) > _LATERAL

    def _is_torso(self, joint: int) -> bool:
        return self.robot.group[self.robot.model.names[joint]] == "torso"

    def hand_rate_m(self, side: Side, joint: int) -> Vector3:
        """Velocity of a hand per rate of a joint of its arm."""
        hand = self.effector_m(f"{side}_hand", np.zeros(3))
        return np.asarray(np.cross(self.joint_axis(joint), hand - self._reference_data.oMi[joint].translation))


def require_weight(robot: Robot) -> None:
    """Raise ``InvalidInput`` (``robot-not-recordable``) for a robot that is too light for force plates."""
    if robot.mass_kg < MIN_MASS_KG:
        raise _not_recordable(robot, f"it weighs less than {MIN_MASS_KG:g} kg, which plates hardly measure")


def _limb_joints(robot: Robot, effector: str, group: str) -> tuple[int, ...]:
    """Joints of a group that move an effector; none for an effector that the robot lacks."""
    if effector not in robot.effectors:
        return ()
    frame = robot.model.frames[robot.model.getFrameId(robot.effectors[effector].frame)]
    names = robot.model.names
    return tuple(int(j) for j in robot.model.supports[frame.parentJoint] if robot.group.get(names[j]) == group)


def _not_recordable(robot: Robot, reason: str) -> InvalidInput:
    message = f"Recordings of {robot.name} cannot be simulated: {reason}."
    return InvalidInput("robot-not-recordable", message, [Fault("robot", reason)])
