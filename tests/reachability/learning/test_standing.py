"""Postures of a standing robot: every one meets the conditions, and what is drawn is uniform where nothing hinders."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import kstest

from stridelab.errors import NotEstimable
from stridelab.reachability.learning import standing_sampler
from stridelab.reachability.learning.standing_sampler import StandingConfigurations
from stridelab.reachability.standing_conditions import Stance
from stridelab.robots.configuration_sampling import uniform_configurations
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision

KNEE = {"talos": "leg_{}_4_joint", "g1": "{}_knee_joint"}


def soles_and_base(robot: Robot, q: np.ndarray) -> tuple[pin.SE3, pin.SE3, pin.SE3]:
    """Left sole, right sole and base in the world."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[frames["left_foot"]].copy(), data.oMf[frames["right_foot"]].copy(), data.oMi[1].copy()


def turned_deg(T: pin.SE3) -> float:
    return float(np.degrees(np.arctan2(T.rotation[1, 0], T.rotation[0, 0])))


@pytest.fixture(scope="module", params=["talos", "g1"])
def stances(request: pytest.FixtureRequest) -> tuple[Robot, StandingConfigurations, list[np.ndarray]]:
    robot = load_robot(request.param)
    stream = StandingConfigurations(robot, np.random.default_rng(1))
    return robot, stream, list(islice(stream, 120))


def test_the_soles_are_flat_and_a_step_apart(stances: tuple[Robot, StandingConfigurations, list[np.ndarray]]) -> None:
    robot, stream, postures = stances
    E, length_m = Stance(), stream.leg_length_m
    for q in postures:
        left, right, _ = soles_and_base(robot, q)
        assert np.abs(left.homogeneous - np.eye(4)).max() < 1e-5
        assert np.abs(right.rotation[:, 2] - [0.0, 0.0, 1.0]).max() < 1e-5
        for relative, side in ((left.actInv(right), -1.0), (right.actInv(left), 1.0)):
            x, y, z = relative.translation / length_m
            assert abs(x) <= E.ahead + 1e-5
            assert abs(z) <= E.above + 1e-5
            assert E.aside[0] - 1e-5 <= side * y <= E.aside[1] + 1e-5
            assert abs(turned_deg(relative)) <= E.toes_deg + 1e-3


def test_the_base_is_upright_and_looks_ahead(stances: tuple[Robot, StandingConfigurations, list[np.ndarray]]) -> None:
    robot, _, postures = stances
    for q in postures:
        _, right, base = soles_and_base(robot, q)
        assert np.degrees(np.arccos(base.rotation[2, 2])) <= Stance().upright_deg
        assert abs(turned_deg(base) - turned_deg(right) / 2) <= Stance().upright_deg + 2.0  # a tilt turns the heading


def test_the_knees_are_bent_and_nothing_touches(
    stances: tuple[Robot, StandingConfigurations, list[np.ndarray]],
) -> None:
    robot, stream, postures = stances
    lower, upper = robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:]
    for q in postures:
        assert not SelfCollision(robot).any_collision(q)
        assert (q[7:] >= lower).all()
        assert (q[7:] <= upper).all()
    knees = [robot.model.joints[robot.model.getJointId(KNEE[robot.name].format(s))].idx_q for s in ("left", "right")]
    angles = np.array(postures)[:, knees]
    assert angles.min() > 0.4  # 95 % of the leg's span
    assert angles.max() < 2.4  # 58 %
    assert stream.tried > len(postures)


def test_postures_over_a_step_ahead_are_rejected(talos: Robot) -> None:
    """The same draws, so that a stance accepted with the highest step is accepted without one too."""
    tried = {}
    for step in (0.0, 0.4):
        stream = StandingConfigurations(talos, np.random.default_rng(5), replace(Stance(), step=step))
        for _ in islice(stream, 150):
            pass
        tried[step] = stream.tried
    assert tried[0.4] > 1.1 * tried[0.0]


def test_what_is_drawn_is_uniform_where_nothing_hinders(talos: Robot) -> None:
    narrow = Stance(ahead=0.1, above=0.02, aside=(0.22, 0.26), toes_deg=2.0, upright_deg=3.0, step=0.0)
    stream = StandingConfigurations(talos, np.random.default_rng(2), narrow)
    length_m = stream.leg_length_m
    ahead, above, height = [], [], []
    for q in islice(stream, 400):
        _, right, base = soles_and_base(talos, q)
        ahead.append(right.translation[0] / length_m)
        above.append(right.translation[2] / length_m)
        hips_m = base.act(np.array([-0.02, 0.0, -0.27105])) - right.translation / 2
        if np.hypot(*hips_m[:2]) < 0.25 * length_m:
            height.append(hips_m[2] / length_m)
    assert kstest(ahead, "uniform", (-0.1, 0.2)).pvalue > 1e-3
    assert kstest(above, "uniform", (-0.02, 0.04)).pvalue > 1e-3
    free = [h for h in height if 0.75 < h < 0.9]
    assert len(free) > 20
    assert kstest(free, "uniform", (0.75, 0.15)).pvalue > 1e-3


def test_no_uniformly_drawn_posture_stands(talos: Robot) -> None:
    """Soles that lie flat are no event of random joints: that is why the legs are solved for."""
    for q in islice(uniform_configurations(talos, np.random.default_rng(4)), 200):
        left, right, _ = soles_and_base(talos, q)
        assert left.actInv(right).rotation[2, 2] < 1.0 - 1e-9


def test_a_robot_with_one_sole_does_not_stand(talos: Robot) -> None:
    hopper = replace(talos, effectors={k: e for k, e in talos.effectors.items() if k != "right_foot"})
    with pytest.raises(NotEstimable) as refusal:
        StandingConfigurations(hopper, np.random.default_rng(0))
    assert refusal.value.code == "measure-unavailable"


def test_soles_on_one_leg_do_not_stand(talos: Robot) -> None:
    twice = {"left_foot": talos.effectors["left_foot"], "right_foot": talos.effectors["left_foot"]}
    with pytest.raises(NotEstimable) as refusal:
        StandingConfigurations(replace(talos, effectors=twice), np.random.default_rng(0))
    assert refusal.value.code == "measure-unavailable"


def test_an_impossible_stance_is_given_up(talos: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standing_sampler, "MAX_EMPTY_BATCHES", 2)
    stream = StandingConfigurations(talos, np.random.default_rng(0), Stance(aside=(3.0, 4.0)))
    with pytest.raises(NotEstimable) as refusal:
        next(stream)
    assert refusal.value.code == "no-free-configuration"
