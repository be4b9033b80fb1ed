"""Where a dragged foothold may go: on the tread it stands on, or along the rail it holds.

A foot slides in the plane of its tread. Its patch stays inside the upper face of the box and off the boxes that stand
on that face: a lower step runs on below the next one. A hand slides along the axis of its rail.
"""

import math
from dataclasses import dataclass

import numpy as np

from stridelab.schemas.scenarios import BoxSurface, RailSurface, Scenario
from stridelab_web.scene.contacts import PlacedContact, box_rotation, rotation_matrix

ON_SURFACE_M = 0.03
"""Maximum distance between a contact and its surface."""
STANDS_ON_M = 1e-4
MAX_ROUNDS = 12
MIN_UP_COSINE = 0.9999


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in a plane: its centre ``(2,)``, half its edges ``(2,)``, and the direction of the first one."""

    centre_m: np.ndarray
    half_m: np.ndarray
    yaw_rad: float

    @property
    def axes(self) -> np.ndarray:
        """Rows: its two directions."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[c, s], [-s, c]])

    def extent(self, along: np.ndarray) -> float:
        """Half its extent along a unit direction."""
        return float(self.half_m @ np.abs(self.axes @ along))

    def moved_to(self, centre_m: np.ndarray) -> "Rectangle":
        """The same rectangle elsewhere."""
        return Rectangle(centre_m, self.half_m, self.yaw_rad)


@dataclass(frozen=True)
class Tread:
    """The upper face of a box. ``rotation`` and ``origin_m`` place the face's frame (middle of it, z outwards)."""

    rotation: np.ndarray
    origin_m: np.ndarray
    half_m: np.ndarray
    obstacles: tuple[Rectangle, ...]

    def ray_intersection(self, eye_m: np.ndarray, through_m: np.ndarray) -> np.ndarray | None:
        """Intersection of the ray from ``eye_m`` through another point with the plane of the face, or None."""
        eye, direction = self.rotation.T @ (eye_m - self.origin_m), self.rotation.T @ (through_m - eye_m)
        if abs(direction[2]) < 1e-9 or eye[2] * direction[2] >= 0:
            return None
        return np.asarray(self.origin_m + self.rotation @ (eye - eye[2] / direction[2] * direction))

    def constrain_position(
        self, touch: PlacedContact, half_m: tuple[float, float], here_m: np.ndarray, wanted_m: np.ndarray
    ) -> np.ndarray | None:
        """The position near ``wanted_m`` at which the patch is completely on the tread; None without one.

        ``half_m`` are half the edges of the patch. From ``here_m`` the patch does not jump across a box in its way. The
        distance from the plane is that of ``wanted_m``.
        """
        turned = self.rotation.T @ rotation_matrix(touch.contact.orientation_wxyz)
        half = np.array(half_m)
        wanted = self.rotation.T @ (wanted_m - self.origin_m)
        patch = Rectangle(wanted[:2], half, math.atan2(turned[1, 0], turned[0, 0]))
        here = patch.moved_to((self.rotation.T @ (here_m - self.origin_m))[:2])
        face = Rectangle(np.zeros(2), self.half_m, 0.0)
        for _ in range(MAX_ROUNDS):
            patch = patch.moved_to(_shift_inside(patch, face))
            pushes = [_shortest_way_out(patch, block, here) for block in self.obstacles]
            deepest = max(pushes, key=np.linalg.norm, default=np.zeros(2))
            if np.linalg.norm(deepest) < 1e-9:
                return np.asarray(self.origin_m + self.rotation @ [*patch.centre_m, wanted[2]])
            patch = patch.moved_to(patch.centre_m + deepest)
        return None


@dataclass(frozen=True)
class RailAxis:
    """The axis of a rail, from ``start_m`` along the unit vector ``along`` for ``length_m``."""

    start_m: np.ndarray
    along: np.ndarray
    length_m: float

    def ray_intersection(self, eye_m: np.ndarray, through_m: np.ndarray) -> np.ndarray | None:
        """The point of the axis that is nearest to a ray; None where the two are parallel."""
        v = (through_m - eye_m) / np.linalg.norm(through_m - eye_m)
        w = self.start_m - eye_m
        cosine = float(self.along @ v)
        if 1 - cosine**2 < 1e-9:
            return None
        distance = (cosine * float(v @ w) - float(self.along @ w)) / (1 - cosine**2)
        return np.asarray(self.start_m + distance * self.along)

    def constrain_position(
        self, touch: PlacedContact, half_m: tuple[float, float], here_m: np.ndarray, wanted_m: np.ndarray
    ) -> np.ndarray | None:
        """``here_m`` shifted along the rail to the projection of ``wanted_m``, or to the rail's end."""
        distance = float(np.clip(self.along @ (wanted_m - self.start_m), 0.0, self.length_m))
        return np.asarray(here_m + (distance - float(self.along @ (here_m - self.start_m))) * self.along)


