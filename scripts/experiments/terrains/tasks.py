"""Tasks of the contact planner as a stranger would draw them: a terrain, a stance and a goal stance, by a seed.

Twelve kinds in turn for three robots. Lengths that depend on the robot are multiples of its step relative to that of
TALOS. One task of five is drawn impassable on purpose, by one measure that is beyond the robot.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from stridelab.contacts.planner.step_limits import StepDefaults

TALOS_STEP_M: Final = 0.30
IMPASSABLE_SHARE: Final = 0.2
WALL_M: Final = (0.1, 2.0)
"""Thickness and height of walls."""
EDGE_M: Final = 4.0
"""Half the size of the ground; walls across end there."""

Surfaces = list[dict[str, Any]]


@dataclass(frozen=True)
class Place:
    """Where a robot stands: position of the middle between its soles, and heading."""

    x_m: float
    y_m: float
    z_m: float = 0.0
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Drawing:
    """A terrain with start and goal; ``blockers`` names surfaces of which a right refusal names one, if any."""

    terrain: Surfaces
    start: Place
    goal: Place
    blockers: tuple[str, ...] = ()


class Pencil:
    """Random numbers of one task: lengths that grow with the robot, signs, and whether it is impassable."""

    def __init__(self, rng: np.random.Generator, robot: StepDefaults) -> None:
        self.rng, self.scale, self.robot = rng, robot.step_m / TALOS_STEP_M, robot
        self.is_impassable = bool(rng.random() < IMPASSABLE_SHARE)

    def draw_between(self, low: float, high: float) -> float:
        """A number in an interval."""
        return round(float(self.rng.uniform(low, high)), 3)

    def length_m(self, low: float, high: float) -> float:
        """A length in an interval, which grows with the robot."""
        return round(float(self.rng.uniform(low, high)) * self.scale, 3)

    def draw_sign(self) -> float:
        """Either side."""
        return float(self.rng.choice((-1.0, 1.0)))

    def opening_m(self) -> float:
        """Width of a door, or of a slit."""
        width_m = self.length_m(0.75, 1.05)
        return round(0.3 * self.scale, 3) if self.is_impassable else width_m

    def rise_m(self) -> float:
        """Height of a stair, or of one too high."""
        rise_m = round(self.draw_between(0.4, 0.9) * self.robot.rise_max_m, 3)
        return round(2.2 * self.robot.rise_max_m, 3) if self.is_impassable else rise_m


def make_solid(
    name: str, x_m: tuple[float, float], y_m: tuple[float, float], z_m: tuple[float, float]
) -> dict[str, Any]:
    """A box from its extents."""
    sides = [x_m, y_m, z_m]
    return {
        "name": name,
        "kind": "box",
        "center_m": [round((low + high) / 2, 4) for low, high in sides],
        "size_m": [round(high - low, 4) for low, high in sides],
    }


def make_ground() -> dict[str, Any]:
    """Level ground."""
    return make_solid("ground", (-EDGE_M, EDGE_M), (-EDGE_M, EDGE_M), (-0.1, 0.0))


def wall_with_door(x_m: float, middle_m: float, width_m: float, name: str) -> Surfaces:
    """A wall across the way from edge to edge, with a door."""
    thick = (x_m - WALL_M[0] / 2, x_m + WALL_M[0] / 2)
    return [
        make_solid(f"{name} left", thick, (middle_m + width_m / 2, EDGE_M), (0.0, WALL_M[1])),
        make_solid(f"{name} right", thick, (-EDGE_M, middle_m - width_m / 2), (0.0, WALL_M[1])),
    ]


def door_aside(pencil: Pencil) -> Drawing:
    """A door beside the straight way."""
    middle_m = pencil.draw_sign() * pencil.draw_between(0.4, 1.2)
    walls = wall_with_door(1.5, middle_m, pencil.opening_m(), "wall")
    names = ("wall left", "wall right") if pencil.is_impassable else ()
    return Drawing([make_ground(), *walls], Place(0, 0), Place(pencil.draw_between(2.8, 3.2), 0), names)


def two_doors(pencil: Pencil) -> Drawing:
    """Two doors in succession, not in line."""
    first = wall_with_door(
        1.2, pencil.draw_sign() * pencil.draw_between(0.0, 0.5), pencil.length_m(0.8, 1.05), "first wall"
    )
    second = wall_with_door(2.6, pencil.draw_sign() * pencil.draw_between(0.0, 0.5), pencil.opening_m(), "second wall")
    names = ("second wall left", "second wall right") if pencil.is_impassable else ()
    return Drawing([make_ground(), *first, *second], Place(0, 0), Place(3.6, 0), names)


def corridor(pencil: Pencil) -> Drawing:
    """An L-shaped corridor, which the robot leaves with a quarter turn."""
    half_m, side = pencil.length_m(1.2, 1.6) / 2, pencil.draw_sign()
    end_m, t = pencil.draw_between(1.6, 2.2), WALL_M[0]

    def make_wall(name: str, x_m: tuple[float, float], y_m: tuple[float, float]) -> dict[str, Any]:
        low, high = sorted((side * y_m[0], side * y_m[1]))
        return make_solid(name, x_m, (low, high), (0.0, WALL_M[1]))

    walls = [
        make_wall("outer wall", (-1.0, end_m + half_m), (-half_m - t, -half_m)),
        make_wall("end wall", (end_m + half_m, end_m + half_m + t), (-half_m - t, 3.0)),
        make_wall("inner wall", (-1.0, end_m - half_m), (half_m, half_m + t)),
        make_wall("inner end wall", (end_m - half_m - t, end_m - half_m), (half_m + t, 3.0)),
        make_wall("back wall", (-1.0 - t, -1.0), (-half_m - t, half_m + t)),
    ]
    goal = Place(end_m, side * 2.0, 0.0, side * np.pi / 2)
    if pencil.is_impassable:
        walls.append(make_wall("barrier", (end_m - half_m, end_m + half_m), (1.2, 1.3)))
    return Drawing([make_ground(), *walls], Place(0, 0), goal, ("barrier",) if pencil.is_impassable else ())


def wall_end(pencil: Pencil) -> Drawing:
    """A wall across the way with a gap between its end and a second wall."""
    side, end_m = pencil.draw_sign(), pencil.draw_between(0.1, 0.9)
    gap_m = pencil.opening_m()
    walls = wall_with_door(1.5, side * (end_m + gap_m / 2), gap_m, "wall")
    names = ("wall left", "wall right") if pencil.is_impassable else ()
    return Drawing([make_ground(), *walls], Place(0, 0), Place(3.0, 0), names)


def bench(pencil: Pencil) -> Drawing:
    """A bench across the way, or one from edge to edge."""
    middle_m, half_m = pencil.draw_between(-0.4, 0.4), pencil.draw_between(0.5, 0.9)
    span = (-EDGE_M, EDGE_M) if pencil.is_impassable else (middle_m - half_m, middle_m + half_m)
    seat = make_solid("bench", (1.3, 1.7), span, (0.0, pencil.draw_between(0.42, 0.48)))
    return Drawing([make_ground(), seat], Place(0, 0), Place(3.0, 0), ("bench",) if pencil.is_impassable else ())


def step_down(pencil: Pencil) -> Drawing:
    """A step down from a platform, then a turn."""
    rise_m, side = pencil.rise_m(), pencil.draw_sign()
    platform = make_solid("platform", (-1.0, 0.6), (-1.0, 1.0), (0.0, rise_m))
    goal = Place(1.5, side * pencil.draw_between(0.3, 1.0), 0.0, side * pencil.draw_between(np.pi / 4, np.pi / 2))
    names = ("ground", "platform") if pencil.is_impassable else ()
    return Drawing([make_ground(), platform], Place(0, 0, rise_m), goal, names)


def stones(pencil: Pencil) -> Drawing:
    """Stones in two rows over a pit, in pairs, with uneven heights."""
    apart_m, rows = pencil.length_m(0.26, 0.34), 4
    terrain = [make_solid("near bank", (-1.0, 0.3), (-1.0, 1.0), (-0.3, 0.0))]
    x_m = 0.3 + apart_m / 2
    for k in range(rows):
        if pencil.is_impassable and k == rows // 2:
            x_m += 2.0 * pencil.scale
        for name, side in (("left", 1.0), ("right", -1.0)):
            half_m, top_m = 0.15 * pencil.scale, pencil.length_m(-0.04, 0.04)
            middle_m = side * (pencil.robot.width_m / 2 + pencil.length_m(0.05, 0.08))
            span = (middle_m - half_m, middle_m + half_m)
            terrain.append(make_solid(f"stone {k + 1} {name}", (x_m - half_m, x_m + half_m), span, (-0.3, top_m)))
        x_m += apart_m
    terrain.append(make_solid("far bank", (x_m - apart_m / 2, x_m + 1.5), (-1.0, 1.0), (-0.3, 0.0)))
    names = ("stone 3 left", "stone 3 right") if pencil.is_impassable else ()
    return Drawing(terrain, Place(0, 0), Place(x_m + 0.4, 0), names)


def ramp(pencil: Pencil) -> Drawing:
    """A ramp onto a landing, on which the robot turns."""
    angle = np.radians(30.0 if pencil.is_impassable else pencil.draw_between(4.0, 9.0))
    run_m, side = pencil.draw_between(0.9, 1.4), pencil.draw_sign()
    rise_m = run_m * np.tan(angle)
    turn = Rotation.from_euler("y", -angle)
    thick_m = 0.1
    top = np.array([0.6 + run_m / 2, 0.0, rise_m / 2])
    slope = {
        "name": "ramp",
        "kind": "box",
        "center_m": np.round(top - turn.apply([0, 0, thick_m / 2]), 5).tolist(),
        "size_m": [round(run_m / np.cos(angle), 5), 2.0, thick_m],
        "orientation_wxyz": np.round(turn.as_quat(scalar_first=True), 9).tolist(),
    }
    edge_m, z_m = 0.6 + run_m, round(float(rise_m), 4)
    floor = make_solid("ground", (-EDGE_M, 0.6), (-EDGE_M, EDGE_M), (-0.1, 0.0))
    landing = make_solid("landing", (edge_m, edge_m + 1.4), (-1.6, 1.6), (z_m - 0.1, z_m))
    goal = Place(edge_m + 0.7, side * 0.7, z_m, side * np.pi / 2)
    names = ("ramp", "landing") if pencil.is_impassable else ()
    return Drawing([floor, slope, landing], Place(0, 0), goal, names)


def low_table(pencil: Pencil) -> Drawing:
    """A low table in the way: a plate on a foot, or one from edge to edge."""
    y_m, half_m = pencil.draw_between(-0.3, 0.3), pencil.draw_between(0.3, 0.6)
    top_m = pencil.draw_between(0.45, 0.6)
    span = (-EDGE_M, EDGE_M) if pencil.is_impassable else (y_m - half_m, y_m + half_m)
    plate = make_solid("table", (1.2, 1.8), span, (top_m - 0.04, top_m))
    leg = make_solid("leg", (1.45, 1.55), (y_m - 0.05, y_m + 0.05), (0.0, top_m - 0.04))
    return Drawing([make_ground(), plate, leg], Place(0, 0), Place(3.0, 0), ("table",) if pencil.is_impassable else ())


def passage(pencil: Pencil) -> Drawing:
    """A narrow passage between two boxes that reach to the edges."""
    middle_m, gap_m = pencil.draw_between(-0.3, 0.3), pencil.opening_m()
    high_m, deep_m = pencil.draw_between(0.7, 1.2), pencil.draw_between(0.5, 1.0)
    sides = ((middle_m + gap_m / 2, EDGE_M), (-EDGE_M, middle_m - gap_m / 2))
    names = ("left box", "right box")
    boxes = [make_solid(n, (1.0, 1.0 + deep_m), y, (0.0, high_m)) for n, y in zip(names, sides, strict=True)]
    return Drawing([make_ground(), *boxes], Place(0, 0), Place(3.0, 0), names if pencil.is_impassable else ())


def platform(pencil: Pencil) -> Drawing:
    """A platform beside the robot, two steps up."""
    rise_m, deep_m, side = pencil.rise_m(), pencil.draw_between(0.3, 0.4), pencil.draw_sign()

    def make_stair(name: str, near_m: float, far_m: float, top_m: float) -> dict[str, Any]:
        low, high = sorted((side * near_m, side * far_m))
        return make_solid(name, (-0.6, 1.6), (low, high), (0.0, top_m))

    stairs = [make_stair("first step", 0.7, 0.7 + deep_m, rise_m)]
    stairs.append(make_stair("platform", 0.7 + deep_m, 2.6, round(2 * rise_m, 3)))
    goal = Place(0.5, side * (1.2 + deep_m), round(2 * rise_m, 3), side * np.pi / 2)
    return Drawing([make_ground(), *stairs], Place(0, 0), goal, ("first step",) if pencil.is_impassable else ())


def goal_behind(pencil: Pencil) -> Drawing:
    """A goal behind the start that faces away from it, with a wall in between if it is impassable."""
    goal = Place(
        -pencil.draw_between(1.4, 2.4),
        pencil.draw_between(-0.8, 0.8),
        0.0,
        pencil.draw_sign() * pencil.draw_between(2.4, 3.1),
    )
    terrain = [make_ground()]
    if pencil.is_impassable:
        terrain.append(make_solid("wall", (-0.9, -0.8), (-EDGE_M, EDGE_M), (0.0, 1.0)))
    return Drawing(terrain, Place(0, 0), goal, ("wall",) if pencil.is_impassable else ())


KINDS: Final[Mapping[str, Callable[[Pencil], Drawing]]] = {
    build.__name__: build
    for build in (
        door_aside,
        two_doors,
        corridor,
        wall_end,
        bench,
        step_down,
        stones,
        ramp,
        low_table,
        passage,
        platform,
        goal_behind,
    )
}
"""Builders by kind."""


@dataclass(frozen=True, eq=False)
class DrawnTask:
    """A task of the contact planner; ``blockers`` are empty where it is meant to be passable."""

    index: int
    robot: str
    kind: str
    task: dict[str, Any]
    blockers: tuple[str, ...]


def draw_tasks(number: int, seed: int, robots: Mapping[str, StepDefaults]) -> list[DrawnTask]:
    """``number`` tasks; every one depends on the seed and its index only."""
    names, kinds, tasks = tuple(robots), tuple(KINDS), []
    for index in range(number):
        kind, robot = kinds[index % len(kinds)], names[(index + index // len(kinds)) % len(names)]
        pencil = Pencil(np.random.default_rng([seed, index]), robots[robot])
        drawing = KINDS[kind](pencil)
        ends = {
            end: {"contacts": _stance(place, robots[robot].width_m)}
            for end, place in (("start", drawing.start), ("goal", drawing.goal))
        }
        task = {"name": f"{kind} {index}", "robot": robot, "friction": 0.5, "terrain": drawing.terrain, **ends}
        tasks.append(DrawnTask(index, robot, kind, task, drawing.blockers))
    return tasks


def _stance(place: Place, width_m: float) -> list[dict[str, Any]]:
    c, s = np.cos(place.yaw_rad), np.sin(place.yaw_rad)
    turn = Rotation.from_euler("z", place.yaw_rad).as_quat(scalar_first=True)
    return [
        {
            "effector": foot,
            "position_m": [
                round(float(place.x_m - side * s * width_m / 2), 6),
                round(float(place.y_m + side * c * width_m / 2), 6),
                place.z_m,
            ],
            "orientation_wxyz": np.round(turn, 9).tolist(),
        }
        for foot, side in (("left_foot", 1.0), ("right_foot", -1.0))
    ]
