"""Reads scenes of MuJoCo (``.xml``, alone, in a folder, or in a ``.zip``) through its own compiler.

Read are the shapes of the world and of bodies fixed to it; bodies with joints, the robots, are left out. Included files
and meshes come from the same folder or zip alone.
"""

import tempfile
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path, PurePosixPath
from typing import Final

import mujoco
import numpy as np

from stridelab.contacts.terrain_meshes.clouds import MAX_POINTS, refuse_terrain
from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.contacts.terrain_meshes.segmenting import TerrainShapes
from stridelab.contacts.terrain_meshes.shapes import Bar, Solid, cylinder_mesh, solid_mesh
from stridelab.conventions import Points, Rotation, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.proposal.archive import UnpackedRobot, unpack_robot
from stridelab.robots.proposal.description import MESHES, read_xml
from stridelab.robots.proposal.mjcf import insert_included

SCENE_FORMATS: Final = (".xml", ".zip")
READ_SECTIONS: Final = ("asset", "compiler", "default", "worldbody")
ASSETS: Final = (*MESHES, ".msh", ".png", ".bin")
MAX_GEOMS: Final = 5_000
MAX_REPLICATED: Final = 2_000
MAX_BESIDE: Final = 5_000
"""Files in the folder of a scene: it is not a whole home."""
MARGIN_M: Final = 1.0
"""How far an endless floor reaches beyond the other shapes."""
LONGEST_REACH_M: Final = 50.0
SECTORS: Final = 32


def read_scene(path: Path) -> TerrainShapes:
    """Read the fixed shapes of a scene.

    Raises ``UnreadableFile`` (``terrain-file-unreadable``) for one that MuJoCo does not compile, without fixed shapes,
    with elements that multiply bodies without limit, or that read other models; those of ``unpack_robot`` and
    ``read_xml`` for a damaged zip or XML.
    """
    with tempfile.TemporaryDirectory() as folder:
        upload = _unpack_scene(path, Path(folder))
        root = read_xml(upload.description, path.name)
        if root.tag != "mujoco":
            raise refuse_terrain(path, f"It is a document <{root.tag[:40]}>, not a scene of MuJoCo (<mujoco>).")
        left_out: list[str] = []
        insert_included(root, upload, left_out)
        remarks = [f"The included file {one[:80]} is missing and was left out." for one in left_out]
        robots = _prune_scene(path, root)
        remarks += [f"Moving bodies are left out: {', '.join(robots[:5])}."] if robots else []
        model = _compile_scene(path, root, upload, remarks)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return _Collector(path, model, data, remarks).collect_shapes()


def _unpack_scene(path: Path, folder: Path) -> UnpackedRobot:
    """The scene and what lies beside it: of a zip, or of the folder of a file."""
    if path.suffix.lower() == ".zip":
        return unpack_robot(path, path.name, folder, _scene_of_zip(path), ASSETS)
    beside: dict[PurePosixPath, Path] = {}
    for k, one in enumerate(path.parent.rglob("*")):
        if k > MAX_BESIDE:
            break
        if one.suffix.lower() in (*ASSETS, ".xml") and one.is_file() and not one.is_symlink():
            beside[PurePosixPath(one.relative_to(path.parent).as_posix())] = one
    parts = {name: one for name, one in beside.items() if name.suffix.lower() == ".xml"}
    meshes = {name: one for name, one in beside.items() if name not in parts}
    return UnpackedRobot(path, PurePosixPath(path.name), meshes, parts)


