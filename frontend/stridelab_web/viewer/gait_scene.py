"""The gait scene: floor, plates, markers, skeleton, forces, central axis, centre of mass, wheel, measures of balance.

Nodes are placed at the first time at which they exist; then the page moves them (static/js/viewer/scene.js).
"""

import numpy as np
import viser

from stridelab.schemas.recordings import Recording
from stridelab.translations.catalogue import gettext
from stridelab_web.scene import com_frames, cycloid_frames, stability_frames
from stridelab_web.scene.body_frames import profile_of
from stridelab_web.scene.frames import Frames
from stridelab_web.scene.second_walk import OTHER
from stridelab_web.scene.shadows import is_shadow
from stridelab_web.viewer import meshes
from stridelab_web.viewer.scene_parts import (
    Colour,
    add_arrow,
    add_floor,
    add_mesh,
    add_path,
    add_shadows,
    limb_mesh,
    place_camera,
    prepare_scene,
)

BLUE, ORANGE, BROWN = (11, 92, 156), (226, 132, 20), (176, 96, 0)
MARKER, BONE, PLATE, PLATE_OFF = (62, 78, 94), (166, 180, 194), (214, 224, 232), (235, 235, 235)
AXIS_COLOUR, WHEEL, SKIN = (58, 66, 76), (0, 121, 92), (196, 206, 216)
PURPLE, GREEN, RED = (110, 64, 170), (0, 121, 92), (196, 43, 28)
SECOND = (0, 133, 153)
"""Colour of the second walk."""
MARKER_RADIUS_M, BONE_RADIUS_M, AXIS_RADIUS_M = 0.011, 0.006, 0.0025
MARGIN_RADIUS_M = 0.009
POINTS: dict[str, tuple[Colour, float]] = {
    com_frames.FUSED: (BLUE, 0.014),
    f"{com_frames.GEOMETRY}/point": (BROWN, 0.012),
    f"{com_frames.ON_AXIS}/point": (AXIS_COLOUR, 0.012),
    cycloid_frames.HUB: (WHEEL, 0.008),
    cycloid_frames.POINT: (WHEEL, 0.01),
    stability_frames.XCOM: (PURPLE, 0.013),
    f"{OTHER}{com_frames.FUSED}": (SECOND, 0.014),
    f"{OTHER}{stability_frames.XCOM}": (SECOND, 0.013),
}
PATHS: dict[str, tuple[Colour, float]] = {
    com_frames.PATH: (BLUE, 0.004),
    f"{com_frames.GEOMETRY}/path": (BROWN, 0.003),
    f"{com_frames.ON_AXIS}/path": (AXIS_COLOUR, 0.003),
    cycloid_frames.TRACE: (WHEEL, 0.003),
    cycloid_frames.GROUND: (WHEEL, 0.003),
    cycloid_frames.HUB_PATH: (BONE, 0.0015),
    stability_frames.XCOM_PATH: (PURPLE, 0.0025),
    f"{OTHER}{com_frames.PATH}": (SECOND, 0.004),
    f"{OTHER}{stability_frames.XCOM_PATH}": (SECOND, 0.0025),
}
"""Colour and radius of the centre of mass, of the inputs that are places, and of the wheel."""
ARROWS: dict[str, Colour] = {"/forces/total_shaft": BROWN, f"{stability_frames.MOMENTUM}_shaft": PURPLE}
"""Colours of the arrows that are not forces of plates."""
PLATE_RIM, LABEL_INSIDE = 0.04, 0.25
RIM_SHARE, SPOKES = 0.05, 6
"""Half thickness of the wheel's rim over its radius, and how many spokes show that it turns."""


