"""The share of an arm's capability that a hand bears, against torques computed anew with the force scaled."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import WorstValues
from stridelab.wholebody.certificate.contact_checks import hand_loads
from stridelab.wholebody.motion import WholeBodyMotion


def holding(robot: Robot, force_n: np.ndarray) -> WholeBodyMotion:
    """Two samples of rest in the reference posture with a force on the right hand, the base held by magic."""
    q, model, data = robot.q_reference, robot.model, robot.model.createData()
    effector = robot.effectors["right_hand"]
    frame = model.getFrameId(effector.frame)
    pin.framesForwardKinematics(model, data, q)
    p = data.oMf[frame].act(effector.T_frame_contact.position_m)
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
    arm = p - data.oMf[frame].translation
    tau = pin.computeGeneralizedGravity(model, data, q) - (J[:3] - pin.skew(arm) @ J[3:]).T @ force_n
    hand = Contact("right_hand", Placement(p, np.eye(3)), "rail", 0.6, "point")
    sequence = ContactSequence(
        "hold", "talos", 0.6, Terrain.from_surfaces([]), (ContactPhase(0.004, {"right_hand": hand}),)
    )
    still, none = np.zeros((2, model.nv)), np.zeros((2, 3))
    return WholeBodyMotion(
        sequence=sequence, rate_hz=250.0, time_s=np.array([0.0, 0.004]), q=np.tile(q, (2, 1)), v=still, a=still,
        tau_nm=np.tile(tau[6:], (2, 1)), forces_n={"right_hand": np.tile(force_n, (2, 1, 1))},
        points_m={"right_hand": np.zeros((1, 3))}, com_m=none, com_v_m_s=none, l_nms=none, com_reference_m=none,
        com_v_reference_m_s=none, l_reference_nms=none, failures=(), solve_time_s=0.0,
    )  # fmt: skip


def share(robot: Robot, motion: WholeBodyMotion) -> float:
    worst = WorstValues(motion.time_s, np.zeros(2, dtype=int))
    (check,) = hand_loads(robot, motion.sequence, motion, slice(None), worst)
    assert check.effector == "right_hand"
    return check.value


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -0.5, 0.8)])
def test_the_force_divided_by_its_share_brings_a_joint_to_its_limit(
    talos: Robot, direction: tuple[float, float, float]
) -> None:
    force = 20.0 * np.array(direction)
    result = share(talos, holding(talos, force))
    arm = [talos.group[joint] == "arm" and "right" in joint for joint in talos.joint_names]
    for factor, ratio in ((1.0, 1.0), (0.9, None), (1.1, None)):
        limit = holding(talos, factor * force / result)
        most = np.max(np.abs(limit.tau_nm[0][arm]) / talos.model.effortLimit[6:][arm])
        assert most == pytest.approx(ratio, abs=1e-9) if ratio else (most < 1.0) == (factor < 1.0)


def test_a_hand_that_bears_nothing_is_not_checked(talos: Robot) -> None:
    motion = holding(talos, np.zeros(3))
    worst = WorstValues(motion.time_s, np.zeros(2, dtype=int))
    (check,) = hand_loads(talos, motion.sequence, motion, slice(None), worst)
    assert check.effector is None
