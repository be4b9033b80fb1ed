"""Builders of scenarios: walking on level ground, and the thesis' three experiments (4.6.2 to 4.6.4) for TALOS.

x is the direction of travel, soles start at x = 0 with both feet ``FOOT_Y_M`` beside the middle. Stair ``i`` (from 1)
has its riser at ``first_riser_m + (i - 1) depth_m`` and its foothold at ``x = i depth_m``.
"""

import math
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final, Literal

FOOT_Y_M: Final = 0.09
"""Half the distance between the soles' centres."""
ROBOT: Final = "talos"

Point = tuple[float, float, float]
Contacts = dict[str, dict[str, Any]]
Scenario = dict[str, Any]
Footing = Literal["both", "alternate"]
"""Both feet on every stair, the right one first; or right and left in turn, one on each, level again on the top."""


@dataclass(frozen=True)
class Timing:
    """Durations (s): standing at both ends, one effector moving, all effectors resting in between."""

    ends_s: float
    move_s: float
    rest_s: float


@dataclass(frozen=True)
class Stairs:
    """``number`` stairs of ``height_m`` and ``depth_m``; the top one is ``landing_m`` longer."""

    number: int
    height_m: float
    depth_m: float = 0.30
    width_m: float = 1.2
    first_riser_m: float = 0.145
    landing_m: float = 0.6

    @property
    def boxes(self) -> list[dict[str, Any]]:
        """One box per stair, from the ground to its tread and from its riser to the end of the flight."""
        end = self.first_riser_m + self.number * self.depth_m + self.landing_m
        risers = [self.first_riser_m + i * self.depth_m for i in range(self.number)]
        return [_box(f"stair {i}", (x, end), self.width_m, (0.0, i * self.height_m)) for i, x in enumerate(risers, 1)]

    def foothold(self, stair: int) -> tuple[float, float]:
        """X and z of the soles on a stair; 0 is the ground before the first, -1 one depth before that."""
        return stair * self.depth_m, max(0, stair) * self.height_m


@dataclass(frozen=True)
class HandRail:
    """A rail parallel to the stairs, in the plane ``y = y_m``.

    The hand's contact is ``ahead_m`` before the feet and ``height_m`` above the line through the footholds. The rail's
    axis lies ``radius_m`` below the line of contacts and runs on for ``overhang_m`` past the first and the last.
    """

    ahead_m: float = 0.22
    height_m: float = 0.80
    y_m: float = -0.50
    radius_m: float = 0.02
    friction: float = 0.6
    overhang_m: float = 0.4

    def contact(self, x_feet_m: float, slope: float) -> dict[str, Any]:
        """The hand's contact when the feet are at ``x_feet_m``: z along the rail's normal, x along the rail."""
        half = math.atan(slope) / 2
        position = (x_feet_m + self.ahead_m, self.y_m, slope * x_feet_m + self.height_m)
        return _contact("right_hand", position, (math.cos(half), 0.0, -math.sin(half), 0.0))

    def surface(self, x_first_m: float, x_last_m: float, slope: float) -> dict[str, Any]:
        """The rail for feet that go from ``x_first_m`` to ``x_last_m``."""
        a = math.atan(slope)
        ends = [
            (x + self.ahead_m + self.radius_m * math.sin(a), self.y_m,
             slope * x + self.height_m - self.radius_m * math.cos(a))
            for x in (x_first_m - self.overhang_m, x_last_m + self.overhang_m)
        ]  # fmt: skip
        return {
            "name": "rail",
            "kind": "rail",
            "from_m": _rounded(ends[0]),
            "to_m": _rounded(ends[1]),
            "radius_m": self.radius_m,
            "friction": self.friction,
        }


