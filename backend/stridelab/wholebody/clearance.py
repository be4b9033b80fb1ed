"""Distances of the body from itself and from the terrain, on convex hulls.

A sole that stands on a box, or is about to, is not measured against that box: during the contact, in the first and in
the last eighth of a swing. Every other pair of a link and a box is, at all times; so is every link against the rails,
but for the links that hold them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Int

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Box, Rail
from stridelab.conventions import Configurations, Series
from stridelab.robots.contact_frames import se3
from stridelab.robots.robot import Effector, Robot
from stridelab.wholebody.certificate import Check
from stridelab.wholebody.worst import Worst

SWING_SHARE = 0.125
"""Share of a swing after lift-off and before touch-down in which a sole is close to its own box."""
LEG_CLEARANCE_M = 0.010
"""Of shanks and swinging soles from what they do not stand on: the replay errs by as much."""
_TOUCHING_M = 5e-3
"""A box nearer than this to a contact's rectangle carries it, or lies level with the box that does."""


def self_collision(robot: Robot, q: Configurations, worst: Worst) -> Check:
    """Number of different pairs of links that touch in any of the configurations; the first is named."""
    data, geometry = robot.model.createData(), robot.collision
    results = geometry.createData()
    pairs = geometry.collisionPairs
    found: dict[int, int] = {}
    for i, configuration in enumerate(q):
        if pin.computeCollisions(robot.model, data, geometry, results, configuration, False):
            for k in range(len(pairs)):
                if results.collisionResults[k].isCollision():
                    found.setdefault(k, i)
    name, unit = "self_collision_pairs", "pairs"
    if not found:
        return Check(name, 0.0, unit, 0.0)
    k, i = min(found.items(), key=lambda pair: pair[1])
    touching = " and ".join(_link(robot.model, geometry.geometryObjects[o]) for o in (pairs[k].first, pairs[k].second))
    return Check(name, float(len(found)), unit, 0.0, False, int(worst.phase[i]), touching, float(worst.time_s[i]))


def terrain_distances(robot: Robot, sequence: ContactSequence, q: Configurations, worst: Worst) -> tuple[Check, Check]:
    """Smallest distance (m) of a link's hull from a box or a rail, of any link and of those of the legs.

    A penetration is negative.
    """
    scene = _Scene.of(robot, sequence)
    model, data, results = robot.model, robot.model.createData(), scene.geometry.createData()
    values = np.full((len(q), len(scene.links)), np.inf)
    for i, configuration in enumerate(q):
        pin.computeDistances(model, data, scene.geometry, results, configuration)
        skipped = scene.own(int(worst.phase[i]), float(worst.time_s[i]))
        for k, (column, effector, surface) in enumerate(scene.pairs):
            if effector is None or surface not in skipped[effector]:
                values[i, column] = min(values[i, column], results.distanceResults[k].min_distance)
    legs = np.array([_group(robot, link) == "leg" for link in scene.links], dtype=bool)
    of_legs = [link for link, leg in zip(scene.links, legs, strict=True) if leg]
    return (
        worst.at_least("terrain_distance_min", values, "m", 0.0, scene.links),
        worst.at_least("leg_terrain_distance_min", values[:, legs], "m", LEG_CLEARANCE_M, of_legs),
    )


def _group(robot: Robot, link: str) -> str:
    """Where in the body a link lies: where the joint that moves it does."""
    frame = robot.model.frames[robot.model.getFrameId(link)]
    return robot.group.get(str(robot.model.names[frame.parentJoint]), "")


