"""The robot in its reference posture at the start of a scenario, which shows its size."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import trimesh
import viser

from stridelab.schemas.robots import LinkPose
from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import HalfSizes, rotation_matrix
from stridelab_web.viewer.robot_links import add_robot

ROBOT, GHOST = "/robot", "/ghost"
"""The robot, and the replay of a plan that is being computed: the page gives it the robot's meshes."""


@dataclass(frozen=True)
class Posed:
    """The links of a robot in its reference posture: facing x, x = y = z = 0 midway between its soles."""

    poses: Mapping[str, LinkPose]
    meshes: Mapping[str, trimesh.Trimesh]


@dataclass(frozen=True)
class StandingPose:
    """Pose of the standing robot: the middle between its soles ``(3,)``, and the direction that it faces."""

    position_m: np.ndarray
    yaw_rad: float

    @property
    def orientation_wxyz(self) -> tuple[float, float, float, float]:
        """The rotation about the vertical as a quaternion."""
        return float(np.cos(self.yaw_rad / 2)), 0.0, 0.0, float(np.sin(self.yaw_rad / 2))


def initial_pose(scenario: Scenario, sizes: HalfSizes) -> StandingPose | None:
    """Mean position and direction of the patches in contact in the first phase; None without one."""
    first = scenario.phases[0].contacts if scenario.phases else []
    soles = [contact for contact in first if contact.effector in sizes]
    if not soles:
        return None
    x, y, _ = np.sum([rotation_matrix(sole.orientation_wxyz)[:, 0] for sole in soles], axis=0)
    return StandingPose(np.mean([sole.position_m for sole in soles], axis=0), float(np.arctan2(y, x)))


def add_standing(scene: viser.SceneApi, posed: Posed) -> viser.FrameHandle:
    """Add the robot below one node, hidden until it is placed."""
    whole = scene.add_frame(ROBOT, show_axes=False, visible=False)
    scene.add_frame(GHOST, show_axes=False)
    for link, handle in add_robot(scene, list(posed.poses), posed.meshes).items():
        pose = posed.poses[link]
        handle.position, handle.wxyz = pose[:3], pose[3:]
        scene.add_frame(f"{GHOST}/{link}", show_axes=False)
    return whole


def place_robot(whole: viser.FrameHandle, place: StandingPose | None) -> None:
    """Place the robot, or hide it without a place."""
    whole.visible = place is not None
    if place is not None:
        whole.position, whole.wxyz = tuple(place.position_m), place.orientation_wxyz
