"""Builders of scenarios with obstacles: tilted stepping stones, a hand on a wall."""

from collections.abc import Sequence
from typing import Any, Final

from scipy.spatial.transform import Rotation

from stridelab.contacts.scenarios.parts import (
    TALOS,
    Point,
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

Tilt = tuple[float, float]
"""Angles in degrees about x (left side up) and about y (front down)."""
TILTS: Final[tuple[Tilt, ...]] = ((10.0, 0.0), (0.0, -12.0), (-20.0, 0.0), (0.0, 12.0))
CAREFUL: Final = Timing(2.0, 1.6, 0.3)
STONE_M: Final = (0.28, 0.16, 0.20)
LAST_STEP_EXTRA_M: Final = 0.06
"""Extra length of the last step, so that the heels clear the last stone."""
STONE_FRICTION: Final = 0.7
STONE_TOP_M: Final = 0.06
"""Height of the middle of a stone's upper face."""


def stepping_stones(
    tilts: Sequence[Tilt] = TILTS,
    step_m: float = 0.27,
    timing: Timing = CAREFUL,
    walker: Walker = TALOS,
) -> Scenario:
    """A walk over tilted stones, right foot first, with level ground before and after.

    A stone is a box of ``STONE_M``, sunk into the ground except for its upper part.
    """
    standing = both_feet(walker, 0.0, 0.0)
    phases, stones = [phase(timing.ends_s, standing)], []
    for i, tilt in enumerate(tilts, 1):
        effector = _foot_of_step(i)
        top = (i * step_m, both_feet(walker, 0.0, 0.0)[effector]["position_m"][1], STONE_TOP_M)
        turn = Rotation.from_euler("xy", tilt, degrees=True)
        stones.append(_stone_box(f"stone {i}", top, turn))
        phases += move_effector(standing, contact(effector, top, turn.as_quat(scalar_first=True)), timing)
    end_m = (len(tilts) + 1) * step_m + LAST_STEP_EXTRA_M
    for i in (len(tilts) + 1, len(tilts) + 2):
        phases += move_effector(standing, both_feet(walker, end_m, 0.0)[_foot_of_step(i)], timing)
    phases[-1]["duration_s"] = timing.ends_s
    steepest = max(abs(degrees) for tilt in tilts for degrees in tilt)
    return scenario(
        "Stepping stones",
        f"{len(stones)} stones that lean by up to {steepest:g} degrees, one foot on each, from rest to rest.",
        walker.robot,
        [ground(), *stones],
        phases,
    )


def wall_step(
    step_m: float = 0.30,
    hand_m: Point = (0.25, -0.60, 0.95),
    timing: Timing = CAREFUL,
    walker: Walker = TALOS,
    friction: float = 0.6,
) -> Scenario:
    """A step with the right hand fixed on a wall at ``hand_m``; the left foot steps first, the right foot follows.

    The wall is a box along x; the hand touches the face towards the robot, its z axis along the normal of that face.
    """
    x, y, z = hand_m
    wall = box("wall", (x - 0.5, x + 0.8), (y - 0.10, y), (0.0, z + 0.6), friction=friction)
    turn = Rotation.from_euler("x", -90, degrees=True)
    hand = contact("right_hand", (x, y, z), turn.as_quat(scalar_first=True))
    standing = both_feet(walker, 0.0, 0.0) | {"right_hand": hand}
    phases = [phase(timing.ends_s, standing)]
    for effector in ("left_foot", "right_foot"):
        phases += move_effector(standing, both_feet(walker, step_m, 0.0)[effector], timing)
    phases[-1]["duration_s"] = timing.ends_s
    return scenario(
        "A step along a wall",
        f"A step of {step_m:g} m with the right hand on a wall, from rest to rest.",
        walker.robot,
        [ground(), wall],
        phases,
    )


def _foot_of_step(i: int) -> str:
    """Right foot first."""
    return ("left_foot", "right_foot")[i % 2]


def _stone_box(name: str, top_m: Point, turn: Rotation) -> dict[str, Any]:
    """A box with the centre of its upper face at ``top_m``."""
    center = top_m - turn.apply([0.0, 0.0, STONE_M[2] / 2])
    return {
        "name": name,
        "kind": "box",
        "center_m": round_values(center.tolist()),
        "size_m": list(STONE_M),
        "orientation_wxyz": [round(float(value), 9) + 0.0 for value in turn.as_quat(scalar_first=True)],
        "friction": STONE_FRICTION,
    }
