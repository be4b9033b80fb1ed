"""The robot in its reference posture where a scenario begins: how large it is beside its way, not yet how it moves."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import trimesh
import viser

from stridelab.schemas.robots import LinkPose
from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import HalfSizes, rotation
from stridelab_web.viewer.robot_links import add_robot

ROBOT = "/robot"


@dataclass(frozen=True)
class Posed:
    """The links of a robot in its reference posture: facing x, x = y = z = 0 midway between its soles."""

    poses: Mapping[str, LinkPose]
    meshes: Mapping[str, trimesh.Trimesh]


@dataclass(frozen=True)
class Place:
    """Where the robot stands: the middle between its soles ``(3,)``, and the direction that it faces."""

    position_m: np.ndarray
    yaw_rad: float

    @property
    def wxyz(self) -> tuple[float, float, float, float]:
        """The turn about the vertical as a quaternion."""
        return float(np.cos(self.yaw_rad / 2)), 0.0, 0.0, float(np.sin(self.yaw_rad / 2))


def first_place(scenario: Scenario, sizes: HalfSizes) -> Place | None:
    """The mean of the patches that touch in the first phase and of their directions; None where none does."""
    first = scenario.phases[0].contacts if scenario.phases else []
    soles = [contact for contact in first if contact.effector in sizes]
    if not soles:
        return None
    x, y, _ = np.sum([rotation(sole.orientation_wxyz)[:, 0] for sole in soles], axis=0)
    return Place(np.mean([sole.position_m for sole in soles], axis=0), float(np.arctan2(y, x)))


def add_standing(scene: viser.SceneApi, posed: Posed) -> viser.FrameHandle:
    """The robot below one node, which places it; not to be seen before."""
    whole = scene.add_frame(ROBOT, show_axes=False, visible=False)
    for link, handle in add_robot(scene, list(posed.poses), posed.meshes).items():
        pose = posed.poses[link]
        handle.position, handle.wxyz = pose[:3], pose[3:]
    return whole


def stand(whole: viser.FrameHandle, place: Place | None) -> None:
    """Put the robot there; away where there is no such place."""
    whole.visible = place is not None
    if place is not None:
        whole.position, whole.wxyz = tuple(place.position_m), place.wxyz
