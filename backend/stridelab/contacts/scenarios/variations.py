"""Variations of a scenario: changes stride, step height, timing or friction and everything that depends on it.

    stride    the longest horizontal displacement of a foot between two contacts, in metres. All contacts and boxes are
              stretched along the path: xi -> s xi
    height    the largest rise or fall of a foot between two contacts, in metres: z -> s z about the first soles
    timing    a factor on all durations
    friction  the coefficient of every surface

Soles keep their size: validation reports a sole that no longer fits on its tread.
"""

import copy
import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final, Literal, get_args

import numpy as np

from stridelab.conventions import Vector3
from stridelab.errors import Fault, InvalidInput

Field = Literal["stride", "height", "timing", "friction"]
FIELDS: Final[tuple[Field, ...]] = get_args(Field)
UNITS: Final[Mapping[Field, str]] = {"stride": "m", "height": "m", "timing": "", "friction": ""}
Scenario = dict[str, Any]
LEAST_M: Final = 1e-3
"""Minimum stride or rise that can be scaled."""
STRAIGHT: Final = 1e-3
"""Sine of the largest angle between a box and the path for the box to count as aligned."""


def varied(scenario: Mapping[str, Any], values: Mapping[Field, float]) -> Scenario:
    """A copy of ``scenario`` (``schemas.scenarios.Scenario`` as a mapping) with each field at its value.

    Raises ``InvalidInput`` (``sweep-field-impossible``) if the scenario cannot take the value.
    """
    result: Scenario = copy.deepcopy(dict(scenario))
    for field, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise _impossible(field, f"{value:g} is not above zero")
        _CHANGES[field](result, value)
    return result


def present(scenario: Mapping[str, Any], field: Field) -> float:
    """The current value of ``field`` in ``scenario``."""
    if field == "timing":
        return 1.0
    if field == "friction":
        return float(scenario["friction"])
    ways = _ways_m(scenario)
    if field == "height":
        return max((abs(float(way[2])) for way in ways), default=0.0)
    return max((float(np.hypot(way[0], way[1])) for way in ways), default=0.0)


def _stride(scenario: Scenario, stride_m: float) -> None:
    s = _factor(scenario, "stride", stride_m)
    origin, along = _origin_m(scenario), _along(scenario)

    def stretched(p: Vector3) -> Vector3:
        return p + (s - 1.0) * float((p - origin) @ along) * along

    for surface in scenario["terrain"]:
        axis = _axis_along(surface, along, "stride")
        surface["size_m"][axis] = s * surface["size_m"][axis]
        surface["center_m"] = stretched(np.array(surface["center_m"], dtype=float)).tolist()
    _move(scenario, stretched)


def _height(scenario: Scenario, height_m: float) -> None:
    s, ground = _factor(scenario, "height", height_m), _origin_m(scenario)[2]

    def raised(p: Vector3) -> Vector3:
        return np.array([p[0], p[1], ground + s * (p[2] - ground)])

    for surface in scenario["terrain"]:
        _axis_along(surface, np.array([1.0, 0.0, 0.0]), "height", any_turn=True)
        z, half = surface["center_m"][2], surface["size_m"][2] / 2
        top, bottom = ground + s * (z + half - ground), min(z - half, ground + s * (z - half - ground))
        if top - bottom < LEAST_M:
            raise _impossible("height", f"{surface['name']} would have no thickness")
        surface["center_m"][2], surface["size_m"][2] = (top + bottom) / 2, top - bottom
    _move(scenario, raised)


def _timing(scenario: Scenario, factor: float) -> None:
    for phase in scenario["phases"]:
        phase["duration_s"] *= factor


def _friction(scenario: Scenario, friction: float) -> None:
    scenario["friction"] = friction
    for surface in scenario["terrain"]:
        surface["friction"] = None


_CHANGES: Final = {"stride": _stride, "height": _height, "timing": _timing, "friction": _friction}


def _factor(scenario: Scenario, field: Field, wanted_m: float) -> float:
    now_m = present(scenario, field)
    if now_m < LEAST_M:
        raise _impossible(field, "no foot moves in that direction in this scenario")
    return wanted_m / now_m


def _move(scenario: Scenario, to: Any) -> None:
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"] = to(np.array(contact["position_m"], dtype=float)).tolist()


def _places_m(scenario: Mapping[str, Any]) -> dict[str, list[Vector3]]:
    """Consecutive positions of each foot."""
    places: dict[str, list[Vector3]] = {}
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            if "foot" in contact["effector"]:
                p = np.array(contact["position_m"], dtype=float)
                own = places.setdefault(contact["effector"], [])
                if not own or np.linalg.norm(p - own[-1]) > LEAST_M:
                    own.append(p)
    return places


def _ways_m(scenario: Mapping[str, Any]) -> list[Vector3]:
    return [b - a for own in _places_m(scenario).values() for a, b in pairwise(own)]


def _origin_m(scenario: Mapping[str, Any]) -> Vector3:
    return np.asarray(np.mean([own[0] for own in _places_m(scenario).values()], axis=0))


def _along(scenario: Mapping[str, Any]) -> Vector3:
    """The horizontal direction from the first positions of the feet to their last."""
    whole = np.sum([own[-1] - own[0] for own in _places_m(scenario).values()], axis=0) * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(whole))
    if length < LEAST_M:
        raise _impossible("stride", "the feet end where they start")
    return np.asarray(whole / length)


def _axis_along(surface: Mapping[str, Any], along: Vector3, field: Field, *, any_turn: bool = False) -> int:
    """Index of the horizontal axis of a box that points along the path."""
    if surface["kind"] != "box":
        raise _impossible(field, f"{surface['name']} is a rail, which would change its slope")
    w, x, y, z = surface.get("orientation_wxyz") or (1.0, 0.0, 0.0, 0.0)
    if 2.0 * math.hypot(x, y) > STRAIGHT * math.hypot(w, z):  # twice the tangent of half the tilt
        raise _impossible(field, f"{surface['name']} is tilted")
    yaw = 2 * math.atan2(z, w) if surface.get("orientation_wxyz") else surface.get("yaw_rad") or 0.0
    sine = float(along[1] * math.cos(yaw) - along[0] * math.sin(yaw))
    cosine = float(along[0] * math.cos(yaw) + along[1] * math.sin(yaw))
    if not any_turn and min(abs(sine), abs(cosine)) > STRAIGHT:
        raise _impossible(field, f"{surface['name']} is not aligned with the path")
    return 0 if abs(cosine) > abs(sine) else 1


def _impossible(field: Field, why: str) -> InvalidInput:
    sentence = f"The {field} of this scenario cannot be varied: {why}."
    return InvalidInput("sweep-field-impossible", sentence, [Fault(f"vary.{field}", why)])
