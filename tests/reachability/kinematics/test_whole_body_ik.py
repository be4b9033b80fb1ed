"""Kinematics of the whole body for many problems at once, against the robot's own."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.reachability.kinematics.whole_body_ik import BASE, BodyTree, Target
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot


@pytest.fixture(scope="module", params=["talos", "hrp2", "g1"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def postures(tree: BodyTree, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    base = np.hstack([rng.normal(size=(n, 3)), rng.uniform(-0.7, 0.7, (n, 3))])
    return np.hstack([base, rng.uniform(tree.lower[BASE:], tree.upper[BASE:], (n, len(tree.links) - BASE))])


def test_com_and_contacts_are_the_robot_s(robot: Robot) -> None:
    tree = BodyTree.from_robot(robot)
    model, frames = with_contact_frames(robot)
    data = model.createData()
    x = postures(tree, 6, 0)
    q = tree.to_configurations(x)
    np.testing.assert_allclose(tree.to_coordinates(q), x, atol=1e-12)
    at = tree.forward_kinematics(x)
    c, _ = tree.com_and_jacobian(at)
    for k in range(6):
        pin.framesForwardKinematics(model, data, q[k])
        np.testing.assert_allclose(c[k], pin.centerOfMass(model, data, q[k]), atol=1e-12)
        for name, frame in frames.items():
            p, R = tree.contact_frame_pose(name, at)
            np.testing.assert_allclose(p[k], data.oMf[frame].translation, atol=1e-12)
            np.testing.assert_allclose(R[k], data.oMf[frame].rotation, atol=1e-12)


def test_jacobian_of_the_com_by_differences(robot: Robot) -> None:
    tree = BodyTree.from_robot(robot)
    x = postures(tree, 3, 1)
    _, J = tree.com_and_jacobian(tree.forward_kinematics(x))
    for v in range(x.shape[1]):
        h = np.zeros(x.shape[1])
        h[v] = 1e-6
        ahead, behind = (tree.com_and_jacobian(tree.forward_kinematics(x + sign * h))[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(J[:, :, v], (ahead - behind) / 2e-6, atol=1e-8)


def test_the_targets_of_a_posture_are_reached_again(robot: Robot) -> None:
    """Soles, a hand and the CoM of known postures, from postures near them; within limits, to the tolerance."""
    tree = BodyTree.from_robot(robot)
    lower, upper = tree.lower.copy(), tree.upper.copy()
    lower[:BASE], upper[:BASE] = -5.0, 5.0
    n = 60
    rng = np.random.default_rng(2)
    reference = np.tile(tree.to_coordinates(robot.q_reference[None]), (n, 1))
    x = np.clip(reference + rng.normal(0.0, 0.3, reference.shape), lower, upper)
    at = tree.forward_kinematics(x)
    targets = {name: Target(*tree.contact_frame_pose(name, at)) for name in ("left_foot", "right_foot")}
    targets["right_hand"] = Target(tree.contact_frame_pose("right_hand", at)[0])
    c, _ = tree.com_and_jacobian(at)
    limits = np.tile(lower, (n, 1)), np.tile(upper, (n, 1))
    postures, solved = tree.solve(targets, np.tile(np.eye(3), (n, 1, 1)), c, reference, limits, reference)
    assert solved.mean() > 0.7
    assert (postures >= lower).all()
    assert (postures <= upper).all()
    at = tree.forward_kinematics(postures)
    np.testing.assert_allclose(tree.com_and_jacobian(at)[0][solved], c[solved], atol=1e-6)
    for name, target in targets.items():
        p, R = tree.contact_frame_pose(name, at)
        np.testing.assert_allclose(p[solved], target.p_m[solved], atol=1e-6)
        if target.R is not None:
            np.testing.assert_allclose(R[solved], target.R[solved], atol=2e-6)


def test_targets_out_of_reach_are_not_reached(robot: Robot) -> None:
    tree = BodyTree.from_robot(robot)
    x = tree.to_coordinates(robot.q_reference[None])
    at = tree.forward_kinematics(x)
    targets = {name: Target(*tree.contact_frame_pose(name, at)) for name in ("left_foot", "right_foot")}
    limits = tree.lower[None].clip(-5.0), tree.upper[None].clip(max=5.0)
    c, _ = tree.com_and_jacobian(at)
    _, solved = tree.solve(targets, np.eye(3)[None], c + np.array([[0.0, 0.0, 1.0]]), x, limits, x)
    assert not solved.any()
