"""Levers bound how a distance changes, so that what is not looked at is not near."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_pairs import CollisionPairs, PairLevers, wrist_joints
from stridelab.wholebody.control.rigid_body import RigidBody

WALL = Terrain.from_surfaces([Box("wall", Placement.from_wxyz([0.6, 0.0, 0.3]), np.array([0.4, 1.0, 0.6]))])
ALL = 10_000


def walk(robot: Robot, seed: int, n: int, step_rad: float) -> list[np.ndarray]:
    """Configurations one after the other, each joint and the base a little farther in a direction that turns."""
    rng = np.random.default_rng(seed)
    q, v, result = robot.q_reference, np.zeros(robot.model.nv), []
    for _ in range(n):
        v = 0.9 * v + step_rad * rng.normal(size=robot.model.nv)
        q = pin.integrate(robot.model, q, v)
        result.append(q)
    return result


def placed(robot: Robot, pairs: CollisionPairs, body: RigidBody, q: np.ndarray) -> None:
    body.update(q, np.zeros(robot.model.nv))
    pairs.update_placements(body)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["talos", "g1"])
def test_no_distance_changes_by_more_than_levers_allow(name: str, seed: int) -> None:
    robot = load_robot(name)
    pairs, body = CollisionPairs(robot, WALL, 1.0, 1.0), RigidBody(robot)
    pairs.watch_hands(wrist_joints(robot))
    before: dict[int, float] = {}
    q_before = robot.q_reference
    levers = np.abs(pairs.reach_m)
    for q in walk(robot, seed, 8, 0.02):
        placed(robot, pairs, body, q)
        pairs.update_watched(np.inf)
        now = pairs.nearest_pairs(np.inf, ALL)
        distances = dict(zip(now.pair.tolist(), now.distance_m.tolist(), strict=True))
        assert len(distances) == len(pairs.kind)
        allowed = levers @ np.abs(pin.difference(robot.model, q_before, q))
        for k, d in before.items():
            assert abs(distances[k] - d) <= allowed[k] + 1e-6
        before, q_before = distances, q


@pytest.mark.parametrize("seed", range(3))
def test_nothing_near_is_missed(talos: Robot, seed: int) -> None:
    """Every watched pair that is near is detected, as if all were computed at every sample."""
    acts_m, near_m = 0.05, 0.3
    lazy, body = CollisionPairs(talos, WALL, acts_m, 1.0), RigidBody(talos)
    seen = 0
    for i, q in enumerate(walk(talos, seed, 60, 0.002)):
        placed(talos, lazy, body, q)
        eager = CollisionPairs(talos, WALL, acts_m, 1.0)
        placed(talos, eager, body, q)
        if i % 20 == 0:
            lazy.update_watched(near_m)
        eager.update_watched(np.inf)
        result, truth = lazy.nearest_pairs(acts_m, ALL), eager.nearest_pairs(acts_m, ALL)
        assert result.pair.tolist() == truth.pair.tolist()
        assert np.allclose(result.distance_m, truth.distance_m, atol=1e-6)
        seen += len(result.pair)
    assert seen > 20


@pytest.mark.parametrize(("name", "forearm"), [("talos", 1.5), ("g1", 1.0)])
def test_legs_and_forearms_keep_off_a_rail(name: str, forearm: float) -> None:
    """Legs with the usual distances, forearms with more the longer the arm is."""
    robot = load_robot(name)
    rail = Rail("rail", np.array([0.0, -0.4, 0.8]), np.array([2.0, -0.4, 0.8]), 0.02, 0.6)
    pairs = CollisionPairs(robot, Terrain.from_surfaces([rail]), 0.06, 0.5)
    of_legs = pairs.kind == "terrain"
    assert of_legs.any()
    assert np.allclose(pairs.scale[of_legs], 1.0)
    of_arms = (pairs.kind == "arm") & (pairs.scale >= 1.0) & (np.arange(len(pairs.kind)) >= of_legs.argmax())
    assert np.allclose(pairs.scale[of_arms], forearm, atol=0.01)
    assert of_arms.any()


def test_hardly_more_distances_are_computed_than_matter(talos: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the pairs that are watched, the others move too little to come near."""
    pairs, body, computed = CollisionPairs(talos, WALL, 0.06, 10.0), RigidBody(talos), list[int]()
    compute = pin.computeDistance

    def counted(geometry: pin.GeometryModel, results: pin.GeometryData, k: int) -> None:
        computed.append(k)
        compute(geometry, results, k)

    monkeypatch.setattr(pin, "computeDistance", counted)
    mattered, watched = 0, 0
    for i, q in enumerate(walk(talos, 0, 100, 0.0005)):
        placed(talos, pairs, body, q)
        if i % 20 == 0:
            pairs.update_watched(0.12)
        mattered += len(pairs.nearest_pairs(0.06, ALL).pair)
        watched += pairs.watched_count
    assert mattered > 100
    assert len(computed) < mattered + 0.2 * watched


def test_levers_of_a_chain() -> None:
    """A shape up to 0.3 m from the elbow, at the end of an arm of 1 m that slides out by up to 0.2 m more."""
    model = pin.Model()
    shoulder = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    shoulder = model.addJoint(shoulder, pin.JointModelRZ(), pin.SE3.Identity(), "shoulder")
    reach: dict[str, Any] = {"max_effort": np.ones(1), "max_velocity": np.ones(1)}
    slide = model.addJoint(
        shoulder,
        pin.JointModelPX(),
        pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0])),
        "slide",
        **reach,
        min_config=np.array([-0.2]),
        max_config=np.array([0.1]),
    )
    elbow = model.addJoint(slide, pin.JointModelRZ(), pin.SE3.Identity(), "elbow")
    spheres = [(np.array([0.2, 0.0, 0.0]), 0.1), (np.zeros(3), 0.5)]
    joints, shapes = np.array([[elbow, 1], [elbow, 0]]), np.array([[0, 1], [0, 1]])
    sign, reach_m = PairLevers.of_pairs(model, joints, shapes, spheres)
    assert np.array_equal(sign, [[0] * 6 + [1] * 3, [1] * 9])
    assert reach_m[0] == pytest.approx([0.0] * 6 + [1.5, 1.0, 0.3])
    assert reach_m[1] == pytest.approx([1.0] * 3 + [1.5] * 3 + [1.5, 1.0, 0.3])
