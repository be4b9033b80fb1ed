"""The body keeps off itself and off the steps: rows against finite differences, a motion with and without them."""

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.native.availability import NativeSolver, native_availability
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_avoidance import HAND_PUSH_M_S2, AvoidanceSettings, CollisionAvoidance
from stridelab.wholebody.control.hierarchical_qp import Rows
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.motion import WholeBodyMotion

EVER = AvoidanceSettings(apart_m=0.4, acts_m=0.5, near_m=0.6, every=1, most=12, shrunk=10.0)
"""Acts wherever it looks."""
WALL = Box("wall", Placement.from_wxyz([0.6, 0.0, 0.3]), np.array([0.4, 1.0, 0.6]))
NOWHERE = Terrain.from_surfaces([])


def rows_of(avoidance: CollisionAvoidance, body: RigidBody) -> tuple[Rows, np.ndarray]:
    """Rows and weights at the state of a body."""
    avoidance.update(body)
    return avoidance.task_rows()


def at_random(robot: Robot, seed: int) -> tuple[RigidBody, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.q_reference, 0.1 * rng.normal(size=robot.model.nv))
    v = rng.normal(size=robot.model.nv)
    body = RigidBody(robot)
    body.update(q, v)
    return body, q, v


def of_arms(robot: Robot) -> np.ndarray:
    """Which of the velocity's coordinates are those of arms."""
    return np.array([False] * 6 + [robot.group[joint] == "arm" for joint in robot.joint_names])


