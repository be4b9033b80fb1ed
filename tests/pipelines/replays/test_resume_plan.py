"""A plan that was left for a recovery is resumed, and the robot ends where the plan ends."""

import numpy as np
import pytest

from stridelab.pipelines.plan_motion import plan_scenario_motion
from stridelab.pipelines.replays.resume_plan import PlanResumer
from stridelab.robots.loader import load_robot
from stridelab.schemas.plans import ReplayLeftPlan
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.disturbances import Disturbances, Push
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.resumption import MAX_RESUMPTIONS, JointBlend, NotResumed, Resume, Resumption
from stridelab.wholebody.replay.sensors import SensedState
from support.robots.plans import short_walk


@pytest.fixture(scope="module")
def motion() -> WholeBodyMotion:
    return plan_scenario_motion(short_walk())


def pushed(motion: WholeBodyMotion, resume: Resume | None) -> Replay:
    """Pushed to the left by 0.5 m/s, as the first step begins."""
    robot = load_robot(motion.sequence.robot)
    push = Push(float(motion.sequence.ends_s[0]), (0.0, 0.5 * robot.mass_kg, 0.0))
    disturbed = Disturbances(pushes=(push,))
    return PhysicsReplay().run(robot, motion.sequence, motion, lambda *_: None, disturbances=disturbed, resume=resume)


def test_after_a_recovery_the_robot_ends_where_the_plan_ends(motion: WholeBodyMotion) -> None:
    result = pushed(motion, PlanResumer(motion.sequence, plan_scenario_motion))
    left = result.left_plan
    assert left is not None
    assert left.resumed_s is not None
    assert left.time_s < left.resumed_s < result.time_s[-1] - 2.0
    assert left.rested
    assert left.steps >= 1
    assert result.arrived
    assert left.missed_m < 0.03
    assert "replay-left-plan" not in {remark.code for remark in result.remarks}
    assert result.com_m[-1] == pytest.approx(motion.com_m[-1], abs=0.03)
    assert result.plan_time_s[-1] == pytest.approx(motion.time_s[-1], abs=1e-6), "the plan's own clock, to its end"
    assert np.all(np.diff(result.plan_time_s) > -0.5)
    summary = ReplayLeftPlan.from_object(left)
    assert (summary.arrived, summary.not_resumed) == (True, "")


def test_a_plan_that_is_not_resumed_says_why(motion: WholeBodyMotion) -> None:
    """The stance is measured, so that soles that hang 5 cm over the ground are refused."""
    states: list[SensedState] = []

    def note_state(_left_s: float, measured: SensedState) -> NotResumed:
        states.append(measured)
        return NotResumed("the stairs are gone")

    result = pushed(motion, note_state)
    assert (result.fell, result.arrived, result.completed) == (False, False, False)
    (message,) = [remark.message for remark in result.remarks if remark.code == "replay-left-plan"]
    assert "not resumed: the stairs are gone" in message
    (measured,) = states
    for placement in measured.contacts.values():
        placement.position_m[2] += 0.05
    refused = PlanResumer(motion.sequence, plan_scenario_motion)(1.0, measured)
    assert isinstance(refused, NotResumed)
    assert "level surfaces" in refused.reason


def test_the_plan_is_at_its_own_time_from_the_joined_contacts_on(motion: WholeBodyMotion) -> None:
    resumption = Resumption(motion, own_join_s=3.0, join_s=1.5)
    assert resumption.plan_time_s(0.0) == 1.5
    assert resumption.plan_time_s(3.0) == 1.5
    assert resumption.plan_time_s(4.0) == 2.5
    assert MAX_RESUMPTIONS >= 1


def test_the_blend_is_smooth_and_ends() -> None:
    blend, dt_s = JointBlend(np.array([0.2]), np.array([10.0])), 0.004
    parts = []
    while not blend.has_ended:
        parts.append(blend.advance(dt_s))
    angles, rates, torques = (np.array([part[k][0] for part in parts]) for k in range(3))
    assert angles[0] == 0.2
    assert torques[0] == 10.0
    assert angles[-1] == pytest.approx(0.0, abs=1e-6)
    assert np.diff(angles) / dt_s == pytest.approx(rates[:-1], abs=4e-3)
    assert abs(rates[0]) < 1e-9
