"""Legs of many postures at once: forwards as pinocchio has them, backwards to where they came from."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.reachability.kinematics.leg_ik import LegChain
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot


@pytest.mark.parametrize("effector", ["left_foot", "right_foot", "left_hand"])
def test_a_limb_is_placed_as_by_the_whole_robot(talos: Robot, effector: str) -> None:
    model, frames = with_contact_frames(talos)
    data = model.createData()
    chain = LegChain.from_frame(model, frames[effector])
    angles = chain.draw_angles(20, np.random.default_rng(0))
    p, R = chain.contact_frame_pose(angles)
    spans = chain.span_m(angles, 2, -2)
    ids = list(model.supports[model.frames[frames[effector]].parentJoint])[2:]
    for a in range(20):
        q = talos.q_reference.copy()
        q[list(chain.indices_in_q)] = angles[a]
        pin.framesForwardKinematics(model, data, q)
        T = data.oMi[1].actInv(data.oMf[frames[effector]])
        np.testing.assert_allclose(p[a], T.translation, atol=1e-13)
        np.testing.assert_allclose(R[a], T.rotation, atol=1e-13)
        span = np.linalg.norm(data.oMi[ids[-2]].translation - data.oMi[ids[2]].translation)
        assert spans[a] == pytest.approx(span, abs=1e-13)


def test_leg_angles_are_recovered_from_the_foot_pose(talos: Robot) -> None:
    model, frames = with_contact_frames(talos)
    chain = LegChain.from_frame(model, frames["left_foot"])
    angles = chain.draw_angles(2000, np.random.default_rng(1))
    p, R = chain.contact_frame_pose(angles)
    solved, reached = chain.solve_angles(p, R, np.tile(talos.q_reference[list(chain.indices_in_q)], (2000, 1)))
    assert reached.mean() > 0.9
    p_reached, R_reached = chain.contact_frame_pose(solved[reached])
    assert np.abs(p_reached - p[reached]).max() < 1e-6
    assert np.abs(R_reached - R[reached]).max() < 2e-6
    assert (solved >= chain.lower_rad).all()
    assert (solved <= chain.upper_rad).all()


def test_a_target_out_of_reach_is_reported(talos: Robot) -> None:
    model, frames = with_contact_frames(talos)
    chain = LegChain.from_frame(model, frames["left_foot"])
    start = talos.q_reference[list(chain.indices_in_q)][None]
    p, R = chain.contact_frame_pose(start)
    _, reached = chain.solve_angles(p - [0.0, 0.0, 0.5], R, start)
    assert not reached.any()
    _, none = chain.solve_angles(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 6)))
    assert none.shape == (0,)