def build_gait_scene(server: viser.ViserServer, recording: Recording, frames: Frames) -> None:
    """Put the scene of ``recording`` into an empty server."""
    scene = server.scene
    prepare_scene(scene)
    centre, extent = _scene_bounds(recording, frames)
    add_floor(scene, 30.0, height_m=-0.012)
    along = _walking_direction(recording, np.stack([centre - extent * [1, 0, 0], centre + extent * [1, 0, 0]]))
    view = np.array([along[1], -along[0], 0.0]) + 0.45 * along + [0.0, 0.0, 0.28]
    _add_plates(scene, recording, view)
    add_shadows(scene, frames)
    for point in (each for each in frames.points if not is_shadow(each)):
        _add_point(scene, point.name, _first_position(frames, point.at))
    bone, thin = meshes.cylinder(BONE_RADIUS_M), meshes.cylinder(AXIS_RADIUS_M)
    thick = meshes.cylinder(MARGIN_RADIUS_M)
    of = {
        com_frames.AXIS: (thin, AXIS_COLOUR),
        cycloid_frames.SPOKE: (thin, WHEEL),
        stability_frames.BASE: (bone, AXIS_COLOUR),
        stability_frames.INSIDE: (thick, GREEN),
        stability_frames.OUTSIDE: (thick, RED),
        f"{OTHER}{stability_frames.INSIDE}": (thick, GREEN),
        f"{OTHER}{stability_frames.OUTSIDE}": (thick, RED),
        f"{OTHER}/": (bone, SECOND),
    }
    for stick in frames.sticks:
        solid = limb_mesh(frames, stick)
        drawn = (solid, SKIN) if solid else next((of[a] for a in of if stick.name.startswith(a)), (bone, BONE))
        add_mesh(scene, stick.name, *drawn)
    for hoop in frames.hoops:
        add_mesh(scene, hoop.name, meshes.wheel(RIM_SHARE, SPOKES), WHEEL)
    for arrow in frames.arrows:
        add_arrow(scene, arrow, ARROWS.get(arrow.shaft, ORANGE))
    _add_com(scene, frames)
    corners = centre + extent * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    place_camera(server, corners, view)


def _add_plates(scene: viser.SceneApi, recording: Recording, towards_camera: np.ndarray) -> None:
    for plate in recording.plates:
        corners = np.asarray(plate.corners_m, dtype=np.float32)
        name = f"/plates/{plate.index}"
        colour = PLATE if plate.use else PLATE_OFF
        below = corners - np.array([0, 0, 0.004], dtype=np.float32)
        faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
        add_mesh(scene, name, (below, faces), colour)
        edge = meshes.inner_frame(corners, PLATE_RIM)
        add_mesh(scene, f"{name}/edge", edge, BONE)
        text = gettext("Plate %(index)s", index=plate.index)
        if not plate.use:
            text = gettext("Plate %(index)s (not used)", index=plate.index)
        nearest = corners[np.argmax(corners @ towards_camera.astype(np.float32))]
        scene.add_label(f"{name}/label", text, position=nearest + LABEL_INSIDE * (corners.mean(axis=0) - nearest))


def _add_point(scene: viser.SceneApi, name: str, position: np.ndarray) -> None:
    colour, radius = POINTS.get(name, (MARKER, MARKER_RADIUS_M))
    fine = 3 if name in POINTS else 1
    scene.add_icosphere(
        name, radius, colour, subdivisions=fine, position=position, cast_shadow=False, receive_shadow=False
    )


def _add_com(scene: viser.SceneApi, frames: Frames) -> None:
    for track in frames.tracks:
        colour, radius_m = PATHS[track.name]
        add_path(scene, track.name, frames.track_m(track.name), colour, radius_m)
    for ellipsoid in frames.ellipsoids:
        add_mesh(scene, ellipsoid.name, meshes.ball(1.0), BLUE, opacity=0.35)


def _first_position(frames: Frames, at: int) -> np.ndarray:
    track = frames.values[:, at : at + 3]
    present = np.flatnonzero(np.isfinite(track).all(axis=1))
    return track[present[0]].astype(float) if len(present) else np.zeros(3)


def _scene_bounds(recording: Recording, frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """Centre and half extents of the body and of the 2nd to 98th percentile of the rest: markers may be stray."""
    clouds = [frames.values[:, point.at : point.at + 3] for point in frames.points]
    clouds += [np.asarray(plate.corners_m, dtype=np.float32) for plate in recording.plates if plate.use]
    cloud = np.concatenate(clouds) if clouds else np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.8]])
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if not len(cloud):
        cloud = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.8]])
    low, high = np.percentile(cloud, [2, 98], axis=0)
    limbs = [frames.values[:, stick.end : stick.end + 3] for stick in frames.sticks if profile_of(stick)]
    seen = [track[np.isfinite(track).all(axis=1)] for track in limbs]
    body = np.concatenate([[low, high], *(np.percentile(track, [2, 98], axis=0) for track in seen if len(track))])
    low, high = body.min(axis=0), body.max(axis=0)
    return (low + high) / 2, np.maximum((high - low) / 2, 0.3)


def _walking_direction(recording: Recording, path: np.ndarray) -> np.ndarray:
    along = np.asarray(recording.walking_direction or path[-1] - path[0], dtype=float)
    along[2] = 0.0
    length = float(np.linalg.norm(along))
    return along / length if length > 0.2 else np.array([1.0, 0.0, 0.0])
