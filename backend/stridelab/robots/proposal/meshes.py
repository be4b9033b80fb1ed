"""Converts a stranger's meshes: hulls for collision, decimated surfaces for display, in binary STL and in metres."""

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import coal
import fast_simplification
import numpy as np
import pinocchio as pin
from jaxtyping import Float, Float32, Int
from scipy.spatial import ConvexHull, QhullError

from stridelab.conventions import Points
from stridelab.errors import Fault, UnreadableFile
from stridelab.robots.proposal.archive import UnpackedRobot
from stridelab.robots.proposal.collada import (
    Colour,
    collada_parts,
    may_repeat_nodes,
    part_alone,
    part_colour,
    states_y_up,
    unit_m,
)
from stridelab.robots.proposal.description import read_xml

Faces = Int[np.ndarray, "m 3"]
MAX_TRIANGLES: Final = 1_500_000
"""Triangles of all displayed meshes together that are read; later meshes are not displayed."""
SHOWN_TRIANGLES: Final = 6_000
"""Triangles of one displayed mesh."""
MERGED_M: Final = 1e-3
MERGED_SHARES: Final = 200
"""Vertices of a displayed mesh that has too many triangles are merged on a grid of this width, or of this share of its
extent. Without it, the edge collapses stop at the seams of bodies made of many shells, after twenty times the time."""
MAX_EXTENT_M: Final = 10.0
R_Z_UP: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From axes whose y points up to axes whose z does."""
OPEN_AREA_SHARE: Final = 1e-3
"""Share of the area of a surface by which its area vectors may fail to cancel in a closed one."""
TURNED: Final = 0.7
"""Ratio of the distances of shapes from centres of mass, turned and as they are, below which the shapes are turned."""
MAX_COLLADA_BYTES: Final = 64_000_000
MAX_PARTS: Final = 300
"""Parts of a COLLADA file that are read one by one; a displayed mesh of more is left out."""
_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""Record of a binary STL."""
_STL_HEADER_BYTES: Final = 84
_POINT: Final = np.dtype((np.void, 12))


