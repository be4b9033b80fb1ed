"""Recovery by steps in physics: a standing robot that is pushed harder than its soles can bear."""

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.disturbances import Disturbances, Push
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.replay import PhysicsReplay


def pushed(robot: Robot, motion: WholeBodyMotion, speed_m_s: float, angle_rad: float, physics: PhysicsReplay) -> Replay:
    """Pushed after 1 s by what changes the CoM's velocity by ``speed_m_s``."""
    x, y = robot.mass_kg * speed_m_s * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    disturbances = Disturbances(pushes=(Push(1.0, (float(x), float(y), 0.0)),))
    return physics.run(robot, motion.sequence, motion, lambda *_: None, disturbances=disturbances)


def test_steps_save_a_robot_that_falls_without_them(
    talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]
) -> None:
    without = pushed(talos, swaying[1], 0.6, 0.0, PhysicsReplay(recovery=None))
    assert without.fell
    assert without.left_plan is None
    result = pushed(talos, swaying[1], 0.6, 0.0, PhysicsReplay())
    assert not result.fell
    assert result.left_plan is not None
    assert result.left_plan.rested
    assert result.left_plan.steps >= 1
    assert 1.0 < result.left_plan.time_s < 1.2
    assert not result.completed
    (left,) = [remark for remark in result.remarks if remark.code == "replay-left-plan"]
    assert "stands at rest" in left.message
    assert np.linalg.norm(result.v[-1][:3]) < 0.1, "it ends at rest"
    assert result.com_m[-1, 2] > 0.75, "and upright"


@pytest.mark.parametrize(("speed_m_s", "angle_rad"), [(0.5, 0.8), (0.6, 3.14)])
def test_few_steps_suffice(
    talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion], speed_m_s: float, angle_rad: float
) -> None:
    """A capture point inside the hull of both soles needs no step, so that the robot does not step on the spot."""
    result = pushed(talos, swaying[1], speed_m_s, angle_rad, PhysicsReplay())
    assert result.left_plan is not None
    assert result.left_plan.rested
    assert 1 <= result.left_plan.steps <= 4
    assert result.time_s[-1] < 5.0


def test_a_push_that_no_step_can_undo_ends_in_a_fall(
    talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]
) -> None:
    result = pushed(talos, swaying[1], 3.0, 0.0, PhysicsReplay())
    assert result.fell
    assert result.left_plan is not None
    assert not result.left_plan.rested


def test_the_plan_is_not_left_without_need(talos: Robot, swaying: tuple[CentroidalPlan, WholeBodyMotion]) -> None:
    runs = [
        pushed(talos, swaying[1], 0.05, 0.0, PhysicsReplay(recovery=None)),
        pushed(talos, swaying[1], 0.05, 0.0, PhysicsReplay()),
    ]
    assert runs[1].left_plan is None
    assert np.array_equal(runs[0].q, runs[1].q)