def flat_walk(steps: int = 8, step_m: float = 0.25, timing: Timing = Timing(1.0, 0.8, 0.2)) -> Scenario:
    """A walk of ``steps`` steps on level ground, each foot set down ``step_m`` before the other."""
    return _scenario(
        "Flat walk",
        f"{steps} steps of {step_m:g} m on level ground, from rest to rest.",
        [_ground()],
        _level_steps(steps, step_m, timing),
    )


def long_stride(steps: int = 5, step_m: float = 0.45, timing: Timing = Timing(1.0, 1.0, 0.25)) -> Scenario:
    """Experiment 1 (4.6.2): long strides; the feet stand ``step_m`` apart, so that a swing spans ``2 step_m``."""
    return _scenario(
        "Long strides",
        f"Experiment 1 of the thesis: strides of {2 * step_m:g} m on level ground, from rest to rest.",
        [_ground()],
        _level_steps(steps, step_m, timing),
    )


def six_stairs(stairs: Stairs = Stairs(6, 0.10), timing: Timing = Timing(2.5, 1.4, 0.2)) -> Scenario:
    """Experiment 2 (4.6.3): both feet on every stair, the right one first."""
    return _scenario(
        f"{_NUMBERS.get(stairs.number, stairs.number)} stairs",
        f"Experiment 2 of the thesis: {stairs.number} stairs {100 * stairs.height_m:g} cm high, both feet on each.",
        [_ground(), *stairs.boxes],
        _flight(stairs, timing, "both"),
    )


def climb(stairs: Stairs, timing: Timing, footing: Footing = "both") -> Scenario:
    """Experiment 2 (4.6.3) varied: any stairs, at any pace, with both feet or one on every stair."""
    height, depth = 100 * stairs.height_m, 100 * stairs.depth_m
    on_each = {"both": "both feet", "alternate": "one foot"}[footing]
    return _scenario(
        f"{stairs.number} stairs of {height:g} cm",
        f"{stairs.number} stairs {height:g} cm high and {depth:g} cm deep, {on_each} on each, from rest to rest.",
        [_ground(), *stairs.boxes],
        _flight(stairs, timing, footing),
    )


def stairs_with_rail(
    stairs: Stairs = Stairs(4, 0.15), rail: HandRail = HandRail(), timing: Timing = Timing(1.9, 1.8, 0.4)
) -> Scenario:
    """Experiment 3 (4.6.4): a level step, then stairs, the right hand on a rail.

    The hand, the right and the left foot move in turn.
    """
    slope = stairs.height_m / stairs.depth_m
    holds = [stairs.foothold(i) for i in range(-1, stairs.number + 1)]
    standing = _feet(*holds[0]) | {"right_hand": rail.contact(holds[0][0], slope)}
    phases = [_phase(timing.ends_s, standing)]
    for hold in holds[1:]:
        hand = standing.pop("right_hand")
        phases.append(_phase(timing.move_s, standing))
        hand = rail.contact(hold[0], slope)
        standing["right_hand"] = hand
        phases.append(_phase(timing.rest_s, standing))
        phases += _both_feet(standing, hold, timing)
    phases[-1]["duration_s"] = timing.ends_s
    return _scenario(
        "Stairs with a rail",
        f"Experiment 3 of the thesis: a level step, then {stairs.number} stairs {100 * stairs.height_m:g} cm high, "
        "the right hand on a rail.",
        [_ground(), *stairs.boxes, rail.surface(holds[0][0], holds[-1][0], slope)],
        phases,
    )


BUNDLED: Final = {
    "flat-walk": flat_walk,
    "long-stride": long_stride,
    "six-stairs": six_stairs,
    "stairs-with-rail": stairs_with_rail,
}
"""Builder of every file of ``models/scenarios``, by the file's stem."""

_SIDES: Final = ("left_foot", "right_foot")
"""The foot that goes to even stairs, and to odd ones."""
_NUMBERS: Final = {3: "Three", 4: "Four", 5: "Five", 6: "Six", 7: "Seven", 8: "Eight"}


