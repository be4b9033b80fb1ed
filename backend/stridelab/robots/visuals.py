"""Visual meshes of a robot: one coloured mesh per moving joint, and the poses of the links in a configuration.

The meshes are built on request from those of the installed data package; the project does not store them. ``glb``
encodes them as binary glTF 2.0 (GLB) for browsers.
"""

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import coal
import fast_simplification
import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int, UInt8
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stridelab.conventions import Points
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Unavailable
from stridelab.robots.robot import Robot
from stridelab.robots.urdf import full_configuration, full_model, visual_geometry

Faces = Int[np.ndarray, "m 3"]
"""Triangles: three vertex indices each, counterclockwise seen from outside."""

_MAX_TRIANGLES: Final = 36_000
"""Triangles of a whole robot, so that its scene with terrain, contacts and forces has at most 40 000."""
TOLERANCES_M: Final = (0.003, 0.014)
"""Square roots of the quadric errors, which are sums over all planes at a vertex: the second is used for robots that
have too many triangles with the first. The outlines of TALOS and G1 then move by up to 4 mm."""
_BASE_ERROR_M2, _LAST_PASS = 1e-9, 103.0
"""The k-th of the 100 passes of fast_simplification collapses edges up to a quadric error of 1e-9 (k + 3)^a, here in
m^2, however many triangles are left; its default a = 7 begins at (1.5 mm)^2."""
_SKIRT_M = 0.01


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """Everything that one joint moves, in the joint's frame; a colour (red, green, blue, opacity) per vertex."""

    name: str
    vertices_m: Points
    faces: Faces
    colours: UInt8[np.ndarray, "n 4"]


