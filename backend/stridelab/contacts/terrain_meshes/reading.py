"""Reads the mesh of a terrain: STL, OBJ, PLY or GLB, in metres with z up.

A stranger's bytes are parsed here: call it in a process with limits.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from jaxtyping import Int

from stridelab.conventions import Points, Rotation
from stridelab.errors import Fault, UnreadableFile

UpAxis = Literal["+z", "-z", "+y", "-y", "+x", "-x"]
FORMATS: Final = (".stl", ".obj", ".ply", ".glb")
MAX_BYTES: Final = 64_000_000
MAX_TRIANGLES: Final = 500_000
EXTENT_M: Final = (0.2, 100.0)
"""Smallest and largest horizontal extent of a terrain: beyond it, the unit is wrong."""
LIKELY_M: Final = (0.5, 60.0)
"""Widths of most terrains: units that lead to one are offered."""
UP_AXES: Final[dict[UpAxis, Rotation]] = {
    "+z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "+y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "+x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-x": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
}
"""Rotations to z up."""
Triangles = Int[np.ndarray, "m 3"]
SHOWN_NAME: Final = 120


@dataclass(frozen=True, eq=False)
class TerrainMesh:
    """Triangles that face outwards, in metres with z up; ``turned`` if all of them faced inwards in the file."""

    vertices_m: Points
    triangles: Triangles
    turned: bool = False


def read_terrain_mesh(path: Path, *, metres_per_unit: float = 1.0, up: UpAxis | None = None) -> TerrainMesh:
    """Read a mesh; ``up`` is +y for GLB, as its standard says, and +z for other formats if omitted.

    Raises ``UnreadableFile`` (``terrain-mesh-unreadable``) for a file of another format, a damaged, empty or too large
    one, coordinates that are not finite, and an extent that no terrain has.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise _refuse_mesh(path, f"Its format is none of {', '.join(FORMATS)}.")
    if path.stat().st_size > MAX_BYTES:
        raise _refuse_mesh(path, f"It has more than {MAX_BYTES // 1_000_000} MB.")
    import trimesh  # 17 MB that only these files need

    try:
        loaded: Any = trimesh.load(path, force="mesh", process=False, skip_materials=True)
        vertices, triangles = np.array(loaded.vertices, float), np.array(loaded.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # of the parsers, which raise whatever the bytes lead to
        raise _refuse_mesh(path, "It is damaged, or its content does not match its name.") from error
    if len(triangles) == 0:
        raise _refuse_mesh(path, "It has no triangles.")
    if len(triangles) > MAX_TRIANGLES:
        raise _refuse_mesh(path, f"It has {len(triangles)} triangles; at most {MAX_TRIANGLES} are read.")
    if not np.isfinite(vertices).all() or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise _refuse_mesh(path, "It has coordinates that are not finite, or triangles without corners.")
    R = UP_AXES[up or usual_up_axis(path)]
    vertices_m = np.asarray(vertices * metres_per_unit @ R.T)
    extent_m = float(np.ptp(vertices_m[triangles.ravel(), :2], axis=0).max())
    if not EXTENT_M[0] <= extent_m <= EXTENT_M[1]:
        raise _refuse_mesh(path, describe_extent(extent_m, metres_per_unit))
    turned = _faces_inwards(vertices_m, triangles)
    return TerrainMesh(vertices_m, triangles[:, ::-1] if turned else triangles, turned)


def usual_up_axis(path: Path) -> UpAxis:
    """The axis that points up in files of a format: y in GLB, z in all others."""
    return "+y" if path.suffix.lower() == ".glb" else "+z"


def turn_mesh(mesh: TerrainMesh, R: Rotation) -> TerrainMesh:
    """The mesh turned by ``R``; an open mesh faces up afterwards."""
    vertices_m = np.asarray(mesh.vertices_m @ R.T)
    again = _faces_inwards(vertices_m, mesh.triangles)
    return TerrainMesh(vertices_m, mesh.triangles[:, ::-1] if again else mesh.triangles, mesh.turned != again)


def describe_extent(extent_m: float, metres_per_unit: float) -> str:
    """Why an extent is none of a terrain, and the units with which it would be one of 0.5 to 60 m."""
    fitting = [
        f"in {name} it would be {extent_m / metres_per_unit * metres:.3g} m wide"
        for name, metres in (("metres", 1.0), ("centimetres", 0.01), ("millimetres", 0.001))
        if LIKELY_M[0] <= extent_m / metres_per_unit * metres <= LIKELY_M[1]
    ]
    text = f"It is {extent_m:.3g} m wide; a terrain has {EXTENT_M[0]} to {EXTENT_M[1]:g} m. State its unit"
    return text + (f": {', '.join(fitting)}." if fitting else ".")


def _faces_inwards(vertices_m: Points, triangles: Triangles) -> bool:
    """Whether triangles face inwards: a closed mesh has a positive volume, an open one faces up."""
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    areas = 0.5 * np.cross(b - a, c - a)
    is_closed = np.linalg.norm(areas.sum(axis=0)) < 1e-3 * np.linalg.norm(areas, axis=1).sum()
    outwards = (
        float(np.einsum("ij,ij->", a - vertices_m.mean(axis=0), areas)) if is_closed else float(areas[:, 2].sum())
    )
    return outwards < 0.0


def _refuse_mesh(path: Path, reason: str) -> UnreadableFile:
    message = f"The mesh of the terrain cannot be used. {reason}"
    return UnreadableFile("terrain-mesh-unreadable", message, [Fault(path.name[:SHOWN_NAME], "cannot be used")])
