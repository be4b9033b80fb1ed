"""Ranges of joints whose description states none, from the anatomy of a person and the shapes of the robot.

A joint of a leg or the torso gets the range of the person's joint at its place in the chain that turns about the same
axis of the body. Joints of the arms are free by ``ARM_RAD`` until the rest posture is known, and by ``ARM_SWING_RAD``
about it then. Every range then ends where the joint, turned alone from the rest posture, brings two links together that
are apart in it. Not looked at are the two legs against each other, which walking turns together, and neighbours on a
leg, whose hulls often meet where the links interlock.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.robots.proposal.collision_table import NEAR_JOINTS
from stridelab.robots.proposal.limbs import Chain, Limbs
from stridelab.robots.robot import Robot

Range = tuple[float, float]
ROLL, PITCH, YAW = range(3)
"""Axes of the body: ahead, to the left, up."""
LEG_PITCH_RAD: Final[tuple[Range, ...]] = ((-1.9, 0.6), (0.0, 2.2), (-1.0, 0.8))
"""Hip, knee and ankle about the axis to the left, from the straight leg: thigh ahead, shin back, toes up and down."""
HIP_RAD: Final[Mapping[int, Range]] = {ROLL: (-0.4, 0.7), YAW: (-0.8, 0.8)}
"""Hip about the axes ahead (the left leg, outwards) and up."""
ANKLE_RAD: Final[Mapping[int, Range]] = {ROLL: (-0.5, 0.5), YAW: (-0.5, 0.5)}
TORSO_RAD: Final[Mapping[int, Range]] = {ROLL: (-0.4, 0.4), PITCH: (-0.3, 0.8), YAW: (-1.0, 1.0)}
SKEW: Final = 0.8
"""Least cosine between the axis of a joint and one of the body; below it the range is ``SKEW_RAD``."""
SKEW_RAD: Final[Range] = (-0.8, 0.8)
ARM_RAD: Final[Range] = (-1.6, 1.6)
ARM_SWING_RAD: Final = 0.9
SCAN_RAD: Final = 0.1


def anatomical_ranges(
    model: pin.Model, limbs: Limbs, q: Float[np.ndarray, "nq"], joints: Collection[str]
) -> dict[int, Range]:
    """Ranges (rad) by joint id of those moving ``joints`` that are named, at the neutral configuration ``q``."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)

    def axis_of(joint: int) -> tuple[int, float]:
        """The nearest axis of the body, -1 if there is none, and the sense about it."""
        S = np.array(model.joints[joint].createData().S).reshape(6, -1)[3:, 0]
        axis = limbs.R_root.T @ data.oMi[1].rotation.T @ data.oMi[joint].rotation @ S
        nearest = int(np.argmax(np.abs(axis)))
        return (nearest if abs(axis[nearest]) >= SKEW else -1), float(np.sign(axis[nearest]))

    ranges: dict[int, Range] = {}
    for side, leg in zip((1.0, -1.0), limbs.legs, strict=True):
        ranges |= _leg_ranges(leg, {joint: axis_of(joint) for joint in leg}, side)
    for joint in limbs.torso:
        axis, sense = axis_of(joint)
        ranges[joint] = _range_about_axis(TORSO_RAD.get(axis, SKEW_RAD), sense)
    ranges |= {joint: ARM_RAD for arm in limbs.arms for joint in arm}
    return {joint: ends for joint, ends in ranges.items() if str(model.names[joint]) in joints}


def _leg_ranges(leg: Chain, axes: Mapping[int, tuple[int, float]], side: float) -> dict[int, Range]:
    pitches = [joint for joint in leg if axes[joint][0] == PITCH]
    knee = pitches[1] if len(pitches) > 1 else leg[len(leg) // 2]
    ranges = {}
    for joint in leg:
        axis, sense = axes[joint]
        if axis == PITCH:
            k = pitches.index(joint)
            ends = LEG_PITCH_RAD[k] if k < len(LEG_PITCH_RAD) else SKEW_RAD
        else:
            ends = (HIP_RAD if joint < knee else ANKLE_RAD).get(axis, SKEW_RAD)
            sense *= side  # the right leg is the mirror image of the left one
        ranges[joint] = _range_about_axis(ends, sense)
    return ranges


def _range_about_axis(ends: Range, sense: float) -> Range:
    return ends if sense > 0.0 else (-ends[1], -ends[0])


def narrowed_ranges(robot: Robot, ranges: Mapping[str, Range]) -> dict[str, Range]:
    """``ranges`` by joint, ended where links meet that are apart in the rest posture, and arms about that posture."""
    model, geometry = robot.model, robot.collision
    data, results = model.createData(), geometry.createData()
    pin.computeCollisions(model, data, geometry, results, robot.q_reference, False)
    joints = [int(shape.parentJoint) for shape in geometry.geometryObjects]
    for k, pair in enumerate(geometry.collisionPairs):
        a, b = joints[pair.first], joints[pair.second]
        groups = [robot.group.get(str(model.names[joint]), "") for joint in (a, b)]
        on_limb = a in model.supports[b] or b in model.supports[a]
        apart = NEAR_JOINTS if "arm" not in groups else 1
        near = on_limb and abs(len(model.supports[a]) - len(model.supports[b])) <= apart
        legs = not on_limb and groups == ["leg", "leg"]
        if near or legs or results.collisionResults[k].isCollision():  # legs that sway together do not meet
            results.deactivateCollisionPair(k)

    def links_meet(index: int, angle: float) -> bool:
        q = robot.q_reference.copy()
        q[index] = angle
        return bool(pin.computeCollisions(model, data, geometry, results, q, True))

    narrowed = {}
    for name, (low, high) in ranges.items():
        index = model.joints[model.getJointId(name)].idx_q
        rest = float(robot.q_reference[index])
        if robot.group[name] == "arm":
            low, high = max(low, rest - ARM_SWING_RAD), min(high, rest + ARM_SWING_RAD)
        narrowed[name] = _last_free(index, rest, low, links_meet), _last_free(index, rest, high, links_meet)
    return narrowed


def _last_free(index: int, rest: float, end: float, links_meet: Callable[[int, float], bool]) -> float:
    """The angle towards ``end`` before links meet."""
    free = rest
    for angle in np.linspace(rest, end, 1 + max(1, int(np.ceil(abs(end - rest) / SCAN_RAD))))[1:]:
        if links_meet(index, float(angle)):
            break
        free = float(angle)
    return round(free, 4)
