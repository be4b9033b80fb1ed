"""Postures of a standing robot: every one meets the conditions, and their law is that of plain rejection."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import ks_2samp

from stridelab.errors import NotEstimable
from stridelab.reachability import standing
from stridelab.reachability.leg_chain import LegChain
from stridelab.reachability.standing import Stance, StandingConfigurations
from stridelab.robots.collision import in_collision
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.sampling import uniform_configurations

LOOSE = Stance(upright_deg=75.0, turned_deg=120.0, ahead_m=0.9, above_m=0.7, aside_m=(-0.2, 1.0))
"""So wide that plain rejection finds stances too."""


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def meets(robot: Robot, stance: Stance, q: np.ndarray) -> bool:
    """The conditions of ``Stance`` in words, from the whole robot's kinematics."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    base = data.oMf[model.getFrameId(robot.base_frame)]
    left, right = (data.oMf[frames[name]] for name in ("left_foot", "right_foot"))
    up = [T.rotation[:, 2] for T in (base, left, right)]
    if max(angle_deg(up[0], up[1]), angle_deg(up[0], up[2]), angle_deg(up[1], up[2])) > stance.upright_deg:
        return False
    for this, other, side in ((left, right, -1.0), (right, left, 1.0)):
        x, y, z = this.rotation.T @ (other.translation - this.translation)
        ahead = this.rotation.T @ other.rotation[:, 0]
        if abs(np.degrees(np.arctan2(ahead[1], ahead[0]))) > stance.turned_deg:
            return False
        if abs(x) > stance.ahead_m or abs(z) > stance.above_m:
            return False
        if not stance.aside_m[0] <= side * y <= stance.aside_m[1]:
            return False
    return True


@pytest.mark.parametrize("foot", ["left_foot", "right_foot"])
def test_a_leg_is_placed_as_by_the_whole_robot(talos: Robot, foot: str) -> None:
    model, frames = with_contact_frames(talos)
    data = model.createData()
    chain = LegChain.of(model, frames[foot])
    angles = chain.draw(20, np.random.default_rng(0))
    p, R = chain.placed(angles)
    for a in range(20):
        q = talos.q_reference.copy()
        q[list(chain.columns)] = angles[a]
        pin.framesForwardKinematics(model, data, q)
        T = data.oMi[1].actInv(data.oMf[frames[foot]])
        np.testing.assert_allclose(p[a], T.translation, atol=1e-13)
        np.testing.assert_allclose(R[a], T.rotation, atol=1e-13)


def test_every_posture_stands_and_is_free(talos: Robot) -> None:
    stream = StandingConfigurations(talos, np.random.default_rng(1))
    kept = list(islice(stream, 150))
    assert all(meets(talos, Stance(), q) for q in kept)
    assert not any(in_collision(talos, q) for q in kept)
    lower, upper = talos.model.lowerPositionLimit[7:], talos.model.upperPositionLimit[7:]
    assert all((q[7:] >= lower).all() and (q[7:] <= upper).all() for q in kept)
    assert stream.tried > len(kept)


def test_the_law_is_that_of_plain_rejection(talos: Robot) -> None:
    plain = [q for q in islice(uniform_configurations(talos, np.random.default_rng(2)), 2500) if meets(talos, LOOSE, q)]
    assert len(plain) > 250
    staged = list(islice(StandingConfigurations(talos, np.random.default_rng(3), LOOSE), 600))
    for column in range(7, talos.model.nq):
        pvalue = ks_2samp([q[column] for q in plain], [q[column] for q in staged]).pvalue
        assert pvalue > 1e-3, talos.joint_names[column - 7]
    com = [[pin.centerOfMass(talos.model, talos.model.createData(), q)[2] for q in qs] for qs in (plain, staged)]
    assert ks_2samp(*com).pvalue > 1e-3


def test_hardly_any_uniform_posture_stands(talos: Robot) -> None:
    """Which is why the legs are drawn by themselves: one in some thousands."""
    uniform = islice(uniform_configurations(talos, np.random.default_rng(4)), 500)
    assert sum(meets(talos, Stance(), q) for q in uniform) < 4


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


def test_a_stance_that_cannot_be_is_given_up(talos: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standing, "BATCHES_PATIENCE", 2)
    stream = StandingConfigurations(talos, np.random.default_rng(0), Stance(aside_m=(3.0, 4.0)))
    with pytest.raises(NotEstimable) as refusal:
        next(stream)
    assert refusal.value.code == "no-free-configuration"
