"""Courses: obstacles in a row between two platforms, and the stances at both ends, for the contact planner.

The course runs along x. Every element begins where the previous one ends, at its height; the feet start at x = 0.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, Final, Literal

from scipy.spatial.transform import Rotation

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.planner.step_limits import FEET_GAP_M, StepDefaults
from stridelab.contacts.scenarios.parts import box, contact, round_values
from stridelab.errors import Fault, InvalidInput

Side = Literal["left", "right"]
Json = dict[str, Any]
PLATFORM_M: Final = 0.6
"""Length of the first platform behind the feet, and of the last one beyond them."""
THICKNESS_M: Final = 0.20
TRAVEL_MAX_M: Final = 14.0
RAIL_RADIUS_M: Final = 0.02
RAIL_FRICTION: Final = 0.6
HAND_AHEAD_SHARE: Final = 0.27
"""Distance of a hand ahead of the feet, over the mean height ``h`` of the CoM above the soles."""
HAND_HEIGHT_SHARE: Final = 0.92
"""Height of a handrail above the line through the soles, over ``h``."""
HAND_ASIDE_SHARE: Final = 0.69
"""Distance of a handrail from the middle of the course, over ``h``."""
Point = tuple[float, float]
"""Position (x, z) of the walking line, metres."""


@dataclass(frozen=True)
class Level:
    """Level ground, ``length_m`` long, as wide as the course or ``width_m``."""

    length_m: float
    width_m: float | None
    label: ClassVar[str] = "level"

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends."""
        return start[0] + self.length_m, start[1]

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """Boxes of the element that begins at ``start``."""
        yield _slab("floor", start[0], self.end_point(start)[0], start[1], self.width_m or width_m)


@dataclass(frozen=True)
class Flight:
    """A flight of ``number`` stairs, ``rise_m`` high (negative: downwards) and ``depth_m`` deep."""

    number: int
    rise_m: float
    depth_m: float
    label: ClassVar[str] = "stair"

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends: the nose of the last stair, at its height."""
        return start[0] + self.number * self.depth_m, start[1] + self.number * self.rise_m

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """Boxes of the element that begins at ``start``, one per tread."""
        bottom = min(start[1], self.end_point(start)[1]) - THICKNESS_M
        for i in range(1, self.number + 1):
            x = (start[0] + (i - 1) * self.depth_m, start[0] + i * self.depth_m)
            yield box(f"{i}", x, _across(width_m), (bottom, start[1] + i * self.rise_m))


@dataclass(frozen=True)
class Ramp:
    """A slope of ``slope_rad`` (positive: upwards) over a horizontal distance of ``length_m``."""

    length_m: float
    slope_rad: float
    label: ClassVar[str] = "ramp"

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends."""
        return start[0] + self.length_m, start[1] + self.length_m * math.tan(self.slope_rad)

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """The box of the element that begins at ``start``, rotated about y."""
        end, along = self.end_point(start), self.length_m / math.cos(self.slope_rad)
        turn = Rotation.from_euler("y", -self.slope_rad)
        top = ((start[0] + end[0]) / 2, 0.0, (start[1] + end[1]) / 2)
        center = top - turn.apply([0.0, 0.0, THICKNESS_M / 2])
        yield {
            "name": "slab",
            "kind": "box",
            "center_m": round_values(center.tolist()),
            "size_m": round_values((along, width_m, THICKNESS_M)),
            "orientation_wxyz": [round(float(value), 9) + 0.0 for value in turn.as_quat(scalar_first=True)],
        }


