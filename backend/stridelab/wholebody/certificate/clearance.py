"""Distances of the body from itself and from the terrain, on convex hulls.

All pairs of links and surfaces, also of the links that the robot's card leaves out, are measured at all times, with two
exceptions: a sole against the box on which it
stands, lands or lifts off (``effector_contact``), and the links of a hand against a rail that it grasps, approaches or
leaves. The contact sphere of a hand is also measured, except against its own surface; against that one the contact
point is measured while approaching or leaving, with the landing error as tolerance.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Bool, Float, Int

from stridelab.contacts.effector_geometry import HAND_RADIUS_M
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Rail
from stridelab.conventions import Configurations, Series
from stridelab.robots.contact_frames import to_se3
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision
from stridelab.wholebody.certificate.certificate import Check, WorstValues
from stridelab.wholebody.certificate.contact_checks import LANDING_ERROR_M
from stridelab.wholebody.control.collision_pairs import bounding_sphere
from stridelab.wholebody.effector_contact import OwnSurfaces, terrain_shape

LEG_CLEARANCE_M = 0.010
"""Minimum distance of shanks and swinging soles from other surfaces: the tracking error of the replay."""
ARM_CLEARANCE_M = 0.005
"""Minimum distance of arms and hands from surfaces that they are not in contact with."""
_POINT_M = 1e-6
Role = Literal["link", "palm", "point"]


def self_collision(
    robot: Robot, q: Configurations, worst: WorstValues, collision: SelfCollision | None = None
) -> Check:
    """Number of distinct link pairs that collide in any of the configurations; names the first.

    ``collision``, if given, is that of all shapes of the robot.
    """
    collision = SelfCollision(robot, all_shapes=True) if collision is None else collision
    first_sample: dict[int, int] = {}
    for i, configuration in enumerate(q):
        for k in collision.colliding_indices(configuration):
            first_sample.setdefault(k, i)
    name, unit = "self_collision_pairs", "pairs"
    if not first_sample:
        return Check(name, 0.0, unit, 0.0)
    k, i = min(first_sample.items(), key=lambda pair: pair[1])
    link_names = " and ".join(collision.links_of_pair(k))
    return Check(
        name, float(len(first_sample)), unit, 0.0, False, int(worst.phase[i]), link_names, float(worst.time_s[i])
    )


def terrain_distances(
    robot: Robot, sequence: ContactSequence, q: Configurations, worst: WorstValues, tolerance_m: float | None = None
) -> tuple[Check, ...]:
    """Smallest distances (m) from boxes and rails: of all links, of legs, of arms including the hands' spheres.

    Penetration is negative. With hands, the largest depth of a contact point inside its own surface follows. Pairs
    whose bounding spheres are farther apart than the smallest distances until then are not measured.
    With ``tolerance_m``, all limits are lowered by it, and pairs farther apart than these are not measured, either, so
    that values above their limits may be infinite.
    """
    scene = _Scene.build_scene(robot, sequence)
    model, data, results = robot.model, robot.model.createData(), scene.geometry.createData()
    gaps, of_group = _SphereGaps(scene), {of: np.array(scene.groups) == of for of in ("leg", "arm")}
    limits_m = {"": 0.0, "leg": LEG_CLEARANCE_M, "arm": ARM_CLEARANCE_M}
    smallest_m = dict.fromkeys(limits_m, np.inf)
    if tolerance_m is not None:
        limits_m = {of: limit_m - tolerance_m for of, limit_m in limits_m.items()}
        smallest_m = limits_m.copy()
    values = np.full((len(q), len(scene.parts)), np.inf)
    distances, depth = values.copy(), np.full(values.shape, -np.inf)
    (is_near, is_own), is_point = scene.near_and_own_pairs(worst), scene.has_role("point")
    is_measured = np.where(is_point, is_near, ~is_own | scene.has_role("palm"))
    gap_m = np.where(is_measured, gaps.lower_bounds_m(model, data, q), np.inf)
    gap_m[is_measured & is_point] = -np.inf  # the depths of all contact points are measured
    for i in np.argsort(gap_m.min(axis=1, initial=np.inf), kind="stable").tolist():  # the smallest first: fewer follow
        if not gap_m[i].min(initial=np.inf) <= max(smallest_m.values()):
            break
        near = np.flatnonzero(is_measured[i] & (gap_m[i] <= gaps.limits_m(smallest_m)))
        pin.updateGeometryPlacements(model, data, scene.geometry, results, q[i])
        for k in near.tolist():
            pair = scene.pairs[k]
            distance_m, column = float(pin.computeDistance(scene.geometry, results, k).min_distance), pair.column
            if pair.role == "point":
                depth[i, column] = max(depth[i, column], -distance_m)
                continue
            values[i, column] = min(values[i, column], distance_m)
            if not is_own[i, k]:
                distances[i, column] = min(distances[i, column], distance_m)
        smallest_m[""] = min(smallest_m[""], float(values[i].min()))
        for of in ("leg", "arm"):
            smallest_m[of] = min(smallest_m[of], float(distances[i, of_group[of]].min(initial=np.inf)))

    def smallest_distance(name: str, of: np.ndarray, selected: np.ndarray, limit_m: float) -> Check:
        columns = [part for part, is_one in zip(scene.parts, selected, strict=True) if is_one]
        return worst.at_least(name, of[:, selected], "m", limit_m, columns)

    return (
        smallest_distance("terrain_distance_min", values, np.ones(len(scene.parts), dtype=bool), limits_m[""]),
        smallest_distance("leg_terrain_distance_min", distances, of_group["leg"], limits_m["leg"]),
        smallest_distance("arm_terrain_distance_min", distances, of_group["arm"], limits_m["arm"]),
        *([worst.at_most("hand_depth_max", depth, "m", LANDING_ERROR_M, scene.parts)] if scene.hands else []),
    )


class _Pair(NamedTuple):
    """A shape and a surface: the column of the shape's link, its effector, and its role.

    ``palm``: a hand's link and a box, which it must not penetrate even in contact. ``point``: the contact point of a
    hand, which is measured only against the surface that it approaches or leaves. Fingers, which the robot's card
    leaves out, may touch the surface of their hand.
    """

    column: int
    effector: str | None
    surface: str
    role: Role


@dataclass(frozen=True, eq=False)
class _Scene:
    """Hulls, hand spheres and terrain in one geometry; ``groups`` assigns each of ``parts`` to a body group."""

    geometry: pin.GeometryModel
    parts: tuple[str, ...]
    groups: tuple[str, ...]
    pairs: tuple[_Pair, ...]
    hands: tuple[str, ...]
    effectors: tuple[str, ...]
    own: OwnSurfaces

    @staticmethod
    def build_scene(robot: Robot, sequence: ContactSequence) -> "_Scene":
        model = robot.model
        geometry = pin.GeometryModel(robot.full_collision)
        geometry.removeAllCollisionPairs()
        hulls = list(robot.full_collision.geometryObjects)  # references into the copy are invalidated when it grows
        joint_of = {name: model.frames[model.getFrameId(e.frame)].parentJoint for name, e in robot.effectors.items()}
        at_joint = {joint: name for name, joint in joint_of.items()}
        links = dict.fromkeys(_link_name(model, hull) for hull in hulls)
        hands = [name for name in sequence.effectors if robot.effectors[name].kind == "point"]
        parts = (*links, *hands)
        shapes: list[tuple[int, str | None, Role]] = []
        palms = {part.name for part in robot.collision.geometryObjects}
        for hull in hulls:
            effector = at_joint.get(hull.parentJoint)
            is_hand = effector is not None and robot.effectors[effector].kind == "point" and hull.name in palms
            shapes.append((parts.index(_link_name(model, hull)), effector, "palm" if is_hand else "link"))
        groups = {_link_name(model, hull): robot.group.get(str(model.names[hull.parentJoint]), "") for hull in hulls}
        for name in hands:
            geometry.addGeometryObject(_hand_sphere(robot, name, HAND_RADIUS_M))
            geometry.addGeometryObject(_hand_sphere(robot, name, _POINT_M))
            shapes += [(parts.index(name), name, "link"), (parts.index(name), name, "point")]
        pairs: list[_Pair] = []
        for surface in sequence.terrain.surfaces:
            number = geometry.addGeometryObject(
                pin.GeometryObject(f"terrain {surface.name}", 0, 0, *terrain_shape(surface))
            )
            for k, (column, effector, role) in enumerate(shapes):
                closes = role == "palm" and isinstance(surface, Rail)  # a hand closes around a rail
                geometry.addCollisionPair(pin.CollisionPair(k, number))
                pairs.append(_Pair(column, effector, surface.name, "link" if closes else role))
        return _Scene(
            geometry,
            parts,
            (*(groups[link] for link in links), *("arm" for _ in hands)),
            tuple(pairs),
            tuple(hands),
            tuple(robot.effectors),
            OwnSurfaces(sequence, robot.effectors),
        )

    def has_role(self, role: Role) -> Bool[np.ndarray, "pairs"]:
        """Whether each pair has this role."""
        return np.array([pair.role == role for pair in self.pairs], dtype=bool)

    def near_and_own_pairs(self, worst: WorstValues) -> tuple[Bool[np.ndarray, "n pairs"], Bool[np.ndarray, "n pairs"]]:
        """Pairs of an effector and a surface that it leaves or approaches; those and the surface of its contact."""
        is_near, is_own = np.zeros((2, len(worst.time_s), len(self.pairs)), dtype=bool)
        for name in self.effectors:
            numbers = np.array([k for k, pair in enumerate(self.pairs) if pair.effector == name], dtype=int)
            surfaces = [self.pairs[k].surface for k in numbers.tolist()]

            def are_among(some: frozenset[str], surfaces: list[str] = surfaces) -> list[bool]:
                return [surface in some for surface in surfaces]

            for i, (phase, time_s) in enumerate(zip(worst.phase.tolist(), worst.time_s.tolist(), strict=True)):
                near, touched = self.own.nearby_surfaces(name, phase, time_s), self.own.contact_surfaces(name, phase)
                if near:
                    is_near[i, numbers] = is_own[i, numbers] = are_among(near)
                if touched:
                    is_own[i, numbers] |= are_among(touched)
        return is_near, is_own


class _SphereGaps:
    """Lower bounds of the distances of all pairs of a scene: of the shapes' bounding spheres from the surfaces."""

    def __init__(self, scene: _Scene) -> None:
        self._geometry, parts, pairs = scene.geometry, scene.geometry.geometryObjects, scene.geometry.collisionPairs
        first, second = np.array([(pair.first, pair.second) for pair in pairs], dtype=int).reshape(-1, 2).T
        self._shape, self._surfaces = first, sorted(set(second.tolist()))
        self._surface_row = np.searchsorted(self._surfaces, second)
        spheres = [bounding_sphere(part) for part in parts]
        self._joints = np.array([part.parentJoint for part in parts])
        self._centres_m = np.array([part.placement.act(c) for part, (c, _) in zip(parts, spheres, strict=True)])
        self._radius_m = np.array([radius for _, radius in spheres])
        self._boxes = [(parts[k].placement, _half_extents_m(parts[k].geometry)) for k in self._surfaces]
        self._groups = np.array([scene.groups[pair.column] for pair in scene.pairs])

    def lower_bounds_m(self, model: pin.Model, data: pin.Data, q: Configurations) -> Float[np.ndarray, "n pairs"]:
        """Lower bounds of the distances of all pairs in configurations ``q``."""
        joints = np.empty((len(q), model.njoints, 4, 4))
        for i, configuration in enumerate(q):
            pin.forwardKinematics(model, data, configuration)
            joints[i] = [at.homogeneous for at in data.oMi]
        placed = joints[:, self._joints]
        centres_m = np.einsum("nkij,kj->nki", placed[..., :3, :3], self._centres_m) + placed[..., :3, 3]
        to_surface_m = np.empty((len(self._boxes), *centres_m.shape[:2]))
        for row, (place, half_m) in enumerate(self._boxes):
            beyond_m = np.maximum(np.abs((centres_m - place.translation) @ place.rotation) - half_m, 0.0)
            to_surface_m[row] = np.sqrt((beyond_m * beyond_m).sum(axis=2))
        to_surface_m[to_surface_m == 0.0] = -np.inf  # a centre inside a surface: no bound on the depth
        return np.asarray(to_surface_m[self._surface_row, :, self._shape].T - self._radius_m[self._shape])

    def limits_m(self, smallest_m: Mapping[str, float]) -> Float[np.ndarray, "pairs"]:
        """Distances up to which pairs count: the smallest of all or of their group."""
        limit_m = np.full(len(self._groups), smallest_m[""])
        for of in ("leg", "arm"):
            limit_m[self._groups == of] = max(smallest_m[""], smallest_m[of])
        return limit_m


