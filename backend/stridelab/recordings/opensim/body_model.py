"""Reads the bodies, joints and coordinates of an OpenSim model (.osim); muscles, geometry and controllers are skipped.

A joint places the child body B in the parent body P by

    X_PB = X_PF X_FM(q) X_BM^-1,   X_FM = (R(a_1, f_1) R(a_2, f_2) R(a_3, f_3), sum_k b_k g_k)

with fixed frames F in P and M in B, axes a_k and b_k, and functions f_k and g_k of the coordinates q. Files of OpenSim
4 name the frames, files of OpenSim 1 to 3 state them in the joint of each body.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from stridelab.conventions import Rotation, Series, Vector3
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.xml_tree import BrokenXmlError, parse_xml
from stridelab.recordings.opensim.functions import (
    BrokenModelError,
    Function,
    inner_function,
    numbers_in,
    parse_function,
)

GROUND: Final = "ground"
MAX_BODIES: Final = 500
_SKIPPED: Final = frozenset(
    {"ForceSet", "ControllerSet", "ProbeSet", "ContactGeometrySet", "MarkerSet", "attached_geometry", "FrameGeometry"}
    | {"WrapObjectSet", "VisibleObject", "ModelVisualPreferences", "visual_geometry", "ComponentSet", "defaults"}
)
_AXES: Final = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0]), "z": np.array([0.0, 0.0, 1.0])}
_PLAIN_JOINTS: Final = {
    "WeldJoint": ("", ""),
    "PinJoint": ("z", ""),
    "SliderJoint": ("", "x"),
    "UniversalJoint": ("xy", ""),
    "BallJoint": ("xyz", ""),
    "GimbalJoint": ("xyz", ""),
    "PlanarJoint": ("z", "xy"),
    "FreeJoint": ("xyz", "xyz"),
}
"""Axes of rotation, then of translation; the joint's coordinates have the same order."""


@dataclass(frozen=True)
class Frame:
    """Rotation and position of a frame in its body, metres."""

    R: Rotation
    p: Vector3


@dataclass(frozen=True)
class Body:
    """Mass in kg and centre of mass in the body's frame in metres."""

    mass_kg: float
    com_m: Vector3


@dataclass(frozen=True)
class Coordinate:
    """Default value (radians or metres), and whether motion files give the coordinate in degrees."""

    default: float
    rotational: bool
    locked: bool = False


@dataclass(frozen=True)
class JointAxis:
    """Displacement along or about ``axis``: ``function`` of the coordinates of these names."""

    axis: Vector3
    coordinates: tuple[str, ...]
    function: Function


@dataclass(frozen=True)
class Joint:
    """Joint between two bodies; ``rotations`` and ``translations`` have up to three axes, in order."""

    name: str
    parent: str
    child: str
    in_parent: Frame
    in_child: Frame
    rotations: tuple[JointAxis, ...]
    translations: tuple[JointAxis, ...]
    coordinates: tuple[str, ...]


@dataclass(frozen=True)
class Coupling:
    """Coordinate that is a function of others."""

    coordinate: str
    axis: JointAxis


@dataclass(frozen=True)
class BodyModel:
    """Bodies by name, joints in order from the ground, coordinates by name; ``up`` is opposite to gravity."""

    bodies: Mapping[str, Body]
    joints: tuple[Joint, ...]
    coordinates: Mapping[str, Coordinate]
    couplings: tuple[Coupling, ...]
    up: Vector3 = field(default_factory=lambda: _AXES["y"])

    @property
    def mass_kg(self) -> float:
        """Mass of all bodies."""
        return sum(body.mass_kg for body in self.bodies.values())


def is_body_model(text: str) -> bool:
    """Whether a text begins like an OpenSim model, which other XML files of OpenSim do not."""
    head = text[:4000]
    return "<OpenSimDocument" in head and "<Model" in head


