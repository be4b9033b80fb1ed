"""Whether a leg is clear of a step that rises ahead of its toes, as the next stair does.

The step is a box across the way of the sole. What can hit it are the links between hip and ankle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from stridelab.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class StepClearance:
    """One sole: the links above it, the index of its contact frame, and how far ahead of it a step begins.

    ``depth_m`` is the size of the step along the sole and across it.
    """

    links: Sequence[pin.GeometryObject]
    frame: int
    begins_m: float
    depth_m: float

    @staticmethod
    def of(
        robot: Robot, effector: str, frame: int, joints: Sequence[int], gap_m: float, depth_m: float
    ) -> "StepClearance":
        """For the sole ``effector`` on a leg of the ``joints``, the last two of which are its ankle."""
        moved = set(joints[:-2])
        half_m = robot.effectors[effector].contact_half_size_m
        return StepClearance(
            [part for part in robot.collision.geometryObjects if part.parentJoint in moved],
            frame,
            gap_m + (half_m[0] if half_m is not None else 0.0),
            depth_m,
        )

    def clear(self, data: pin.Data, height_m: float) -> bool:
        """Whether nothing touches a step of ``height_m``, the joints and the frame being placed in ``data``."""
        box = coal.Box(self.depth_m, self.depth_m, height_m)
        middle = np.array([self.begins_m + self.depth_m / 2, 0.0, height_m / 2])
        T_world_box = _transform(data.oMf[self.frame] * pin.SE3(np.eye(3), middle))
        request = coal.CollisionRequest()
        return not any(
            coal.collide(
                part.geometry,
                _transform(data.oMi[part.parentJoint] * part.placement),
                box,
                T_world_box,
                request,
                coal.CollisionResult(),
            )
            for part in self.links
        )


def _transform(T: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(T.rotation, T.translation)
