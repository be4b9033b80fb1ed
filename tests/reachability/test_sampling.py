"""The CoM in the contact frames, recomputed body by body; left and right mirror each other."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import ks_2samp

from stridelab.dynamics.placement import Placement
from stridelab.errors import NotFound
from stridelab.reachability.sampling import REPORT_EVERY, ComCloud, sample_com
from stridelab.robots.robot import Robot
from stridelab.robots.sampling import uniform_configurations


def test_they_are_the_com_in_the_contact_frame(talos: Robot) -> None:
    names = tuple(talos.effectors)
    cloud = sample_com(talos, names, 30, np.random.default_rng(3))
    stream = uniform_configurations(talos, np.random.default_rng(3))
    model, data = talos.model, talos.model.createData()
    origins = []
    for a, q in enumerate(islice(stream, 30)):
        pin.framesForwardKinematics(model, data, q)
        masses = np.array([body.mass for body in model.inertias])
        centres = np.array([data.oMi[j].act(body.lever) for j, body in enumerate(model.inertias)])
        com = masses @ centres / masses.sum()
        origins.append([])
        for name, effector in talos.effectors.items():
            link = data.oMf[model.getFrameId(effector.frame)]
            T_world_contact = Placement(link.translation, link.rotation) @ effector.T_frame_contact
            np.testing.assert_allclose(cloud.com_m[name][a], T_world_contact.inverse().act(com[None])[0], atol=1e-12)
            origins[-1].append(T_world_contact.position_m)
    assert cloud.tried == stream.tried
    at = np.array(origins)
    for (first, second), farthest in cloud.pair_distance_max_m.items():
        gaps = np.linalg.norm(at[:, names.index(first)] - at[:, names.index(second)], axis=1)
        assert farthest == pytest.approx(gaps.max(), abs=1e-12)
    assert len(cloud.pair_distance_max_m) == 6


def test_where_the_base_is_does_not_matter(talos: Robot) -> None:
    moved = talos.q_reference.copy()
    moved[:3] += [3.0, -2.0, 5.0]
    moved[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.4, -1.0, 2.0)).coeffs()
    here, there = (
        sample_com(robot, ["right_hand"], 10, np.random.default_rng(0)).com_m["right_hand"]
        for robot in (talos, replace(talos, q_reference=moved))
    )
    np.testing.assert_allclose(here, there, atol=1e-12)


def test_an_effector_alone_has_the_same_samples(talos: Robot, fresh: ComCloud) -> None:
    alone = sample_com(talos, ["left_hand"], 50, np.random.default_rng(20_240_517))
    assert (alone.com_m["left_hand"] == fresh.com_m["left_hand"][:50]).all()
    assert alone.pair_distance_max_m == {}


@pytest.mark.parametrize("part", ["foot", "hand"])
def test_left_and_right_mirror_each_other(fresh: ComCloud, part: str) -> None:
    """Contact frames are chosen so that the mirror changes the sign of y; different postures on either side."""
    left = fresh.com_m[f"left_{part}"][:1000]
    right = fresh.com_m[f"right_{part}"][1000:] * [1.0, -1.0, 1.0]
    for axis in range(3):
        assert ks_2samp(left[:, axis], right[:, axis]).pvalue > 1e-3
    for a, b in ((0, 1), (1, 2), (0, 2)):
        products = [(x - x.mean(axis=0))[:, [a, b]].prod(axis=1) for x in (left, right)]
        error = np.hypot(*(p.std() / np.sqrt(len(p)) for p in products))
        assert abs(products[0].mean() - products[1].mean()) < 4 * error


def test_the_mirror_test_can_fail(fresh: ComCloud) -> None:
    left, right = fresh.com_m["left_foot"][:1000], fresh.com_m["right_foot"][1000:]
    assert ks_2samp(left[:, 1], right[:, 1]).pvalue < 1e-6


def test_progress_counts_postures(talos: Robot) -> None:
    told: list[tuple[float, str]] = []
    sample_com(
        talos, ["left_foot"], 2 * REPORT_EVERY, np.random.default_rng(0), progress=lambda f, m: told.append((f, m))
    )
    assert [fraction for fraction, _ in told] == [0.5, 1.0]
    assert told[0][1] == f"{REPORT_EVERY} of {2 * REPORT_EVERY} postures"


def test_an_unknown_effector_is_named(talos: Robot) -> None:
    with pytest.raises(NotFound) as refusal:
        sample_com(talos, ["left_foot", "tail"], 10, np.random.default_rng(0))
    assert refusal.value.code == "effector-not-found"
    assert refusal.value.faults[0].where == "effectors[1]"
    assert "right_hand" in refusal.value.message
