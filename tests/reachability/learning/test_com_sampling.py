"""The CoM in the effectors' frames, recomputed body by body; left and right mirror each other; the seed decides."""

import gc
import weakref
from dataclasses import replace
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import ks_2samp

from stridelab.dynamics.spatial import Placement
from stridelab.errors import NotEstimable, NotFound
from stridelab.reachability.learning.com_sampling import BLOCK, ComCloud, configuration_stream, sample_com
from stridelab.robots.configuration_sampling import uniform_configurations
from stridelab.robots.robot import Robot


def generator(seed: int, block: int = 0) -> np.random.Generator:
    """That of one block of a cloud."""
    return np.random.default_rng(np.random.SeedSequence(seed).spawn(block + 1)[block])


def test_they_are_the_com_in_the_contact_frame(talos: Robot) -> None:
    names = tuple(talos.effectors)
    cloud = sample_com(talos, names, 30, seed=3)
    stream = uniform_configurations(talos, generator(3))
    model, data = talos.model, talos.model.createData()
    origins: list[list[np.ndarray]] = []
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
        sample_com(robot, ["right_hand"], 10, seed=0).com_m["right_hand"]
        for robot in (talos, replace(talos, q_reference=moved))
    )
    np.testing.assert_allclose(here, there, atol=1e-12)


def test_an_effector_alone_has_the_same_samples(talos: Robot, fresh: ComCloud) -> None:
    alone = sample_com(talos, ["left_hand"], 50, seed=20_240_517)
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


def test_progress_counts_postures_block_by_block(talos: Robot) -> None:
    progress: list[tuple[float, str]] = []
    sample_com(talos, ["left_foot"], BLOCK + 100, seed=0, progress=lambda f, m: progress.append((f, m)))
    assert progress == [(BLOCK / (BLOCK + 100), f"{BLOCK} of {BLOCK + 100} postures"), (1.0, "600 of 600 postures")]


def test_every_block_has_a_child_of_the_seed_of_its_own(talos: Robot, fresh: ComCloud) -> None:
    stream = uniform_configurations(talos, generator(20_240_517, block=2))
    model, data = talos.model, talos.model.createData()
    pin.framesForwardKinematics(model, data, next(stream))
    effector = talos.effectors["left_foot"]
    link = data.oMf[model.getFrameId(effector.frame)]
    T_world_contact = Placement(link.translation, link.rotation) @ effector.T_frame_contact
    com = pin.centerOfMass(model, data, False)
    np.testing.assert_allclose(
        fresh.com_m["left_foot"][2 * BLOCK], T_world_contact.inverse().act(com[None])[0], atol=1e-12
    )


@pytest.mark.parametrize("measure", ["uniform", "conditioned"])
def test_two_processes_draw_what_one_draws(talos: Robot, measure: str) -> None:
    """To the last bit; the last block is a short one."""
    one, two = (sample_com(talos, tuple(talos.effectors), BLOCK + 60, 9, measure, processes=n) for n in (1, 2))
    assert all((one.com_m[name] == two.com_m[name]).all() for name in talos.effectors)
    assert (one.tried, one.pair_distance_max_m) == (two.tried, two.pair_distance_max_m)


def test_an_error_of_another_process_is_raised(talos: Robot) -> None:
    hopper = replace(talos, effectors={k: e for k, e in talos.effectors.items() if k != "right_foot"})
    with pytest.raises(NotEstimable) as refusal:
        sample_com(hopper, ["left_foot"], 2 * BLOCK, 0, "conditioned", processes=2)
    assert refusal.value.code == "measure-unavailable"
    assert refusal.value.faults


def test_the_hand_of_a_standing_robot_sees_the_com_in_the_heading_of_the_trunk(talos: Robot) -> None:
    """Heights are those above the hand; the heading frame differs from the gripper's by a rotation only."""
    cloud = sample_com(talos, tuple(talos.effectors), 40, 5, "conditioned")
    assert cloud.frames == {
        "left_foot": "contact",
        "right_foot": "contact",
        "left_hand": "heading",
        "right_hand": "heading",
    }
    model, data = talos.model, talos.model.createData()
    for a, q in enumerate(islice(configuration_stream(talos, "conditioned", generator(5)), 40)):
        pin.framesForwardKinematics(model, data, q)
        com = pin.centerOfMass(model, data, False)
        forward = data.oMf[model.getFrameId(talos.base_frame)].rotation[:, 0]
        ahead = np.array([forward[0], forward[1], 0.0]) / np.hypot(forward[0], forward[1])
        for name in ("left_hand", "right_hand"):
            effector = talos.effectors[name]
            link = data.oMf[model.getFrameId(effector.frame)]
            r = com - (Placement(link.translation, link.rotation) @ effector.T_frame_contact).position_m
            expected = [r @ ahead, r @ np.cross([0.0, 0.0, 1.0], ahead), r[2]]
            np.testing.assert_allclose(cloud.com_m[name][a], expected, atol=1e-12)


def test_a_stream_is_freed_with_its_last_reference(talos: Robot) -> None:
    """The buffers of the collision check are large: those of a block must not wait for the garbage collector."""
    gc.disable()
    try:
        stream = configuration_stream(talos, "uniform", np.random.default_rng(0))
        next(stream)
        left = weakref.ref(stream)
        del stream
        assert left() is None
    finally:
        gc.enable()


def test_an_unknown_effector_is_named(talos: Robot) -> None:
    with pytest.raises(NotFound) as refusal:
        sample_com(talos, ["left_foot", "tail"], 10, seed=0)
    assert refusal.value.code == "effector-not-found"
    assert refusal.value.faults[0].where == "effectors[1]"
    assert "right_hand" in refusal.value.message
