"""Builders of scenarios: level walking, the thesis' three experiments (4.6.2 to 4.6.4), and stair descent.

Soles start at x = 0. Stair ``i`` (from 1) has its foothold at ``x = i depth_m`` and its riser ``TOE_GAP_M`` before the
toe of a foot on the stair below, which leaves clearance for the shank.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Literal

from stridelab.contacts.scenarios.parts import (
    TALOS,
    Contacts,
    Scenario,
    Timing,
    Walker,
    both_feet,
    box,
    contact,
    ground,
    move_effector,
    phase,
    round_values,
    scenario,
)

STROLLING: Final = Timing(1.0, 0.8, 0.2)
STRIDING: Final = Timing(1.0, 1.0, 0.25)
CLIMBING: Final = Timing(2.5, 1.4, 0.2)
HOLDING_ON: Final = Timing(1.9, 1.8, 0.4)
TOE_GAP_M: Final = 0.055
"""Distance between the toe (the heel when descending) and the riser."""
Footing = Literal["both", "alternate"]
"""Both feet on every stair, right first, or alternately one foot per stair and both on the top."""


@dataclass(frozen=True)
class Stairs:
    """``number`` stairs of ``height_m`` and ``depth_m``; the top one is ``landing_m`` longer.

    ``toe_gap_m`` is the distance from a toe (a heel when descending) to the riser.
    """

    number: int
    height_m: float
    depth_m: float = 0.30
    width_m: float = 1.2
    toe_gap_m: float = TOE_GAP_M
    landing_m: float = 0.6

    def ascending_boxes(self, walker: Walker) -> list[dict[str, Any]]:
        """Boxes of ascending stairs, from the ground to the tread and from the riser to the end of the flight."""
        first = walker.toe_m + self.toe_gap_m
        end = first + self.number * self.depth_m + self.landing_m
        return [self._stair_box(i, (first + (i - 1) * self.depth_m, end)) for i in range(1, self.number + 1)]

    def descending_boxes(self, walker: Walker) -> list[dict[str, Any]]:
        """Boxes of descending stairs, highest first, from behind the start to the edge of the stair."""
        first = self.depth_m - walker.heel_m - self.toe_gap_m
        edges = (first + i * self.depth_m for i in range(self.number))
        return [self._stair_box(self.number - i, (-self.landing_m, x)) for i, x in enumerate(edges)]

    def foothold(self, stair: int) -> tuple[float, float]:
        """Position (x, z) of the soles on a stair; stair 0 is the ground before the first, -1 one depth before that."""
        return stair * self.depth_m, max(0, stair) * self.height_m

    def _stair_box(self, stair: int, x_m: tuple[float, float]) -> dict[str, Any]:
        across = (-self.width_m / 2, self.width_m / 2)
        return box(f"stair {stair}", x_m, across, (0.0, stair * self.height_m))


@dataclass(frozen=True)
class HandRail:
    """A rail parallel to the stairs, in the plane ``y = y_m``.

    The hand's contact is ``ahead_m`` before the feet and ``height_m`` above the line through the footholds. The rail's
    axis lies ``radius_m`` below the line of contacts and extends ``overhang_m`` past the first and the last.
    """

    ahead_m: float = 0.22
    height_m: float = 0.80
    y_m: float = -0.58
    radius_m: float = 0.02
    friction: float = 0.6
    overhang_m: float = 0.4

    def hand_contact(self, x_feet_m: float, slope: float) -> dict[str, Any]:
        """The contact of the hand for feet at ``x_feet_m``: z along the rail's normal, x along the rail."""
        half = math.atan(slope) / 2
        position = (x_feet_m + self.ahead_m, self.y_m, slope * x_feet_m + self.height_m)
        return contact("right_hand", position, (math.cos(half), 0.0, -math.sin(half), 0.0))

    def rail_surface(self, x_first_m: float, x_last_m: float, slope: float) -> dict[str, Any]:
        """The rail for feet that move from ``x_first_m`` to ``x_last_m``."""
        a = math.atan(slope)
        ends = [
            (x + self.ahead_m + self.radius_m * math.sin(a), self.y_m,
             slope * x + self.height_m - self.radius_m * math.cos(a))
            for x in (x_first_m - self.overhang_m, x_last_m + self.overhang_m)
        ]  # fmt: skip
        return {
            "name": "rail",
            "kind": "rail",
            "from_m": round_values(ends[0]),
            "to_m": round_values(ends[1]),
            "radius_m": self.radius_m,
            "friction": self.friction,
        }


