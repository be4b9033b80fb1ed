"""Arms keep off the body: rows against finite differences, and two motions with and without them."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.robots.robot import Robot
from stridelab.wholebody.avoidance import Avoid, Avoidance
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.rigid_body import RigidBody

EVER = Avoid(apart_m=0.4, acts_m=0.5, near_m=0.6, every=1, most=12, shrunk=10.0)
"""Acts wherever it looks."""


def at_random(robot: Robot, seed: int) -> tuple[RigidBody, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.q_reference, 0.1 * rng.normal(size=robot.model.nv))
    v = rng.normal(size=robot.model.nv)
    v[[k for k in range(len(v)) if k < 6 or robot.group[robot.joint_names[k - 6]] != "arm"]] = 0.0  # arms move
    body = RigidBody(robot)
    body.update(q, v)
    return body, q, v


def distances(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Of all pairs with an arm, in the order of the robot's pairs."""
    geometry, data = robot.collision, robot.model.createData()
    results = geometry.createData()
    pin.computeDistances(robot.model, data, geometry, results, q)
    arm = [robot.group.get(robot.model.names[part.parentJoint]) == "arm" for part in geometry.geometryObjects]
    with_arm = [k for k, pair in enumerate(geometry.collisionPairs) if arm[pair.first] or arm[pair.second]]
    return np.array([results.distanceResults[k].min_distance for k in with_arm])


@pytest.mark.parametrize("seed", range(3))
def test_rows_are_the_rate_of_the_distances(talos: Robot, seed: int) -> None:
    body, q, v = at_random(talos, seed)
    avoidance = Avoidance(talos, EVER)
    rows, weights = avoidance.rows(body)
    assert len(weights) > 3
    h = 1e-5
    ahead, behind = (distances(talos, pin.integrate(talos.model, q, s * h * v)) for s in (1.0, -1.0))
    rates = (ahead - behind) / (2.0 * h)
    arms = np.array([False] * 6 + [talos.group[joint] == "arm" for joint in talos.joint_names])
    assert not rows.A[:, ~arms].any()
    for rate in rows.A @ v:
        assert np.abs(rates - rate).min() < 1e-3


def test_what_is_far_is_left_alone_and_weights_do_not_jump(talos: Robot) -> None:
    body, q, _ = at_random(talos, 1)
    far = Avoid(apart_m=1e-4, acts_m=2e-4)
    rows, weights = Avoidance(talos, far).rows(body)
    assert rows.A.shape == (0, talos.model.nv)
    assert len(weights) == 0
    d = distances(talos, q).min()
    for acts_m, bar in ((1.02, 0.01), (1.002, 1e-4)):
        _, weights = Avoidance(talos, Avoid(apart_m=0.5 * d, acts_m=acts_m * d, shrunk=100.0)).rows(body)
        assert weights.max(initial=0.0) <= 4.0 * bar


def test_arms_in_peace_move_as_they_did(talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]) -> None:
    """Where nothing is near, nothing changes."""
    from stridelab.wholebody.controller import WholeBodyController
    from stridelab.wholebody.programme import Settings

    plan, motion = swaying
    without = WholeBodyController(settings=replace(Settings(), avoid=None)).run(talos, plan.sequence, plan)
    assert np.abs(without.q - motion.q).max() < 1e-9