@dataclass
class MeshConverter:
    """Converts the meshes that a description names; ``package`` is the first part of the names that it returns.

    ``assumed`` maps displayed meshes that were left out to the reason.
    """

    upload: UnpackedRobot
    folder: Path
    package: str
    assumed: dict[str, str] = field(default_factory=dict)
    _converted: dict[tuple[Path, tuple[float, ...], bool], str | None] = field(default_factory=dict)
    _read: dict[Path, "_Surface"] = field(default_factory=dict)
    _triangles: int = 0
    missing: list[str] = field(default_factory=list)
    y_up: set[str] = field(default_factory=set)
    """Names of the converted meshes whose COLLADA file states that its y axis points up."""
    colours: dict[str, Colour] = field(default_factory=dict)
    """Colours of the converted meshes whose COLLADA file states any: that of the largest part of the surface."""

    def convert(self, filename: str, scale: Sequence[float], is_collision: bool) -> str | None:
        """Name of the converted mesh; None for a displayed mesh that is missing or too large.

        A missing mesh for collision is collected in ``missing``. Raises ``UnreadableFile`` (``robot-mesh-unreadable``)
        for a mesh that is damaged or whose size is not plausible.
        """
        path = self.upload.find_mesh(filename)
        if path is None:
            (self.missing.append(filename) if is_collision else None)
            self.assumed.setdefault(f"mesh {filename[:120]}", "missing, left out")
            return None
        key = (path, tuple(scale), is_collision)
        if key not in self._converted:
            self._converted[key] = self._convert(path, filename, np.array(scale), is_collision=is_collision)
        return self._converted[key]

    def _convert(self, path: Path, filename: str, scale: np.ndarray, *, is_collision: bool) -> str | None:
        if path not in self._read:
            if path.suffix == ".stl" and path.stat().st_size > _STL_HEADER_BYTES and not is_collision:
                self._triangles += (path.stat().st_size - _STL_HEADER_BYTES) // _TRIANGLE.itemsize
                if self._triangles > MAX_TRIANGLES:
                    self.assumed[f"mesh {filename[:120]}"] = "too many triangles, left out"
                    return None
            self._read[path] = _load_surface(path, filename)
        read = self._read[path]
        unit = unit_m(path) if path.suffix.lower() == ".dae" and np.array_equal(scale, np.ones(3)) else 1.0
        if unit != 1.0:
            self.assumed[f"mesh {filename[:120]}"] = f"in the unit of {unit:g} m that its file states, as in RViz"
        vertices, faces = read.vertices * scale * unit, read.faces
        extent_m = float(np.ptp(vertices, axis=0).max())
        if not np.isfinite(vertices).all() or not 1e-5 < extent_m < MAX_EXTENT_M:
            message = f"The mesh is {extent_m:.3g} m wide; lengths must be in metres (see the scale of the mesh)."
            raise _unreadable(filename, message)
        if is_collision:
            vertices, faces = _convex_hull(vertices)
        elif len(faces) == 0:
            self.assumed[f"mesh {filename[:120]}"] = f"more than {MAX_PARTS} parts, left out"
            return None
        else:
            if len(faces) > SHOWN_TRIANGLES:
                vertices, faces = _merge_close(vertices, faces, min(MERGED_M, extent_m / MERGED_SHARES))
            if len(faces) > SHOWN_TRIANGLES:
                vertices, faces = fast_simplification.simplify(
                    vertices.astype(np.float32), faces.astype(np.int32), target_count=SHOWN_TRIANGLES, agg=5
                )
            if np.prod(np.sign(scale)) < 0.0:
                faces = faces[:, ::-1]
            if _faces_inwards(vertices, faces):
                faces = faces[:, ::-1]
                self.assumed[f"mesh {filename[:120]}"] = "its triangles faced inwards, as in left-handed axes; turned"
        name = f"mesh-{sum(1 for made in self._converted.values() if made):04d}.stl"
        (self.folder / name).write_bytes(binary_stl(np.asarray(vertices, float), np.asarray(faces)))
        if path.suffix.lower() == ".dae" and states_y_up(path):
            self.y_up.add(f"package://{self.package}/{name}")
        if read.colour is not None:
            self.colours[f"package://{self.package}/{name}"] = read.colour
        return f"package://{self.package}/{name}"


