"""The search of steps and pace, on robots whose limits are known."""

from typing import Any

import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines.imitation import pace_search
from stridelab.pipelines.imitation.pace_search import (
    FIRST_PACE,
    SLOWEST_PACE,
    STEP_SHARES,
    Trial,
    find_pace,
    search_fastest,
    search_longest,
)
from stridelab.pipelines.imitation.recorded_walk import walk_of_motion
from stridelab.pipelines.imitation.robot_walk import RobotScale, scale_walk
from stridelab.pipelines.progress import Stages
from stridelab.schemas.imitation.contract import ImitationAttempt
from stridelab.schemas.scenarios import Scenario
from support.command_line import quiet
from support.recordings.flat_footed import FlatFootedWalk

TRUTH = FlatFootedWalk()
RECORDED = walk_of_motion(TRUTH.motion, TRUTH.contacts, TRUTH.gait_steps, 0.9)
SCALE = RobotScale("talos", 0.75, 0.2)
WALK = scale_walk(RECORDED, SCALE)
SCENARIO = Scenario.model_validate(WALK.scenario("Walk", 1.0))


class Limited:
    """A robot that carries out steps up to ``share`` at most at ``pace``, slower ones if they are longer."""

    def __init__(self, share: float, pace: float, *, longer_at: float = 0.0) -> None:
        self.share, self.pace, self.longer_at = share, pace, longer_at
        self.tried: list[tuple[float, float]] = []

    def passes(self, share: float, pace: float) -> bool:
        return pace <= self.longer_at + 1e-9 or (share <= self.share + 1e-9 and pace <= self.pace + 1e-9)

    def __call__(self, share: float, pace: float) -> Trial:
        self.tried.append((share, round(pace, 4)))
        passed = self.passes(share, pace)
        attempt = ImitationAttempt(
            step_share=share, pace=pace, step_length_m=share, speed_m_s=share * pace, certified=passed,
            completed=passed, reason="" if passed else "too fast",
        )  # fmt: skip
        return Trial(WALK, attempt, SCENARIO, None, None, Stages(quiet, {}))


@pytest.mark.parametrize("pace", [0.6, 0.65, 0.8, 0.95, 1.0])
@pytest.mark.parametrize("share", [1.0, 0.7, 0.4])
def test_finds_the_longest_steps_and_their_fastest_pace(share: float, pace: float) -> None:
    robot = Limited(share, pace)
    slow = search_longest(robot)
    assert slow is not None
    best = search_fastest(robot, slow).attempt
    assert (best.step_share, best.pace) == pytest.approx((share, pace))
    assert len(robot.tried) <= len(STEP_SHARES) + 4
    assert len(set(robot.tried)) == len(robot.tried)  # nothing is planned twice


def test_slows_down_where_no_steps_pass_at_first() -> None:
    robot = Limited(0.5, 0.55)
    slow = search_longest(robot)
    assert slow is not None
    assert slow.attempt.pace == SLOWEST_PACE
    best = search_fastest(robot, slow).attempt
    assert (best.step_share, best.pace) == pytest.approx((0.5, 0.55))
    assert (0.5, FIRST_PACE) in robot.tried


def test_a_walk_that_never_passes_is_refused_with_all_attempts(monkeypatch: pytest.MonkeyPatch) -> None:
    never = Limited(0.0, 0.0)

    def try_walk(walk: Any, _body: Any, pace: float, _tell: Any) -> Trial:
        return never(walk.step_share, pace)

    monkeypatch.setattr(pace_search, "try_walk", try_walk)
    with pytest.raises(NotEstimable) as caught:
        find_pace(RECORDED, SCALE, "Walk", quiet)
    assert caught.value.code == "imitation-not-certified"
    assert len(caught.value.faults) == 2 * len(STEP_SHARES)
    assert all(fault.message == "too fast" for fault in caught.value.faults)


def test_given_steps_and_pace_are_the_only_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Limited(0.8, 0.9)
    monkeypatch.setattr(pace_search, "try_walk", lambda walk, _body, pace, _tell: robot(walk.step_share, pace))
    best = find_pace(RECORDED, SCALE, "Walk", quiet, step_share=0.65, pace=0.7).best.attempt
    assert robot.tried == [(0.65, 0.7)]
    assert (best.step_share, best.pace) == (0.65, 0.7)
    best = find_pace(RECORDED, SCALE, "Walk", quiet, step_share=0.65).best.attempt
    assert (best.step_share, best.pace) == pytest.approx((0.65, 0.9))
    best = find_pace(RECORDED, SCALE, "Walk", quiet, pace=0.75).best.attempt
    assert (best.step_share, best.pace) == pytest.approx((0.8, 0.75))
