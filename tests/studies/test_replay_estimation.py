"""The estimator of chapter 2 in the stabiliser's place for the state: a robot that stands on a known force."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.pipelines.replays.replay_estimation import LOW_NOISE, FilteredCom, KinematicCom, replay_estimators
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.replay.sensors import SensedState


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("talos")


def standing(robot: Robot, time_s: float, axis_off_m: float = 0.0) -> SensedState:
    """At rest on one foot in its middle, the axis of the force ``axis_off_m`` to the left of the model's CoM."""
    q, v = robot.q_reference, np.zeros(robot.model.nv)
    com = pin.centerOfMass(robot.model, robot.model.createData(), q)
    place = Placement.from_wxyz([0.0, 0.05, 0.0])
    force = np.array([0.0, 0.0, robot.mass_kg * GRAVITY_M_S2])
    pressed = np.array([com[0], com[1] + axis_off_m, 0.0])
    moment = np.cross(pressed - place.position_m, force)
    return SensedState(time_s, q, v, np.full(3, 9.0), np.full(3, 9.0), {"s": place}, {"s": force}, {"s": moment})


def test_kinematics_know_the_model_and_not_the_simulator(robot: Robot) -> None:
    com = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)
    seen = KinematicCom(robot, 0.0, 0.0)(standing(robot, 0.0))
    assert np.allclose(seen.com_m, com)
    assert not seen.com_v_m_s.any()
    noisy = KinematicCom(robot, 0.002, 0.0, seed=3)
    places = np.array([noisy(standing(robot, 0.0)).com_m for _ in range(400)])
    assert places.std(axis=0) == pytest.approx([0.002] * 3, rel=0.15)


def test_the_filter_is_steadier_than_its_geometry(robot: Robot) -> None:
    com = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)
    estimator = FilteredCom(robot, 0.002)
    result = [estimator(standing(robot, k / 250.0)) for k in range(1500)][750:]
    off = np.array([seen.com_m for seen in result]) - com
    assert np.sqrt(np.mean(off**2)) < 0.001
    assert np.std([seen.com_v_m_s for seen in result]) < 0.02


def test_a_load_that_the_model_does_not_know_is_detected_by_the_axis(robot: Robot) -> None:
    estimator = FilteredCom(robot, 0.0)
    seen = [estimator(standing(robot, k / 250.0, axis_off_m=0.01)) for k in range(2500)][-1]
    com = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)
    assert seen.com_m[1] - com[1] == pytest.approx(0.01, abs=1e-3)


def test_late_sensors_that_repeat_an_instant_are_borne(robot: Robot) -> None:
    estimator, first = FilteredCom(robot, 0.001), standing(robot, 0.0)
    once, again = estimator(first), estimator(replace(first))
    assert np.array_equal(once.com_m, again.com_m)


def test_every_replay_begins_with_new_estimators(robot: Robot) -> None:
    """One replay's noise and filter leave nothing behind for the next."""
    seen = [standing(robot, k / 250.0) for k in range(5)]
    first, second = replay_estimators(robot, LOW_NOISE), replay_estimators(robot, LOW_NOISE)
    assert set(first) == {"the simulator's CoM with noise", "kinematics alone", "kinematics and forces, filtered"}
    for name, observe in first.items():
        reported = [observe(one).com_m for one in seen]
        assert np.array_equal(reported, [second[name](one).com_m for one in seen])
        assert (np.ptp(reported, axis=0).max() > 0.0) == (name != "the simulator's CoM with noise")
