"""Joints that are locked are held in the replay: a hand's softly, a waist's like those of the torso."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import robot_card
from stridelab.robots.data_files import data_files
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.replay.mujoco_model import SimulationModel, build_simulation
from stridelab.wholebody.replay.replay import PhysicsReplay

GROUND = Terrain(
    (Box("ground", Placement.from_wxyz([0.0, 0.0, -0.5], [1.0, 0.0, 0.0, 0.0]), np.array([4.0, 4.0, 1.0])),)
)


def simulated(robot: Robot) -> SimulationModel:
    return build_simulation(robot, GROUND, 0.3, ("left_foot", "right_foot"))


@pytest.fixture(scope="module")
def stiff_waist() -> Robot:
    """G1 with its waist locked, below the trunk that is a third of its mass."""
    card = robot_card("g1")
    groups = {group: pattern for group, pattern in card.groups.items() if group != "torso"}
    armature = {
        ".*_(hip|knee|ankle)_.*": 0.01,
        **{k: v for k, v in card.rotors.armature_kg_m2.items() if "knee" not in k},
    }
    changed = replace(
        card,
        groups=groups,  # type: ignore[arg-type]
        locked_joints=(*card.locked_joints, "waist_.*"),
        rotors=replace(card.rotors, armature_kg_m2=armature),
    )
    return assemble_robot("g1", changed, data_files(card))


def test_a_waist_that_carries_the_trunk_is_held_like_a_torso(stiff_waist: Robot) -> None:
    usual = load_robot("g1")
    waist = [name.startswith("waist") for name in usual.joint_names]
    torso_kp = PhysicsReplay().joint_gains(usual, 0.001)[0][waist].min()
    built = simulated(stiff_waist)
    kp, kd, locked_kp, locked_kd = PhysicsReplay().gains_with_locked(stiff_waist, built)
    for name, stiffness in zip(stiff_waist.locked, locked_kp, strict=True):
        assert stiffness == pytest.approx(torso_kp if name.startswith("waist") else 300.0), name
    # one step of the control of all joints reverses no motion in full: e' <- e' - dt W (K e + D e')
    data = mujoco.MjData(built.model)
    x, y, z, w = stiff_waist.q_reference[3:7]
    data.qpos[:7] = [*stiff_waist.q_reference[:3], w, x, y, z]
    data.qpos[built.moving_qpos], data.qpos[built.locked_qpos] = stiff_waist.q_reference[7:], built.locked_rad
    mujoco.mj_forward(built.model, data)
    M = np.zeros((built.model.nv, built.model.nv))
    mujoco.mj_fullM(built.model, data, M)
    dofs = np.concatenate([built.moving_dof, built.locked_dof])
    W = 0.001 * np.linalg.inv(M)[np.ix_(dofs, dofs)]
    slowed = np.eye(len(dofs)) - W * np.concatenate([kd, locked_kd])
    pulled = -W * np.concatenate([kp, locked_kp])
    step = np.block([[np.eye(len(dofs)) + 0.001 * pulled, 0.001 * slowed], [pulled, slowed]])
    assert np.abs(np.linalg.eigvals(step)).max() < 1.0


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_locked_joints_of_light_links_change_no_gain(name: str) -> None:
    robot = load_robot(name)
    usual = PhysicsReplay().joint_gains(robot, 0.001)
    kp, kd, locked_kp, locked_kd = PhysicsReplay().gains_with_locked(robot, simulated(robot))
    assert np.array_equal(kp, usual[0])
    assert np.array_equal(kd, usual[1])
    assert (locked_kp == 300.0).all()
    assert (locked_kd == 10.0).all()