def _scene_of_zip(path: Path) -> str:
    """The only file of a zip whose name speaks of a scene or a terrain; without, the choice is that of robots."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".xml")]
    except (zipfile.BadZipFile, OSError):
        return ""
    for word in ("terrain", "stair", "scene", ""):
        chosen = [name for name in names if word in PurePosixPath(name).name.lower()]
        if len(chosen) == 1:
            return chosen[0]
    return ""


def _prune_scene(path: Path, root: ET.Element) -> list[str]:
    """Leave assets, defaults and fixed bodies; returns the names of the bodies with joints."""
    for section in [one for one in root if one.tag not in READ_SECTIONS]:
        if section.tag in ("model", "extension"):
            raise refuse_terrain(path, f"It has <{section.tag}>; write its bodies out.")
        root.remove(section)
    moving: list[str] = []

    def prune_children(parent: ET.Element, times: int) -> None:
        for child in list(parent):
            if child.tag in ("composite", "flexcomp", "attach"):
                raise refuse_terrain(path, f"It has <{child.tag}>; write its bodies out.")
            if child.tag == "replicate":
                count = int(child.get("count", "1")) if child.get("count", "1").isdigit() else MAX_REPLICATED + 1
                if times * count > MAX_REPLICATED:
                    raise refuse_terrain(path, f"It replicates shapes more than {MAX_REPLICATED} times.")
                prune_children(child, times * count)
            elif child.tag in ("body", "frame"):
                if child.tag == "body" and (child.get("mocap") == "true" or _has_joint(child)):
                    moving.append(child.get("name", "without a name")[:60])
                    parent.remove(child)
                else:
                    prune_children(child, times)
            elif child.tag != "geom":
                parent.remove(child)

    for world in root.findall("worldbody"):
        prune_children(world, 1)
    return moving


def _has_joint(body: ET.Element) -> bool:
    """Whether a body itself moves: a joint of it, or inside its frames."""
    return any(
        one.tag in ("joint", "freejoint") or (one.tag in ("frame", "replicate") and _has_joint(one)) for one in body
    )


def _compile_scene(path: Path, root: ET.Element, upload: UnpackedRobot, remarks: list[str]) -> mujoco.MjModel:
    """Compile a pruned scene with the meshes and height fields of the upload alone."""
    used = {geom.get(kind) for geom in root.iter("geom") for kind in ("mesh", "hfield")} - {None}
    used |= {
        geom.get(kind) for one in root.findall("default") for geom in one.iter("geom") for kind in ("mesh", "hfield")
    }
    for one in root.iter():
        one.attrib.pop("material", None)
    for compiler in root.iter("compiler"):
        for name in ("meshdir", "assetdir", "texturedir", "discardvisual", "fusestatic"):
            compiler.attrib.pop(name, None)
    assets: dict[str, bytes] = {}
    for section in root.findall("asset"):
        for asset in list(section):
            stated = asset.get("file")
            name = asset.get("name") or PurePosixPath((stated or "").replace("\\", "/")).stem
            if asset.tag not in ("mesh", "hfield") or name not in used:
                section.remove(asset)
                continue
            if stated is None:
                continue
            source = upload.find_mesh(stated)
            if source is None:
                raise refuse_terrain(path, f"The file {stated[:120]} of <{asset.tag}> is not beside it.")
            asset.set("name", name)
            asset.set("file", f"asset-{len(assets):04d}{source.suffix.lower()}")
            assets[asset.get("file", "")] = source.read_bytes()
    for parent in root.iter():
        for one in list(parent) if parent.tag == "default" else ():
            if one.tag not in ("default", "geom", "mesh"):
                parent.remove(one)
    try:
        return mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"), assets=assets).compile()
    except (ValueError, KeyError, mujoco.FatalError) as error:
        raise refuse_terrain(path, f"MuJoCo does not compile it: {' '.join(str(error).split())[:300]}") from error


class _Collector:
    """Collects the shapes of a compiled scene in the world."""

    def __init__(self, path: Path, model: mujoco.MjModel, data: mujoco.MjData, remarks: list[str]) -> None:
        self._path, self._model, self._data = path, model, data
        self._vertices: list[Points] = []
        self._triangles: list[np.ndarray] = []
        self._clouds: list[Points] = []
        self._scene_remarks = remarks
        self._bars: list[Bar] = []
        self._solids: list[Solid] = []
        self._count = 0

    def collect_shapes(self) -> TerrainShapes:
        """All shapes. Raises ``UnreadableFile`` for a scene without any."""
        model = self._model
        touching = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
        geoms = touching or list(range(model.ngeom))
        if not 0 < len(geoms) <= MAX_GEOMS:
            raise refuse_terrain(self._path, f"It has {len(geoms)} fixed shapes; 1 to {MAX_GEOMS} are read.")
        planes = [g for g in geoms if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE]
        others = [g for g in geoms if g not in set(planes)]
        kinds: set[str] = set()
        for g in others:
            self._add_geom(g, kinds)
        self._scene_remarks.extend(f"Shapes of the type {kind} are not read." for kind in sorted(kinds))
        for g in planes:
            self._add_plane(g)
        if not self._vertices and not self._clouds:
            raise refuse_terrain(self._path, "It has no shapes that are read.")
        mesh = TerrainMesh(
            np.concatenate([np.zeros((0, 3)), *self._vertices]),
            np.concatenate([np.zeros((0, 3), dtype=np.int64), *self._triangles]),
        )
        cloud_m = np.concatenate([np.zeros((0, 3)), *self._clouds])
        if len(cloud_m) > MAX_POINTS:
            raise refuse_terrain(self._path, f"Its height fields have {len(cloud_m)} points; at most {MAX_POINTS}.")
        return TerrainShapes(mesh, cloud_m, self._bars, self._solids, self._scene_remarks)

    def _geom_place(self, geom: int) -> tuple[Rotation, Vector3]:
        return np.array(self._data.geom_xmat[geom]).reshape(3, 3), np.array(self._data.geom_xpos[geom])

    def _add_mesh(self, vertices_m: Points, triangles: np.ndarray) -> None:
        self._triangles.append(np.asarray(triangles, dtype=np.int64) + self._count)
        self._vertices.append(np.asarray(vertices_m, dtype=float))
        self._count += len(vertices_m)

    def _add_geom(self, geom: int, kinds: set[str]) -> None:
        R, p = self._geom_place(geom)
        size, kind = np.array(self._model.geom_size[geom]), mujoco.mjtGeom(int(self._model.geom_type[geom]))
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            solid = Solid(Placement(p, R), 2.0 * size)
            self._solids.append(solid)
            self._add_mesh(*solid_mesh(solid))
        elif kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
            bar = Bar(p - size[1] * R[:, 2], p + size[1] * R[:, 2], float(size[0]))
            self._bars.append(bar)
            self._add_mesh(*cylinder_mesh(bar, SECTORS))
        elif kind == mujoco.mjtGeom.mjGEOM_MESH:
            vertices_m, faces = self._mesh_of(int(self._model.geom_dataid[geom]))
            self._add_mesh(vertices_m @ R.T + p, faces)
        elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
            self._clouds.append(self._field_of(int(self._model.geom_dataid[geom])) @ R.T + p)
        else:
            kinds.add(kind.name.removeprefix("mjGEOM_").lower())

    def _mesh_of(self, mesh: int) -> tuple[Points, np.ndarray]:
        model = self._model
        at, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        return (
            np.array(model.mesh_vert[at : at + model.mesh_vertnum[mesh]], float),
            np.array(model.mesh_face[face : face + model.mesh_facenum[mesh]]),
        )

    def _field_of(self, field_id: int) -> Points:
        """Nodes of a height field."""
        model = self._model
        rows, columns = int(model.hfield_nrow[field_id]), int(model.hfield_ncol[field_id])
        at, size = int(model.hfield_adr[field_id]), model.hfield_size[field_id]
        heights = np.array(model.hfield_data[at : at + rows * columns], float).reshape(rows, columns) * size[2]
        x, y = np.meshgrid(np.linspace(-size[0], size[0], columns), np.linspace(-size[1], size[1], rows))
        return np.column_stack([x.ravel(), y.ravel(), heights.ravel()])

    def _add_plane(self, geom: int) -> None:
        """A rectangle; an endless one reaches a metre beyond all other shapes."""
        R, p = self._geom_place(geom)
        size = np.array(self._model.geom_size[geom])
        others_m = np.concatenate([*self._vertices, *self._clouds]) if self._count or self._clouds else p[None]
        local = (others_m - p) @ R
        low, high = local[:, :2].min(axis=0) - MARGIN_M, local[:, :2].max(axis=0) + MARGIN_M
        for axis in range(2):
            if 0.0 < size[axis] <= LONGEST_REACH_M:
                low[axis], high[axis] = -size[axis], size[axis]
        corners = np.array([(low[0], low[1], 0), (high[0], low[1], 0), (high[0], high[1], 0), (low[0], high[1], 0)])
        self._add_mesh(corners @ R.T + p, np.array([(0, 1, 2), (0, 2, 3)]))
