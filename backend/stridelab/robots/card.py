"""Robot cards ``models/robots/<name>.toml``: data about a robot that its URDF and SRDF do not contain.

A card names the description files of an installed data package or of this project. This module does not read those
files, so cards are cheap to load.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import PurePosixPath
from typing import Any, Final, Literal

from pydantic import ConfigDict, TypeAdapter, ValidationError

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.machine.models_folder import models_dir, robot_file, robot_folders

MAX_POSITION_RAD: Final = 4.0 * math.pi
"""Largest joint angle accepted; larger numbers are usually degrees."""
_STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class DataCard:
    """Paths of the description files, relative to the robots folder of ``package`` or to ``models/robots``."""

    __pydantic_config__ = _STRICT
    urdf: str
    package: str | None = None
    srdf: str | None = None


@dataclass(frozen=True)
class ReferenceCard:
    """The reference posture: a posture of the SRDF, or all joints at 0, with the angles that override it."""

    __pydantic_config__ = _STRICT
    posture: str | None = None
    joints_rad: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LimitsCard:
    """Limits that replace those of the description, by pattern of joint names."""

    __pydantic_config__ = _STRICT
    position_rad: dict[str, tuple[float, float]] = field(default_factory=dict)
    velocity_rad_s: dict[str, float] = field(default_factory=dict)
    torque_nm: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RotorsCard:
    """Reflected rotor inertia (after the gears), by pattern of joint names; takes precedence over the SRDF."""

    __pydantic_config__ = _STRICT
    armature_kg_m2: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class CollisionCard:
    """Geometries that are checked for self-collision.

    Patterns of geometry names: ``left_out`` are checked in certificate and replay only, ``visual`` are added from the
    visual model, ``meshes`` keep their triangles because their convex hull is too wide. ``never`` maps link patterns to
    the patterns of the links that they are not checked against.
    """

    __pydantic_config__ = _STRICT
    left_out: tuple[str, ...] = ()
    visual: tuple[str, ...] = ()
    meshes: tuple[str, ...] = ()
    never: dict[str, tuple[str, ...]] = field(default_factory=dict)


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
    """A whole card. Fields that name several joints, geometries or links are regular expressions, matched in full.

    ``references`` are keys of ``models/references.bib`` that results cite in addition to those of the methods.
    ``accepted_inertias`` are links whose largest principal moment exceeds the sum of the others and whose inertia is
    used as the description states it; a simulator replaces it by one with equal moments.
    """

    __pydantic_config__ = _STRICT
    title: str
    licence: str
    base_frame: str
    data: DataCard
    reference: ReferenceCard
    groups: dict[Literal["leg", "torso", "arm", "head"], str]
    effectors: dict[str, EffectorCard]
    references: tuple[str, ...] = ()
    locked_joints: tuple[str, ...] = ()
    accepted_inertias: tuple[str, ...] = ()
    limits: LimitsCard = LimitsCard()
    rotors: RotorsCard = RotorsCard()
    collision: CollisionCard = CollisionCard()

    def canonical_json(self) -> bytes:
        """The fields that affect the robot as JSON with sorted keys, independent of the layout of the file."""
        data = TypeAdapter(RobotCard).dump_python(
            self, mode="json", exclude={"title", "licence", "references"}, exclude_defaults=True
        )
        return json.dumps(data, sort_keys=True, separators=(",", ":")).encode()


def robot_names() -> tuple[str, ...]:
    """Names of the robots that have a card, sorted."""
    cards = (path.stem for folder in robot_folders(models_dir()) for path in (folder / "robots").glob("*.toml"))
    return tuple(sorted(set(cards)))


@cache
def robot_card(name: str) -> RobotCard:
    """The card of one robot.

    Raises ``NotFound`` (``robot-not-found``) for a name without a card.
    """
    return parse_card(name, card_bytes(name))


def card_bytes(name: str) -> bytes:
    """The card's file. Raises ``NotFound`` (``robot-not-found``) listing the available robots."""
    if name not in robot_names():
        raise NotFound("robot-not-found", f"There is no robot {name!r}; there is {', '.join(robot_names())}.")
    return robot_file(models_dir(), "robots", f"{name}.toml").read_bytes()


def parse_card(name: str, text: bytes) -> RobotCard:
    """Validate a card.

    Raises ``InvalidInput`` (``robot-card-invalid``) with one fault per invalid field.
    """
    try:
        data = tomllib.loads(text.decode())
    except ValueError as error:  # not UTF-8, or not TOML
        raise invalid_card(name, [Fault("", f"it is not TOML: {error}")]) from error
    return card_of_fields(name, data)


def card_of_fields(name: str, data: Mapping[str, Any]) -> RobotCard:
    """Validate the fields of a card. Raises as ``parse_card``."""
    try:
        # JSON is strict about types, and still takes a list for a tuple
        card = TypeAdapter(RobotCard).validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        faults = [Fault(field_path(item["loc"]), item["msg"]) for item in error.errors()]
        raise invalid_card(name, faults) from error
    faults = list(_card_faults(card))
    if faults:
        raise invalid_card(name, faults)
    return card


