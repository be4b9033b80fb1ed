"""The robot's model with one operational frame on every contact frame of its effectors."""

from collections.abc import Mapping
from functools import lru_cache

import pinocchio as pin

from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot


def to_se3(placement: Placement) -> pin.SE3:
    """The same placement in pinocchio's type."""
    return pin.SE3(placement.rotation, placement.position_m)


@lru_cache(maxsize=8)
def with_contact_frames(robot: Robot) -> tuple[pin.Model, Mapping[str, int]]:
    """A copy of ``robot.model`` and, per effector, the index of the frame at ``T_frame_contact`` of its link frame.

    Later calls return the same model, which must not be changed.
    """
    model = pin.Model(robot.model)
    index: dict[str, int] = {}
    for name, effector in robot.effectors.items():
        parent = model.getFrameId(effector.frame)
        link = model.frames[parent]
        T_joint_contact = link.placement * to_se3(effector.T_frame_contact)
        index[name] = model.addFrame(
            pin.Frame(f"contact of {name}", link.parentJoint, parent, T_joint_contact, pin.OP_FRAME)
        )
    return model, index
