"""Reads a terrain from a file: its surfaces as in a scenario, and the stairs and rails among them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from stridelab.contacts.terrain_meshes.clouds import CLOUD_FORMATS, has_faces, read_cloud, refuse_terrain
from stridelab.contacts.terrain_meshes.height_maps import read_ascii_grid, read_height_image
from stridelab.contacts.terrain_meshes.reading import (
    FORMATS,
    UP_AXES,
    TerrainMesh,
    UpAxis,
    read_terrain_mesh,
    turn_mesh,
    usual_up_axis,
)
from stridelab.contacts.terrain_meshes.samples import sample_triangles
from stridelab.contacts.terrain_meshes.segmenting import TerrainShapes, cloud_shapes, mesh_shapes, segment_terrain
from stridelab.contacts.terrain_meshes.up_axis import UpReading, find_up_axis, turn_up
from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.scenarios import ReadTerrain

TERRAIN_FORMATS = (*FORMATS, *CLOUD_FORMATS, ".asc", ".png", ".xml", ".zip")


def read_terrain(
    path: Path,
    *,
    metres_per_unit: float = 1.0,
    up: UpAxis | None = None,
    cell_m: float | None = None,
    height_m: float | None = None,
    height_range_m: float | None = None,
) -> ReadTerrain:
    """Read the terrain of a file. A stranger's bytes are parsed here: call it in a process with limits.

    The ending tells what it is: a mesh (``.stl``, ``.obj``, ``.ply``, ``.glb``), a cloud of points (``.ply`` without
    faces, ``.xyz``, ``.pts``, ``.csv``, ``.pcd``), a height map (``.asc``, or ``.png`` with cells of ``cell_m`` and
    ``height_m`` for each step of grey, or ``height_range_m`` from black to white), or a scene of MuJoCo (``.xml``,
    ``.zip``), which is always in metres. The axis ``up`` of meshes and clouds is found if it is None and the points
    are clear about it (``find_up_axis``), else that of the format; a remark then names the axis.

    Raises ``UnreadableFile`` (``terrain-mesh-unreadable``, ``terrain-file-unreadable``, and for scenes as
    ``read_scene``) and ``InvalidInput`` (``terrain-without-surfaces``).
    """
    options = {"cell_m": cell_m, "height_m": height_m, "height_range_m": height_range_m}
    read = segment_terrain(_read_shapes(path, metres_per_unit, up, options))
    if not read["terrain"]:
        text = "has no surface on which a foot can stand: at most 35 degrees steep, 10 cm long and wide."
        raise InvalidInput("terrain-without-surfaces", f"{path.name} {text}", [Fault(path.name, "no surface")])
    return ReadTerrain.model_validate(read)


def _read_shapes(
    path: Path, metres_per_unit: float, up: UpAxis | None, options: Mapping[str, float | None]
) -> TerrainShapes:
    ending = path.suffix.lower()
    if ending in (".xml", ".zip"):
        from stridelab.contacts.terrain_meshes.scenes import read_scene  # MuJoCo, which only scenes need

        return read_scene(path)
    if ending == ".asc":
        return cloud_shapes(read_ascii_grid(path, metres_per_unit=metres_per_unit))
    if ending == ".png":
        return cloud_shapes(read_height_image(path, **options))
    if ending in CLOUD_FORMATS or (ending == ".ply" and not has_faces(path)):
        return _cloud_upright(read_cloud(path, metres_per_unit=metres_per_unit, up=up), up)
    if ending not in FORMATS:
        raise refuse_terrain(path, f"Its format is none of {', '.join(TERRAIN_FORMATS)}.")
    return _mesh_upright(read_terrain_mesh(path, metres_per_unit=metres_per_unit, up=up), up, usual_up_axis(path))


def _cloud_upright(points_m: Points, up: UpAxis | None) -> TerrainShapes:
    if up is not None:
        return cloud_shapes(points_m)
    found = find_up_axis(points_m, "+z")
    shapes = cloud_shapes(turn_up(points_m, "+z", found.axis))
    return replace(shapes, remarks=_axis_remarks(found, "+z"))


def _mesh_upright(mesh: TerrainMesh, up: UpAxis | None, usual: UpAxis) -> TerrainShapes:
    if up is not None:
        return mesh_shapes(mesh)
    to_file = UP_AXES[usual].T  # from z up to the axes of the file
    corners_m = mesh.vertices_m[mesh.triangles] @ to_file.T
    areas = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    points_m = sample_triangles(mesh, np.ones(len(mesh.triangles), dtype=bool)) @ to_file.T
    found = find_up_axis(points_m, usual, -areas if mesh.turned else areas)
    if found.axis != usual:
        mesh = turn_mesh(mesh, UP_AXES[found.axis] @ to_file)
    return replace(mesh_shapes(mesh), remarks=_axis_remarks(found, usual))


def _axis_remarks(found: UpReading, usual: UpAxis) -> list[str]:
    if found.axis != usual:
        return [f"It is read with {found.axis} up, since most of it is level then; state another axis if it is wrong."]
    if found.doubtful:
        return [f"It is read with {found.axis} up; another axis may point up, which the points do not tell."]
    return []
