"""Triangles that a viewer can draw, made from the visual shapes of a robot's description."""

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import fast_simplification
import numpy as np
import pinocchio as pin
import trimesh
from jaxtyping import Float, Int, UInt8

from stridelab.conventions import Points
from stridelab.dynamics.placement import Placement
from stridelab.errors import Unavailable

Faces = Int[np.ndarray, "m 3"]
"""Triangles: three vertex indices each, counterclockwise seen from outside."""

_AGGRESSIVENESS = 2.0
"""The k-th of the 100 passes of fast_simplification collapses edges up to a quadric error of 1e-9 (k + 3)^a, here in
m^2. With a = 2 it ends at (3.2 mm)^2, however many triangles are left; its default of 7 begins at (1.5 mm)^2."""


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """All that one joint moves, in the joint's frame; a colour (red, green, blue, opacity) per vertex."""

    name: str
    vertices_m: Points
    faces: Faces
    colours: UInt8[np.ndarray, "n 4"]


def merged(name: str, meshes: Sequence[LinkMesh]) -> LinkMesh:
    """Several meshes in the same frame as one, possibly empty."""
    starts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])[:-1]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)] if meshes else []
    return LinkMesh(
        name,
        np.concatenate([np.zeros((0, 3)), *(mesh.vertices_m for mesh in meshes)]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        np.concatenate([np.zeros((0, 4), np.uint8), *(mesh.colours for mesh in meshes)]),
    )


def mesh_of(shape: pin.GeometryObject) -> LinkMesh:
    """One visual shape in the frame of its joint, in its own colour, decimated to a few millimetres.

    Raises ``Unavailable`` (``robot-data-unreadable``) for a kind of shape that is not known.
    """
    vertices, faces = _triangles(shape)
    if np.prod(np.sign(shape.meshScale)) < 0.0:  # a mirrored mesh is inside out
        faces = faces[:, ::-1]
    T_joint_shape = Placement(shape.placement.translation, shape.placement.rotation)
    colour = np.round(255 * np.asarray(shape.meshColor)).astype(np.uint8)
    return LinkMesh(shape.name, T_joint_shape.act(vertices), faces, np.repeat(colour[None], len(vertices), axis=0))


def decimated(vertices_m: Points, faces: Faces) -> tuple[Float[np.ndarray, "n_shown 3"], Int[np.ndarray, "m_shown 3"]]:
    """The surface with fewer triangles, by edge collapses of least quadric error.

    The rims of open surfaces stay: without them whole sheets would shrink away, by up to 46 mm on TALOS' torso. With
    them 99 % of its original vertices lie within 2.1 mm of what is shown, and single ones in thin sheets at 11 mm.
    """
    points, corners = fast_simplification.simplify(
        vertices_m, faces, target_count=0, agg=_AGGRESSIVENESS, preserve_border=True
    )
    return np.asarray(points, dtype=float), np.asarray(corners, dtype=np.int64)


def _triangles(shape: pin.GeometryObject) -> tuple[Points, Faces]:
    geometry = shape.geometry
    if isinstance(geometry, coal.BVHModelBase):
        corners = (geometry.tri_indices(i) for i in range(geometry.num_tris))
        faces = np.array([(corner[0], corner[1], corner[2]) for corner in corners], dtype=np.int64)
        return decimated(np.array(geometry.vertices()), faces)
    if isinstance(geometry, coal.Cylinder):
        solid = trimesh.creation.cylinder(geometry.radius, 2.0 * geometry.halfLength)
    elif isinstance(geometry, coal.Box):
        solid = trimesh.creation.box(2.0 * geometry.halfSide)
    elif isinstance(geometry, coal.Sphere):
        solid = trimesh.creation.icosphere(2, geometry.radius)
    else:
        kind = type(geometry).__name__
        raise Unavailable("robot-data-unreadable", f"Shape {shape.name} is a {kind}, which cannot be shown.")
    return np.array(solid.vertices), np.array(solid.faces, dtype=np.int64)