@dataclass(frozen=True)
class Stones:
    """A row of ``number`` stones for the left and the right foot in turn, ``spacing_m`` apart, without ground between.

    Their tops lean by ``tilt_rad``, in turn to the left, to the front, to the right and to the back.
    """

    number: int
    spacing_m: float
    tilt_rad: float
    label: ClassVar[str] = "stone"
    SIZE_M: ClassVar[tuple[float, float]] = (0.28, 0.20)

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends."""
        return start[0] + self.number * self.spacing_m + self.SIZE_M[0] / 2, start[1]

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """Boxes of the element that begins at ``start``."""
        for i in range(1, self.number + 1):
            lean = ((1, 0), (0, -1), (-1, 0), (0, 1))[(i - 1) % 4]
            turn = Rotation.from_euler("xy", [self.tilt_rad * lean[0], self.tilt_rad * lean[1]])
            y = foot_y_m * (1 if i % 2 == 0 else -1)
            top = (start[0] + i * self.spacing_m - self.SIZE_M[0] / 2 + 0.05, y, start[1])
            center = top - turn.apply([0.0, 0.0, THICKNESS_M / 2])
            yield {
                "name": f"{i}",
                "kind": "box",
                "center_m": round_values(center.tolist()),
                "size_m": round_values((*self.SIZE_M, THICKNESS_M)),
                "orientation_wxyz": [round(float(value), 9) + 0.0 for value in turn.as_quat(scalar_first=True)],
            }


@dataclass(frozen=True)
class Bar:
    """A bar of ``height_m`` across level ground, ``thickness_m`` thick, to step over; 0.6 m of ground on both sides."""

    height_m: float
    thickness_m: float
    label: ClassVar[str] = "bar"
    BESIDE_M: ClassVar[float] = 0.6

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends."""
        return start[0] + 2 * self.BESIDE_M + self.thickness_m, start[1]

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """Boxes of the element that begins at ``start``: the floor and the bar on it."""
        yield _slab("floor", start[0], self.end_point(start)[0], start[1], width_m)
        x = (start[0] + self.BESIDE_M, start[0] + self.BESIDE_M + self.thickness_m)
        yield box("bar", x, _across(width_m), (start[1], start[1] + self.height_m))


