"""The scene of a plan: terrain, robot, contacts, forces, and the path of the centre of mass."""

from collections.abc import Container, Iterable, Mapping

import numpy as np
import trimesh
import viser

from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.scenarios import BoxSurface, RailSurface, Scenario, ScenarioContact
from stridelab_web.scene.body_frames import PERSON
from stridelab_web.scene.contacts import HalfSizes, box_corners_m, box_rotation, effector_side, placed_contacts
from stridelab_web.scene.density_nodes import Quaternion, reach_places, shown_level_sets
from stridelab_web.scene.frames import Frames
from stridelab_web.scene.plan_frames import COM, GHOST, MEASURED, MOMENTUM, ROBOT, Cone
from stridelab_web.viewer import meshes
from stridelab_web.viewer.contact_markers import COLOURS, add_fixed_marks
from stridelab_web.viewer.robot_links import add_robot
from stridelab_web.viewer.scene_parts import (
    Colour,
    add_arrow,
    add_mesh,
    add_path,
    add_shadows,
    limb_mesh,
    place_camera,
    prepare_scene,
)
from stridelab_web.viewer.terrain import add_terrain, is_ground

COM_COLOUR: Colour = (20, 30, 40)
FORCE: Colour = (170, 51, 119)
MOMENTUM_COLOUR: Colour = (0, 121, 92)
ARROWS: Mapping[str, Colour] = {MOMENTUM: MOMENTUM_COLOUR, MEASURED: (51, 34, 136)}
COM_LIGHT: Colour = (255, 255, 255)
COM_RADIUS_M, PATH_RADIUS_M = 0.05, 0.006
"""The ball has the usual symbol of a centre of mass; the page draws both over the body (static/js/viewer/scene.js)."""
BONE_RADIUS_M, PERSON_COM_RADIUS_M = 0.012, 0.035
PERSON_COLOUR: Colour = (204, 102, 17)
PERSON_OPACITY = 0.45
AMBIENT = 1.1
REACH_OPACITY = 0.2
CONE_OPACITY, CONE_M = 0.35, 0.45
"""A cone ends below the tip of the arrow of a force that carries the body."""
RIGHT_FRONT = np.array([0.3, -1.0, 0.42])
"""Direction to the camera for a robot that walks along x."""
BODY_M = (0.45, 0.45, 1.75)
"""Size of a robot around and above its footholds."""
HIPS_M = 0.9
MIN_WALK_M = 0.3
MIN_RAY_COMPONENT = 1e-9
"""Minimum component of a ray, which avoids divisions by zero."""
NEAR_M = 1.0
"""Maximum distance from the contacts of boxes that must be in view."""


def build_plan_scene(
    server: viser.ViserServer,
    scenario: Scenario,
    sizes: HalfSizes,
    frames: Frames,
    cones: Iterable[Cone],
    link_meshes: Mapping[str, trimesh.Trimesh],
    reach: RobotReachability | None,
) -> None:
    """Put a plan into an empty server; the page moves its nodes. ``reach`` holds the densities of the plan."""
    scene = server.scene
    prepare_scene(scene, AMBIENT)
    add_terrain(scene, scenario, merged=True)
    add_fixed_marks(scene, scenario, sizes)
    copies = frozenset(copy.name for copy in frames.copies)
    _add_reach(scene, scenario, reach, copies)
    add_robot(scene, [b.name.removeprefix(ROBOT) for b in frames.bodies if b.name.startswith(ROBOT)], link_meshes)
    add_shadows(scene, frames)
    for ghost in (body.name for body in frames.bodies if body.name.startswith(GHOST)):
        scene.add_frame(ghost, show_axes=False)
    for arrow in frames.arrows:
        add_arrow(scene, arrow, next((c for group, c in ARROWS.items() if arrow.shaft.startswith(group)), FORCE))
    _add_person(scene, frames)
    _add_cones(scene, cones, copies)
    add_path(scene, "/paths/com", frames.track_m("/paths/com"), COM_COLOUR, PATH_RADIUS_M)
    add_com(scene, COM)
    towards_camera = rotate_to_walk(scenario, RIGHT_FRONT)
    if is_hidden(scenario, towards_camera):
        towards_camera = rotate_to_walk(scenario, RIGHT_FRONT * [1, -1, 1])
    place_camera(server, sights_m(scenario), towards_camera)


def add_com(scene: viser.SceneApi, name: str) -> None:
    """Add the symbol of a centre of mass: a ball in two halves; the light one is a node below ``name``."""
    dark, light = meshes.sphere_halves(COM_RADIUS_M)
    add_mesh(scene, name, dark, COM_COLOUR, side="front")
    add_mesh(scene, f"{name}/light", light, COM_LIGHT, side="front")


def _add_person(scene: viser.SceneApi, frames: Frames) -> None:
    """Add the limbs and the centre of mass of the person whose walk is imitated; the robot shows through."""
    for stick in frames.sticks:
        solid = limb_mesh(frames, stick) or meshes.cylinder(BONE_RADIUS_M)
        add_mesh(scene, stick.name, solid, PERSON_COLOUR, opacity=PERSON_OPACITY)
    for point in frames.points:
        if point.name.startswith(PERSON):
            add_mesh(scene, point.name, meshes.ball(PERSON_COM_RADIUS_M), PERSON_COLOUR)


