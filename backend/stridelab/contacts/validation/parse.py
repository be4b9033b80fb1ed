"""Parses a scenario in plain form and collects the faults of its values.

Valid parts are parsed even if others are faulty, so that one report contains all faults.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.terrain import Box, Rail, Surface, Terrain
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault

DURATION_S: Final = (0.05, 60.0)
"""Minimum and maximum duration of a phase."""
FRICTION_MAX: Final = 2.0
COM_HEIGHT_MAX_M: Final = 3.0
LENGTH_MAX_M: Final = 100.0
"""Maximum length; larger values are not in metres."""
NORM_MIN: Final = 1e-6
"""Minimum length of a quaternion or a rail."""


@dataclass(frozen=True, eq=False)
class DraftPhase:
    """The valid part of one phase; ``named`` are all effectors that it names, including those with faults."""

    duration_s: float | None
    contacts: Mapping[str, Placement]
    named: frozenset[str]


@dataclass(frozen=True, eq=False)
class Draft:
    """The valid part of a scenario, with the faults of its values."""

    name: str
    robot: str
    friction: float
    start_com_height_m: float | None
    terrain: Terrain
    phases: tuple[DraftPhase, ...]
    faults: tuple[Fault, ...]
    invalid_friction: frozenset[str | None] = frozenset()
    """Surfaces with an invalid friction of their own; contains None if the scenario's friction is invalid."""


def contact_field(phase: int, effector: str) -> str:
    """The field path of a contact in a fault."""
    return f"phases[{phase}].contacts[{effector}]"


def parse_scenario(scenario: Mapping[str, Any], effectors: Mapping[str, EffectorShape]) -> Draft:
    """Parse a scenario, ``schemas.scenarios.Scenario`` as a mapping; invalid values become faults."""
    reader = _Parser(effectors)
    friction = reader.parse_friction(None, "friction", scenario.get("friction", 0.3))
    height = reader.value_or_fault("start_com_height_m", lambda: _com_height_m(scenario.get("start_com_height_m")))
    surfaces = [
        s
        for i, entry in enumerate(_list_items(scenario, "terrain"))
        if (s := reader.parse_surface(i, entry)) is not None
    ]
    phases = tuple(reader.parse_phase(i, entry) for i, entry in enumerate(_list_items(scenario, "phases")))
    name, robot = str(scenario.get("name", "")), str(scenario.get("robot", ""))
    terrain, without = Terrain.from_surfaces(surfaces), frozenset(reader.invalid_friction)
    return Draft(name, robot, friction or 0.3, height, terrain, phases, tuple(reader.faults), without)


class _Parser:
    """Parser that collects faults."""

    def __init__(self, effectors: Mapping[str, EffectorShape]) -> None:
        self.effectors = effectors
        self.faults: list[Fault] = []
        self.names: set[str] = set()
        self.invalid_friction: set[str | None] = set()

    def value_or_fault(self, where: str, read_value: Callable[[], Any]) -> Any:
        """Return the value, or None and add a fault at ``where``."""
        try:
            return read_value()
        except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
            missing = isinstance(error, KeyError)
            self.faults.append(Fault(where, f"{error.args[0]} is missing" if missing else str(error)))
            return None

    def parse_surface(self, index: int, entry: Any) -> Surface | None:
        where = f"terrain[{index}]"
        parsed: Surface | None = self.value_or_fault(where, lambda: _parse_shape(entry))
        if parsed is None:
            return None
        if entry.get("friction") is not None:
            parsed = replace(parsed, friction=self.parse_friction(parsed.name, where, entry["friction"]))
        if parsed.name in self.names:
            self.faults.append(Fault(f"{where}.name", f"two surfaces have the name {parsed.name!r}"))
            return None
        self.names.add(parsed.name)
        return parsed

    def parse_friction(self, surface: str | None, where: str, value: Any) -> float | None:
        """Return the coefficient of a surface or of the scenario, or None and add a fault if it is invalid."""
        coefficient: float | None = self.value_or_fault(where, lambda: _friction_coefficient(value))
        if coefficient is None:
            self.invalid_friction.add(surface)
        return coefficient

    def parse_phase(self, index: int, entry: Any) -> DraftPhase:
        where = f"phases[{index}]"
        duration_s = self.value_or_fault(f"{where}.duration_s", lambda: _duration_s(entry["duration_s"]))
        contacts: dict[str, Placement] = {}
        named: set[str] = set()
        for i, (effector, contact) in enumerate(_contact_entries(entry)):
            if effector not in self.effectors:
                available = ", ".join(self.effectors)
                place = contact_field(index, effector) if effector else f"{where}.contacts[{i}]"
                self.faults.append(
                    Fault(place, f"the robot has no effector {effector!r}; it has {available or 'none'}")
                )
                continue
            if effector in named:
                self.faults.append(Fault(contact_field(index, effector), "the same effector is named twice"))
                continue
            named.add(effector)
            placement = self.value_or_fault(contact_field(index, effector), partial(_parse_placement, contact))
            if placement is not None:
                contacts[effector] = placement
        return DraftPhase(duration_s, contacts, frozenset(named))