Guide = Tread | RailAxis


def guide_of(scenario: Scenario, touch: PlacedContact) -> Guide | None:
    """The surface that ``touch`` slides on: the nearest face or rail within 3 cm, or None."""
    p = np.array(touch.contact.position_m)
    candidates: list[tuple[float, Guide]] = []
    for surface in scenario.terrain:
        if isinstance(surface, RailSurface):
            start, end = np.array(surface.from_m), np.array(surface.to_m)
            length = float(np.linalg.norm(end - start))
            if length > 0:
                along = (end - start) / length
                nearest = start + np.clip(along @ (p - start), 0.0, length) * along
                away = float(np.linalg.norm(p - nearest))
                candidates.append((abs(min(away, abs(away - surface.radius_m))), RailAxis(start, along, length)))
            continue
        R, origin = box_rotation(surface), top_middle_m(surface)
        local = R.T @ (p - origin)
        half = np.array(surface.size_m[:2]) / 2
        if (np.abs(local[:2]) <= half + ON_SURFACE_M).all():
            candidates.append((abs(float(local[2])), Tread(R, origin, half, _boxes_on_face(scenario, surface))))
    away, guide = min(candidates, key=lambda one: one[0], default=(math.inf, None))
    return guide if away <= ON_SURFACE_M else None


def top_middle_m(box: BoxSurface) -> np.ndarray:
    """Middle of the upper face."""
    return np.asarray(np.array(box.center_m) + box.size_m[2] / 2 * box_rotation(box)[:, 2])


def _boxes_on_face(scenario: Scenario, box: BoxSurface) -> tuple[Rectangle, ...]:
    """Outlines, in the frame of the face, of the boxes that rise above the face of ``box`` and begin no higher."""
    R, origin = box_rotation(box), top_middle_m(box)
    outlines = []
    for other in scenario.terrain:
        if other is box or not isinstance(other, BoxSurface):
            continue
        turned = R.T @ box_rotation(other)
        top = R.T @ (top_middle_m(other) - origin)
        if turned[2, 2] < MIN_UP_COSINE or not top[2] - other.size_m[2] <= STANDS_ON_M < top[2]:
            continue
        yaw = math.atan2(turned[1, 0], turned[0, 0])
        outlines.append(Rectangle(top[:2], np.array(other.size_m[:2]) / 2, yaw))
    return tuple(outlines)


def _shift_inside(patch: Rectangle, face: Rectangle) -> np.ndarray:
    """Centre of ``patch`` shifted into ``face``; in the middle where it is wider than the face."""
    local = face.axes @ (patch.centre_m - face.centre_m)
    room = np.array([max(face.half_m[k] - patch.extent(face.axes[k]), 0.0) for k in range(2)])
    return np.asarray(face.centre_m + face.axes.T @ np.clip(local, -room, room))


def _shortest_way_out(patch: Rectangle, block: Rectangle, here: Rectangle) -> np.ndarray:
    """The shortest shift after which ``patch`` and ``block`` do not overlap (separating axes); zero if they do not.

    Ways out to the side on which ``here`` is clear of the block come first.
    """
    ways: list[tuple[bool, float, np.ndarray]] = []
    for axis in (*patch.axes, *block.axes):
        touching = patch.extent(axis) + block.extent(axis)
        apart, before = (float((one.centre_m - block.centre_m) @ axis) for one in (patch, here))
        if abs(apart) >= touching - 1e-9:
            return np.zeros(2)
        clear = abs(before) >= touching - 1e-6
        side = math.copysign(1.0, before if clear else apart)
        ways.append((not clear, touching - side * apart, side * axis))
    _, shift, direction = min(ways, key=lambda way: way[:2])
    return np.asarray(shift * direction)