def binary_stl(vertices_m: Points, faces: Faces) -> bytes:
    """A triangle mesh as binary STL."""
    record = np.zeros(len(faces), _TRIANGLE)
    record["corners"] = corners = vertices_m[faces].astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    record["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return bytes(80) + np.array(len(faces), "<u4").tobytes() + record.tobytes()


def read_mesh(path: Path) -> Points:
    """Corners of the triangles of a converted mesh, (3 m, 3), in metres."""
    corners = _binary_stl_corners(path)
    return np.zeros((1, 3)) if corners is None else corners.astype(float)


def turn_y_up_shapes(root: ET.Element, folder: Path, y_up: Collection[str], assumed: dict[str, str]) -> None:
    """Turn shapes of COLLADA meshes with y up to z up in a plain description, if they fit the links better then.

    Some programs apply the up axis that a COLLADA file states, others ignore it, and descriptions are written for
    either. The shapes of the robot fit where their middles are near the centres of mass of their links: with both
    readings the distances, weighted by mass, are summed over the links; all shapes are turned where the sum falls below
    ``TURNED`` of the other. ``assumed`` is extended.
    """
    as_is_m, turned_m, origins = 0.0, 0.0, []
    for link in root.findall("link"):
        com, mass = link.find("inertial/origin"), link.find("inertial/mass")
        for shape in (*link.findall("collision"), *link.findall("visual")):
            mesh, origin = shape.find("geometry/mesh"), shape.find("origin")
            if mesh is None or origin is None or mesh.attrib["filename"] not in y_up:
                continue
            origins.append(origin)
            if com is None or mass is None:
                continue
            points = read_mesh(folder / mesh.attrib["filename"].rsplit("/", 1)[1])
            middle_m = 0.5 * (points.min(axis=0) + points.max(axis=0))
            T, com_m, mass_kg = (
                placement_of_element(origin),
                placement_of_element(com).translation,
                float(mass.attrib["value"]),
            )
            as_is_m += mass_kg * float(np.linalg.norm(T.act(middle_m) - com_m))
            turned_m += mass_kg * float(np.linalg.norm(T.act(R_Z_UP @ middle_m) - com_m))
    if not turned_m < TURNED * as_is_m:
        return
    for origin in origins:
        rpy = pin.rpy.matrixToRpy(placement_of_element(origin).rotation @ R_Z_UP)
        origin.set("rpy", " ".join(repr(float(angle)) for angle in rpy))
    assumed["meshes with y up"] = (
        f"turned to z up, as their files state: their middles are then {turned_m / as_is_m:.2f} times as far from the "
        "centres of mass of their links"
    )


def colour_shapes(root: ET.Element, colours: Mapping[str, Colour], assumed: dict[str, str]) -> None:
    """Give displayed shapes of a plain description the ``colours`` that the files of their meshes state.

    They take precedence over a colour of the description, as in RViz: some descriptions state black for all links and
    leave the rest to the meshes. ``assumed`` is extended.
    """
    for visual in root.findall("link/visual"):
        mesh = visual.find("geometry/mesh")
        rgb = None if mesh is None else colours.get(mesh.attrib["filename"])
        if rgb is None:
            continue
        color = visual.find("material/color")
        if color is None:
            name = mesh.attrib["filename"].rsplit("/", 1)[-1]  # type: ignore[union-attr]
            color = ET.SubElement(ET.SubElement(visual, "material", name=name), "color", rgba="0 0 0 1")
        else:
            assumed["colours"] = "those of the meshes' own files, in place of those of the description, as in RViz"
        opacity = color.attrib["rgba"].split()[3]
        color.set("rgba", " ".join([*(repr(float(value)) for value in rgb), opacity]))


def placement_of_element(origin: ET.Element | None) -> pin.SE3:
    """Placement of an ``origin`` of a description, the identity where it has none."""
    if origin is None:
        return pin.SE3.Identity()
    rpy, xyz = (np.array(origin.get(key, "0 0 0").split(), float) for key in ("rpy", "xyz"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _merge_close(
    vertices: Points, faces: Faces, width_m: float
) -> tuple[Float[np.ndarray, "n_kept 3"], Int[np.ndarray, "m_kept 3"]]:
    """One vertex for all in a cell of a grid; triangles that lose an edge are left out."""
    cells = np.round((vertices - vertices.min(axis=0)) / width_m).astype(np.int64)
    _, first, merged = np.unique(cells @ (1 << np.array([0, 21, 42])), return_index=True, return_inverse=True)
    faces = merged.reshape(-1)[faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return vertices[first], faces[kept]


def _faces_inwards(vertices: Points, faces: Faces) -> bool:
    """Whether a closed surface is inside out; of an open one nothing is known.

    The area vectors of a closed surface cancel, and the volume that it encloses is negative if they point inwards.
    """
    a, b, c = ((vertices - vertices.mean(axis=0))[faces[:, k]] for k in range(3))
    areas = 0.5 * np.cross(b - a, c - a)
    closed = np.linalg.norm(areas.sum(axis=0)) < OPEN_AREA_SHARE * np.linalg.norm(areas, axis=1).sum()
    return bool(closed and np.einsum("ij,ij->", a, areas) < 0.0)


def _convex_hull(vertices: Points) -> tuple[Float[np.ndarray, "n_hull 3"], Faces]:
    """Convex hull with outward triangles; a flat mesh gets a thickness of 1 mm."""
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        spread = vertices[:, None] + 5e-4 * np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        vertices = spread.reshape(-1, 3)
        hull = ConvexHull(vertices)
    faces = hull.simplices.copy()
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    used = np.unique(faces)
    return vertices[used], np.searchsorted(used, faces)


@dataclass(frozen=True, eq=False)
class _Surface:
    """Triangles of a file, and the colour of the largest part of them; none if they have too many parts."""

    vertices: Points
    faces: Faces
    colour: Colour | None = None


def _load_surface(path: Path, filename: str) -> _Surface:
    if (corners := _binary_stl_corners(path)) is not None:
        _, first, index = np.unique(corners.view(_POINT), return_index=True, return_inverse=True)
        return _Surface(corners[first].astype(float), index.reshape(-1, 3))
    try:
        surface = _load_parts(path, filename) if path.suffix.lower() == ".dae" else _load_all(path)
    except (ValueError, RuntimeError, IndexError) as error:
        raise _unreadable(filename, "The mesh is damaged, or its content does not match its name.") from error
    if len(surface.vertices) < 3:
        raise _unreadable(filename, "The mesh has no triangles.")
    return surface


def _load_all(path: Path) -> _Surface:
    if path.suffix.lower() == ".obj":
        import trimesh  # 17 MB that only these files need

        mesh = trimesh.load_mesh(path, process=False, skip_materials=True, group_material=False)
        return _Surface(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64).reshape(-1, 3))
    mesh = coal.MeshLoader().load(str(path), np.ones(3))
    faces = [[t[0], t[1], t[2]] for t in (mesh.tri_indices(i) for i in range(mesh.num_tris))]
    return _Surface(np.array(mesh.vertices()), np.array(faces, np.int64).reshape(-1, 3))


def _load_parts(path: Path, filename: str) -> _Surface:
    """A COLLADA file, of which every part is read alone.

    coal numbers the triangles of all parts of a geometry (one for each of its materials) from the first vertex of the
    first one, which mixes up the triangles of all others; the vertices are right.
    """
    try:
        root = read_xml(path, filename, MAX_COLLADA_BYTES)
    except UnreadableFile:  # with a document type, or too large
        return _load_all(path)
    parts = list(collada_parts(root))
    whole = _load_all(path) if not 0 < len(parts) <= MAX_PARTS or may_repeat_nodes(root) else None
    if whole is not None and len(parts) > MAX_PARTS:
        return _Surface(whole.vertices, whole.faces[:0])
    surfaces: list[_Surface] = []
    areas_m2: dict[Colour, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder, "part.dae")
        for part in parts:
            alone.write_bytes(part_alone(root, part))
            surfaces.append(surface := _load_all(alone))
            if (colour := part_colour(root, part)) is not None:
                areas_m2[colour] = areas_m2.get(colour, 0.0) + _surface_area_m2(surface)
    largest = max(areas_m2, key=lambda colour: areas_m2[colour]) if areas_m2 else None
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    if whole is not None and starts[-1] != len(whole.vertices):  # parts that other nodes of the file repeat
        return _Surface(whole.vertices, whole.faces, largest)
    faces = [surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
    return _Surface(np.concatenate([surface.vertices for surface in surfaces]), np.concatenate(faces), largest)


def _surface_area_m2(surface: _Surface) -> float:
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _binary_stl_corners(path: Path) -> Float32[np.ndarray, "k 3"] | None:
    """Three corners per triangle of a binary STL; None for a file of another format, or without triangles."""
    if path.suffix.lower() != ".stl" or path.stat().st_size <= _STL_HEADER_BYTES:
        return None
    content = path.read_bytes()
    count = int.from_bytes(content[80:_STL_HEADER_BYTES], "little")
    if count == 0 or len(content) != _STL_HEADER_BYTES + count * _TRIANGLE.itemsize:
        return None
    triangles = np.frombuffer(content, _TRIANGLE, offset=_STL_HEADER_BYTES)
    return np.ascontiguousarray(triangles["corners"].reshape(-1, 3)) + np.float32(0.0)  # no negative zeros


def _unreadable(filename: str, message: str) -> UnreadableFile:
    return UnreadableFile("robot-mesh-unreadable", message, [Fault(filename[:120], "cannot be read")])
