"""The scene of a robot: its reference posture, and the densities of its CoM relative to each effector.

All nodes exist from the start; the page shows the chosen ones (static/js/viewer/robot_view.js).
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import trimesh
import viser

from stridelab.schemas.reachability import EffectorReach, RobotReachability
from stridelab.schemas.robots import RobotFacts
from stridelab_web.scene.contacts import rotation_matrix
from stridelab_web.viewer import meshes
from stridelab_web.viewer.robot_links import add_robot
from stridelab_web.viewer.scene_parts import NARROW, Colour, add_floor, add_mesh, place_camera, prepare_scene

AMBIENT = 1.1
LEVELS: Final[Mapping[float, tuple[Colour, float]]] = {
    0.5: ((8, 48, 92), 0.5),
    0.8: ((11, 92, 156), 0.28),
    0.95: ((110, 170, 215), 0.2),
}
"""Colour and opacity of the surface that holds a share of the mass: darker where it is more likely."""
CLOUD: Colour = (176, 96, 0)
MODE: Colour = (20, 30, 40)
POINT_M, MODE_RADIUS_M = 0.008, 0.022
AXES_M, AXIS_RADIUS_M = 0.14, 0.006
WIDE_SHARE, TALL_SHARE = 0.95, 2.05
"""Half the width and the least height of the view, over the height of the CoM."""
TOWARDS = np.array([0.95, -1.0, 0.42])


def build_robot_scene(
    server: viser.ViserServer,
    facts: RobotFacts,
    meshes: Mapping[str, trimesh.Trimesh],
    reach: Sequence[RobotReachability],
) -> None:
    """Put a robot into an empty server, with the densities of each measure."""
    scene = server.scene
    prepare_scene(scene, AMBIENT)
    add_floor(scene, 12.0)
    poses = dict(zip(facts.links, facts.link_poses, strict=True))
    scene.add_frame("/robot", show_axes=False)
    for link, handle in add_robot(scene, facts.links, meshes).items():
        handle.position, handle.wxyz = poses[link][:3], poses[link][3:]
    for learned in reach:
        for density in learned.effectors:
            _add_reach(scene, density_node(learned.measure, density.card.effector), density)
    place_camera(server, sights_m(facts, meshes), TOWARDS, NARROW)


def sights_m(facts: RobotFacts, links: Mapping[str, trimesh.Trimesh]) -> np.ndarray:
    """Corners ``(8, 3)`` of what the first view shows: the densities, and the robot to the top of its head."""
    wide, tall = WIDE_SHARE * facts.com_height_m, TALL_SHARE * facts.com_height_m
    for name, pose in zip(facts.links, facts.link_poses, strict=True):
        if name in links and len(links[name].vertices):
            _, _, up = rotation_matrix(pose[3:])
            tall = max(tall, pose[2] + float((links[name].vertices @ up).max()))
    return np.array([[x, y, z] for x in (-wide, wide) for y in (-wide, wide) for z in (0.0, tall)])


def density_node(measure: str, effector: str) -> str:
    """The node of a density's frame; below it are ``cloud``, ``mode`` and the surfaces ``50``, ``80`` and ``95``."""
    return f"/reach/{measure}/{effector}"


def _add_reach(scene: viser.SceneApi, name: str, density: EffectorReach) -> None:
    pose = density.reference_pose
    scene.add_frame(name, axes_length=AXES_M, axes_radius=AXIS_RADIUS_M, position=pose[:3], wxyz=pose[3:])
    scene.add_point_cloud(
        f"{name}/cloud",
        np.array(density.com_m, dtype=np.float32).reshape(-1, 3),
        colors=CLOUD,
        point_size=POINT_M,
        point_shape="circle",
    )
    mode = add_mesh(scene, f"{name}/mode", meshes.ball(MODE_RADIUS_M), MODE, side="front")
    mode.position = density.card.mode_m
    for level in density.level_sets:
        colour, opacity = LEVELS[level.mass]
        mesh = np.array(level.vertices_m, dtype=np.float32), np.array(level.triangles, dtype=np.uint32)
        add_mesh(scene, f"{name}/{100 * level.mass:.0f}", mesh, colour, opacity, side="front")
