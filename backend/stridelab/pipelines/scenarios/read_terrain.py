"""Reads a terrain from a file: its surfaces as in a scenario, and the stairs and rails among them."""

from pathlib import Path

from stridelab.contacts.terrain_meshes.reading import UpAxis, read_terrain_mesh
from stridelab.contacts.terrain_meshes.surfaces import standing_surfaces
from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.terrains import ReadTerrain


def read_terrain(path: Path, *, metres_per_unit: float = 1.0, up: UpAxis | None = None) -> ReadTerrain:
    """Read the terrain of a file. A stranger's bytes are parsed here: call it in a process with limits.

    Raises ``UnreadableFile`` (``terrain-mesh-unreadable``) and ``InvalidInput`` (``terrain-without-surfaces``).
    """
    surfaces = standing_surfaces(read_terrain_mesh(path, metres_per_unit=metres_per_unit, up=up))
    if not surfaces:
        text = "has no surface on which a foot can stand: at most 35 degrees steep, 10 cm long and wide."
        raise InvalidInput("terrain-without-surfaces", f"{path.name} {text}", [Fault(path.name, "no surface")])
    return ReadTerrain.model_validate({"terrain": surfaces})