def _level_steps(steps: int, step_m: float, timing: Timing) -> list[dict[str, Any]]:
    """Right and left in turn, the last step drawing level with the foot before."""
    standing = _feet(0.0, 0.0)
    phases = [_phase(timing.ends_s, standing)]
    for i in range(steps):
        x = min(i + 1, steps - 1) * step_m
        moving = ("right_foot", "left_foot")[i % 2]
        phases.append(_phase(timing.move_s, {k: c for k, c in standing.items() if k != moving}))
        standing[moving] = _feet(x, 0.0)[moving]
        phases.append(_phase(timing.rest_s, standing))
    phases[-1]["duration_s"] = timing.ends_s
    return phases


def _flight(stairs: Stairs, timing: Timing, footing: Footing) -> list[dict[str, Any]]:
    """From the ground to the top stair."""
    feet = _feet(*stairs.foothold(0))
    phases = [_phase(timing.ends_s, feet)]
    for stair in range(1, stairs.number + 1):
        if footing == "both":
            phases += _both_feet(feet, stairs.foothold(stair), timing)
        else:
            phases += _one_foot(feet, _SIDES[stair % 2], stairs.foothold(stair), timing)
    if footing == "alternate":
        phases += _one_foot(feet, _SIDES[(stairs.number + 1) % 2], stairs.foothold(stairs.number), timing)
    phases[-1]["duration_s"] = timing.ends_s
    return phases


def _both_feet(standing: Contacts, hold: tuple[float, float], timing: Timing) -> Iterable[dict[str, Any]]:
    """Right, then left foot to ``hold``; ``standing`` is brought up to date."""
    for moving in ("right_foot", "left_foot"):
        yield from _one_foot(standing, moving, hold, timing)


def _one_foot(standing: Contacts, moving: str, hold: tuple[float, float], timing: Timing) -> Iterable[dict[str, Any]]:
    """One foot to ``hold``, then rest; ``standing`` is brought up to date."""
    yield _phase(timing.move_s, {k: c for k, c in standing.items() if k != moving})
    standing[moving] = _feet(*hold)[moving]
    yield _phase(timing.rest_s, standing)


def _feet(x_m: float, z_m: float) -> Contacts:
    return {
        "left_foot": _contact("left_foot", (x_m, FOOT_Y_M, z_m)),
        "right_foot": _contact("right_foot", (x_m, -FOOT_Y_M, z_m)),
    }


def _contact(effector: str, position_m: Point, wxyz: Iterable[float] = (1.0, 0.0, 0.0, 0.0)) -> dict[str, Any]:
    quaternion = [round(value, 9) + 0.0 for value in wxyz]
    return {"effector": effector, "position_m": _rounded(position_m), "orientation_wxyz": quaternion}


def _phase(duration_s: float, contacts: Contacts) -> dict[str, Any]:
    return {"duration_s": duration_s, "contacts": [deepcopy(contacts[name]) for name in sorted(contacts)]}


def _ground() -> dict[str, Any]:
    return _box("ground", (-2.0, 6.0), 4.0, (-0.2, 0.0))


def _box(name: str, x_m: tuple[float, float], width_m: float, z_m: tuple[float, float]) -> dict[str, Any]:
    return {
        "name": name,
        "kind": "box",
        "center_m": _rounded((sum(x_m) / 2, 0.0, sum(z_m) / 2)),
        "size_m": _rounded((x_m[1] - x_m[0], width_m, z_m[1] - z_m[0])),
        "yaw_rad": 0.0,
    }


def _rounded(values: Iterable[float]) -> list[float]:
    """To the micrometre, so that the files read well."""
    return [round(value, 6) + 0.0 for value in values]


def _scenario(name: str, description: str, terrain: list[dict[str, Any]], phases: list[dict[str, Any]]) -> Scenario:
    return {
        "name": name,
        "description": description,
        "robot": ROBOT,
        "friction": 0.3,
        "terrain": terrain,
        "phases": phases,
    }
