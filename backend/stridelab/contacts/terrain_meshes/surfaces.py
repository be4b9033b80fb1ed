"""Rectangles on which feet can stand, found in the mesh or the scan of a terrain.

Planes are exact, from the triangles of clean meshes, or fitted to the points of scans. In each plane, on a grid, cells
are free that it covers and that no other standable plane covers within ``HEADROOM_M`` above. The largest free
rectangles become boxes with that upper face. Edges of exact rectangles snap to vertices less than a cell away, so that
faces of stairs and ramps keep their size; those of scanned ones are where their outermost points are. Level surfaces
are solid down to the lowest point of the terrain, or a slab where one can walk below; tilted ones are slabs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.scenarios.parts import round_values
from stridelab.contacts.terrain_meshes.growing import LEVEL_RAD, Region, grow_regions, scanned_planes
from stridelab.contacts.terrain_meshes.planes import (
    HEADROOM_M,
    Plane,
    block_below,
    exact_planes,
)
from stridelab.contacts.terrain_meshes.planes import SHORTEST_EDGE_M as SHORTEST_EDGE_M
from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.contacts.terrain_meshes.rectangles import Cells, best_turn_rad, has_square, largest_rectangle, size_of
from stridelab.contacts.terrain_meshes.samples import MESH_SPACING_M, Samples, prepare_samples, sample_triangles
from stridelab.contacts.terrain_meshes.shapes import INSIDE_M, lie_in_boxes
from stridelab.conventions import Mask, Points, Rotation, Vector3
from stridelab.dynamics.spatial import Placement

MAX_SURFACES: Final = 199
"""Of a terrain, which may have a rail beside them."""
SLAB_M: Final = 0.05
FURTHER_SHARE: Final = 0.4
"""Least share of a plane's first rectangle of a further one; of none beside the holes of scans."""
SOLE_M: Final = (0.12, 0.2)
"""Least width and length of a further rectangle: smaller ones are splinters beside the first."""
DEEP_M: Final = 0.21
"""Edges of rectangles of scans that are preferred: TALOS' sole is 21 cm long."""
DEEP_SHARE: Final = 0.4
"""Least share of the largest rectangle of a preferred one."""
TURNED_GAIN: Final = 1.15
"""Least growth of the largest rectangle for which a plane's axes are turned."""
TURNED_FILL: Final = 0.9
"""Share of its bounds below which a plane is no rectangle, and other directions are tried."""
TURNED_M2: Final = 4.0
STRIP_SPACINGS: Final = 2.0
LEAST_UNDERSIDE_M2: Final = 0.04
THICKEST_SLAB_M: Final = 0.3
"""How far below a plane an underside is that of its own slab, and no obstacle beside it."""
LEAST_SAMPLED: Final = -0.1
"""Vertical part of the normals of triangles from which on they are sampled: undersides hold no foot."""
Place2 = Float[np.ndarray, "2"]
UpperFace = tuple[Rotation, Vector3, Place2]
"""Rotation of a box, middle of its upper face, and half the edges of that face."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Points of a scan, and the flat regions among them."""

    samples: Samples
    regions: list[Region]


@dataclass(frozen=True, eq=False)
class Standing:
    """Boxes of a scenario's terrain, how many more were left out, and the scans of the mesh and of the cloud.

    ``undersides`` are the faces of the mesh that look down and are in no box.
    """

    boxes: list[dict[str, Any]]
    dropped: int
    scans: list[Scan]
    undersides: list[Scan]


def standing_surfaces(mesh: TerrainMesh) -> list[dict[str, Any]]:
    """Boxes of a scenario's terrain (``BoxSurface``), from the largest on, at most ``MAX_SURFACES``."""
    return find_standing(mesh, np.zeros((0, 3))).boxes