def read_body_model(text: str, name: str) -> BodyModel:
    """Parse an .osim file; ``name`` is its name in messages.

    Raises ``UnreadableFile`` (``osim-broken``).
    """
    try:
        return _parse_model(parse_xml(text, _SKIPPED))
    except (BrokenXmlError, BrokenModelError) as error:
        raise UnreadableFile(
            "osim-broken", f"The OpenSim model {name} cannot be used: {error}.", [Fault(name, str(error))]
        ) from error


def euler_xyz(angles_rad: Vector3) -> Rotation:
    """Rotation of body-fixed rotations about x, y and z."""
    c, s = np.cos(angles_rad), np.sin(angles_rad)
    x = np.array([[1.0, 0.0, 0.0], [0.0, c[0], -s[0]], [0.0, s[0], c[0]]])
    y = np.array([[c[1], 0.0, s[1]], [0.0, 1.0, 0.0], [-s[1], 0.0, c[1]]])
    z = np.array([[c[2], -s[2], 0.0], [s[2], c[2], 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(x @ y @ z)


def _parse_model(root: Element) -> BodyModel:
    model = root.find("Model") if root.tag == "OpenSimDocument" else None
    if model is None:
        raise BrokenModelError("it has no Model")
    elements = _objects(model, "BodySet")
    if not 1 <= len(elements) <= MAX_BODIES:
        raise BrokenModelError(f"it has {len(elements)} bodies; 1 to {MAX_BODIES} are expected")
    bodies: dict[str, Body] = {}
    frames: dict[str, tuple[str, Frame]] = {}
    joints: list[tuple[Element, str]] = []
    for element in elements:
        name = element.get("name", "").strip()
        if name in bodies:
            raise BrokenModelError(f"it has two bodies of the name {name[:40]!r}")
        if name != GROUND:
            bodies[name] = _parse_body(element, name)
        frames |= _named_frames(element.find("components"), name)
        joints += [(joint, name) for joint in element.findall("Joint/*")]
    joints += [(joint, "") for joint in _objects(model, "JointSet")]
    coordinates: dict[str, Coordinate] = {}
    parsed = [_parse_joint(element, child, frames, coordinates) for element, child in joints]
    for joint in parsed:
        used = {one for axis in (*joint.rotations, *joint.translations) for one in axis.coordinates}
        if unknown := sorted(used - coordinates.keys()):
            raise BrokenModelError(
                f"the joint {joint.name[:40]} uses the coordinate {unknown[0][:40]!r}, which does not exist"
            )
    gravity = numbers_in(model.findtext("gravity", "0 -9.81 0"), 3)
    largest = int(np.argmax(np.abs(gravity)))
    up = -np.sign(gravity[largest]) * np.eye(3)[largest] if gravity.any() else _AXES["y"]
    couplings = tuple(_couplings(model, coordinates))
    return BodyModel(bodies, tuple(_from_the_ground(parsed, bodies)), coordinates, couplings, up)


def _objects(parent: Element, tag: str) -> list[Element]:
    return list(parent.findall(f"{tag}/objects/*"))


def _parse_body(element: Element, name: str) -> Body:
    mass_kg = numbers_in(element.findtext("mass", "0"), 1)[0]
    if mass_kg < 0.0:
        raise BrokenModelError(f"the body {name[:40]} has a negative mass")
    return Body(float(mass_kg), numbers_in(element.findtext("mass_center", "0 0 0"), 3))


def _named_frames(holder: Element | None, owner: str = "") -> dict[str, tuple[str, Frame]]:
    """Parent and offset of the frames in an element by name; ``owner`` is the component that has them."""
    frames = {}
    for element in () if holder is None else holder.findall("PhysicalOffsetFrame"):
        offset = Frame(
            euler_xyz(numbers_in(element.findtext("orientation", "0 0 0"), 3)),
            numbers_in(element.findtext("translation", "0 0 0"), 3),
        )
        parent = _socket(element, "parent")
        frames[element.get("name", "")] = owner if parent == ".." else parent, offset
    return frames


def _socket(element: Element, name: str) -> str:
    """Last part of the path in a socket."""
    for tag in (f"socket_{name}", f"socket_{name}_connectee_name"):
        if path := element.findtext(tag, "").strip():
            return PurePosixPath(path).name
    raise BrokenModelError(f"{element.tag} {element.get('name', '')[:40]} states no {name}")


def _resolve(name: str, frames: Mapping[str, tuple[str, Frame]]) -> tuple[str, Frame]:
    """Body of a frame, and the frame in it."""
    frame = Frame(np.eye(3), np.zeros(3))
    for _ in range(len(frames) + 1):
        if name not in frames:
            return name, frame
        name, offset = frames[name]
        frame = Frame(offset.R @ frame.R, offset.R @ frame.p + offset.p)
    raise BrokenModelError(f"the frame {name[:40]} is fixed to itself")


def _parse_joint(
    element: Element, child: str, frames: Mapping[str, tuple[str, Frame]], coordinates: dict[str, Coordinate]
) -> Joint:
    name = element.get("name", "")
    if element.findtext("reverse", "false").strip().lower() == "true":
        raise BrokenModelError(f"the joint {name[:40]} is reversed, which is not read")
    if child:
        parent, body = element.findtext("parent_body", "").strip(), child
        in_parent = _old_frame(element, "_in_parent")
        in_child = _old_frame(element, "")
    else:
        own = {**frames, **_named_frames(element.find("frames"))}
        parent, in_parent = _resolve(_socket(element, "parent_frame"), own)
        body, in_child = _resolve(_socket(element, "child_frame"), own)
    elements = [*element.findall("coordinates/Coordinate"), *element.findall("CoordinateSet/objects/Coordinate")]
    names = tuple(one.get("name", "") for one in elements)
    if element.tag == "CustomJoint":
        axes = _transform_axes(element, name)
        used = {one: k for one in names for k, axis in enumerate(axes) if one in axis.coordinates and _is_pure(axis)}
        rotational = {one: k < 3 for one, k in used.items()}
    elif element.tag in _PLAIN_JOINTS:
        letters = "".join(_PLAIN_JOINTS[element.tag])
        turns = len(_PLAIN_JOINTS[element.tag][0])
        if len(names) != len(letters):
            raise BrokenModelError(f"the {element.tag} {name[:40]} has {len(names)} coordinates, not {len(letters)}")
        axes = [JointAxis(_AXES[a], (one,), _identity) for a, one in zip(letters, names, strict=True)]
        rotational = {one: k < turns for k, one in enumerate(names)}
        axes[turns:turns] = [_NO_MOTION] * (3 - turns)
    else:
        raise BrokenModelError(f"the joint {name[:40]} is of the kind {element.tag[:40]}, which is not read")
    for one, coordinate in zip(names, elements, strict=True):
        coordinates[one] = _parse_coordinate(coordinate, stated_rotational=rotational.get(one, False))
    return Joint(name, parent, body, in_parent, in_child, tuple(axes[:3]), tuple(axes[3:]), names)


def _old_frame(element: Element, suffix: str) -> Frame:
    location = numbers_in(element.findtext(f"location{suffix}", "0 0 0"), 3)
    return Frame(euler_xyz(numbers_in(element.findtext(f"orientation{suffix}", "0 0 0"), 3)), location)


def _identity(q: Sequence[Series]) -> Series:
    return q[0]


def _zero(q: Sequence[Series]) -> Series:
    return np.zeros(1)


_NO_MOTION: Final = JointAxis(_AXES["x"], (), _zero)
_NOT_FUNCTIONS: Final = frozenset({"coordinates", "coordinate", "axis", "function", "is_rotation"})


def _is_pure(axis: JointAxis) -> bool:
    """Whether the displacement is the only coordinate itself, or its negative: OpenSim's condition for its unit."""
    if len(axis.coordinates) != 1:
        return False
    values = axis.function([np.array([0.0, 1.0, 2.0])])
    return bool(np.allclose(np.abs(np.diff(values)), 1.0))


def _transform_axes(element: Element, name: str) -> list[JointAxis]:
    """The three rotations and three translations of a CustomJoint; OpenSim 1 lists those that are not zero."""
    axes = element.findall("SpatialTransform/TransformAxis")
    listed = element.findall("TransformAxisSet/objects/TransformAxis")
    if listed:
        turns = [one for one in listed if one.findtext("is_rotation", "true").strip() == "true"]
        shifts = [one for one in listed if one not in turns]
        if len(turns) > 3 or len(shifts) > 3 or (turns and listed[: len(shifts)] != shifts):
            raise BrokenModelError(f"the joint {name[:40]} turns before it moves, which is not read")
        parsed = [[_transform_axis(one, name) for one in group] for group in (turns, shifts)]
        return [axis for group in parsed for axis in (*group, *[_NO_MOTION] * (3 - len(group)))]
    if len(axes) != 6:
        raise BrokenModelError(f"the joint {name[:40]} has {len(axes)} axes, not 6")
    return [_transform_axis(one, name) for one in axes]


def _transform_axis(element: Element, joint: str) -> JointAxis:
    direction = numbers_in(element.findtext("axis", ""), 3)
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise BrokenModelError(f"the joint {joint[:40]} has an axis of length zero")
    coordinates = tuple((element.findtext("coordinates") or element.findtext("coordinate") or "").split())
    function = inner_function(element, "function")
    direct = [part for part in element if part.tag not in _NOT_FUNCTIONS]
    if function is None:
        function = parse_function(direct[0]) if direct else (_identity if coordinates else _zero)
    try:
        function([np.zeros(1)] * len(coordinates))
    except IndexError as error:
        raise BrokenModelError(f"the joint {joint[:40]} has a function of no coordinate") from error
    return JointAxis(direction / length, coordinates, function)


def _parse_coordinate(element: Element, *, stated_rotational: bool) -> Coordinate:
    motion = element.findtext("motion_type", "").strip().lower()
    rotational = motion == "rotational" if motion else stated_rotational
    locked = element.findtext("locked", "false").strip().lower() == "true"
    return Coordinate(float(numbers_in(element.findtext("default_value", "0"), 1)[0]), rotational, locked)


def _couplings(model: Element, coordinates: Mapping[str, Coordinate]) -> Iterator[Coupling]:
    for element in _objects(model, "ConstraintSet"):
        off = element.findtext("isDisabled", "false").strip() == "true"
        off |= element.findtext("isEnforced", "true").strip() == "false"
        if element.tag != "CoordinateCouplerConstraint" or off:
            continue
        dependent = element.findtext("dependent_coordinate_name", "").strip()
        independent = tuple((element.findtext("independent_coordinate_names") or "").split())
        function = inner_function(element, "coupled_coordinates_function")
        if function is None or not independent or not {dependent, *independent} <= coordinates.keys():
            name = element.get("name", "")[:40]
            raise BrokenModelError(f"the constraint {name} couples coordinates that do not exist")
        yield Coupling(dependent, JointAxis(_AXES["x"], independent, function))


def _from_the_ground(joints: list[Joint], bodies: Mapping[str, Body]) -> Iterator[Joint]:
    """The joints, each after that which places its parent."""
    placed, left = {GROUND}, list(joints)
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end != GROUND and end not in bodies:
                raise BrokenModelError(f"the joint {joint.name[:40]} names the body {end[:40]!r}, which does not exist")
    while left:
        ready = [joint for joint in left if joint.parent in placed and joint.child not in placed]
        if not ready:
            names = ", ".join(joint.child[:40] for joint in left[:5])
            raise BrokenModelError(f"no chain of joints leads from the ground to {names}, or two do")
        for joint in ready:
            if joint.child in placed:
                raise BrokenModelError(f"two joints place the body {joint.child[:40]}")
            placed.add(joint.child)
            left.remove(joint)
            yield joint
    if beside := sorted(set(bodies) - placed):
        raise BrokenModelError(f"no joint places the body {beside[0][:40]}")
