"""Assigns contacts to surfaces and checks height, tilt, distance to the edge and obstruction.

Collision checks of swings with the boxes of the terrain.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.effector_geometry import EffectorShape, foot_clearance_m, sole_points_m
from stridelab.contacts.swing import SwingCurve, required_rise_m
from stridelab.contacts.terrain import (
    PARALLEL_COSINE,
    UP,
    Box,
    ContactArea,
    Rail,
    Terrain,
    bounding_box,
    contact_area,
    depth_in_box_m,
    face_towards,
    is_vertical,
    vertical_span_m,
)
from stridelab.contacts.validation.parse import Draft
from stridelab.conventions import Points, Series, Vector3
from stridelab.dynamics.spatial import Placement

HEIGHT_TOLERANCE_M: Final = 0.005
"""Largest distance of a contact from its surface, above or below."""
TILT_TOLERANCE_RAD: Final = np.radians(3.0)
"""Largest angle between the contact's z axis and the surface's normal."""
EDGE_TOLERANCE_M: Final = 0.005
"""How far a corner of a sole, or a hand, may lie past the edge of its surface."""
LEVEL_TOLERANCE_M: Final = 0.010
"""Height difference up to which adjacent faces support a sole together."""
DEPTH_TOLERANCE_M: Final = 0.005
"""Depth up to which a sole may penetrate another box."""

Stance = Mapping[str, "SurfaceContact"]
"""The contacts of one phase by effector."""


@dataclass(frozen=True, eq=False)
class SurfaceContact:
    """One effector placement: its surface, its margins and its problems."""

    effector: str
    shape: EffectorShape
    placement: Placement
    area: ContactArea | None
    friction: float
    height_m: float | None
    edge_m: float | None
    problems: tuple[str, ...]

    @property
    def surface(self) -> str | None:
        """Name of the surface, or None."""
        return None if self.area is None else self.area.surface.name

    @cached_property
    def corners_m(self) -> Points:
        """Corners of the sole, or the contact point of a hand, in world coordinates."""
        return self.placement.act(outline_points_m(self.shape)[:4])


def outline_points_m(shape: EffectorShape) -> Points:
    """Corners, edge midpoints and centre of a sole ``(9, 3)`` in its contact frame; the origin for a hand."""
    return sole_points_m(shape.half_size_m)


def displacement_text(vector_m: Vector3) -> str:
    """Text that describes a displacement."""
    x, y, z = (float(value) for value in np.round(vector_m, 3) + 0.0)
    if x == y == 0.0:
        return f"{'raise' if z > 0 else 'lower'} it by {abs(z):.3g} m"
    return f"move it by ({x:.3g}, {y:.3g}, {z:.3g}) m"


def contacts_on_surfaces(draft: Draft, effectors: Mapping[str, EffectorShape]) -> tuple[Stance, ...]:
    """Assign the contacts of every phase to their nearest surfaces; equal contacts share one object."""
    ground = _Ground(draft.terrain, draft.friction)
    checked: dict[tuple[str, bytes, bytes], SurfaceContact] = {}
    stances: list[Stance] = []
    for phase in draft.phases:
        stance: dict[str, SurfaceContact] = {}
        for effector, placement in phase.contacts.items():
            key = (effector, placement.position_m.tobytes(), placement.rotation.tobytes())
            if key not in checked:
                checked[key] = ground.check_contact(effector, effectors[effector], placement)
            stance[effector] = checked[key]
        stances.append(stance)
    return tuple(stances)


class _Ground:
    """The contact areas of a terrain."""

    def __init__(self, terrain: Terrain, friction: float) -> None:
        self.boxes = terrain.boxes
        self.bounds_m = terrain.box_bounds_m
        self.faces = [contact_area(box) for box in terrain.boxes]
        self.lines = [contact_area(rail) for rail in terrain.rails]
        self.friction = friction

    def check_contact(self, effector: str, shape: EffectorShape, placement: Placement) -> SurfaceContact:
        near = self._nearby_boxes(shape, placement)
        on = _nearest_area(self._contact_areas(shape, placement, near), placement.position_m)
        if on is None:
            what = "stand on" if shape.kind == "surface" else "touch"
            problem = f"has no surface: the terrain has nothing to {what}"
            return SurfaceContact(effector, shape, placement, None, self.friction, None, None, (problem,))
        place = on.locate(placement.position_m[np.newaxis])
        height, aside = float(place.height_m[0]), float(place.aside_m[0])
        edges = float(place.edge_m[0]) if shape.kind == "point" else self._edge_m(on, shape, placement, near)
        problems = _position_problems(on, height, aside, float(place.distance_m[0]))
        problems += list(_tilt_problems(on, placement))
        if not problems and edges < -EDGE_TOLERANCE_M:
            problems.append(_edge_problem(on, placement.act(outline_points_m(shape)), edges, shape))
        if not problems:
            problems += list(self._obstruction_problems(on, placement.act(outline_points_m(shape)), near))
        friction = self.friction if on.surface.friction is None else on.surface.friction
        return SurfaceContact(effector, shape, placement, on, friction, height, edges, tuple(problems))

    def _nearby_boxes(self, shape: EffectorShape, placement: Placement) -> list[int]:
        """Indices of the boxes that can affect the contact: near the nearest face or within the radius of the sole."""
        if not self.boxes:
            return []
        (low_m, high_m), point_m = self.bounds_m, placement.position_m
        away = np.linalg.norm(np.maximum(np.maximum(low_m - point_m, point_m - high_m), 0.0), axis=1)
        first = self._box_face(int(away.argmin()), shape, placement).locate(point_m[np.newaxis])
        radius = float(np.linalg.norm(outline_points_m(shape), axis=1).max()) + 2 * LEVEL_TOLERANCE_M
        return np.flatnonzero(away <= max(float(first.distance_m[0]) + 2e-3, radius)).tolist()

    def _contact_areas(self, shape: EffectorShape, placement: Placement, nearby: Sequence[int]) -> list[ContactArea]:
        """Contact areas of an effector: upper faces for a sole; rails and the faces along its z axis for a hand."""
        faces = [self._box_face(i, shape, placement) for i in nearby]
        return faces if shape.kind == "surface" else faces + self.lines

    def _box_face(self, box: int, shape: EffectorShape, placement: Placement) -> ContactArea:
        sole = shape.kind == "surface"
        return self.faces[box] if sole else face_towards(self.boxes[box], placement.rotation[:, 2])

    def _edge_m(self, on: ContactArea, shape: EffectorShape, placement: Placement, nearby: Sequence[int]) -> float:
        """Smallest distance of a corner to the edge of its supporting face, among the faces level with ``area``."""
        corners = placement.act(outline_points_m(shape)[:4])
        flat = corners - np.outer((corners - on.center_m) @ on.normal, on.normal)
        best = on.locate(flat).edge_m
        for face in (self.faces[i] for i in nearby):
            place = face.locate(flat)
            level = (np.abs(place.height_m) < LEVEL_TOLERANCE_M) & bool(
                face.normal @ on.normal > np.cos(TILT_TOLERANCE_RAD)
            )
            best = np.where(level, np.maximum(best, place.edge_m), best)
        return float(best.min())

    def _obstruction_problems(self, on: ContactArea, sole_m: Points, nearby: Sequence[int]) -> Iterator[str]:
        """The problem of a sole or hand inside another box, the highest one if there are several."""
        raised = sole_m + LEVEL_TOLERANCE_M * on.normal
        others = [(self.boxes[i], self.faces[i]) for i in nearby if self.boxes[i] is not on.surface]
        inside = [
            (-float(face.locate(sole_m[[int(depth.argmax())]]).height_m[0]), box.name)
            for box, face in others
            if (depth := depth_in_box_m(box, raised)).max() > DEPTH_TOLERANCE_M
        ]
        if inside:
            below, name = max(inside)
            yield f"is inside {name!r}, {below:.3g} m below its upper face"


def _nearest_area(parts: Sequence[ContactArea], point_m: Vector3) -> ContactArea | None:
    """The nearest area; among those within a millimetre, the one whose edge is farthest away."""
    if not parts:
        return None
    places = [part.locate(point_m[np.newaxis]) for part in parts]
    distance: Series = np.array([place.distance_m[0] for place in places])
    edge: Series = np.array([place.edge_m[0] for place in places])
    return parts[int(np.argmax(np.where(distance <= distance.min() + 1e-3, edge, -np.inf)))]


def _position_problems(on: ContactArea, height: float, aside: float, distance: float) -> list[str]:
    name = on.surface.name
    if isinstance(on.surface, Rail):
        if distance <= HEIGHT_TOLERANCE_M:
            return []
        return [f"is not on a surface: it is {distance:.3g} m off the upper side of {name!r}"]
    upper = bool(on.normal[2] > np.sqrt(0.5))
    if aside > EDGE_TOLERANCE_M:
        return [f"is not on a surface: {name!r}, the nearest one, is {distance:.3g} m away"]
    if height > HEIGHT_TOLERANCE_M:
        where = "above" if upper else "off"
        return [f"is in the air, {height:.3g} m {where} {name!r}: {displacement_text(-height * on.normal)}"]
    if height < -HEIGHT_TOLERANCE_M:
        face = "upper face" if upper else "face"
        return [f"is inside {name!r}, {-height:.3g} m below its {face}: {displacement_text(-height * on.normal)}"]
    return []


def _tilt_problems(on: ContactArea, placement: Placement) -> Iterator[str]:
    if isinstance(on.surface, Rail) and is_vertical(on.surface):
        yield f"cannot rest on {on.surface.name!r}: a vertical rail has no upper side"
        return
    tilt = float(np.arccos(np.clip(placement.rotation[:, 2] @ on.normal, -1.0, 1.0)))
    if tilt > TILT_TOLERANCE_RAD:
        yield f"its z axis is {np.degrees(tilt):.3g} degrees off the normal of {on.surface.name!r}"


def _edge_problem(on: ContactArea, patch_m: Points, edge: float, shape: EffectorShape) -> str:
    what = "the sole" if shape.kind == "surface" else "the hand"
    text = f"{what} is {-edge:.3g} m past the edge of {on.surface.name!r}"
    local = ((patch_m - on.center_m) @ on.frame)[:, :2]
    low, high = local.min(axis=0), local.max(axis=0)
    if isinstance(on.surface, Box) and (high - low <= 2 * on.half_m).all():
        inwards = np.maximum(-on.half_m - low, 0.0) - np.maximum(high - on.half_m, 0.0)
        text += f": {displacement_text(on.frame[:, :2] @ inwards)}"
    return text


SHARES: Final[Series] = np.linspace(0.0, 1.0, 25)
"""Shares of a swing at which it is checked."""
SWING_COLLISION_DEPTH_TOLERANCE_M: Final = 0.003
"""Depth inside a box up to which a path is accepted."""


def find_swings(stances: tuple[Stance, ...]) -> Iterator[tuple[int, SurfaceContact, SurfaceContact]]:
    """All swings: first phase, contact at lift-off and contact at landing."""
    last: dict[str, tuple[int, SurfaceContact]] = {}
    for k, stance in enumerate(stances):
        for name, touch in stance.items():
            if name in last and last[name][0] < k - 1:
                yield last[name][0] + 1, last[name][1], touch
            last[name] = (k, touch)


def swing_collisions(stances: tuple[Stance, ...], terrain: Terrain) -> Iterator[tuple[int, str, str, float]]:
    """Swings through boxes: phase, effector, name of the box, and depth (m) inside it."""
    all_swings = list(find_swings(stances))
    if not all_swings:
        return
    paths = [_swept_points(start, end, terrain) for _, start, end in all_swings]
    low, high = (np.array([extreme(path, axis=(0, 1)) for path in paths]) for extreme in (np.min, np.max))
    for box in terrain.boxes:
        half = np.abs(box.placement.rotation) @ box.size_m / 2 - SWING_COLLISION_DEPTH_TOLERANCE_M
        above, below = low < box.placement.position_m + half, high > box.placement.position_m - half
        for i in np.flatnonzero((above & below).all(axis=1)):
            phase, start, _ = all_swings[i]
            depths = _overlaps_m(box, start.shape, paths[i])
            depth = float(depths.max())
            if depth > max(depths[0], depths[-1], 0.0) + SWING_COLLISION_DEPTH_TOLERANCE_M:
                yield phase, start.effector, box.name, depth


def _overlaps_m(box: Box, shape: EffectorShape, path_m: Float[np.ndarray, "t k 3"]) -> Series:
    """Depth of a sole or a hand inside a box at every instant of a path of its outline points.

    A sole is a rectangle: its depth is the smallest overlap of the projections on the box's axes, its own normal and
    the products of the edges of both (separating axes), so that a thin box between two points of the outline counts.
    """
    if shape.kind == "point":
        return depth_in_box_m(box, path_m[:, 0])
    local = (path_m[:, :4] - box.placement.position_m) @ box.placement.rotation
    edges = np.stack([local[:, 0] - local[:, 1], local[:, 1] - local[:, 2]], axis=1)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    products = np.cross(edges[:, :, np.newaxis], np.eye(3)).reshape(len(local), 6, 3)
    sizes = np.linalg.norm(products, axis=2, keepdims=True)
    products = np.where(sizes > PARALLEL_COSINE, products / np.maximum(sizes, PARALLEL_COSINE), np.eye(3)[0])
    axes = np.concatenate(
        [np.tile(np.eye(3), (len(local), 1, 1)), np.cross(edges[:, :1], edges[:, 1:]), products], axis=1
    )
    along = axes @ local.transpose(0, 2, 1)
    reach = np.abs(axes) @ box.size_m / 2
    overlap = np.minimum(reach - along.min(axis=2), reach + along.max(axis=2))
    return np.asarray(overlap.min(axis=1))


def _swept_points(start: SurfaceContact, end: SurfaceContact, terrain: Terrain) -> Float[np.ndarray, "t k 3"]:
    """Outline points of the effector along its swing."""
    sole = outline_points_m(start.shape)
    rises = required_rise_m(start.placement, end.placement, sole, terrain, foot_clearance_m(start.shape.com_height_m))
    curve = SwingCurve(start.placement, end.placement, 1.0, start.shape.kind, rise_m=rises)
    positions, rotations = curve.poses_at(SHARES)
    return np.asarray(np.einsum("tij,kj->tki", rotations, sole) + positions[:, np.newaxis])


TRUNK_HEIGHT_SHARES: Final = (0.7, 1.0)
"""An obstacle from the lower to the higher of these shares of a standing CoM's height is in the way of the trunk."""
TRUNK_WIDTH_SHARE: Final = 1.5
"""A width that every trunk has, in widths of a sole: the hips are above the soles."""
TRUNK_SPACING_M: Final = 0.02
"""Distance of the points at which the path of the trunk is checked."""


