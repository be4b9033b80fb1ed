"""Obstacles of a terrain: boxes that no body may pass, and what no box explains.

A box of a mesh or a scene is an obstacle if no foot stands on it. Of a scan, two faces of a wall that look away from
each other are a box, other faces thin ones (``seen_faces``). What is in no box is counted, to be named.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from stridelab.contacts.scenarios.parts import round_values
from stridelab.contacts.terrain_meshes.growing import Region
from stridelab.contacts.terrain_meshes.planes import STEEPEST_RAD
from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.contacts.terrain_meshes.samples import Samples, sample_triangles
from stridelab.contacts.terrain_meshes.seen_faces import has_opening
from stridelab.contacts.terrain_meshes.shapes import Bar, Solid, frames_of_boxes, lie_in_boxes, lie_in_frames
from stridelab.dynamics.spatial import Placement

LEAST_EDGE_M: Final = 0.1
"""Longest edge of the smallest obstacle."""
WALL_M: Final = (0.3, 0.5)
"""Least width and height of a wall of a scan."""
WALL_THICK_M: Final = (0.03, 0.4)
UPRIGHT: Final = 0.1
"""Largest vertical part of the normal of a wall."""
SHARED: Final = 0.5
FILLED: Final = 0.7
LEAST_POST_M: Final = 0.3


def box_of_solid(solid: Solid) -> dict[str, Any]:
    """A box of a scenario's terrain."""
    return {
        "kind": "box",
        "center_m": round_values(solid.placement.position_m.tolist()),
        "size_m": round_values(solid.size_m.tolist()),
        "orientation_wxyz": round_values(solid.placement.wxyz.tolist()),
    }


def solid_of_post(bar: Bar) -> Solid | None:
    """The box around an upright bar; None for another one."""
    span = bar.to_m - bar.from_m
    length_m = float(np.linalg.norm(span))
    if length_m < LEAST_POST_M or abs(span[2]) < 0.9 * length_m:
        return None
    d = span / length_m * np.sign(span[2])
    x = np.cross([0.0, 1.0, 0.0], d)
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(d, x), d])
    return Solid(
        Placement(0.5 * (bar.from_m + bar.to_m), R), np.array([2.0 * bar.radius_m, 2.0 * bar.radius_m, length_m])
    )


def obstacle_boxes(solids: Sequence[Solid], boxes: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Boxes of the solids that the standing boxes do not contain, from the largest on."""
    corners = 0.5 * np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
    frames = frames_of_boxes(boxes)
    obstacles = []
    for solid in sorted(solids, key=lambda one: -float(np.prod(one.size_m))):
        corners_m = solid.placement.position_m + (corners * solid.size_m) @ solid.placement.rotation.T
        points_m = np.concatenate([corners_m, solid.placement.position_m[None]])
        if solid.size_m.max() >= LEAST_EDGE_M and not lie_in_frames(frames, points_m).all():
            obstacles.append(box_of_solid(solid))
            frames += frames_of_boxes(obstacles[-1:])
    return obstacles


def scanned_walls(samples: Samples, regions: Sequence[Region]) -> list[Solid]:
    """Boxes between two upright regions of a scan that cover each other, with nothing known between them."""
    upright = [one for one in regions if abs(one.normal[2]) < UPRIGHT]
    walls = [one for one in upright if _is_filled(samples, one)]
    faces = [_face_of(samples, one) for one in walls]
    solids: list[Solid] = []
    used: set[int] = set()
    for i, (R, low, high, offset_m) in enumerate(faces):
        if i in used or (high - low < WALL_M).any():
            continue
        for j in range(i + 1, len(faces)):
            other, other_low, other_high, other_offset_m = faces[j]
            if j in used or abs(other[:, 2] @ R[:, 2]) < 0.99:
                continue
            corners = np.array([(*other_low, other_offset_m), (*other_high, other_offset_m)]) @ other.T @ R
            thick_m = float(corners[:, 2].mean()) - offset_m
            lower, upper = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
            shared = np.minimum(high, upper) - np.maximum(low, lower)
            wide = np.maximum(high - low, upper - lower)
            if WALL_THICK_M[0] < abs(thick_m) < WALL_THICK_M[1] and (shared > SHARED * wide).all():
                lowest, highest = np.maximum(low, lower), np.minimum(high, upper)
                middle = np.append(0.5 * (lowest + highest), offset_m + 0.5 * thick_m)
                axes = np.column_stack([R[:, 0], -R[:, 2], R[:, 1]])
                size_m = np.array([highest[0] - lowest[0], abs(thick_m), highest[1] - lowest[1]])
                solids.append(Solid(Placement(R @ middle, axes), size_m))
                used |= {i, j}
                break
    return solids


def _is_filled(samples: Samples, region: Region) -> bool:
    """Whether a region fills its rectangle: a riser with a post above it, or a wall with a door, does not."""
    R, low, high, _ = _face_of(samples, region)
    is_full = float(region.members.sum()) * samples.spacing_m**2 > FILLED * float(np.prod(high - low))
    return is_full and not has_opening(samples, region, R)


def _face_of(samples: Samples, region: Region) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Axes of an upright region (along it, up, normal), its lower and upper corner in them, and its place."""
    n = np.append(region.normal[:2], 0.0)
    n /= np.linalg.norm(n)
    up = np.array([0.0, 0.0, 1.0])
    R = np.column_stack([np.cross(up, n), up, n])
    members = region.members & (np.abs(samples.normals @ n) > 0.9)  # not those of the floor at its foot
    local = samples.points_m[members if members.any() else region.members] @ R
    low, high = np.quantile(local[:, :2], [0.005, 0.995], axis=0)
    return R, low, high, float(local[:, 2].mean())


def unexplained_area_m2(mesh: TerrainMesh, clouds: Sequence[Samples], boxes: Sequence[dict[str, Any]]) -> float:
    """Area of the faces of a mesh and of the points of clouds that no foot can stand on and that are in no box."""
    corners_m = mesh.vertices_m[mesh.triangles]
    areas = 0.5 * np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    size_m2 = np.linalg.norm(areas, axis=1)
    steep = areas[:, 2] < np.cos(STEEPEST_RAD) * size_m2
    points_m = sample_triangles(mesh, steep)
    share = float((~lie_in_boxes(boxes, points_m)).mean()) if len(points_m) else 0.0
    outside_m2 = share * float(size_m2[steep].sum())
    for cloud in clouds:
        walls_m = cloud.points_m[cloud.normals[:, 2] < np.cos(STEEPEST_RAD)]
        outside_m2 += float((~lie_in_boxes(boxes, walls_m)).sum()) * cloud.spacing_m**2
    return outside_m2