def _add_cones(scene: viser.SceneApi, cones: Iterable[Cone], copies: Container[str]) -> None:
    """Add cones with their tips at the contacts; the page moves the tips to the points of application."""
    for cone in cones:
        contact = cone.touch.contact
        if cone.name in copies:
            _add_empty_node(scene, cone.name, contact, contact.orientation_wxyz)
            continue
        mesh = meshes.open_cone(cone.friction, CONE_M)
        handle = add_mesh(scene, cone.name, mesh, COLOURS[effector_side(contact.effector)], opacity=CONE_OPACITY)
        handle.position, handle.wxyz = contact.position_m, contact.orientation_wxyz


def _add_reach(
    scene: viser.SceneApi, scenario: Scenario, reach: RobotReachability | None, copies: Container[str]
) -> None:
    """Add a level set per place; places without densities get empty nodes, so that the page finds all nodes."""
    shown = shown_level_sets(reach)
    for place in reach_places(scenario):
        contact = place.contact
        if contact.effector not in shown:
            scene.add_frame(place.name, show_axes=False)
            continue
        density, level = shown[contact.effector]
        if place.name in copies:
            _add_empty_node(scene, place.name, contact, place.orientation_wxyz(density))
            continue
        mesh = np.array(level.vertices_m, dtype=np.float32), np.array(level.triangles, dtype=np.uint32)
        handle = add_mesh(
            scene, place.name, mesh, COLOURS[effector_side(contact.effector)], opacity=REACH_OPACITY, side="front"
        )
        handle.position, handle.wxyz = contact.position_m, place.orientation_wxyz(density)


def _add_empty_node(scene: viser.SceneApi, name: str, contact: ScenarioContact, wxyz: Quaternion) -> None:
    """Add a node at a contact, to which the page gives the meshes of another node."""
    scene.add_frame(name, show_axes=False, position=contact.position_m, wxyz=wxyz)


def rotate_to_walk(scenario: Scenario, direction: np.ndarray) -> np.ndarray:
    """Rotate a direction, given for a walk along x, to the direction of ``scenario``."""
    c, s = walk_direction(scenario)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ direction)


def walk_direction(scenario: Scenario) -> tuple[float, float]:
    """Unit vector, seen from above, from the first contact to the last; along x if they are close."""
    placed = [np.array(touch.contact.position_m) for touch in placed_contacts(scenario)]
    along = (placed[-1] - placed[0])[:2] if placed else np.zeros(2)
    length = float(np.linalg.norm(along))
    return (float(along[0]) / length, float(along[1]) / length) if length > MIN_WALK_M else (1.0, 0.0)


def is_hidden(scenario: Scenario, towards_camera: np.ndarray) -> bool:
    """Whether a box of the terrain, a wall, stands between the camera and the robot's hips over any foothold."""
    feet = [t.contact.position_m for t in placed_contacts(scenario) if "foot" in t.effector]
    hips_m = np.array(feet).reshape(-1, 3) + np.array([0.0, 0.0, HIPS_M])
    return any(
        _rays_hit(box, hips_m, towards_camera)
        for box in scenario.terrain
        if isinstance(box, BoxSurface) and not is_ground(box)
    )


def _rays_hit(box: BoxSurface, from_m: np.ndarray, direction: np.ndarray) -> bool:
    """Whether a ray from one of the points ``(n, 3)`` hits the box (slab method)."""
    R, half = box_rotation(box), np.array(box.size_m) / 2
    start, along = (from_m - box.center_m) @ R, direction @ R
    along = np.where(np.abs(along) < MIN_RAY_COMPONENT, MIN_RAY_COMPONENT, along)
    ends = np.stack([(-half - start) / along, (half - start) / along])
    enters, leaves = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    return bool((np.maximum(enters, 0.0) < leaves).any())


def sights_m(scenario: Scenario, height_m: float = BODY_M[2]) -> np.ndarray:
    """Points ``(n, 3)`` that must be in view: ``height_m`` above every foothold, rails, and boxes nearby."""
    places = np.array([touch.contact.position_m for touch in placed_contacts(scenario)]).reshape(-1, 3)
    if not len(places):
        places = np.zeros((1, 3))
    feet = [t.contact.position_m for t in placed_contacts(scenario) if "foot" in t.effector]
    standing = np.array(feet).reshape(-1, 3) if feet else places
    x, y, _ = BODY_M
    room = np.array([[sx * x, sy * y, h] for sx in (-1, 1) for sy in (-1, 1) for h in (0.0, height_m)])
    cloud = [(standing[:, None] + room).reshape(-1, 3), places]
    low, high = places.min(axis=0) - NEAR_M, places.max(axis=0) + NEAR_M
    for surface in scenario.terrain:
        if isinstance(surface, RailSurface):
            cloud.append(np.clip([surface.from_m, surface.to_m], low, high))
        elif not is_ground(surface):
            cloud.append(np.clip(box_corners_m(surface), low, high))
    return np.concatenate(cloud)