def trunk_collisions(stances: tuple[Stance, ...], terrain: Terrain, com_height_m: float) -> Iterator[tuple[int, str]]:
    """Boxes and rails that the trunk would pass through between two phases: the later phase, and the name.

    The trunk is ``TRUNK_WIDTH_SHARE`` soles wide and goes in straight lines over the mean of the soles of each phase.
    An obstacle is in its way if it contains the heights of the CoM from crouching to standing there, such as a post
    between the feet.
    """
    soles = [[one.placement.position_m for one in stance.values() if one.shape.kind == "surface"] for stance in stances]
    middles = [(k, np.mean(places, axis=0)) for k, places in enumerate(soles) if places]
    low_m, high_m = (extreme([z for _, (_, _, z) in middles], default=0.0) for extreme in (min, max))
    boxes = [one if isinstance(one, Box) else bounding_box(one) for one in terrain.surfaces]
    bounds = Terrain(tuple(boxes)).box_bounds_m
    least, most = (share * com_height_m for share in TRUNK_HEIGHT_SHARES)
    tall = (bounds[0][:, 2] <= high_m + least) & (bounds[1][:, 2] >= low_m + most)
    soles_m = [min(one.shape.half_size_m) for stance in stances for one in stance.values() if one.shape.half_size_m]
    room_m = 2.0 * TRUNK_WIDTH_SHARE * max(soles_m, default=0.0)
    boxes = [_widened_box(boxes[i], room_m) for i in np.flatnonzero(tall)]
    lowest, highest = Terrain(tuple(boxes)).box_bounds_m
    for (_, start), (k, end) in pairwise(middles):
        near = (lowest <= np.maximum(start, end) + least * UP).all(axis=1)
        near &= (highest >= np.minimum(start, end) + most * UP).all(axis=1)
        count = 1 + math.ceil(float(np.linalg.norm(end - start)) / TRUNK_SPACING_M)
        line = np.linspace(start, end, count)
        for box in (boxes[i] for i in np.flatnonzero(near)):
            low, high = vertical_span_m(box, line)
            if ((low <= line[:, 2] + least) & (high >= line[:, 2] + most)).any():
                yield k, box.name


def _widened_box(box: Box, by_m: float) -> Box:
    """The box with edges longer by ``by_m`` in the horizontal directions."""
    return replace(box, size_m=box.size_m + by_m * (1.0 - np.abs(box.placement.rotation[2])))
