"""Joints that a servo moves: the balance gives them the servo's torques and accounts for their motion."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.sequence import Contact
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.recovery.balance_rows import (
    BalanceRows,
    BalanceTargets,
    BalanceWeights,
    LevelHeading,
    recovery_settings,
)
from stridelab.wholebody.recovery.driven_joints import DrivenJoints

ARM = ("left_shoulder_pitch_joint", "left_elbow_joint", "right_elbow_joint")


@pytest.fixture(scope="module")
def g1() -> Robot:
    return load_robot("g1")


def servo(robot: Robot, away_rad: float) -> DrivenJoints:
    at = [robot.joint_names.index(name) for name in ARM]
    return DrivenJoints(robot, ARM, np.full(3, 14.0), np.full(3, 0.9), robot.q_reference[7:][at] + away_rad)


def test_the_torques_are_those_of_a_spring_and_a_damper_within_the_limits(g1: Robot) -> None:
    q, v = g1.q_reference[7:], np.zeros(29)
    assert servo(g1, 0.1).torques_nm(q, v) == pytest.approx(1.4)
    v[g1.joint_names.index(ARM[1])] = 2.0
    assert servo(g1, 0.1).torques_nm(q, v) == pytest.approx([1.4, 1.4 - 1.8, 1.4])
    assert servo(g1, -9.0).torques_nm(q, v) == pytest.approx(-25.0)


def test_the_balance_moves_the_body_with_the_servo(g1: Robot) -> None:
    """The accelerations of a standing robot are those of the equations of motion with the servo's torques."""
    body, driven = RigidBody(g1), servo(g1, 0.3)
    v = np.zeros(g1.model.nv)
    body.update(g1.q_reference, v)
    half = g1.effectors["left_foot"].contact_half_size_m
    contacts = {
        name: Contact(name, Placement(body.frame_state(name).position_m, np.eye(3)), "", 0.6, "surface", half)
        for name in ("left_foot", "right_foot")
    }
    targets = BalanceTargets(np.zeros(2), float(body.com_m[2]), 0.0, LevelHeading(0.0), LevelHeading(0.0), {})
    found = {
        free: BalanceRows(g1, body, contacts, BalanceWeights(), recovery_settings(), None, None if free else driven)
        for free in (True, False)
    }
    still, moved = (found[free].solve_sample(targets) for free in (True, False))
    expected_nm = driven.torques_nm(g1.q_reference[7:], v[6:])
    assert moved.tau_nm[driven.at] == pytest.approx(expected_nm, abs=1e-6)
    assert np.abs(still.tau_nm[driven.at] - expected_nm).max() > 1.0, "which the balance alone would not choose"
    inverse_nm = pin.rnea(g1.model, g1.model.createData(), g1.q_reference, v, moved.a)
    assert inverse_nm[6 + driven.at] == pytest.approx(expected_nm, abs=1e-6)
    assert moved.a[6 + driven.at].min() > 1.0, "the arms follow the servo"
    assert inverse_nm[2] == pytest.approx(g1.mass_kg * GRAVITY_M_S2, rel=0.2)
    com_a = body.A_g[:2] @ moved.a / g1.mass_kg
    assert np.abs(com_a).max() < 0.1, "and the body bears them"
