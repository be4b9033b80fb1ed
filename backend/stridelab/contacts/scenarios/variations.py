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
MIN_DISPLACEMENT_M: Final = 1e-3
"""Minimum stride or rise that can be scaled."""
ALIGNED_SINE: Final = 1e-3
"""Sine of the largest angle between a box and the path for the box to count as aligned."""


def vary_scenario(scenario: Mapping[str, Any], values: Mapping[Field, float]) -> Scenario:
    """A copy of ``scenario`` (``schemas.scenarios.Scenario`` as a mapping) with each field at its value.

    Raises ``InvalidInput`` (``sweep-field-impossible``) if the scenario cannot take the value.
    """
    result: Scenario = copy.deepcopy(dict(scenario))
    for field, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise _field_impossible(field, f"{value:g} is not above zero")
        _CHANGES[field](result, value)
    return result


def current_value(scenario: Mapping[str, Any], field: Field) -> float:
    """The current value of ``field`` in ``scenario``."""
    if field == "timing":
        return 1.0
    if field == "friction":
        return float(scenario["friction"])
    ways = _displacements_m(scenario)
    if field == "height":
        return max((abs(float(way[2])) for way in ways), default=0.0)
    return max((float(np.hypot(way[0], way[1])) for way in ways), default=0.0)


def _set_stride(scenario: Scenario, stride_m: float) -> None:
    s = _scale_factor(scenario, "stride", stride_m)
    origin, along = _origin_m(scenario), _path_direction(scenario)

    def stretch_along_path(p: Vector3) -> Vector3:
        return p + (s - 1.0) * float((p - origin) @ along) * along

    for surface in scenario["terrain"]:
        axis = _axis_along(surface, along, "stride")
        surface["size_m"][axis] = s * surface["size_m"][axis]
        surface["center_m"] = stretch_along_path(np.array(surface["center_m"], dtype=float)).tolist()
    _map_positions(scenario, stretch_along_path)


def _set_height(scenario: Scenario, height_m: float) -> None:
    s, ground = _scale_factor(scenario, "height", height_m), _origin_m(scenario)[2]

    def scale_height(p: Vector3) -> Vector3:
        return np.array([p[0], p[1], ground + s * (p[2] - ground)])

    for surface in scenario["terrain"]:
        _axis_along(surface, np.array([1.0, 0.0, 0.0]), "height", any_turn=True)
        z, half = surface["center_m"][2], surface["size_m"][2] / 2
        top, bottom = ground + s * (z + half - ground), min(z - half, ground + s * (z - half - ground))
        if top - bottom < MIN_DISPLACEMENT_M:
            raise _field_impossible("height", f"{surface['name']} would have no thickness")
        surface["center_m"][2], surface["size_m"][2] = (top + bottom) / 2, top - bottom
    _map_positions(scenario, scale_height)


def _scale_durations(scenario: Scenario, factor: float) -> None:
    for phase in scenario["phases"]:
        phase["duration_s"] *= factor


def _set_friction(scenario: Scenario, friction: float) -> None:
    scenario["friction"] = friction
    for surface in scenario["terrain"]:
        surface["friction"] = None


_CHANGES: Final = {"stride": _set_stride, "height": _set_height, "timing": _scale_durations, "friction": _set_friction}


def _scale_factor(scenario: Scenario, field: Field, wanted_m: float) -> float:
    now_m = current_value(scenario, field)
    if now_m < MIN_DISPLACEMENT_M:
        raise _field_impossible(field, "no foot moves in that direction in this scenario")
    return wanted_m / now_m


def _map_positions(scenario: Scenario, transform: Any) -> None:
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"] = transform(np.array(contact["position_m"], dtype=float)).tolist()


def _foot_positions_m(scenario: Mapping[str, Any]) -> dict[str, list[Vector3]]:
    """Consecutive positions of each foot."""
    places: dict[str, list[Vector3]] = {}
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            if "foot" in contact["effector"]:
                p = np.array(contact["position_m"], dtype=float)
                own = places.setdefault(contact["effector"], [])
                if not own or np.linalg.norm(p - own[-1]) > MIN_DISPLACEMENT_M:
                    own.append(p)
    return places


def _displacements_m(scenario: Mapping[str, Any]) -> list[Vector3]:
    return [b - a for own in _foot_positions_m(scenario).values() for a, b in pairwise(own)]


def _origin_m(scenario: Mapping[str, Any]) -> Vector3:
    return np.asarray(np.mean([own[0] for own in _foot_positions_m(scenario).values()], axis=0))


def _path_direction(scenario: Mapping[str, Any]) -> Vector3:
    """The horizontal direction from the first positions of the feet to their last."""
    whole = np.sum([own[-1] - own[0] for own in _foot_positions_m(scenario).values()], axis=0) * [1.0, 1.0, 0.0]
    length = float(np.linalg.norm(whole))
    if length < MIN_DISPLACEMENT_M:
        raise _field_impossible("stride", "the feet end where they start")
    return np.asarray(whole / length)


def _axis_along(surface: Mapping[str, Any], along: Vector3, field: Field, *, any_turn: bool = False) -> int:
    """Index of the horizontal axis of a box that points along the path."""
    if surface["kind"] != "box":
        raise _field_impossible(field, f"{surface['name']} is a rail, which would change its slope")
    w, x, y, z = surface.get("orientation_wxyz") or (1.0, 0.0, 0.0, 0.0)
    if 2.0 * math.hypot(x, y) > ALIGNED_SINE * math.hypot(w, z):  # twice the tangent of half the tilt
        raise _field_impossible(field, f"{surface['name']} is tilted")
    yaw = 2 * math.atan2(z, w) if surface.get("orientation_wxyz") else surface.get("yaw_rad") or 0.0
    sine = float(along[1] * math.cos(yaw) - along[0] * math.sin(yaw))
    cosine = float(along[0] * math.cos(yaw) + along[1] * math.sin(yaw))
    if not any_turn and min(abs(sine), abs(cosine)) > ALIGNED_SINE:
        raise _field_impossible(field, f"{surface['name']} is not aligned with the path")
    return 0 if abs(cosine) > abs(sine) else 1


def _field_impossible(field: Field, why: str) -> InvalidInput:
    sentence = f"The {field} of this scenario cannot be varied: {why}."
    return InvalidInput("sweep-field-impossible", sentence, [Fault(f"vary.{field}", why)])
