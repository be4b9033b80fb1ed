"""Building blocks of scenarios in plain form: robots, durations, contacts, phases and boxes.

x is the direction of travel, z points up; soles are level and point along x unless a rotation is given.
"""

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

Point = tuple[float, float, float]
Contacts = dict[str, dict[str, Any]]
Scenario = dict[str, Any]
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)
"""Orientation of a contact on level ground."""


@dataclass(frozen=True)
class Walker:
    """Dimensions of a robot that determine its footholds.

    ``foot_y_m`` is half the distance between the soles' contact frames, about that of the reference posture; ``toe_m``
    and ``heel_m`` are how far shoe and sole reach before and behind the contact frame.
    """

    robot: str
    foot_y_m: float
    toe_m: float
    heel_m: float


TALOS: Final = Walker("talos", 0.09, 0.105, 0.116)
HRP2: Final = Walker("hrp2", 0.105, 0.1175, 0.1175)


@dataclass(frozen=True)
class Timing:
    """Durations (s): standing at both ends, one effector moving, all effectors resting in between."""

    ends_s: float
    move_s: float
    rest_s: float


def scenario(
    name: str,
    description: str,
    robot: str,
    terrain: Sequence[dict[str, Any]],
    phases: Sequence[dict[str, Any]],
    friction: float = 0.3,
) -> Scenario:
    """A complete scenario, ``schemas.scenarios.Scenario`` as a mapping."""
    return {
        "name": name,
        "description": description,
        "robot": robot,
        "friction": friction,
        "terrain": list(terrain),
        "phases": list(phases),
    }


def both_feet(walker: Walker, x_m: float, z_m: float) -> Contacts:
    """Both feet side by side on level ground."""
    return {
        "left_foot": contact("left_foot", (x_m, walker.foot_y_m, z_m)),
        "right_foot": contact("right_foot", (x_m, -walker.foot_y_m, z_m)),
    }


def contact(effector: str, position_m: Point, wxyz: Iterable[float] = LEVEL) -> dict[str, Any]:
    """One contact."""
    quaternion = [round(value, 9) + 0.0 for value in wxyz]
    return {"effector": effector, "position_m": round_values(position_m), "orientation_wxyz": quaternion}


def phase(duration_s: float, contacts: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """One phase with copies of ``contacts``."""
    return {"duration_s": duration_s, "contacts": [deepcopy(contacts[name]) for name in sorted(contacts)]}


def move_effector(standing: Contacts, target: dict[str, Any], timing: Timing) -> Iterable[dict[str, Any]]:
    """Two phases: an effector swings to the contact ``target``, then all rest; updates ``standing``."""
    effector = target["effector"]
    yield phase(timing.move_s, {name: c for name, c in standing.items() if name != effector})
    standing[effector] = target
    yield phase(timing.rest_s, standing)


def ground() -> dict[str, Any]:
    """Level ground at z = 0."""
    return box("ground", (-2.0, 6.0), (-2.0, 2.0), (-0.2, 0.0))


def box(
    name: str, x_m: tuple[float, float], y_m: tuple[float, float], z_m: tuple[float, float], **more: float
) -> dict[str, Any]:
    """A box along the axes, from its extents; ``more`` may name a ``friction``."""
    extents = (x_m, y_m, z_m)
    return {
        "name": name,
        "kind": "box",
        "center_m": round_values(sum(ends) / 2 for ends in extents),
        "size_m": round_values(ends[1] - ends[0] for ends in extents),
        "yaw_rad": 0.0,
    } | more


def round_values(values: Iterable[float]) -> list[float]:
    """Round to a micrometre for readable files."""
    return [round(value, 6) + 0.0 for value in values]
