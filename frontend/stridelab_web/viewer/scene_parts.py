"""Parts of all scenes: light, force arrows, paths, and a camera with everything in view."""

import math
from typing import Literal

import numpy as np
import viser

from stridelab_web.scene.body_frames import median_length_m, profile_of
from stridelab_web.scene.frames import HEAD_M, Arrow, Frames, Stick
from stridelab_web.scene.shadows import is_shadow
from stridelab_web.viewer import meshes

Colour = tuple[int, int, int]
SHAFT_RADIUS_M, HEAD_RADIUS_M = 0.012, 0.03
SHADOW_M, SHADOW_OPACITY, SHADOW_PIXELS = 0.42, 0.45, 64
"""Width of the shadow of a foot, how dark its middle is, and the pixels of its picture."""
FOV_RAD = 0.7
WIDE, NARROW = 1.6, 1.25
"""Width over height of the picture above a timeline, and beside a panel; a wider one shows more."""
MARGIN = 1.06
PATH_TOLERANCE_DIVISOR = 20
"""A path is drawn through as many of its points as keep it within this part of its thickness."""


def prepare_scene(scene: viser.SceneApi, ambient: float = 2.2) -> None:
    """Light without shadows, z up; thin objects need more ``ambient`` light than bodies."""
    scene.set_up_direction("+z")
    # Without a graphics card an environment map costs a hundredfold (0.4 instead of 36 images per second for fifty
    # spheres in software), and so do screen-space lines: lines are thin meshes here.
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=True, cast_shadow=False)
    scene.add_light_ambient("/light", intensity=ambient)


def add_floor(scene: viser.SceneApi, fade_m: float, height_m: float = 0.0) -> None:
    """Add an infinite grid of 1 m and 0.25 m at ``height_m``, which fades at a distance of ``fade_m``."""
    scene.add_grid(
        "/floor",
        infinite_grid=True,
        cell_size=0.25,
        section_size=1.0,
        cell_color=(232, 236, 240),
        section_color=(205, 212, 219),
        fade_distance=fade_m,
        shadow_opacity=0.0,
        position=(0.0, 0.0, height_m),
    )


def add_mesh(
    scene: viser.SceneApi,
    name: str,
    mesh: meshes.Mesh,
    colour: Colour,
    opacity: float | None = None,
    side: Literal["front", "double"] = "double",
) -> viser.MeshHandle:
    """Add a mesh of one colour without shadows. Nodes that are drawn over a body need ``side`` "front"."""
    return scene.add_mesh_simple(
        name, *mesh, color=colour, opacity=opacity, side=side, cast_shadow=False, receive_shadow=False
    )


def add_shadows(scene: viser.SceneApi, frames: Frames) -> None:
    """Add a round spot for every shadow of ``frames``, black in the middle and clear at its rim."""
    axis = np.linspace(-1.0, 1.0, SHADOW_PIXELS)
    inside = np.clip(1.0 - np.hypot(*np.meshgrid(axis, axis)), 0.0, 1.0)
    picture = np.zeros((SHADOW_PIXELS, SHADOW_PIXELS, 4), dtype=np.uint8)
    picture[..., 3] = np.round(255 * SHADOW_OPACITY * inside * inside * (3.0 - 2.0 * inside))
    for point in frames.points:
        if is_shadow(point):
            scene.add_image(
                point.name, picture, SHADOW_M, SHADOW_M, format="png", cast_shadow=False, receive_shadow=False
            )


def add_arrow(scene: viser.SceneApi, arrow: Arrow, colour: Colour) -> None:
    """Add shaft and head of a force; the page sets their length and direction."""
    add_mesh(scene, arrow.shaft, meshes.cylinder(SHAFT_RADIUS_M), colour, side="front")
    add_mesh(scene, arrow.head, meshes.cone(HEAD_RADIUS_M, HEAD_M), colour, side="front")


def add_path(scene: viser.SceneApi, name: str, path_m: np.ndarray | None, colour: Colour, radius_m: float) -> None:
    """Add a thin tube along ``path_m`` ``(n, 3)``, interrupted at NaN; does nothing without a path."""
    if path_m is None:
        return
    slices = _true_runs(np.isfinite(path_m).all(axis=1))
    runs = [path_m[part] for part in slices if part.stop - part.start > 1]
    pieces = [meshes.tube(run[meshes.simplify_path(run, radius_m / PATH_TOLERANCE_DIVISOR)], radius_m) for run in runs]
    if pieces:
        add_mesh(scene, name, meshes.merge_meshes(pieces), colour, side="front")


def place_camera(
    server: viser.ViserServer, corners_m: np.ndarray, towards_camera: np.ndarray, aspect: float = WIDE
) -> None:
    """Look at ``corners_m`` ``(n, 3)`` from a direction, at a distance at which all of them are in view."""
    look_at, position = camera_pose(corners_m, towards_camera, aspect)
    server.initial_camera.fov = FOV_RAD
    server.initial_camera.look_at = tuple(look_at)
    server.initial_camera.position = tuple(position)


def camera_pose(corners_m: np.ndarray, towards_camera: np.ndarray, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Target and position: a point at ``d`` in front of the middle is in view from ``|across| / tan - d`` on."""
    back = towards_camera / np.linalg.norm(towards_camera)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    middle = (corners_m.min(axis=0) + corners_m.max(axis=0)) / 2
    half = math.tan(FOV_RAD / 2) / MARGIN
    cloud = corners_m - middle
    # The middle of the picture, not of the box: what is near looks larger.
    for _ in range(4):
        needed = np.maximum(np.abs(cloud @ up) / half, np.abs(cloud @ right) / (half * aspect)) + cloud @ back
        reach = float(needed.max())
        depth = reach - cloud @ back
        tall, wide = cloud @ up / depth, cloud @ right / depth
        shift = (tall.max() + tall.min()) / 2 * reach * up + (wide.max() + wide.min()) / 2 * reach * right
        middle, cloud = middle + shift, cloud - shift
    return middle, middle + reach * back


def _true_runs(mask: np.ndarray) -> list[slice]:
    """Slices of consecutive true samples."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def limb_mesh(frames: Frames, stick: Stick) -> meshes.Mesh | None:
    """The solid of a limb, as thick as its median length says; None for what is no limb, or never seen."""
    profile = profile_of(stick)
    length_m = median_length_m(frames.values, stick)
    if profile is None or not length_m > 0.0:
        return None
    return meshes.solid_of_revolution([(height, share * length_m) for height, share in profile])