def _half_extents_m(shape: coal.CollisionGeometry) -> Float[np.ndarray, "3"]:
    """Half the edges of the box around a shape, whose centre is that of its frame."""
    shape.computeLocalAABB()
    return np.asarray(0.5 * (shape.aabb_local.max_ - shape.aabb_local.min_))


def _hand_sphere(robot: Robot, name: str, radius_m: float) -> pin.GeometryObject:
    """Sphere behind the contact point of a hand, which lies on its surface."""
    effector = robot.effectors[name]
    frame = robot.model.frames[robot.model.getFrameId(effector.frame)]
    centre = pin.SE3(np.eye(3), np.array([0.0, 0.0, radius_m]))
    placement = frame.placement * to_se3(effector.T_frame_contact) * centre
    return pin.GeometryObject(f"{radius_m:g} m of {name}", frame.parentJoint, placement, coal.Sphere(radius_m))


def _link_name(model: pin.Model, hull: pin.GeometryObject) -> str:
    """Name of the link that a hull belongs to: the body of its parent frame."""
    return str(model.frames[hull.parentFrame].name)


def thin_samples(time_s: Series, phase: Int[np.ndarray, "n"], every: int) -> tuple[slice, WorstValues]:
    """Slice of every ``every``-th sample, and the checks over them."""
    chosen = slice(None, None, every)
    return chosen, WorstValues(time_s[chosen], phase[chosen])
