"""Pairs of links that need no self-collision check, from sampled configurations: the card's ``collision.never``.

Left out are pairs that a joint connects, that overlap at rest or in nearly all configurations (their convex hulls are
wider than the links), neighbours on a limb whose hulls meet where what is drawn of them does not, and pairs that never
came within ``CLEARANCE_M`` of each other. Arms that touch the legs or the trunk at rest are no such pair: the posture
is at fault.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.robots.robot import Robot
from stridelab.robots.visuals import visual_shapes

CONFIGURATIONS: Final = 1_000
CLEARANCE_M: Final = 0.01
ALWAYS: Final = 0.95
"""Share of the configurations from which two links touch nearly always."""
NEAR_JOINTS: Final = 3
"""Links at most so many joints apart on a limb are neighbours: their hulls often meet where the links interlock."""
COMPARED: Final = 200
FEWEST: Final = 4
"""Configurations in which the hulls of neighbours are compared with what is drawn, and in how many they must meet."""
DRAWN_SHARE: Final = 0.1
"""Share of these in which the drawn shapes must meet as well; it is 0 to 0.01 or 0.2 to 1 for fifteen robots."""

Pair = tuple[str, str]


def never_colliding(robot: Robot, configurations: int = CONFIGURATIONS, seed: int = 0) -> dict[str, tuple[str, ...]]:
    """Links by the links that they need not be checked against, for a ``robot`` with all pairs."""
    model, geometry = robot.model, robot.collision
    data, results = model.createData(), geometry.createData()
    links = [str(model.frames[part.parentFrame].name) for part in geometry.geometryObjects]
    shapes = [(links[pair.first], links[pair.second]) for pair in geometry.collisionPairs]
    pairs = sorted(set(shapes))
    of_shapes = np.array([pairs.index(pair) for pair in shapes], int)
    collide = _check(robot, data, results, 0.0)
    at_rest = {shapes[k] for k in collide(robot.q_reference)}
    near = np.zeros(len(pairs), int)
    touching = np.zeros(len(pairs), int)
    rng, q = np.random.default_rng(seed), robot.q_reference.copy()
    low, high = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
    draws = [rng.uniform(low, high) for _ in range(configurations)]
    for margin_m, count in ((CLEARANCE_M, near), (0.0, touching)):
        if margin_m == 0.0:  # only pairs that were nearly always close can have touched as often
            for rare in np.flatnonzero((near <= ALWAYS * configurations)[of_shapes]):
                results.deactivateCollisionPair(int(rare))
        collide = _check(robot, data, results, margin_m)
        for angles in draws:
            q[7:] = angles
            count[np.unique(of_shapes[collide(q)])] += 1
    table: dict[str, set[str]] = defaultdict(set)
    for k, pair in enumerate(pairs):
        overlap = pair in at_rest or touching[k] > ALWAYS * configurations
        if overlap or near[k] == 0 or _connected(robot, pair):
            table[pair[0]].add(pair[1])
    neighbours = [pair for pair in pairs if pair[1] not in table.get(pair[0], ()) and _near_on_limb(robot, pair)]
    for first, second in _only_hulls_meet(robot, neighbours, draws[:COMPARED]):
        table[first].add(second)
    return {link: tuple(sorted(others)) for link, others in sorted(table.items())}


def _check(
    robot: Robot, data: pin.Data, results: pin.GeometryData, margin_m: float
) -> Callable[[Float[np.ndarray, "nq"]], Int[np.ndarray, "k"]]:
    """Function that returns the indices of those pairs that are active now and closer than ``margin_m``.

    Only pairs whose bounding spheres are as close are looked at: in a robot of many shapes, these are few.
    """
    geometry = robot.collision
    for request in results.collisionRequests:
        request.security_margin = margin_m
    shapes = [part.geometry for part in geometry.geometryObjects]
    for shape in shapes:
        shape.computeLocalAABB()
    centres_m, radii_m = [shape.aabb_center for shape in shapes], np.array([shape.aabb_radius for shape in shapes])
    first, second = np.array([(pair.first, pair.second) for pair in geometry.collisionPairs], int).reshape(-1, 2).T
    active = np.flatnonzero(np.array(results.activeCollisionPairs, bool))
    first, second = first[active], second[active]
    reach_m = radii_m[first] + radii_m[second] + margin_m

    def collide(q: np.ndarray) -> np.ndarray:
        pin.updateGeometryPlacements(robot.model, data, geometry, results, q)
        at_m = np.array([T.act(centre) for T, centre in zip(results.oMg, centres_m, strict=True)])
        candidates = active[np.linalg.norm(at_m[first] - at_m[second], axis=1) <= reach_m]
        return np.array([k for k in candidates if pin.computeCollision(geometry, results, int(k))], int)

    return collide


def _connected(robot: Robot, pair: Pair) -> bool:
    """Whether one of the links hangs on the joint that the other carries."""
    model = robot.model
    a, b = (model.frames[model.getFrameId(name)].parentJoint for name in pair)
    return bool(model.parents[a] == b or model.parents[b] == a)


def _only_hulls_meet(robot: Robot, pairs: Sequence[Pair], draws: Sequence[np.ndarray]) -> Iterator[Pair]:
    """Those of ``pairs`` whose collision shapes meet while the drawn ones do not."""
    if not pairs:
        return
    drawn, hulls = visual_shapes(robot), robot.collision.copy()
    qs = [np.concatenate([robot.q_reference[:7], angles]) for angles in draws]
    for pair in pairs:
        met = [q for q, meets in zip(qs, _shapes_meet(robot, hulls, pair, qs), strict=True) if meets]
        shown = _shapes_meet(robot, drawn, pair, met)
        if len(met) >= FEWEST and drawn.collisionPairs and sum(shown) <= DRAWN_SHARE * len(met):
            yield pair


def _shapes_meet(robot: Robot, geometry: pin.GeometryModel, pair: Pair, qs: Sequence[np.ndarray]) -> list[bool]:
    """Whether shapes of two links meet, in every configuration; ``geometry`` gets their pairs and no others."""
    links = [str(robot.model.frames[shape.parentFrame].name) for shape in geometry.geometryObjects]
    geometry.removeAllCollisionPairs()
    for one, other in product(*([k for k, link in enumerate(links) if link == name] for name in pair)):
        geometry.addCollisionPair(pin.CollisionPair(one, other))
    results, data = geometry.createData(), robot.model.createData()
    return [bool(pin.computeCollisions(robot.model, data, geometry, results, q, True)) for q in qs]


def _near_on_limb(robot: Robot, pair: Pair) -> bool:
    """Whether one of the links carries the other over at most ``NEAR_JOINTS`` joints."""
    model = robot.model
    a, b = (list(model.supports[model.frames[model.getFrameId(name)].parentJoint]) for name in pair)
    return bool((a[-1] in b or b[-1] in a) and abs(len(a) - len(b)) <= NEAR_JOINTS)