def flat_walk(steps: int = 8, step_m: float = 0.25, timing: Timing = STROLLING, walker: Walker = TALOS) -> Scenario:
    """A walk of ``steps`` steps on level ground, each foot set down ``step_m`` before the other."""
    return scenario(
        "Flat walk",
        f"{steps} steps of {step_m:g} m on level ground, from rest to rest.",
        walker.robot,
        [ground()],
        _level_steps(steps, step_m, timing, walker),
    )


def turn_on_the_spot(turns: int, turn_rad: float, timing: Timing = STROLLING, walker: Walker = TALOS) -> Scenario:
    """Turns to the left about the point between the feet, the left foot first, both feet by ``turn_rad`` each time."""
    standing = both_feet(walker, 0.0, 0.0)
    phases = [phase(timing.ends_s, standing)]
    for i in range(1, turns + 1):
        heading = i * turn_rad
        wxyz = (math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))
        for name, y_m in (("left_foot", walker.foot_y_m), ("right_foot", -walker.foot_y_m)):
            position_m = (-y_m * math.sin(heading), y_m * math.cos(heading), 0.0)
            phases += move_effector(standing, contact(name, position_m, wxyz), timing)
    phases[-1]["duration_s"] = timing.ends_s
    return scenario(
        "Turn",
        f"{turns} turns of {math.degrees(turn_rad):.0f} degrees on the spot, from rest to rest.",
        walker.robot,
        [ground()],
        phases,
    )


def long_stride(steps: int = 5, step_m: float = 0.45, timing: Timing = STRIDING, walker: Walker = TALOS) -> Scenario:
    """Experiment 1 (4.6.2): long strides; the feet stand ``step_m`` apart, so that a swing spans ``2 step_m``."""
    return scenario(
        "Long strides",
        f"Experiment 1 of the thesis: strides of {2 * step_m:g} m on level ground, from rest to rest.",
        walker.robot,
        [ground()],
        _level_steps(steps, step_m, timing, walker),
    )


def six_stairs(stairs: Stairs = Stairs(6, 0.10), timing: Timing = CLIMBING, walker: Walker = TALOS) -> Scenario:
    """Experiment 2 (4.6.3): both feet on every stair, the right one first."""
    return scenario(
        f"{_NUMBERS.get(stairs.number, stairs.number)} stairs",
        f"Experiment 2 of the thesis: {stairs.number} stairs {100 * stairs.height_m:g} cm high, both feet on each.",
        walker.robot,
        [ground(), *stairs.ascending_boxes(walker)],
        _climb_phases(stairs, timing, "both", walker),
    )


def climb(stairs: Stairs, timing: Timing, footing: Footing = "both", walker: Walker = TALOS) -> Scenario:
    """Experiment 2 (4.6.3) with any stairs and timing, with both feet or one on every stair."""
    height, depth = 100 * stairs.height_m, 100 * stairs.depth_m
    on_each = {"both": "both feet", "alternate": "one foot"}[footing]
    return scenario(
        f"{stairs.number} stairs of {height:g} cm",
        f"{stairs.number} stairs {height:g} cm high and {depth:g} cm deep, {on_each} on each, from rest to rest.",
        walker.robot,
        [ground(), *stairs.ascending_boxes(walker)],
        _climb_phases(stairs, timing, footing, walker),
    )