def find_standing(mesh: TerrainMesh, cloud_m: Points) -> Standing:
    """The surfaces of a mesh and of a cloud of points, either of which may be empty."""
    planes, free = exact_planes(mesh)
    up = _upward_part(mesh)
    scanned = free & (up > LEAST_SAMPLED)
    scans = []
    for points_m, from_mesh in ((sample_triangles(mesh, scanned), True), (cloud_m, False)):
        samples = prepare_samples(points_m, from_mesh=from_mesh)
        if samples is not None:
            scans.append(Scan(samples, grow_regions(samples)))
            planes += scanned_planes(samples, scans[-1].regions)
    floor_m = min(
        float(mesh.vertices_m[mesh.triangles.ravel(), 2].min(initial=np.inf)),
        float(np.quantile(cloud_m[:, 2], 0.001)) if len(cloud_m) else np.inf,
    )
    boxes = sorted(_boxes_of(planes, floor_m), key=lambda one: -one[0])
    undersides = _scan_undersides(mesh, up <= LEAST_SAMPLED, [box for _, box in boxes], planes)
    if undersides:
        above = [plane for scan in undersides for plane in scanned_planes(scan.samples, scan.regions)]
        boxes = sorted(_boxes_of(planes, floor_m, above), key=lambda one: -one[0])
    named = [{"name": f"surface {k + 1}"} | box for k, (_, box) in enumerate(boxes[:MAX_SURFACES])]
    return Standing(named, max(len(boxes) - MAX_SURFACES, 0), scans, undersides)


def _scan_undersides(
    mesh: TerrainMesh, down: Mask, boxes: Sequence[Mapping[str, Any]], planes: Sequence[Plane]
) -> list[Scan]:
    """The faces of a mesh that look down, as a scan; without those in a box, on a plane, and below one as of a slab."""
    points_m = sample_triangles(mesh, down)
    points_m = points_m[~lie_in_boxes(boxes, points_m)]
    for plane in planes:
        above_m, covered = plane.heights_above(points_m)
        points_m = points_m[~(covered & (above_m > -THICKEST_SLAB_M) & (above_m < INSIDE_M))]
    if len(points_m) * MESH_SPACING_M**2 < LEAST_UNDERSIDE_M2:
        return []
    samples = prepare_samples(points_m, from_mesh=True)
    return [] if samples is None else [Scan(samples, grow_regions(samples))]


def _upward_part(mesh: TerrainMesh) -> Float[np.ndarray, "m"]:
    """Vertical part of the normals of triangles, -1 for those without area."""
    corners_m = mesh.vertices_m[mesh.triangles]
    normals = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    return np.asarray(np.where(lengths > 1e-12, normals[:, 2] / np.maximum(lengths, 1e-12), -1.0))


def _boxes_of(
    planes: Sequence[Plane], floor_m: float, above: Sequence[Plane] = ()
) -> Iterator[tuple[float, dict[str, Any]]]:
    """Areas and boxes of the free rectangles of all planes; below planes ``above`` there is no headroom either."""
    for plane in planes:
        free = plane.covered.copy()
        block_below(free, plane, [*planes, *above])
        turned = _turn_to_free(plane, free)
        if turned is not plane:
            free = turned.covered.copy()
            block_below(free, turned, [*(one for one in planes if one is not plane), *above])
        first_m2, share = 0.0, 0.0 if plane.spacing_m and turned is plane else FURTHER_SHARE
        for low_m, high_m in _free_rectangles(turned, free):
            edges_m = high_m - low_m
            area_m2 = float(edges_m.prod())
            is_sole = edges_m.min() >= SOLE_M[0] and edges_m.max() >= SOLE_M[1]
            is_splinter = first_m2 > 0.0 and not (is_sole and area_m2 > share * first_m2)
            if edges_m.min() >= SHORTEST_EDGE_M and not is_splinter:
                first_m2 = max(first_m2, area_m2)
                yield area_m2, _box_below(turned, low_m, high_m, floor_m, planes)


def _turn_to_free(plane: Plane, free: Cells) -> Plane:
    """The plane, with its axes along its largest rectangle if it is small and none itself."""
    at = np.argwhere(free)
    if len(at) * plane.cell_m**2 > TURNED_M2 or len(at) < 4:
        return plane
    bounds = np.prod(np.ptp(at, axis=0) + 1)
    if len(at) > TURNED_FILL * bounds:
        return plane
    turn_rad = best_turn_rad(free, TURNED_GAIN)
    return plane.turn_axes(turn_rad) if turn_rad else plane


def _free_rectangles(plane: Plane, free: Cells) -> Iterator[tuple[Place2, Place2]]:
    """Lower and upper corners of the largest free rectangle, of the largest in what it leaves, and so on."""
    least = int((SHORTEST_EDGE_M - plane.cell_m) / plane.cell_m)
    for _ in range(MAX_SURFACES):
        if not has_square(free, least):
            return
        span = largest_rectangle(free)
        if plane.spacing_m:  # beside a hole of a scan, a shorter and deeper rectangle holds a sole
            deep = largest_rectangle(free, int(DEEP_M / plane.cell_m))
            span = deep if size_of(deep) > DEEP_SHARE * size_of(span) else span
        (i, j), (k, m) = span
        if min(k - i, m - j) * plane.cell_m < SHORTEST_EDGE_M - plane.cell_m:
            return
        free[i:k, j:m] = False
        ends_m = plane.low_m + plane.cell_m * np.array([(i, j), (k, m)])
        yield _outermost_edges(plane, ends_m) if plane.spacing_m else _snapped_edges(plane, ends_m)