def merge_meshes(name: str, meshes: Sequence[LinkMesh]) -> LinkMesh:
    """Concatenate meshes in the same frame; the result may be empty."""
    starts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])[:-1]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)] if meshes else []
    return LinkMesh(
        name,
        np.concatenate([np.zeros((0, 3)), *(mesh.vertices_m for mesh in meshes)]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        np.concatenate([np.zeros((0, 4), np.uint8), *(mesh.colours for mesh in meshes)]),
    )


def mesh_of(shape: pin.GeometryObject, tolerance_m: float = TOLERANCES_M[0]) -> LinkMesh:
    """One visual shape in the frame of its joint, in its own colour, decimated to ``tolerance_m``.

    Raises ``Unavailable`` (``robot-data-unreadable``) for an unsupported kind of shape.
    """
    mirror = np.sign(shape.meshScale)
    vertices, faces = _shape_triangles(shape.geometry, shape.name)
    if isinstance(shape.geometry, coal.BVHModelBase):
        # Not mirrored, so that the two sides of a robot are simplified alike.
        vertices, faces = decimate(vertices * mirror, faces, tolerance_m)
        vertices = vertices * mirror
    if np.prod(mirror) < 0.0:  # a mirrored mesh is inside out
        faces = faces[:, ::-1]
    T_joint_shape = Placement(shape.placement.translation, shape.placement.rotation)
    colour = np.round(255 * np.asarray(shape.meshColor)).astype(np.uint8)
    return LinkMesh(shape.name, T_joint_shape.act(vertices), faces, np.repeat(colour[None], len(vertices), axis=0))


def decimate(
    vertices_m: Points, faces: Faces, tolerance_m: float = TOLERANCES_M[0]
) -> tuple[Float[np.ndarray, "n_shown 3"], Int[np.ndarray, "m_shown 3"]]:
    """Simplify a surface by edge collapses of a quadric error up to ``tolerance_m`` squared.

    The borders of open surfaces are held in place by planes perpendicular to the surface (Garland and Heckbert 1997,
    section 6), here a skirt of triangles that is left out of the result: otherwise whole sheets would shrink, by up to
    46 mm on TALOS' torso. Connected parts that are smaller than ``tolerance_m``, mostly screws, are left out.
    """
    skirt_m, skirt = _border_planes(vertices_m, faces)
    all_m, all_faces = np.concatenate([vertices_m, skirt_m]), np.concatenate([faces, skirt])
    _, _, collapses = fast_simplification.simplify(
        all_m,
        all_faces,
        target_count=0,
        agg=float(np.log(tolerance_m**2 / _BASE_ERROR_M2) / np.log(_LAST_PASS)),
        return_collapses=True,
    )
    points, _, new_of = fast_simplification.replay_simplification(all_m, all_faces, collapses)
    corners = np.asarray(new_of, dtype=np.int64)[faces]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    return _without_small_parts(np.asarray(points, dtype=float), corners, tolerance_m)


def _border_planes(
    vertices_m: Points, faces: Faces
) -> tuple[Float[np.ndarray, "n_more 3"], Int[np.ndarray, "m_more 3"]]:
    """Triangles on both sides of each edge of only one triangle, perpendicular to that, and their further vertices."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = np.sort(edges, axis=1).T
    _, index, count = np.unique(low * len(vertices_m) + high, return_index=True, return_counts=True)
    rim = index[count == 1]
    start, end = edges[rim].T
    a, b, c = (vertices_m[faces[rim // 3, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    further_m, triangles = [], []
    for k, side_m in enumerate((_SKIRT_M, -_SKIRT_M)):
        further_m.append(np.stack([vertices_m[start], vertices_m[end]], axis=1) + side_m * normal[:, None])
        beside = len(vertices_m) + 2 * (k * len(rim) + np.arange(len(rim)))
        triangles += [np.column_stack([end, start, beside]), np.column_stack([end, beside, beside + 1])]
    return np.concatenate(further_m).reshape(-1, 3), np.concatenate(triangles)


def _without_small_parts(
    vertices_m: Points, faces: Faces, size_m: float
) -> tuple[Float[np.ndarray, "n_shown 3"], Int[np.ndarray, "m_shown 3"]]:
    """The connected parts whose bounding box has a diagonal above ``size_m``, or all if none has."""
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    n = len(vertices_m)
    _, part = connected_components(coo_array((np.ones(len(edges)), edges.T), (n, n)), directed=False)
    low_m, high_m = (np.full((n, 3), sign * np.inf) for sign in (1.0, -1.0))
    np.minimum.at(low_m, part, vertices_m)
    np.maximum.at(high_m, part, vertices_m)
    large = (np.linalg.norm(high_m - low_m, axis=1) > size_m)[part[faces[:, 0]]]
    used, corners = np.unique(faces[large] if large.any() else faces, return_inverse=True)
    return vertices_m[used], corners.reshape(-1, 3)


def _shape_triangles(geometry: coal.CollisionGeometry, name: str) -> tuple[Points, Faces]:
    if isinstance(geometry, coal.BVHModelBase):
        corners = (geometry.tri_indices(i) for i in range(geometry.num_tris))
        faces = np.array([(corner[0], corner[1], corner[2]) for corner in corners], dtype=np.int64)
        return np.array(geometry.vertices()), faces
    import trimesh  # 17 MB, and a second, that only robots with simple solids need

    if isinstance(geometry, coal.Cylinder):
        solid = trimesh.creation.cylinder(geometry.radius, 2.0 * geometry.halfLength)
    elif isinstance(geometry, coal.Box):
        solid = trimesh.creation.box(2.0 * geometry.halfSide)
    elif isinstance(geometry, coal.Sphere):
        solid = trimesh.creation.icosphere(2, geometry.radius)
    else:
        kind = type(geometry).__name__
        raise Unavailable("robot-data-unreadable", f"Shape {name} is a {kind}, which is not supported.")
    return np.array(solid.vertices), np.array(solid.faces, dtype=np.int64)


__all__ = ["LinkMesh", "glb", "link_meshes", "link_names", "link_poses", "split_glb"]


def link_names(robot: Robot) -> tuple[str, ...]:
    """Name of the link that each joint moves, the base first: the order of meshes and poses."""
    return tuple(_link_of(robot.model, joint) for joint in range(1, robot.model.njoints))


def visual_shapes(robot: Robot) -> pin.GeometryModel:
    """The visual shapes of ``robot.model``. Raises ``Unavailable`` (``robot-data-unreadable``)."""
    full = full_model(robot.urdf)
    visual = visual_geometry(full, robot.urdf, robot.package_dirs)
    locked_ids = [full.getJointId(joint) for joint in robot.locked]
    return pin.buildReducedModel(full, visual, locked_ids, full_configuration(robot, full))[1]


@lru_cache(maxsize=4)
def link_meshes(robot: Robot) -> tuple[LinkMesh, ...]:
    """One mesh per link of ``link_names``, including the locked links fixed to it.

    Made in some seconds, and once for a robot in a process: the arrays must not be modified.
    Decimated to a quadric error of 3 mm, or of 14 mm if the robot would have more than 36 000 triangles.

    Raises ``Unavailable`` (``robot-data-unreadable``) if the description's meshes cannot be read.
    """
    visual = visual_shapes(robot)
    for tolerance_m in TOLERANCES_M:
        shapes, triangles = [], 0
        for shape in visual.geometryObjects:
            shapes.append((shape.parentJoint, mesh_of(shape, tolerance_m)))
            triangles += len(shapes[-1][1].faces)
            if triangles > _MAX_TRIANGLES and tolerance_m != TOLERANCES_M[-1]:
                break
        else:
            break
    return tuple(
        merge_meshes(name, [mesh for parent, mesh in shapes if parent == joint])
        for joint, name in enumerate(link_names(robot), start=1)
    )


def link_poses(robot: Robot, q: Float[np.ndarray, "nq"]) -> Float[np.ndarray, "n_links 7"]:
    """Pose of every link of ``link_names`` in the world: px, py, pz (m), qw, qx, qy, qz (w >= 0)."""
    return np.asarray(link_pose_frames(robot, q[None])[0])


def link_pose_frames(robot: Robot, q: Float[np.ndarray, "f nq"]) -> Float[np.ndarray, "f n_links 7"]:
    """``link_poses`` of many postures; making room for the kinematics takes far longer than one posture."""
    data, poses = robot.model.createData(), np.empty((len(q), robot.model.njoints - 1, 7))
    for frame, posture in zip(poses, q, strict=True):
        pin.forwardKinematics(robot.model, data, posture)
        frame[:] = [pin.SE3ToXYZQUATtuple(T_world_joint) for T_world_joint in list(data.oMi)[1:]]
    wxyz = poses[:, :, [6, 3, 4, 5]]
    return np.concatenate([poses[:, :, :3], np.where(wxyz[:, :, :1] < 0.0, -wxyz, wxyz)], axis=2)


def _link_of(model: pin.Model, joint: int) -> str:
    """Name of the first body on the joint; bodies that are fixed to it follow in the model."""
    return next(str(f.name) for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY)


_MATT: Final = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7}}
"""Default material: glTF's own is metal, which renders black without an environment to reflect."""
_FLOAT, _UBYTE, _UINT = 5126, 5121, 5125
_VERTICES, _INDICES = 34962, 34963


def glb(meshes: Sequence[LinkMesh]) -> bytes:
    """Encode meshes as GLB: one node per mesh, named after the link, at the origin; empty for an empty mesh.

    URDF colours are sRGB, as URDF viewers interpret them; glTF colours are linear.
    """
    buffer = _Buffer()
    nodes: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    for mesh in meshes:
        nodes.append({"name": mesh.name})
        if not len(mesh.faces):
            continue
        nodes[-1]["mesh"] = len(shapes)
        vertices = mesh.vertices_m.astype(np.float32)
        extent = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
        colours = {"normalized": True}
        attributes = {
            "POSITION": buffer.add_array(vertices, _FLOAT, "VEC3", _VERTICES, extent),
            "COLOR_0": buffer.add_array(srgb_to_linear(mesh.colours), _UBYTE, "VEC4", _VERTICES, colours),
        }
        indices = buffer.add_array(mesh.faces.astype(np.uint32).ravel(), _UINT, "SCALAR", _INDICES, {})
        shapes.append(
            {"name": mesh.name, "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}
        )
    return _encode_glb(nodes, shapes, buffer)


def split_glb(data: bytes) -> dict[str, bytes]:
    """One GLB per node of a file of ``glb``, by its name: what ``glb`` writes of its mesh alone.

    Raises ``ValueError`` for any other content.
    """
    document, binary = _decode_glb(data)
    return {node["name"]: _glb_of_node(node, document, binary) for node in document["nodes"]}


def _glb_of_node(node: Mapping[str, Any], document: Mapping[str, Any], binary: bytes) -> bytes:
    buffer = _Buffer()
    if "mesh" not in node:
        return _encode_glb([node], [], buffer)
    mesh = document["meshes"][node["mesh"]]
    primitive = mesh["primitives"][0]
    attributes = {name: buffer.copy_array(document, binary, k) for name, k in primitive["attributes"].items()}
    indices = buffer.copy_array(document, binary, primitive["indices"])
    alone = {**mesh, "primitives": [{**primitive, "attributes": attributes, "indices": indices}]}
    return _encode_glb([{**node, "mesh": 0}], [alone], buffer)


def _encode_glb(nodes: Sequence[Mapping[str, Any]], meshes: Sequence[Mapping[str, Any]], buffer: "_Buffer") -> bytes:
    document = {
        "asset": {"version": "2.0", "generator": "stridelab"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [_MATT],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    chunks = _glb_chunk(b"JSON", text + b" " * (-len(text) % 4)) + _glb_chunk(b"BIN\0", bytes(buffer.data))
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _decode_glb(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Document and binary chunk of a file of ``glb``. Raises ``ValueError``."""
    if len(data) < 20 or data[:4] != b"glTF" or int.from_bytes(data[8:12], "little") != len(data):
        raise ValueError("not a whole GLB file")
    end = 20 + int.from_bytes(data[12:16], "little")
    document: dict[str, Any] = json.loads(data[20:end])
    return document, data[end + 8 :]


def srgb_to_linear(colours: UInt8[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 4"]:
    """Convert sRGB to linear colours (IEC 61966-2-1), opacity unchanged; 8 bits lose at most 7 of 255."""
    share = colours[:, :3] / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.column_stack([np.round(255.0 * light).astype(np.uint8), colours[:, 3]])


class _Buffer:
    """The binary chunk with its buffer views and accessors; every array is a multiple of four bytes long."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add_array(self, array: np.ndarray, component: int, shape: str, target: int, extra: dict[str, Any]) -> int:
        """Append an array; return its accessor index."""
        raw = np.ascontiguousarray(array).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw), "target": target}
        accessor = {"bufferView": len(self.views), "componentType": component, "type": shape, "count": len(array)}
        self.views.append(view)
        self.accessors.append(accessor | extra)
        self.data += raw
        return len(self.accessors) - 1

    def copy_array(self, document: Mapping[str, Any], binary: bytes, accessor: int) -> int:
        """Append the array of an accessor of another file; return its accessor index."""
        of_array = document["accessors"][accessor]
        view = document["bufferViews"][of_array["bufferView"]]
        self.accessors.append({**of_array, "bufferView": len(self.views)})
        self.views.append({**view, "byteOffset": len(self.data)})
        self.data += binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return len(self.accessors) - 1


def _glb_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack("<I4s", len(data), kind) + data