def _list_items(scenario: Mapping[str, Any], key: str) -> Sequence[Any]:
    items = scenario.get(key)
    return items if isinstance(items, Sequence) and not isinstance(items, str) else ()


def _contact_entries(entry: Any) -> Iterator[tuple[str, Any]]:
    for contact in _list_items(entry, "contacts") if isinstance(entry, Mapping) else ():
        yield (str(contact.get("effector", "")), contact) if isinstance(contact, Mapping) else ("", contact)


def _parse_shape(entry: Mapping[str, Any]) -> Surface:
    """Parse a surface without its friction."""
    name = str(entry["name"])
    if entry["kind"] == "rail":
        start, end, radius = _vector(entry, "from_m"), _vector(entry, "to_m"), _length_m(entry["radius_m"], "radius_m")
        if np.linalg.norm(end - start) < NORM_MIN:
            raise ValueError("the rail has no length: from_m and to_m are the same")
        if radius <= 0:
            raise ValueError("radius_m must be above 0")
        return Rail(name, start, end, radius)
    if entry["kind"] != "box":
        raise ValueError(f"a surface is a box or a rail, not {entry['kind']!r}")
    size = _vector(entry, "size_m")
    if size.min() <= 0:
        raise ValueError("all three edges of size_m must be above 0")
    yaw, wxyz = entry.get("yaw_rad"), entry.get("orientation_wxyz")
    if yaw is not None and wxyz is not None:
        raise ValueError("a box is turned by yaw_rad or by orientation_wxyz, not by both")
    if yaw is not None:
        half = _finite_number(yaw, "yaw_rad") / 2
        wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))
    return Box(name, _build_placement(_vector(entry, "center_m"), wxyz), size)


def _parse_placement(contact: Mapping[str, Any]) -> Placement:
    return _build_placement(_vector(contact, "position_m"), contact.get("orientation_wxyz"))


def _build_placement(position_m: Vector3, wxyz: Sequence[Any] | None) -> Placement:
    quaternion = (1.0, 0.0, 0.0, 0.0) if wxyz is None else tuple(_finite_number(v, "orientation_wxyz") for v in wxyz)
    if len(quaternion) != 4:
        raise ValueError("orientation_wxyz must have four numbers")
    largest = max(abs(value) for value in quaternion)
    if largest < NORM_MIN:
        raise ValueError("orientation_wxyz is zero: it has no direction")
    return Placement.from_wxyz([float(value) for value in position_m], [value / largest for value in quaternion])


def _vector(entry: Mapping[str, Any], key: str) -> Vector3:
    values = [_length_m(value, key) for value in entry[key]]
    if len(values) != 3:
        raise ValueError(f"{key} must have three numbers")
    return np.array(values)


def _finite_number(value: Any, what: str) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite")
    return number


def _length_m(value: Any, what: str) -> float:
    length = _finite_number(value, what)
    if abs(length) > LENGTH_MAX_M:
        raise ValueError(f"{what} has {length:g} m: lengths are in metres, up to {LENGTH_MAX_M:g} m")
    return length


def _friction_coefficient(value: Any) -> float:
    friction = _finite_number(value, "friction")
    if not 0 < friction <= FRICTION_MAX:
        raise ValueError(f"friction must be above 0 and at most {FRICTION_MAX:g}")
    return friction


def _com_height_m(value: Any) -> float | None:
    height = None if value is None else _finite_number(value, "start_com_height_m")
    if height is not None and not 0 < height <= COM_HEIGHT_MAX_M:
        raise ValueError(f"the CoM starts above the soles, at most {COM_HEIGHT_MAX_M:g} m")
    return height


def _duration_s(value: Any) -> float:
    duration_s = _finite_number(value, "duration_s")
    low, high = DURATION_S
    if not low <= duration_s <= high:
        raise ValueError(f"a phase lasts {low:g} to {high:g} s, not {duration_s:g} s")
    return duration_s
