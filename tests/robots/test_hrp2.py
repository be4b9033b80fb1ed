"""HRP-2 as written from numbers, against the description that the numbers come from."""

import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.robots import urdf
from stridelab.robots.card import robot_card
from stridelab.robots.data_files import data_files
from stridelab.robots.loader import load_robot
from stridelab.robots.self_collision import SelfCollision

SOURCE = Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[3] / "shared")).resolve() / "robots" / "hrp2"
if not SOURCE.is_dir():
    pytest.skip("the published description of HRP-2 is not here (set STRIDELAB_TEST_DATA)", allow_module_level=True)

N = 1000


@pytest.fixture(scope="module")
def ours() -> pin.Model:
    return urdf.full_model(data_files(robot_card("hrp2")).urdf)


@pytest.fixture(scope="module")
def published() -> pin.Model:
    return pin.buildModelFromUrdf(str(SOURCE / "urdf" / "hrp2.urdf"), pin.JointModelFreeFlyer())


@pytest.fixture(scope="module")
def configurations(published: pin.Model) -> np.ndarray:
    """Joint angles uniform in their ranges, the base anywhere."""
    rng, model = np.random.default_rng(3), published
    q = np.zeros((N, model.nq))
    q[:, :3] = rng.uniform(-1.0, 1.0, (N, 3))
    quaternions = rng.normal(size=(N, 4))
    q[:, 3:7] = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    q[:, 7:] = rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:], (N, model.nq - 7))
    return q


def test_joints_and_limits_are_those_published(ours: pin.Model, published: pin.Model) -> None:
    assert list(ours.names) == list(published.names)
    assert ours.nq == 37
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        assert getattr(ours, limit) == pytest.approx(getattr(published, limit), abs=1e-12), limit


def test_links_soles_and_hands_are_where_they_were(
    ours: pin.Model, published: pin.Model, configurations: np.ndarray
) -> None:
    mine, theirs = ours.createData(), published.createData()
    names = [f.name for f in published.frames if f.type == pin.FrameType.BODY and "sole_center" not in f.name]
    pairs = [(ours.getFrameId(name), published.getFrameId(name)) for name in names]
    assert len(pairs) == 35
    worst = 0.0
    for q in configurations:
        pin.framesForwardKinematics(ours, mine, q)
        pin.framesForwardKinematics(published, theirs, q)
        for i, k in pairs:
            worst = max(worst, np.abs(mine.oMf[i].homogeneous - theirs.oMf[k].homogeneous).max())
    assert worst < 1e-6


def test_masses_centre_of_mass_and_inertias_are_the_same(
    ours: pin.Model, published: pin.Model, configurations: np.ndarray
) -> None:
    assert pin.computeTotalMass(ours) == pytest.approx(56.037, abs=1e-3)
    mine, theirs = ours.createData(), published.createData()
    for q in configurations:
        com_m = pin.centerOfMass(ours, mine, q)
        assert com_m == pytest.approx(pin.centerOfMass(published, theirs, q), abs=1e-6)
    for q in configurations[:50]:
        assert pin.crba(ours, mine, q) == pytest.approx(pin.crba(published, theirs, q), abs=1e-6)


def test_self_collisions_agree_with_those_of_the_meshes(published: pin.Model, configurations: np.ndarray) -> None:
    """The published meshes as they are, of the same pairs of links: 89 % agreement over 4000 configurations."""
    robot = load_robot("hrp2")
    meshes = pin.buildGeomFromUrdf(
        published, str(SOURCE / "urdf" / "hrp2.urdf"), pin.GeometryType.COLLISION, package_dirs=[str(SOURCE.parent)]
    )
    part = {published.frames[item.parentFrame].name: k for k, item in enumerate(meshes.geometryObjects)}
    links = [robot.model.frames[item.parentFrame].name for item in robot.collision.geometryObjects]
    for a, b in {(links[pair.first], links[pair.second]) for pair in robot.collision.collisionPairs}:
        meshes.addCollisionPair(pin.CollisionPair(part[a], part[b]))
    assert len(meshes.collisionPairs) == 185
    data, buffers, check = published.createData(), meshes.createData(), SelfCollision(robot)
    moving = [published.joints[published.getJointId(joint)].idx_q for joint in robot.joint_names]
    rest = robot.q_reference
    verdicts = []
    for q in configurations[:400]:
        ours, theirs = rest.copy(), pin.neutral(published)
        ours[7:] = q[moving]
        for joint, angle_rad in robot.locked.items():
            theirs[published.joints[published.getJointId(joint)].idx_q] = angle_rad
        theirs[moving] = q[moving]
        verdicts.append(
            (pin.computeCollisions(published, data, meshes, buffers, theirs, True), check.any_collision(ours))
        )
    truth, by_hulls = np.array(verdicts).T
    assert 0.55 < truth.mean() < 0.75
    assert np.mean(truth & ~by_hulls) < 0.11, "missed"
    assert np.mean(by_hulls & ~truth) < 0.07, "false alarms"
    assert not check.any_collision(rest)
