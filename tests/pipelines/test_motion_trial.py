"""The search of the fastest pace, on motions whose fastest pace is known."""

from typing import Any

import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines import motion_trial
from stridelab.pipelines.motion_trial import MotionTrial, at_pace, bisect_steps, find_fastest_pace
from stridelab.pipelines.progress import Stages
from stridelab.pipelines.scenarios.scenario_files import read_scenario
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from support.command_line import quiet

WALK = read_scenario("flat-walk")
GIVEN_S = sum(phase.duration_s for phase in WALK.phases)


class PassingTrial(MotionTrial):
    """A trial that is certified if it has no reasons."""

    @property
    def certified(self) -> bool:
        return not self.reasons


class Limited:
    """A robot whose motions pass up to a pace."""

    def __init__(self, pace: float) -> None:
        self.pace = pace
        self.tried: list[float] = []

    def __call__(self, task: PlanMotionTask, _progress: Any) -> MotionTrial:
        pace = GIVEN_S / sum(phase.duration_s for phase in task.scenario.phases)
        self.tried.append(round(pace, 6))
        reasons = () if pace <= self.pace + 1e-6 else ("certificate: landing_error_max 0.001 m",)
        return PassingTrial(task, Stages(quiet, {}), reasons=reasons)


def task_of(scenario: Scenario = WALK) -> PlanMotionTask:
    return PlanMotionTask(scenario=scenario, input=PlanMotionInput(scenario=scenario, fastest=True))


@pytest.mark.parametrize("fastest", [0.3, 0.45, 0.7, 0.95, 1.0, 1.05, 1.55, 2.95, 3.0])
def test_finds_the_fastest_pace_to_its_resolution(fastest: float) -> None:
    robot = Limited(fastest)
    trial, search = find_fastest_pace(task_of(), quiet, robot)
    assert search.pace == pytest.approx(fastest)
    assert trial.passed
    assert sum(phase.duration_s for phase in trial.task.scenario.phases) == pytest.approx(GIVEN_S / fastest)
    assert [one.pace for one in search.attempts] == pytest.approx(robot.tried)
    assert len(set(robot.tried)) == len(robot.tried) <= 8  # none is planned twice
    assert search.finished
    assert all(bool(one.reason) == (one.pace > fastest + 1e-6) for one in search.attempts)


def test_durations_stay_within_those_of_valid_scenarios() -> None:
    hasty = at_pace(WALK, min(phase.duration_s for phase in WALK.phases) / 0.06)
    robot = Limited(3.0)
    _trial, search = find_fastest_pace(task_of(hasty), quiet, lambda *_: PassingTrial(task_of(), Stages(quiet, {})))
    assert search.pace == pytest.approx(1.2)  # 0.06 s over it are the 0.05 s that a phase lasts at least
    slow = WALK.model_copy(
        update={"phases": [WALK.phases[0].model_copy(update={"duration_s": 45.0}), *WALK.phases[1:]]}
    )
    with pytest.raises(NotEstimable) as caught:
        find_fastest_pace(task_of(slow), quiet, Limited(0.0))
    assert [fault.where for fault in caught.value.faults] == ["pace 1"]  # at 0.7 it would last more than a minute
    assert not robot.tried


def test_a_motion_that_never_passes_is_refused_with_its_attempts() -> None:
    with pytest.raises(NotEstimable) as caught:
        find_fastest_pace(task_of(), quiet, Limited(0.25))
    assert caught.value.code == "no-pace-passes"
    assert [fault.where for fault in caught.value.faults] == ["pace 1", "pace 0.7", "pace 0.5", "pace 0.3"]
    assert "landing_error_max" in caught.value.message


def test_the_search_ends_with_its_time_but_not_before_something_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_trial, "SEARCH_S", -1.0)
    robot = Limited(0.5)
    _trial, search = find_fastest_pace(task_of(), quiet, robot)
    assert robot.tried == pytest.approx([1.0, 0.7, 0.5])
    assert (search.pace, search.finished) == (0.5, False)


@pytest.mark.parametrize("largest", [3, 4, 7, 8])
def test_bisection_finds_the_last_number_that_passes(largest: int) -> None:
    assert bisect_steps(lambda number: number <= largest, 3, 9) == largest


def test_stages_that_fail_are_the_reason_of_a_trial() -> None:
    apart = WALK.model_dump()
    apart["phases"][3]["contacts"][0]["position_m"] = (0.0, 0.0, 5.0)
    scenario = Scenario.model_validate(apart)
    trial = motion_trial.try_motion(task_of(scenario), quiet)
    assert not trial.passed
    assert trial.result is None
    assert "phases[3]" in trial.reason or "phase 3" in trial.reason
