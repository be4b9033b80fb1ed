"""Segments a terrain into surfaces of a scenario: standing surfaces, rails and obstacles, and the stairs among them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from stridelab.contacts.terrain import Rail, bounding_box
from stridelab.contacts.terrain_meshes.obstacles import (
    box_of_solid,
    obstacle_boxes,
    scanned_walls,
    solid_of_post,
    unexplained_area_m2,
)
from stridelab.contacts.terrain_meshes.planes import STEEPEST_RAD
from stridelab.contacts.terrain_meshes.rails import fit_rails, is_rail, rail_surfaces
from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.contacts.terrain_meshes.seen_faces import clutter_boxes, steep_regions, thin_boxes
from stridelab.contacts.terrain_meshes.shapes import Bar, Solid, lie_in_boxes, shapes_of_parts
from stridelab.contacts.terrain_meshes.stairs import find_stairs, tolerances_of
from stridelab.contacts.terrain_meshes.surfaces import (
    MAX_SURFACES,
    THICKEST_SLAB_M,
    Scan,
    Standing,
    find_standing,
    upper_faces,
)
from stridelab.conventions import Mask, Points
from stridelab.dynamics.spatial import Placement

FARTHEST_M: Final = 90.0
"""Coordinates beyond are moved: a scenario reaches 100 m."""
NAMED_M2: Final = 0.2
"""Area without a box from which on it is named."""
INSIDE_WALL_M: Final = 0.06
"""How far below a surface a wall with its middle ends at least: two risers are none."""
NAMED_NOISE_M: Final = 2e-4
ALONG_RAIL_M: Final = 0.03
BESIDE_BOX_M: Final = 0.06
"""Distance from a box of points that are no obstacle of their own."""
BESIDE_RAIL_M: Final = 0.08
"""Distance from a rail of points that are no obstacle: its noise, and what holds it."""


@dataclass(frozen=True, eq=False)
class TerrainShapes:
    """What a file holds, in metres with z up: triangles, points, and the bars and boxes that it states as such."""

    mesh: TerrainMesh
    cloud_m: Points
    bars: list[Bar] = field(default_factory=list)
    solids: list[Solid] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def mesh_shapes(mesh: TerrainMesh) -> TerrainShapes:
    """The shapes of a mesh, with the bars and boxes among its parts."""
    bars, solids = shapes_of_parts(mesh)
    return TerrainShapes(mesh, np.zeros((0, 3)), bars, solids)


def cloud_shapes(points_m: Points) -> TerrainShapes:
    """The shapes of a cloud of points."""
    empty = TerrainMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    return TerrainShapes(empty, points_m)


def segment_terrain(shapes: TerrainShapes) -> dict[str, Any]:
    """``{terrain, stairs, remarks}`` as of ``ReadTerrain``; terrain is empty if no foot can stand anywhere."""
    shapes = _move_near(shapes)
    standing = find_standing(shapes.mesh, shapes.cloud_m)
    boxes = standing.boxes
    if not boxes:
        return {"terrain": [], "stairs": [], "remarks": shapes.remarks}
    bars = [bar for bar in shapes.bars if is_rail(bar, boxes)]
    for scan in standing.scans:
        bars += fit_rails(scan.samples, _left_points(scan, bars), boxes)
    bars = bars[: 200 - len(boxes)]
    rails = rail_surfaces(bars)
    posts = [post for bar in shapes.bars if (post := solid_of_post(bar)) is not None]
    tops_m = np.array([top_m for _, top_m, _ in upper_faces(boxes)]) - (0.0, 0.0, INSIDE_WALL_M)
    walls = [wall for scan in standing.scans for wall in scanned_walls(scan.samples, scan.regions)]
    walls = [wall for wall in walls if not lie_in_boxes([box_of_solid(wall)], tops_m).any()]
    solids = [one for one in (*shapes.solids, *posts, *walls) if not _is_along(one, bars)]
    solid_boxes = obstacle_boxes(solids, boxes)
    slabs = [_deepen_box(box) for box in boxes]
    known = [*slabs, *solid_boxes, *(box_of_solid(one) for one in shapes.solids)]  # also those on which feet stand
    seen = [*solid_boxes, *obstacle_boxes(_seen_solids(standing, bars, known), boxes)]
    room = max(MAX_SURFACES + 1 - len(boxes) - len(rails), 0)
    obstacles = [{"name": f"obstacle {k + 1}"} | box for k, box in enumerate(seen[:room])]
    noise_m, spacing_m = _errors_of(standing)
    stairs = find_stairs(boxes, rails, tolerances_of(noise_m, spacing_m))
    many = f"{len(seen) - room} more obstacles were left out; a terrain has at most {MAX_SURFACES + 1} parts."
    remarks = [
        *shapes.remarks,
        *([many] if len(seen) > room else []),
        *_scan_remarks(standing),
        *_left_out(shapes, standing, [*slabs, *obstacles], bars),
    ]
    return {"terrain": [*boxes, *rails, *obstacles], "stairs": stairs, "remarks": remarks}


def _deepen_box(box: dict[str, Any]) -> dict[str, Any]:
    """A standing box that is at least as deep as the thickest slab, whose sides and underside are then explained."""
    R = Placement.from_wxyz(box["center_m"], box["orientation_wxyz"]).rotation
    more_m = max(THICKEST_SLAB_M - box["size_m"][2], 0.0)
    center_m = np.array(box["center_m"]) - 0.5 * more_m * R[:, 2]
    return box | {"center_m": center_m.tolist(), "size_m": [*box["size_m"][:2], box["size_m"][2] + more_m]}


def _seen_solids(standing: Standing, bars: Sequence[Bar], boxes: Sequence[dict[str, Any]]) -> list[Solid]:
    """Thin boxes of faces on which no foot stands and that no box explains, and boxes of what has no faces."""
    solids: list[Solid] = []
    down = {id(scan) for scan in standing.undersides}
    for scan in (*standing.scans, *standing.undersides):
        outside = ~lie_in_boxes(boxes, scan.samples.points_m)
        faces = scan.regions if id(scan) in down else steep_regions(scan.regions, float(np.cos(STEEPEST_RAD)))
        thin = [solid for region in faces for solid in thin_boxes(scan.samples, region, outside)]
        left = outside & _left_points(scan, bars, BESIDE_RAIL_M)
        known = [*boxes, *(box_of_solid(one) for one in thin)]
        left[left] = ~lie_in_boxes(known, scan.samples.points_m[left], BESIDE_BOX_M)
        solids += [*thin, *clutter_boxes(scan.samples.points_m[left])]
    return solids


def _move_near(shapes: TerrainShapes) -> TerrainShapes:
    """The shapes, moved to the origin if coordinates, as of maps, are beyond those of a scenario."""
    points_m = np.concatenate([shapes.mesh.vertices_m, shapes.cloud_m])
    low, high = np.quantile(points_m, [0.001, 0.999], axis=0)
    if max(np.abs(low).max(), np.abs(high).max()) <= FARTHEST_M:
        return shapes
    origin = np.floor(0.5 * (low + high))
    origin[2] = np.floor(low[2])
    mesh = TerrainMesh(shapes.mesh.vertices_m - origin, shapes.mesh.triangles)
    bars = [Bar(one.from_m - origin, one.to_m - origin, one.radius_m) for one in shapes.bars]
    solids = [
        Solid(type(one.placement)(one.placement.position_m - origin, one.placement.rotation), one.size_m)
        for one in shapes.solids
    ]
    moved = f"Coordinates are relative to ({origin[0]:.0f}, {origin[1]:.0f}, {origin[2]:.0f}) m of the file."
    return TerrainShapes(mesh, shapes.cloud_m - origin, bars, solids, [*shapes.remarks, moved])


def _errors_of(standing: Standing) -> tuple[float, float]:
    """Largest noise and spacing of the scans."""
    samples = [scan.samples for scan in standing.scans if scan.regions]
    return max((one.noise_m for one in samples), default=0.0), max((one.spacing_m for one in samples), default=0.0)


def _left_points(scan: Scan, bars: Sequence[Bar], beside_m: float = ALONG_RAIL_M) -> Mask:
    """Points of no plane and of no bar."""
    left = np.ones(len(scan.samples.points_m), dtype=bool)
    for region in scan.regions:
        left &= ~region.members
    for bar in bars:
        left &= ~_near_bar(bar, scan.samples.points_m, beside_m)
    return left


def _near_bar(bar: Bar, points_m: Points, beside_m: float = ALONG_RAIL_M) -> Mask:
    span = bar.to_m - bar.from_m
    share = np.clip((points_m - bar.from_m) @ span / (span @ span), 0.0, 1.0)
    away_m = np.linalg.norm(points_m - bar.from_m - np.outer(share, span), axis=1)
    return np.asarray(away_m < bar.radius_m + beside_m)


def _is_along(solid: Solid, bars: Sequence[Bar]) -> bool:
    """Whether a box is that of a rail."""
    axis = int(np.argmax(solid.size_m))
    ends = solid.placement.position_m + np.outer([-0.5, 0.5], solid.size_m[axis] * solid.placement.rotation[:, axis])
    return any(bool(_near_bar(bar, ends).all()) for bar in bars)


def _scan_remarks(standing: Standing) -> list[str]:
    remarks: list[str] = []
    if standing.dropped:
        remarks.append(f"{standing.dropped} more surfaces were left out; a terrain has at most {MAX_SURFACES}.")
    remarks += [
        f"Planes were fitted to points {100.0 * scan.samples.spacing_m:.1f} cm apart with "
        f"{1000.0 * scan.samples.noise_m:.1f} mm of noise."
        for scan in standing.scans
        if scan.regions and scan.samples.noise_m > NAMED_NOISE_M
    ]
    return remarks


def _left_out(
    shapes: TerrainShapes, standing: Standing, boxes: Sequence[dict[str, Any]], bars: Sequence[Bar]
) -> list[str]:
    """Remark on faces that are no surface and no obstacle."""
    rails = [box_of_solid(_solid_of_bar(bar)) for bar in bars]
    clouds = standing.scans[-1:] if len(shapes.cloud_m) else []
    area_m2 = unexplained_area_m2(shapes.mesh, [scan.samples for scan in clouds], [*boxes, *rails])
    if area_m2 < NAMED_M2:
        return []
    return [f"{area_m2:.1f} m² of walls, undersides and steep ground are no obstacles: no box explains them."]


def _solid_of_bar(bar: Bar) -> Solid:
    box = bounding_box(Rail("bar", bar.from_m, bar.to_m, bar.radius_m))
    return Solid(box.placement, np.asarray(box.size_m))