def _snapped_edges(plane: Plane, ends_m: Float[np.ndarray, "2 2"]) -> tuple[Place2, Place2]:
    """Edges at vertices less than a cell away, else half a cell inwards."""
    for end, inwards_m in ((0, 0.5 * plane.cell_m), (1, -0.5 * plane.cell_m)):
        for axis in range(2):
            apart_m = np.abs(plane.places_m[:, axis] - ends_m[end, axis])
            nearest = int(np.argmin(apart_m))
            snaps = apart_m[nearest] < plane.cell_m
            ends_m[end, axis] = plane.places_m[nearest, axis] if snaps else ends_m[end, axis] + inwards_m
    return ends_m[0], ends_m[1]


def _outermost_edges(plane: Plane, ends_m: Float[np.ndarray, "2 2"]) -> tuple[Place2, Place2]:
    """Edges half a spacing beyond the outermost points: their median over strips across the edge.

    An edge beyond which the plane goes on, below another one, stays.
    """
    low_m, high_m = ends_m[0].copy(), ends_m[1].copy()
    window_m = 2.0 * plane.spacing_m + 1.5 * plane.cell_m
    for axis in range(2):
        other = 1 - axis
        within = (plane.places_m[:, other] > low_m[other]) & (plane.places_m[:, other] < high_m[other])
        along_m, out_m = plane.places_m[within][:, other], plane.places_m[within][:, axis]
        strips = np.floor((along_m - low_m[other]) / (STRIP_SPACINGS * plane.spacing_m)).astype(int)
        for end, sign in ((0, -1.0), (1, 1.0)):
            edge_m = sign * float((low_m, high_m)[end][axis])
            beyond = sign * out_m
            near = (beyond > edge_m - window_m) & (beyond < edge_m + window_m)
            count = max(int(strips.max(initial=0)) + 1, 1)
            outermost = np.full(count, -np.inf)
            np.maximum.at(outermost, strips[near], beyond[near])
            outermost = outermost[np.isfinite(outermost)]
            goes_on = (beyond > edge_m + window_m).sum() > 0.3 * count
            if len(outermost) and not goes_on:
                ends_m[end, axis] = sign * (float(np.median(outermost)) + 0.5 * plane.spacing_m)
    return ends_m[0], ends_m[1]


def _box_below(plane: Plane, low: Place2, high: Place2, floor_m: float, planes: Sequence[Plane]) -> dict[str, Any]:
    """A box whose upper face is a rectangle of a plane."""
    top_m = plane.place_in_world((0.5 * (low + high))[None])[0]
    depth_m = SLAB_M
    if plane.R[2, 2] > np.cos(LEVEL_RAD) and not _has_way_below(plane, low, high, planes):
        depth_m = max(float(top_m[2]) - floor_m, SLAB_M)
    return {
        "kind": "box",
        "center_m": round_values((top_m - 0.5 * depth_m * plane.R[:, 2]).tolist()),
        "size_m": round_values((*(high - low).tolist(), depth_m)),
        "orientation_wxyz": round_values(Placement(top_m, plane.R).wxyz.tolist()),
    }


def _has_way_below(plane: Plane, low: Place2, high: Place2, planes: Sequence[Plane]) -> bool:
    """Whether another plane lies below a rectangle with headroom between them."""
    steps = [np.linspace(a, b, 7)[1:-1] for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    points_m = plane.place_in_world(places)
    for other in planes:
        if other is not plane and other.is_near(plane):
            above_m, covered = other.heights_above(points_m)
            if (covered & (above_m > HEADROOM_M)).any():
                return True
    return False


def upper_faces(boxes: Sequence[Mapping[str, Any]]) -> list[UpperFace]:
    """Rotation, middle of the upper face and half its edges, of every box."""
    faces = []
    for box in boxes:
        R = Placement.from_wxyz(box["center_m"], box["orientation_wxyz"]).rotation
        size_m = np.array(box["size_m"])
        faces.append((R, np.array(box["center_m"]) + 0.5 * size_m[2] * R[:, 2], 0.5 * size_m[:2]))
    return faces
