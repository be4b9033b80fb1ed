"""The rolling wheel as reference acceleration, against the derivatives of (3.1), (3.2)."""

import numpy as np
import pytest

from stridelab.contacts.sequence import ContactSequence
from stridelab.pipelines.imitation.comparison import Walker
from stridelab.pipelines.imitation.recorded_walk import walk_of_motion
from stridelab.pipelines.imitation.robot_walk import RobotScale, scale_walk
from stridelab.pipelines.imitation.wheel_reference import RollingWheel, rolling_wheel, steady_spans
from stridelab.pipelines.plan_problem import validate_scenario
from stridelab.schemas.scenarios import Scenario
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Branch
from support.recordings.flat_footed import FlatFootedWalk


@pytest.fixture(scope="module")
def sequence() -> ContactSequence:
    truth = FlatFootedWalk(length_m=0.4)
    recorded = walk_of_motion(truth.motion, truth.contacts, truth.gait_steps, 0.75)
    walk = scale_walk(recorded, RobotScale("talos", 0.75, 0.2))
    return validate_scenario(Scenario.model_validate(walk.scenario("Walk", 0.5)))[0]


def test_steady_steps_lie_between_the_first_and_the_last_two(sequence: ContactSequence) -> None:
    spans = steady_spans(sequence)
    assert len(spans) == 3
    assert [end - start for start, end, _ in spans] == pytest.approx([1.0] * 3, abs=1e-3)
    assert [length for _, _, length in spans] == pytest.approx([0.4] * 3, abs=1e-3)
    assert spans[0][0] == pytest.approx(sequence.starts_s[3])


@pytest.mark.parametrize("branch", [1, -1])
def test_accelerations_are_those_of_the_wheel(sequence: ContactSequence, branch: Branch) -> None:
    wheel = RollingWheel(branch, 0.2, 0.9)
    times_s = np.linspace(0.0, sequence.duration_s, 4001)
    a = wheel.accelerations_m_s2(sequence, times_s)
    middle = 0.5 * (times_s[:-1] + times_s[1:])
    start_s, end_s, length_m = steady_spans(sequence)[1]
    inside = (middle > start_s + 0.01) & (middle < end_s - 0.01)
    R_m, omega = length_m / FULL_TURN_RAD, FULL_TURN_RAD / (end_s - start_s)
    theta = FULL_TURN_RAD * ((middle[inside] - start_s) / (end_s - start_s) - 0.9)
    assert a[inside, 0] == pytest.approx(branch * 0.2 * R_m * omega**2 * np.sin(theta), abs=2e-3)
    assert a[inside, 2] == pytest.approx(0.2 * R_m * omega**2 * np.cos(theta), abs=2e-3)
    assert not a[:, 1].any()
    outside = (middle < steady_spans(sequence)[0][0]) | (middle > steady_spans(sequence)[-1][1])
    assert not a[outside].any()
    whole = (middle > start_s) & (middle < end_s)
    assert np.abs(a[whole].sum(axis=0)).max() * (times_s[1] - times_s[0]) < 0.01  # a turn returns to its velocity


@pytest.mark.parametrize("branch", [1, -1])
def test_the_wheel_of_a_path_is_recovered(branch: Branch) -> None:
    """A CoM on a wheel with r = 0.2 R whose lowest point is at 90 % of every step."""
    truth = FlatFootedWalk(steps=6, length_m=0.628)
    motion, step = truth.motion, truth.gait_steps[1]
    share = (motion.time_s - step.start_s) / (step.end_s - step.start_s)
    theta, R_m = FULL_TURN_RAD * (share - 0.9), truth.length_m / FULL_TURN_RAD
    motion.com_m[:, 0] = R_m * theta - branch * 0.2 * R_m * np.sin(theta)
    motion.com_m[:, 2] = 0.9 - 0.2 * R_m * np.cos(theta)
    person = Walker.of_motion(motion, truth.gait_steps)
    wheel = rolling_wheel(person.fits, branch)
    assert wheel.ratio == pytest.approx(0.2, rel=0.02)
    assert wheel.lowest_share == pytest.approx(0.9, abs=0.01)
