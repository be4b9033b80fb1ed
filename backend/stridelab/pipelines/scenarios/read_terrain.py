"""Reads a terrain from a file: its surfaces as in a scenario, and the stairs and rails among them."""

from pathlib import Path

from stridelab.contacts.terrain_meshes.clouds import CLOUD_FORMATS, has_faces, read_cloud, refuse_terrain
from stridelab.contacts.terrain_meshes.height_maps import read_ascii_grid, read_height_image
from stridelab.contacts.terrain_meshes.reading import FORMATS, UpAxis, read_terrain_mesh
from stridelab.contacts.terrain_meshes.segmenting import TerrainShapes, cloud_shapes, mesh_shapes, segment_terrain
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
) -> ReadTerrain:
    """Read the terrain of a file. A stranger's bytes are parsed here: call it in a process with limits.

    The ending tells what it is: a mesh (``.stl``, ``.obj``, ``.ply``, ``.glb``), a cloud of points (``.ply`` without
    faces, ``.xyz``, ``.pts``, ``.csv``, ``.pcd``), a height map (``.asc``, or ``.png`` with cells of ``cell_m`` and
    ``height_m`` for each step of grey), or a scene of MuJoCo (``.xml``, ``.zip``), which is always in metres.

    Raises ``UnreadableFile`` (``terrain-mesh-unreadable``, ``terrain-file-unreadable``, and for scenes as
    ``read_scene``) and ``InvalidInput`` (``terrain-without-surfaces``).
    """
    read = segment_terrain(_read_shapes(path, metres_per_unit, up, cell_m, height_m))
    if not read["terrain"]:
        text = "has no surface on which a foot can stand: at most 35 degrees steep, 10 cm long and wide."
        raise InvalidInput("terrain-without-surfaces", f"{path.name} {text}", [Fault(path.name, "no surface")])
    return ReadTerrain.model_validate(read)


def _read_shapes(
    path: Path, metres_per_unit: float, up: UpAxis | None, cell_m: float | None, height_m: float | None
) -> TerrainShapes:
    ending = path.suffix.lower()
    if ending in (".xml", ".zip"):
        from stridelab.contacts.terrain_meshes.scenes import read_scene  # MuJoCo, which only scenes need

        return read_scene(path)
    if ending == ".asc":
        return cloud_shapes(read_ascii_grid(path, metres_per_unit=metres_per_unit))
    if ending == ".png":
        return cloud_shapes(read_height_image(path, cell_m=cell_m, height_m=height_m))
    if ending in CLOUD_FORMATS or (ending == ".ply" and not has_faces(path)):
        return cloud_shapes(read_cloud(path, metres_per_unit=metres_per_unit, up=up))
    if ending not in FORMATS:
        raise refuse_terrain(path, f"Its format is none of {', '.join(TERRAIN_FORMATS)}.")
    return mesh_shapes(read_terrain_mesh(path, metres_per_unit=metres_per_unit, up=up))
