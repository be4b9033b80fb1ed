"""Self-collision of a configuration: which shapes of the robot overlap, mostly convex hulls.

The library's search for a separating direction starts where the last one ended. Of 4000 uniform configurations of
TALOS, held against linear programmes, 5 had a pair that it missed (four grazing, one 9 mm deep), and none had one that
does not touch; a verdict at that rate may thus depend on what was asked before. A motion is checked at many instants.

From the shapes of a description to those that are checked against each other: convex hulls, without futile pairs.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.robots.card import CollisionCard
from stridelab.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class SelfCollision:
    """The check with its own buffers, for many configurations; one per thread."""

    robot: Robot
    data: pin.Data
    hulls: pin.GeometryData

    @staticmethod
    def of(robot: Robot) -> "SelfCollision":
        """A check for ``robot``."""
        return SelfCollision(robot, robot.model.createData(), robot.collision.createData())

    def found(self, q: Float[np.ndarray, "nq"]) -> bool:
        """Whether any pair collides; stops at the first."""
        return bool(pin.computeCollisions(self.robot.model, self.data, self.robot.collision, self.hulls, q, True))

    def pairs(self, q: Float[np.ndarray, "nq"]) -> tuple[tuple[str, str], ...]:
        """Names of the links of all pairs that collide."""
        pin.computeCollisions(self.robot.model, self.data, self.robot.collision, self.hulls, q, False)
        checked = zip(self.robot.collision.collisionPairs, self.hulls.collisionResults, strict=True)
        return tuple((self._link(p.first), self._link(p.second)) for p, result in checked if result.isCollision())

    def colliding(self, q: Float[np.ndarray, "nq"]) -> tuple[int, ...]:
        """Numbers of all pairs that collide, in the order of ``pairs``."""
        pin.computeCollisions(self.robot.model, self.data, self.robot.collision, self.hulls, q, False)
        return tuple(k for k, result in enumerate(self.hulls.collisionResults) if result.isCollision())

    def _link(self, part: int) -> str:
        return str(self.robot.model.frames[self.robot.collision.geometryObjects[part].parentFrame].name)


@dataclass(frozen=True, eq=False)
class Apart:
    """Rows that push shapes out of each other: of the pairs with these ``numbers``, nearer than ``gap_m``.

    With the distance ``d`` (negative by the depth), its direction ``n`` from the first shape to the second and the
    nearest points, ``n^T (J_2 - J_1) dq = gap - d``.
    """

    robot: Robot
    hulls: pin.GeometryData
    numbers: tuple[int, ...]
    gap_m: float = 0.005

    def rows(self, model: pin.Model, data: pin.Data) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m nv"]]:
        """Errors and their Jacobian, where the joint Jacobians in ``data`` are those of the posture."""
        geometry = self.robot.collision
        pin.updateGeometryPlacements(model, data, geometry, self.hulls)
        e, J = [], []
        for number in self.numbers:
            pin.computeDistance(geometry, self.hulls, number)
            found, pair = self.hulls.distanceResults[number], geometry.collisionPairs[number]
            if found.min_distance >= self.gap_m:
                continue
            n = np.array(found.normal)
            ends = ((pair.first, found.getNearestPoint1(), -1.0), (pair.second, found.getNearestPoint2(), 1.0))
            row = np.zeros(model.nv)
            for part, point, sign in ends:
                joint = geometry.geometryObjects[part].parentJoint
                J_joint = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
                arm = np.array(point) - data.oMi[joint].translation
                row += sign * (n @ J_joint[:3] + np.cross(arm, n) @ J_joint[3:])
            e.append(self.gap_m - found.min_distance)
            J.append(row)
        return np.array(e), np.array(J).reshape(-1, model.nv)


def collision_model(
    model: pin.Model, collision: pin.GeometryModel, visual: pin.GeometryModel, card: CollisionCard, srdf: Path | None
) -> pin.GeometryModel:
    """The shapes that can touch, with the pairs that are checked: all but those that the card or the SRDF excludes.

    Shapes that hang on the same joint are no pair. A mesh is replaced by its convex hull unless the card keeps it.
    """
    chosen = pin.GeometryModel()
    for original in collision.geometryObjects:
        if not matches(card.left_out, original.name):
            chosen.addGeometryObject(original if matches(card.meshes, original.name) else hull(original))
    for original in visual.geometryObjects:
        if matches(card.visual, original.name):
            part = original if matches(card.meshes, original.name) else hull(original)
            chosen.addGeometryObject(renamed(part, f"{part.name} (visual)"))
    links = [str(model.frames[part.parentFrame].name) for part in chosen.geometryObjects]
    joints = [part.parentJoint for part in chosen.geometryObjects]
    for i, k in combinations(range(chosen.ngeoms), 2):
        if joints[i] != joints[k] and not excluded(card.never, links[i], links[k]):
            chosen.addCollisionPair(pin.CollisionPair(i, k))
    if srdf is not None:
        pin.removeCollisionPairs(model, chosen, str(srdf), False)
    return chosen


def hull(original: pin.GeometryObject) -> pin.GeometryObject:
    """The same part with the convex hull of its mesh; a primitive shape stays what it is."""
    part = original.copy()
    if isinstance(part.geometry, coal.BVHModelBase):
        # buildConvexRepresentation would take the triangles as if they were convex already
        part.geometry.buildConvexHull(True, "Qt")
        part.geometry = part.geometry.convex
    return part


def renamed(original: pin.GeometryObject, name: str) -> pin.GeometryObject:
    """The same part under another name: a visual shape is often called like the collision shape of its link."""
    part = original.copy()
    part.name = name
    return part


def excluded(never: Mapping[str, tuple[str, ...]], link: str, other: str) -> bool:
    """Whether the card says, of either link, that it is not checked against the other."""
    return any(
        (re.fullmatch(one, link) and matches(others, other)) or (re.fullmatch(one, other) and matches(others, link))
        for one, others in never.items()
    )


def matches(patterns: tuple[str, ...], name: str) -> bool:
    """Whether one of the patterns matches the whole name."""
    return any(re.fullmatch(pattern, name) for pattern in patterns)