def invalid_card(name: str, faults: list[Fault]) -> InvalidInput:
    """The error for a card whose fields are invalid or do not match the robot's description."""
    places = "; ".join(f"{fault.where}: {fault.message}" if fault.where else fault.message for fault in faults)
    return InvalidInput("robot-card-invalid", f"The card of robot {name!r} is invalid. {places}", faults)


def _card_faults(card: RobotCard) -> Iterator[Fault]:
    """Faults that the types do not exclude."""
    if card.data.package is not None and not card.data.package.isidentifier():
        yield Fault("data.package", f"{card.data.package!r} is not the name of a package")
    for where, path in (("data.urdf", card.data.urdf), ("data.srdf", card.data.srdf)):
        if path is not None and (PurePosixPath(path).is_absolute() or ".." in PurePosixPath(path).parts):
            yield Fault(where, "the path must be relative, without '..'")
    if card.reference.posture is not None and card.data.srdf is None:
        yield Fault("reference.posture", "there is no SRDF that could hold a posture; give the angles in joints_rad")
    yield from _bad_patterns(card)
    yield from _bad_limits(card)
    if not any(effector.kind == "surface" for effector in card.effectors.values()):
        yield Fault("effectors", "no effector is a surface; the robot needs at least one to stand on")
    for name, effector in card.effectors.items():
        where, size = f"effectors.{name}", effector.contact_half_size_m
        if (effector.kind == "surface") != (size is not None):
            yield Fault(f"{where}.contact_half_size_m", "required for a surface, not allowed for a point")
        if size is not None and min(size) <= 0.0:
            yield Fault(f"{where}.contact_half_size_m", "both half edges must be positive")
        if not math.isclose(math.hypot(*effector.orientation_wxyz), 1.0, abs_tol=1e-6):
            yield Fault(f"{where}.orientation_wxyz", "the quaternion does not have norm 1")


def card_patterns(card: RobotCard) -> Iterator[tuple[str, str, str]]:
    """All patterns of a card: the field, the kind of object named (joint, link, part, visual), the pattern."""
    for group, pattern in card.groups.items():
        yield f"groups.{group}", "joint", pattern
    for i, pattern in enumerate(card.locked_joints):
        yield f"locked_joints[{i}]", "joint", pattern
    for i, pattern in enumerate(card.accepted_inertias):
        yield f"accepted_inertias[{i}]", "link", pattern
    for where, table in tables_by_joint(card).items():
        for pattern in table:
            yield f"{where}.{pattern}", "joint", pattern
    parts = card.collision
    for where, kind, names in (
        ("left_out", "part", parts.left_out),
        ("visual", "visual", parts.visual),
        ("meshes", "part", parts.meshes),
    ):
        for i, pattern in enumerate(names):
            yield f"collision.{where}[{i}]", kind, pattern
    for link, others in parts.never.items():
        yield f"collision.never.{link}", "link", link
        for i, pattern in enumerate(others):
            yield f"collision.never.{link}[{i}]", "link", pattern


def tables_by_joint(card: RobotCard) -> dict[str, Mapping[str, Any]]:
    """The tables of a card that give values to joints, by field."""
    return {
        "reference.joints_rad": card.reference.joints_rad,
        "limits.position_rad": card.limits.position_rad,
        "limits.velocity_rad_s": card.limits.velocity_rad_s,
        "limits.torque_nm": card.limits.torque_nm,
        "rotors.armature_kg_m2": card.rotors.armature_kg_m2,
    }


def _bad_patterns(card: RobotCard) -> Iterator[Fault]:
    for where, _, pattern in card_patterns(card):
        try:
            re.compile(pattern)
        except re.error as error:
            yield Fault(where, f"{pattern!r} is not a regular expression: {error}")


def _bad_limits(card: RobotCard) -> Iterator[Fault]:
    for pattern, (low, high) in card.limits.position_rad.items():
        if low >= high:
            yield Fault(f"limits.position_rad.{pattern}", f"the lower limit {low} is not below the upper one {high}")
        elif max(abs(low), abs(high)) > MAX_POSITION_RAD:
            yield Fault(
                f"limits.position_rad.{pattern}",
                f"{low} to {high} rad exceeds two turns; the unit must be radians, not degrees",
            )
    positive = {
        "limits.velocity_rad_s": card.limits.velocity_rad_s,
        "limits.torque_nm": card.limits.torque_nm,
        "rotors.armature_kg_m2": card.rotors.armature_kg_m2,
    }
    for where, table in positive.items():
        for pattern, value in table.items():
            if value <= 0.0:
                yield Fault(f"{where}.{pattern}", "it must be positive")


def field_path(location: tuple[int | str, ...]) -> str:
    """Path of a field in a pydantic error location, such as ``effectors.left_foot.position_m[0]``."""
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(steps).removeprefix(".")