def descent(stairs: Stairs = Stairs(4, 0.10), timing: Timing = CLIMBING, walker: Walker = TALOS) -> Scenario:
    """Down ``stairs`` to the ground, both feet on every stair, the right one first."""
    standing = both_feet(walker, 0.0, stairs.number * stairs.height_m)
    phases = [phase(timing.ends_s, standing)]
    for i in range(1, stairs.number + 1):
        hold = (i * stairs.depth_m, (stairs.number - i) * stairs.height_m)
        phases += _move_both_feet(standing, hold, timing, walker)
    phases[-1]["duration_s"] = timing.ends_s
    return scenario(
        "Downstairs",
        f"Down {stairs.number} stairs {100 * stairs.height_m:g} cm high, both feet on each, from rest to rest.",
        walker.robot,
        [ground(), *stairs.descending_boxes(walker)],
        phases,
    )


def stairs_with_rail(
    stairs: Stairs = Stairs(4, 0.15),
    rail: HandRail = HandRail(),
    timing: Timing = HOLDING_ON,
    walker: Walker = TALOS,
) -> Scenario:
    """Experiment 3 (4.6.4): a level step, then stairs, the right hand on a rail.

    The hand, the right and the left foot move in turn.
    """
    slope = stairs.height_m / stairs.depth_m
    holds = [stairs.foothold(i) for i in range(-1, stairs.number + 1)]
    standing = both_feet(walker, *holds[0]) | {"right_hand": rail.hand_contact(holds[0][0], slope)}
    phases = [phase(timing.ends_s, standing)]
    for hold in holds[1:]:
        phases += move_effector(standing, rail.hand_contact(hold[0], slope), timing)
        phases += _move_both_feet(standing, hold, timing, walker)
    phases[-1]["duration_s"] = timing.ends_s
    return scenario(
        "Stairs with a rail",
        f"Experiment 3 of the thesis: a level step, then {stairs.number} stairs {100 * stairs.height_m:g} cm high, "
        "the right hand on a rail.",
        walker.robot,
        [ground(), *stairs.ascending_boxes(walker), rail.rail_surface(holds[0][0], holds[-1][0], slope)],
        phases,
    )


_SIDES: Final = ("left_foot", "right_foot")
"""The foot that steps on even stairs and the foot that steps on odd ones."""
_NUMBERS: Final = {3: "Three", 4: "Four", 5: "Five", 6: "Six", 7: "Seven", 8: "Eight"}


def _level_steps(steps: int, step_m: float, timing: Timing, walker: Walker) -> list[dict[str, Any]]:
    """Phases of alternating steps, right foot first; the last step closes the stance."""
    standing = both_feet(walker, 0.0, 0.0)
    phases = [phase(timing.ends_s, standing)]
    for i in range(steps):
        x = min(i + 1, steps - 1) * step_m
        phases += move_effector(standing, both_feet(walker, x, 0.0)[("right_foot", "left_foot")[i % 2]], timing)
    phases[-1]["duration_s"] = timing.ends_s
    return phases


def _climb_phases(stairs: Stairs, timing: Timing, footing: Footing, walker: Walker) -> list[dict[str, Any]]:
    """Phases of a climb from the ground to the top stair."""
    standing = both_feet(walker, *stairs.foothold(0))
    phases = [phase(timing.ends_s, standing)]
    for stair in range(1, stairs.number + 1):
        hold = stairs.foothold(stair)
        if footing == "both":
            phases += _move_both_feet(standing, hold, timing, walker)
        else:
            phases += move_effector(standing, both_feet(walker, *hold)[_SIDES[stair % 2]], timing)
    if footing == "alternate":
        last = both_feet(walker, *stairs.foothold(stairs.number))[_SIDES[(stairs.number + 1) % 2]]
        phases += move_effector(standing, last, timing)
    phases[-1]["duration_s"] = timing.ends_s
    return phases


def _move_both_feet(
    standing: Contacts, hold: tuple[float, float], timing: Timing, walker: Walker
) -> Iterable[dict[str, Any]]:
    """Phases that move the right, then the left foot to ``hold``; updates ``standing``."""
    for moving in ("right_foot", "left_foot"):
        yield from move_effector(standing, both_feet(walker, *hold)[moving], timing)
