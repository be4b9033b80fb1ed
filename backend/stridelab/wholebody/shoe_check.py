"""Contacts whose shoes collide: a check of the planned placements before any motion is computed.

The links that a sole carries rigidly (``T_world_link`` follows from the contact alone) take up more room than the
rectangle of the contact. In a planned stance they may overlap with the shoe of the other foot, or come closer to a step
than the certificate allows, whatever the rest of the body does. Such a scenario is refused by name.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

import coal
import numpy as np
import pinocchio as pin

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Box
from stridelab.errors import Fault, InvalidInput
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.clearance import LEG_CLEARANCE_M
from stridelab.wholebody.effector_contact import OwnSurfaces, terrain_shape

Shape = tuple[pin.SE3, coal.CollisionGeometry]
_ROUNDING_M: Final = 1e-4


def require_room_for_shoes(robot: Robot, sequence: ContactSequence) -> None:
    """Require that no shoe overlaps with the other one, or comes nearer to a step than the certificate allows.

    Raises ``InvalidInput`` (``scenario-invalid``) with the phase, the effector, the other part and the distance of
    every fault.
    """
    faults = shoe_faults(robot, sequence)
    if faults:
        named = "; ".join(f"{fault.where}: {fault.message}" for fault in faults[:3])
        raise InvalidInput("scenario-invalid", f"The shoes of {robot.title} have no room. {named}.", faults)


def shoe_faults(robot: Robot, sequence: ContactSequence) -> list[Fault]:
    """Faults of shoes that overlap, then of shoes too near to a step; each contact once."""
    return [*_overlaps(robot, sequence), *_close_steps(robot, sequence)]


def shoe_ends_m(robot: Robot, name: str) -> tuple[float, float]:
    """How far the shoe of the sole ``name`` reaches before and behind its contact frame, and at least its sole."""
    half_m = (robot.effectors[name].contact_half_size_m or (0.0, 0.0))[0]
    ahead_m = behind_m = half_m
    for place, geometry in _shoe_shapes(robot, name):
        geometry.computeLocalAABB()
        middle = 0.5 * (geometry.aabb_local.min_ + geometry.aabb_local.max_)
        half = 0.5 * (geometry.aabb_local.max_ - geometry.aabb_local.min_)
        x_m, reach_m = float((place * middle)[0]), float(np.abs(place.rotation[0]) @ half)
        ahead_m, behind_m = max(ahead_m, x_m + reach_m), max(behind_m, reach_m - x_m)
    return ahead_m, behind_m


def largest_shoe_m(robot: Robot) -> tuple[float, float]:
    """How far the shoes of both feet reach before and behind their contact frames at most, rounded up to 1 mm."""
    ends = [shoe_ends_m(robot, name) for name in ("left_foot", "right_foot")]
    ahead_m, behind_m = (math.ceil(1e3 * max(own)) / 1e3 for own in zip(*ends, strict=True))
    return ahead_m, behind_m


def _overlaps(robot: Robot, sequence: ContactSequence) -> Iterator[Fault]:
    """Faults of shoes that overlap; each pair of contacts once."""
    shoes = {name: _shoe_shapes(robot, name) for name in _soles(robot)}
    seen: set[frozenset[int]] = set()
    for phase, contacts in enumerate(part.contacts for part in sequence.phases):
        for first, second in combinations(sorted(contacts.keys() & shoes.keys()), 2):
            key = frozenset((id(contacts[first]), id(contacts[second])))
            if key in seen:
                continue
            seen.add(key)
            one, other = (_placed(shoes[name], contacts[name]) for name in (first, second))
            distance_m = min((_distance_m(a, b) for a in one for b in other), default=1.0)
            if distance_m < -_ROUNDING_M:
                yield Fault(
                    f"phases[{phase}].contacts[{second}]",
                    f"its shoe overlaps with that of {first} by {-1000 * distance_m:.1f} mm",
                )


def _close_steps(robot: Robot, sequence: ContactSequence) -> Iterator[Fault]:
    """Faults of shoes that stand too near to a box that does not carry them; each contact once."""
    own = OwnSurfaces(sequence, robot.effectors)
    boxes = [(box.name, terrain_shape(box)) for box in sequence.terrain.surfaces if isinstance(box, Box)]
    shoes = {name: _shoe_shapes(robot, name) for name in _soles(robot)}
    seen: set[int] = set()
    for phase, contacts in enumerate(part.contacts for part in sequence.phases):
        for name in sorted(contacts.keys() & shoes.keys()):
            if id(contacts[name]) in seen:
                continue
            seen.add(id(contacts[name]))
            shoe, carriers = _placed(shoes[name], contacts[name]), own.contact_surfaces(name, phase)
            for box_name, box in boxes:
                if box_name in carriers:
                    continue
                distance_m = min((_distance_m(shape, box) for shape in shoe), default=1.0)
                if distance_m < LEG_CLEARANCE_M - _ROUNDING_M:
                    yield Fault(
                        f"phases[{phase}].contacts[{name}]",
                        f"its shoe is {1000 * distance_m:.1f} mm from {box_name!r}; {1000 * LEG_CLEARANCE_M:g} mm are "
                        "required",
                    )


def _soles(robot: Robot) -> Mapping[str, int]:
    """The joint that carries every sole."""
    frames = {name: robot.model.getFrameId(one.frame) for name, one in robot.effectors.items() if one.kind == "surface"}
    return {name: int(robot.model.frames[frame].parentJoint) for name, frame in frames.items()}


def _shoe_shapes(robot: Robot, name: str) -> list[Shape]:
    """The shapes that a sole carries rigidly, relative to its contact frame."""
    effector = robot.effectors[name]
    frame = robot.model.frames[robot.model.getFrameId(effector.frame)]
    contact_from_joint = (frame.placement * to_se3(effector.T_frame_contact)).inverse()
    parts = [part for part in robot.full_collision.geometryObjects if part.parentJoint == frame.parentJoint]
    return [(contact_from_joint * part.placement, part.geometry) for part in parts]


def _placed(shapes: list[Shape], contact: Contact) -> list[Shape]:
    """Shapes in the world."""
    return [(to_se3(contact.placement) * at, geometry) for at, geometry in shapes]


def _distance_m(one: Shape, other: Shape) -> float:
    """Distance of two shapes; negative by the depth where they overlap."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    places = [coal.Transform3s(at.rotation, at.translation) for at, _ in (one, other)]
    return float(coal.distance(one[1], places[0], other[1], places[1], request, result))
