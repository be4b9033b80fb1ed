"""The gait scene: floor, plates, markers, skeleton, force arrows, centre of mass with its path and band.

Nodes are placed at the first instant at which they exist; from then on the page moves them (static/js/scene.js).
"""

import numpy as np
import viser

from stridelab.schemas.recordings import Recording
from stridelab_web.frames import Frames
from stridelab_web.viewer import shapes
from stridelab_web.viewer.parts import add_arrow, add_path, prepare

BLUE, ORANGE, BROWN = (11, 92, 156), (226, 132, 20), (176, 96, 0)
MARKER, BONE, PLATE, PLATE_OFF = (62, 78, 94), (166, 180, 194), (214, 224, 232), (235, 235, 235)
MARKER_RADIUS_M, BONE_RADIUS_M, COM_RADIUS_M = 0.011, 0.006, 0.028
BAND_WIDTHS = 1.96
"""Semi-axes of the band in standard deviations: 95 %."""
BAND_SAMPLES = 400
PLATE_RIM, LABEL_INSIDE = 0.04, 0.25


def build(server: viser.ViserServer, recording: Recording, frames: Frames) -> None:
    """Put the scene of ``recording`` into an empty server."""
    scene = server.scene
    prepare(scene)
    centre, extent = _bounds(recording, frames)
    scene.add_grid(
        "/floor",
        infinite_grid=True,
        cell_size=0.25,
        section_size=1.0,
        cell_color=(232, 236, 240),
        section_color=(205, 212, 219),
        fade_distance=30.0,
        shadow_opacity=0.0,
        position=(0.0, 0.0, -0.012),
    )
    along = _direction(recording, np.stack([centre - extent * [1, 0, 0], centre + extent * [1, 0, 0]]))
    view = np.array([along[1], -along[0], 0.0]) + 0.45 * along + [0.0, 0.0, 0.28]
    _add_plates(scene, recording, view)
    for point in frames.points:
        _add_point(scene, point.name, _first(frames, point.at))
    stick = shapes.cylinder(BONE_RADIUS_M)
    for bone in frames.sticks:
        scene.add_mesh_simple(bone.name, *stick, color=BONE, side="double", cast_shadow=False, receive_shadow=False)
    for arrow in frames.arrows:
        add_arrow(scene, arrow, BROWN if arrow.shaft == "/forces/total_shaft" else ORANGE)
    _add_paths(scene, recording, frames)
    _place_camera(server, centre, extent, along, view)


def _add_plates(scene: viser.SceneApi, recording: Recording, towards_camera: np.ndarray) -> None:
    for plate in recording.plates:
        corners = np.asarray(plate.corners_m, dtype=np.float32)
        name = f"/plates/{plate.index}"
        colour = PLATE if plate.use else PLATE_OFF
        below = corners - np.array([0, 0, 0.004], dtype=np.float32)
        faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
        scene.add_mesh_simple(name, below, faces, color=colour, side="double", cast_shadow=False, receive_shadow=False)
        edge = shapes.rim(corners, PLATE_RIM)
        scene.add_mesh_simple(f"{name}/edge", *edge, color=BONE, side="double", cast_shadow=False, receive_shadow=False)
        text = f"plate {plate.index}" if plate.use else f"plate {plate.index} (not used)"
        nearest = corners[np.argmax(corners @ towards_camera.astype(np.float32))]
        scene.add_label(f"{name}/label", text, position=nearest + LABEL_INSIDE * (corners.mean(axis=0) - nearest))


def _add_point(scene: viser.SceneApi, name: str, position: np.ndarray) -> None:
    colour, radius, fine = MARKER, MARKER_RADIUS_M, 1
    if name == "/com/fused":
        colour, radius, fine = BLUE, COM_RADIUS_M, 3
    elif name == "/com/markers_only":
        colour, radius, fine = BROWN, 0.6 * COM_RADIUS_M, 3
    scene.add_icosphere(
        name, radius, colour, subdivisions=fine, position=position, cast_shadow=False, receive_shadow=False
    )


def _add_paths(scene: viser.SceneApi, recording: Recording, frames: Frames) -> None:
    add_path(scene, "/paths/fused", frames.track("/paths/fused"), BLUE, 0.004)
    add_path(scene, "/paths/markers_only", frames.track("/paths/markers_only"), BROWN, 0.003)
    path = frames.track("/paths/fused")
    if path is None or frames.com_sd_m is None:
        return
    there = np.flatnonzero(np.isfinite(path).all(axis=1) & np.isfinite(frames.com_sd_m).all(axis=1))
    if len(there) < 2:
        return
    kept = there[np.unique(np.linspace(0, len(there) - 1, BAND_SAMPLES).astype(int))]
    vertices, faces = shapes.band(path[kept], BAND_WIDTHS * frames.com_sd_m[kept], _direction(recording, path[kept]))
    scene.add_mesh_simple(
        "/paths/band", vertices, faces, color=BLUE, opacity=0.22, side="double", cast_shadow=False, receive_shadow=False
    )


def _first(frames: Frames, at: int) -> np.ndarray:
    track = frames.values[:, at : at + 3]
    there = np.flatnonzero(np.isfinite(track).all(axis=1))
    return track[there[0]].astype(float) if len(there) else np.zeros(3)


def _bounds(recording: Recording, frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """Centre and half extents of everything, from its 2nd to its 98th percentile: a stray marker must not set them."""
    clouds = [frames.values[:, p.at : p.at + 3].reshape(-1, 3) for p in frames.points]
    clouds += [np.asarray(plate.corners_m, dtype=np.float32) for plate in recording.plates if plate.use]
    cloud = np.concatenate(clouds) if clouds else np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.8]])
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if not len(cloud):
        cloud = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.8]])
    low, high = np.percentile(cloud, 2, axis=0), np.percentile(cloud, 98, axis=0)
    return (low + high) / 2, np.maximum((high - low) / 2, 0.3)


def _direction(recording: Recording, path: np.ndarray) -> np.ndarray:
    along = np.asarray(recording.walking_direction or path[-1] - path[0], dtype=float)
    along[2] = 0.0
    length = float(np.linalg.norm(along))
    return along / length if length > 0.2 else np.array([1.0, 0.0, 0.0])


def _place_camera(
    server: viser.ViserServer, centre: np.ndarray, extent: np.ndarray, along: np.ndarray, view: np.ndarray
) -> None:
    """Look from the person's right side, a little from above and ahead, far enough to see the whole way."""
    reach = max(float(extent @ np.abs(along)), 1.9 * float(extent[2]), 1.2)
    server.initial_camera.fov = 0.7
    server.initial_camera.look_at = tuple(centre)
    server.initial_camera.position = tuple(centre + view / np.linalg.norm(view) * reach * 1.7)
