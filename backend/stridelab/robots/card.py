"""Robot cards ``models/robots/<name>.toml``: what this project says of a robot beyond its own description.

The card names the files of an installed data package; nothing of it is read here, so that cards are light.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final, Literal

from pydantic import ConfigDict, TypeAdapter, ValidationError

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.resources import models_dir

_STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class DataCard:
    """Files of the data package ``package``, relative to its folder of robots."""

    __pydantic_config__ = _STRICT
    package: str
    urdf: str
    srdf: str


@dataclass(frozen=True)
class ReferenceCard:
    """Posture of the SRDF, with the joints in which ours differs from it."""

    __pydantic_config__ = _STRICT
    posture: str
    joints_rad: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class CollisionCard:
    """Patterns of the collision geometries that are left out."""

    __pydantic_config__ = _STRICT
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class EffectorCard:
    """One effector; the pose is that of its contact frame in the link ``frame``."""

    __pydantic_config__ = _STRICT
    frame: str
    kind: Literal["surface", "point"]
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    contact_half_size_m: tuple[float, float] | None = None
    ankle: tuple[str, str] | None = None


@dataclass(frozen=True)
class RobotCard:
    """A whole card. ``groups`` and ``locked_joints`` hold patterns of joint names, to be matched in full."""

    __pydantic_config__ = _STRICT
    title: str
    licence: str
    base_frame: str
    data: DataCard
    reference: ReferenceCard
    groups: dict[Literal["leg", "torso", "arm", "head"], str]
    effectors: dict[str, EffectorCard]
    locked_joints: tuple[str, ...] = ()
    collision: CollisionCard = CollisionCard()


def robot_names() -> tuple[str, ...]:
    """Names of the robots that have a card, sorted."""
    return tuple(sorted(path.stem for path in (models_dir() / "robots").glob("*.toml")))


@cache
def robot_card(name: str) -> RobotCard:
    """The card of one robot.

    Raises ``NotFound`` (``robot-not-found``) for a name without a card.
    """
    return parse(name, card_bytes(name))


def card_bytes(name: str) -> bytes:
    """The card's file. Raises ``NotFound`` (``robot-not-found``) naming the robots that there are."""
    if name not in robot_names():
        raise NotFound("robot-not-found", f"There is no robot {name!r}; there is {', '.join(robot_names())}.")
    return (models_dir() / "robots" / f"{name}.toml").read_bytes()


def parse(name: str, text: bytes) -> RobotCard:
    """Validate a card.

    Raises ``InvalidInput`` (``robot-card-invalid``) with one fault per field that makes no sense.
    """
    try:
        data = tomllib.loads(text.decode())
    except ValueError as error:  # not UTF-8, or not TOML
        raise invalid(name, [Fault("", f"it is not TOML: {error}")]) from error
    try:
        # JSON is strict about types, and still takes a list for a tuple
        card = TypeAdapter(RobotCard).validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        faults = [Fault(_where(item["loc"]), item["msg"]) for item in error.errors()]
        raise invalid(name, faults) from error
    faults = list(_faults(card))
    if faults:
        raise invalid(name, faults)
    return card


def invalid(name: str, faults: list[Fault]) -> InvalidInput:
    """The error for a card whose fields make no sense, or do not fit the robot's description."""
    places = "; ".join(f"{fault.where}: {fault.message}" if fault.where else fault.message for fault in faults)
    return InvalidInput("robot-card-invalid", f"The card of robot {name!r} makes no sense. {places}", faults)


def _faults(card: RobotCard) -> Iterator[Fault]:
    """What the types do not say."""
    if not card.data.package.isidentifier():
        yield Fault("data.package", f"{card.data.package!r} is not the name of a package")
    yield from _bad_patterns({f"groups.{group}": pattern for group, pattern in card.groups.items()})
    yield from _bad_patterns({f"locked_joints[{i}]": p for i, p in enumerate(card.locked_joints)})
    yield from _bad_patterns({f"collision.left_out[{i}]": p for i, p in enumerate(card.collision.left_out)})
    if not any(effector.kind == "surface" for effector in card.effectors.values()):
        yield Fault("effectors", "no effector is a surface, on which the robot could stand")
    for name, effector in card.effectors.items():
        where, size = f"effectors.{name}", effector.contact_half_size_m
        if (effector.kind == "surface") != (size is not None):
            yield Fault(f"{where}.contact_half_size_m", "a surface has a size and a point has none")
        if size is not None and min(size) <= 0.0:
            yield Fault(f"{where}.contact_half_size_m", "both half edges must be positive")
        if not math.isclose(math.hypot(*effector.orientation_wxyz), 1.0, abs_tol=1e-6):
            yield Fault(f"{where}.orientation_wxyz", "the quaternion does not have norm 1")


def _bad_patterns(patterns: Mapping[str, str]) -> Iterator[Fault]:
    for where, pattern in patterns.items():
        try:
            re.compile(pattern)
        except re.error as error:
            yield Fault(where, f"{pattern!r} is not a regular expression: {error}")


def _where(location: tuple[Any, ...]) -> str:
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(steps).removeprefix(".")