@dataclass(frozen=True)
class Block:
    """A box ``height_m`` high (negative: a pit) and ``length_m`` long, to step on and off."""

    height_m: float
    length_m: float
    label: ClassVar[str] = "box"

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends, at the height of its start."""
        return start[0] + self.length_m, start[1]

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """The box of the element that begins at ``start``."""
        top = start[1] + self.height_m
        height = (min(start[1], top) - THICKNESS_M, top)
        yield box("top", (start[0], start[0] + self.length_m), _across(width_m), height)


@dataclass(frozen=True)
class Gap:
    """No ground over ``length_m``."""

    length_m: float
    label: ClassVar[str] = "gap"

    def end_point(self, start: Point) -> Point:
        """Point of the walking line at which the element ends."""
        return start[0] + self.length_m, start[1]

    def surfaces(self, start: Point, width_m: float, foot_y_m: float) -> Iterator[Json]:
        """No surface."""
        yield from ()


Element = Level | Flight | Ramp | Stones | Bar | Block | Gap
"""One obstacle: a ``label``, the point at which it ends, and its boxes, whose names are unique within it."""


@dataclass(frozen=True)
class Course:
    """A platform, ``elements`` in a row, another platform; handrails on the sides of ``handrails`` along all of it."""

    elements: Sequence[Element]
    handrails: Sequence[Side] = ()
    width_m: float = 1.2

    def contact_task(self, effectors: Mapping[str, EffectorShape]) -> Json:
        """Return ``{terrain, start, goal}`` for the contact planner.

        ``effectors`` are those of the robot; they give the width of its stance and the place of its hands.

        Raises ``InvalidInput``: ``course-too-long`` (longer than ``TRAVEL_MAX_M``), ``course-without-hand`` (no hand on
        the side of a handrail), ``course-without-feet`` (not two soles whose reach has been learned).
        """
        robot = StandingRobot.of_effectors(effectors, self.handrails)
        line, terrain = (
            [(0.0, 0.0), (robot.edge_m, 0.0)],
            [_slab("start", -PLATFORM_M, robot.edge_m, 0.0, self.width_m)],
        )
        for k, element in enumerate(self.elements, 1):
            surfaces = element.surfaces(line[-1], self.width_m, robot.foot_y_m)
            terrain += [surface | {"name": f"{k} {element.label} {surface['name']}"} for surface in surfaces]
            line.append(element.end_point(line[-1]))
        end_x, end_z = line[-1]
        if end_x > TRAVEL_MAX_M:
            text = f"the course is {end_x:.1f} m long; at most {TRAVEL_MAX_M:g} m are planned at once"
            raise InvalidInput("course-too-long", text[0].upper() + text[1:] + ".", [Fault("elements", text)])
        line.append((end_x + robot.edge_m, end_z))
        terrain.append(_slab("end", end_x, end_x + robot.edge_m + PLATFORM_M, end_z, self.width_m))
        terrain += [surface for side in self.handrails for surface in _rails(line, side, robot.height_m)]
        return {
            "terrain": terrain,
            "start": {"contacts": robot.contacts(line[0], self.handrails)},
            "goal": {"contacts": robot.contacts(line[-1], self.handrails)},
        }


@dataclass(frozen=True)
class StandingRobot:
    """Dimensions of a robot that stands: ``edge_m`` from the middle of a sole to an edge in front of the toes."""

    foot_y_m: float
    edge_m: float
    height_m: float

    @classmethod
    def of_effectors(cls, effectors: Mapping[str, EffectorShape], handrails: Sequence[Side]) -> "StandingRobot":
        """Dimensions from the soles and their learned reach.

        Raises ``InvalidInput``: ``course-without-feet`` (not two soles whose reach has been learned),
        ``course-without-hand`` (no hand on the side of a handrail).
        """
        soles = [effectors.get(name) for name in ("left_foot", "right_foot")]
        sizes = [sole.half_size_m for sole in soles if sole is not None and sole.half_size_m is not None]
        heights = [sole.com_height_m for sole in soles if sole is not None and sole.com_height_m is not None]
        if len(sizes) < 2 or len(heights) < 2:
            text = "a course needs a robot with two soles whose reach has been learned"
            raise InvalidInput("course-without-feet", text[0].upper() + text[1:] + ".", [Fault("robot", text)])
        for side in handrails:
            if f"{side}_hand" not in effectors:
                text = f"the robot has no {side} hand for a handrail"
                raise InvalidInput("course-without-hand", text[0].upper() + text[1:] + ".", [Fault("handrails", text)])
        toe_m, width_m = max(size[0] for size in sizes), sum(size[1] for size in sizes) + 2 * FEET_GAP_M
        return cls(width_m / 2, toe_m + StepDefaults.toe_gap_m, sum(heights) / 2)

    def contacts(self, at: Point, handrails: Sequence[Side]) -> list[Json]:
        """Contacts of both feet at ``at`` and of the hands on the handrails."""
        x, z = at
        stance = [contact("left_foot", (x, self.foot_y_m, z)), contact("right_foot", (x, -self.foot_y_m, z))]
        ahead, up = HAND_AHEAD_SHARE * self.height_m, HAND_HEIGHT_SHARE * self.height_m
        for side in handrails:
            y = _side_sign(side) * HAND_ASIDE_SHARE * self.height_m
            stance.append(contact(f"{side}_hand", (x + ahead, y, z + up)))
        return stance


def _rails(line: Sequence[Point], side: Side, h: float) -> Iterator[Json]:
    """Rails above the walking line, ahead of it as the hands are; the first and the last extend beyond the hands."""
    points = [line[0]]
    for before, at, after in zip(line, line[1:], line[2:], strict=False):
        if abs(_slope(before, at) - _slope(at, after)) > 1e-9:
            points.append(at)
    points.append(line[-1])
    points[0] = (points[0][0] - 0.5 * h, points[0][1])
    points[-1] = (points[-1][0] + 0.5 * h, points[-1][1])
    y, up, ahead = _side_sign(side) * HAND_ASIDE_SHARE * h, HAND_HEIGHT_SHARE * h - RAIL_RADIUS_M, HAND_AHEAD_SHARE * h
    for k, (start, end) in enumerate(pairwise(points), 1):
        yield {
            "name": f"{side} rail {k}",
            "kind": "rail",
            "from_m": round_values((start[0] + ahead, y, start[1] + up)),
            "to_m": round_values((end[0] + ahead, y, end[1] + up)),
            "radius_m": RAIL_RADIUS_M,
            "friction": RAIL_FRICTION,
        }


def _side_sign(side: Side) -> float:
    return 1.0 if side == "left" else -1.0


def _slope(start: Point, end: Point) -> float:
    return (end[1] - start[1]) / (end[0] - start[0])


def _across(width_m: float) -> Point:
    return -width_m / 2, width_m / 2


def _slab(name: str, x0: float, x1: float, z: float, width_m: float) -> Json:
    return box(name, (x0, x1), _across(width_m), (z - THICKNESS_M, z))