@dataclass(frozen=True, eq=False)
class _Scene:
    """Hulls and terrain in one geometry.

    ``pairs``: per collision pair the column of the link, the sole that the link is (else None), the surface.
    ``carriers``: per surface contact (by identity) the boxes that carry it.
    """

    sequence: ContactSequence
    geometry: pin.GeometryModel
    links: tuple[str, ...]
    pairs: tuple[tuple[int, str | None, str], ...]
    soles: frozenset[str]
    carriers: Mapping[int, frozenset[str]]

    @staticmethod
    def of(robot: Robot, sequence: ContactSequence) -> "_Scene":
        model = robot.model
        geometry = pin.GeometryModel(robot.collision)
        geometry.removeAllCollisionPairs()
        hulls = list(robot.collision.geometryObjects)  # those of the copy move when it grows
        joint_of = {name: model.frames[model.getFrameId(e.frame)].parentJoint for name, e in robot.effectors.items()}
        sole_of = {joint_of[name]: name for name, e in robot.effectors.items() if e.kind == "surface"}
        holding = {joint_of[name] for name, e in robot.effectors.items() if e.kind == "point"}
        links = tuple(dict.fromkeys(_link(model, hull) for hull in hulls))
        pairs: list[tuple[int, str | None, str]] = []
        for surface in sequence.terrain.surfaces:
            placed = pin.GeometryObject(f"terrain {surface.name}", 0, 0, *_shape(surface))
            number = geometry.addGeometryObject(placed)
            for k, hull in enumerate(hulls):
                if isinstance(surface, Rail) and hull.parentJoint in holding:
                    continue
                geometry.addCollisionPair(pin.CollisionPair(k, number))
                pairs.append((links.index(_link(model, hull)), sole_of.get(hull.parentJoint), surface.name))
        contacts = [c for phase in sequence.phases for c in phase.contacts.values()]
        carriers = {id(c): _carriers(sequence, c, robot.effectors[c.effector]) for c in contacts if c.kind == "surface"}
        return _Scene(sequence, geometry, links, tuple(pairs), frozenset(sole_of.values()), carriers)

    def own(self, phase: int, time_s: float) -> dict[str, frozenset[str]]:
        """Per sole, the surfaces that it stands on, leaves or nears."""
        return {name: self._own(name, phase, time_s) for name in self.soles}

    def _own(self, sole: str, phase: int, time_s: float) -> frozenset[str]:
        sequence = self.sequence
        here = sequence.phases[phase].contacts.get(sole)
        if here is not None:
            return self.carriers[id(here)]
        first, last = phase, phase
        while first > 0 and sole not in sequence.phases[first - 1].contacts:
            first -= 1
        while last + 1 < len(sequence.phases) and sole not in sequence.phases[last + 1].contacts:
            last += 1
        start, end = float(sequence.starts_s[first]), float(sequence.ends_s[last])
        share = (time_s - start) / (end - start)
        near: frozenset[str] = frozenset()
        before, after = sequence.last_contact(sole, phase), sequence.next_contact(sole, phase)
        if before is not None and share < SWING_SHARE:
            near |= self.carriers[id(before)]
        if after is not None and share > 1.0 - SWING_SHARE:
            near |= self.carriers[id(after)]
        return near


def _carriers(sequence: ContactSequence, contact: Contact, effector: Effector) -> frozenset[str]:
    """The boxes under a contact's rectangle: its own, and those level with it."""
    x, y = effector.contact_half_size_m or (0.0, 0.0)
    rectangle, place = coal.Box(2.0 * x, 2.0 * y, 1e-4), _transform(se3(contact.placement))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    near = {contact.surface}
    for box in sequence.terrain.boxes:
        shape, at = _shape(box)[1], _transform(_shape(box)[0])
        result.clear()
        if coal.distance(rectangle, place, shape, at, request, result) < _TOUCHING_M:
            near.add(box.name)
    return frozenset(near)


def _shape(surface: Box | Rail) -> tuple[pin.SE3, coal.CollisionGeometry]:
    if isinstance(surface, Box):
        return se3(surface.placement), coal.Box(*(float(edge) for edge in surface.size_m))
    axis = surface.to_m - surface.from_m
    length = float(np.linalg.norm(axis))
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis / length).toRotationMatrix()
    return pin.SE3(R, 0.5 * (surface.from_m + surface.to_m)), coal.Capsule(surface.radius_m, length)


def _transform(placement: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(placement.rotation, placement.translation)


def _link(model: pin.Model, hull: pin.GeometryObject) -> str:
    """Name of the link that a hull belongs to: the body of its parent frame."""
    return str(model.frames[hull.parentFrame].name)


def thinned(time_s: Series, phase: Int[np.ndarray, "n"], every: int) -> tuple[slice, Worst]:
    """Every so many samples, and the checks over them."""
    chosen = slice(None, None, every)
    return chosen, Worst(time_s[chosen], phase[chosen])