def distances(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Of all pairs of the robot, and of its shapes from the wall ahead."""
    geometry, data = pin.GeometryModel(robot.full_collision), robot.model.createData()
    shapes = len(robot.full_collision.geometryObjects)
    at = pin.SE3(WALL.placement.rotation, WALL.placement.position_m)
    wall = geometry.addGeometryObject(pin.GeometryObject("wall", 0, 0, at, coal.Box(*WALL.size_m.tolist())))
    for k in range(shapes):
        geometry.addCollisionPair(pin.CollisionPair(k, wall))
    results = geometry.createData()
    pin.computeDistances(robot.model, data, geometry, results, q)
    return np.array([result.min_distance for result in results.distanceResults])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("moving", ["arms", "all"])
def test_rows_are_the_rate_of_the_distances(talos: Robot, seed: int, moving: str) -> None:
    """Of pairs with an arm as far as arms move, of the others as far as anything does."""
    body, q, v = at_random(talos, seed)
    arms = of_arms(talos)
    rows, weights = rows_of(CollisionAvoidance(talos, Terrain.from_surfaces([WALL]), EVER), body)
    arm_alone = ~rows.A[:, ~arms].any(axis=1)
    chosen = arm_alone if moving == "arms" else ~arm_alone
    assert len(weights) == len(rows.b)
    assert chosen.sum() > 3
    if moving == "arms":
        v[~arms] = 0.0
    h = 1e-5
    ahead, behind = (distances(talos, pin.integrate(talos.model, q, s * h * v)) for s in (1.0, -1.0))
    rates = (ahead - behind) / (2.0 * h)
    for rate in rows.A[chosen] @ v:
        assert np.abs(rates - rate).min() < 5e-3


def test_shins_avoid_what_stands_before_them(talos: Robot) -> None:
    body, _, _ = at_random(talos, 0)
    by = AvoidanceSettings(apart_m=0.2, acts_m=0.4, near_m=0.5, every=1)
    without, with_wall = (
        rows_of(CollisionAvoidance(talos, Terrain.from_surfaces(boxes), by), body)[0] for boxes in ((), (WALL,))
    )
    assert len(without.b) == 0
    of_legs = np.abs(with_wall.A[:, :6]).any(axis=1)  # rows of arms move arms only
    assert 0 < of_legs.sum() <= by.most
    assert with_wall.A[of_legs, 0].max() < 0.0  # away from it is backwards


def test_what_is_far_is_left_alone_and_weights_do_not_jump(talos: Robot) -> None:
    body, q, _ = at_random(talos, 1)
    far = AvoidanceSettings(apart_m=1e-4, acts_m=2e-4)
    rows, weights = rows_of(CollisionAvoidance(talos, NOWHERE, far), body)
    assert rows.A.shape == (0, talos.model.nv)
    assert len(weights) == 0
    d = distances(talos, q).min()
    for acts_m, bar in ((1.02, 0.01), (1.002, 1e-4)):
        settings = AvoidanceSettings(apart_m=0.5 * d, acts_m=acts_m * d, shrunk=100.0)
        _, weights = rows_of(CollisionAvoidance(talos, NOWHERE, settings), body)
        assert weights.max(initial=0.0) <= 4.0 * bar


def test_arms_in_peace_move_as_they_did(talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]) -> None:
    """Where nothing is near, nothing changes."""
    from stridelab.wholebody.control.controller import WholeBodyController
    from stridelab.wholebody.control.task_stack import Settings

    plan, motion = swaying
    without = WholeBodyController(settings=replace(Settings(), avoid=None)).run(talos, plan.sequence, plan)
    assert np.abs(without.q - motion.q).max() < 1e-9


def test_a_swinging_hand_is_pushed_off_a_surface(talos: Robot) -> None:
    """Along the line of smallest distance, only while it swings, and by no task."""
    body = RigidBody(talos)
    body.update(talos.q_reference, np.zeros(talos.model.nv))
    hand_m = body.frame_state("right_hand").position_m
    beside = Box("beside", Placement.from_wxyz((hand_m - [0.0, 0.2, 0.0]).tolist()), np.array([0.3, 0.2, 0.3]))
    avoidance = CollisionAvoidance(talos, Terrain.from_surfaces([beside]), EVER)
    tasks = len(rows_of(avoidance, body)[1])
    assert not avoidance.hand_push_m_s2("right_hand").any()
    avoidance.watch_hands(["left_foot", "right_hand"])
    assert len(rows_of(avoidance, body)[1]) == tasks
    x, y, z = avoidance.hand_push_m_s2("right_hand")
    assert y > 1.0
    assert y > 5.0 * abs(x)
    assert np.linalg.norm([x, y, z]) <= HAND_PUSH_M_S2 * (1.0 + 1e-9)
    assert not avoidance.hand_push_m_s2("left_hand").any()


def test_a_forearm_keeps_off_a_surface_also_while_its_hand_holds_it(talos: Robot) -> None:
    """By a task of the arm, from the full distance on; the wrist beyond it is free to touch."""
    body = RigidBody(talos)
    body.update(talos.q_reference, np.zeros(talos.model.nv))
    elbow, roll, wrist = (talos.model.getJointId(f"arm_right_{k}_joint") for k in (4, 5, 6))
    forearm_m = body.data.oMi[roll].translation
    rows = {}
    for name, aside_m in (("near", 0.2), ("far", 0.5)):
        beside = Box(name, Placement.from_wxyz((forearm_m - [0.0, aside_m, 0.0]).tolist()), np.array([0.1, 0.2, 0.1]))
        avoidance = CollisionAvoidance(talos, Terrain.from_surfaces([beside]), AvoidanceSettings(near_m=0.2))
        A = rows_of(avoidance, body)[0].A
        columns = [talos.model.joints[joint].idx_v for joint in (elbow, roll, wrist)]
        moves_elbow, rolls, moves_wrist = (np.abs(A[:, column]) > 1e-9 for column in columns)
        rows[name] = int((moves_elbow & rolls & ~moves_wrist).sum())
    assert rows["near"] > rows["far"]


@pytest.mark.skipif(not isinstance(native_availability(), NativeSolver), reason="the module is not built")
@pytest.mark.parametrize("seed", range(4))
def test_native_rows_are_those_of_numpy(talos: Robot, seed: int) -> None:
    """Rows, weights and pushes on postures with distant, near and overlapping pairs."""
    body, _, _ = at_random(talos, seed)
    native, plain = (CollisionAvoidance(talos, Terrain.from_surfaces([WALL]), EVER) for _ in range(2))
    plain.__dict__["_native_rows"] = None
    for avoidance in (native, plain):
        avoidance.watch_hands(talos.effectors)
        avoidance.update(body)
    (rows, weights), (expected, expected_weights) = native.task_rows(), plain.task_rows()
    assert len(rows.b) > 3
    np.testing.assert_allclose(rows.A, expected.A, atol=1e-9)
    np.testing.assert_allclose(rows.b, expected.b, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(weights, expected_weights, rtol=1e-9)
    for name, effector in talos.effectors.items():
        pushes = [a.push_m_s2(name) if effector.kind == "surface" else a.hand_push_m_s2(name) for a in (native, plain)]
        np.testing.assert_allclose(pushes[0], pushes[1], atol=1e-9)
