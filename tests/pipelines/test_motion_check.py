"""Whether the body can follow the plan between stances: drags that it cannot follow, what is followed again, pauses."""

from typing import Any

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.validation.validate import build_validated
from stridelab.pipelines import motion_check
from stridelab.pipelines.motion_check import COM_ERROR_M, MotionCheck, Results
from stridelab.pipelines.plan_motion import plan_motion, stage_shares
from stridelab.pipelines.plan_problem import load_densities
from stridelab.pipelines.progress import Stages
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.loader import load_robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.service.samples.scenarios import bundled_scenarios
from stridelab.wholebody.control.controller import ControllerRun, WholeBodyController
from support.robots.scenario_bodies import everywhere

TALOS = load_robot("talos")


@pytest.fixture
def talos_check() -> MotionCheck:
    return MotionCheck(TALOS, load_densities(TALOS, DEFAULT_MEASURE))


@pytest.fixture
def spans(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Durations of all runs of the controller."""
    begun: list[float] = []

    class Watched(ControllerRun):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            begun.append(float(self.times[-1] - self.times[0]))

    monkeypatch.setattr(motion_check, "ControllerRun", Watched)
    return begun


def walk(**moved_m: tuple[tuple[float, float, float], tuple[float, float, float]]) -> dict[str, Any]:
    """``flat-walk`` with contacts moved, by effector: from where, to where."""
    scenario = bundled_scenarios()["flat-walk"]
    for effector, (place_m, to_m) in moved_m.items():
        everywhere(scenario, effector, place_m, position_m=list(to_m))
    return scenario


def built(scenario: dict[str, Any]) -> tuple[Scenario, ContactSequence]:
    return Scenario.model_validate(scenario), build_validated(scenario, effector_shapes("talos"))


def results_of(talos_check: MotionCheck, scenario: dict[str, Any]) -> Results:
    results = talos_check.continue_check(*built(scenario), lambda: False)
    assert results is not None
    return results


FIRST_LEFT = (0.0, 0.09, 0.0)
AHEAD_LEFT = (0.5, 0.09, 0.0)


def test_the_body_can_follow_the_plan_of_a_sample(talos_check: MotionCheck) -> None:
    results = results_of(talos_check, walk())
    assert sorted(results) == list(range(17))
    assert all(one.passed and not one.reason for one in results.values())


def test_a_first_stance_that_is_left_too_far_behind_is_named(talos_check: MotionCheck) -> None:
    """The stances are reachable, but the CoM of the plan is not, as the whole body finds after seconds."""
    results = results_of(talos_check, walk(left_foot=(FIRST_LEFT, (0.473, 0.526, 0.0))))
    ((phase, failed),) = [(k, one) for k, one in results.items() if not one.passed]
    assert phase <= 1
    assert "the centre of mass is" in failed.reason
    assert f"{1e3 * COM_ERROR_M:g} are allowed" in failed.reason
    assert max(results) <= 1, "no later phase is followed"


def test_only_phases_beside_a_change_are_followed_again(talos_check: MotionCheck, spans: list[float]) -> None:
    whole = results_of(talos_check, walk())
    assert spans == [pytest.approx(built(walk())[1].duration_s, abs=0.02)]
    moved = results_of(talos_check, walk(left_foot=(AHEAD_LEFT, (0.52, 0.09, 0.0))))
    assert moved.keys() == whole.keys()
    assert len(spans) == 2
    assert spans[1] < 0.7 * spans[0]
    assert results_of(talos_check, walk()) == whole
    assert len(spans) == 2, "both are cached"


def test_a_failure_holds_for_its_plan_alone(talos_check: MotionCheck) -> None:
    """A far second foothold bends the plan of the first stance, whose contacts are those of the walk as it was."""
    far = results_of(talos_check, walk(right_foot=((0.25, -0.09, 0.0), (1.05, -0.09, 0.0))))
    assert not far[0].passed
    assert all(one.passed for one in results_of(talos_check, walk()).values())


def test_a_paused_check_ends_with_the_same_results(talos_check: MotionCheck) -> None:
    fresh = MotionCheck(TALOS, load_densities(TALOS, DEFAULT_MEASURE))
    scenario = walk(left_foot=(FIRST_LEFT, (0.473, 0.526, 0.0)))
    pauses, results = 0, talos_check.continue_check(*built(scenario), lambda: True)
    while results is None:
        pauses += 1
        results = talos_check.continue_check(*built(scenario), lambda: True)
    assert pauses > 3
    assert results == results_of(fresh, scenario)


def test_a_run_from_a_later_phase_starts_on_its_contacts_at_the_speed_of_the_plan() -> None:
    scenario, sequence = built(walk())
    request = PlanMotionInput(scenario=scenario)
    stages = Stages(lambda _fraction, _message: None, stage_shares(request))
    planned = plan_motion(PlanMotionTask(scenario=scenario, input=request), stages)
    whole, plan = planned.motion, planned.plan
    assert whole is not None
    run = ControllerRun(WholeBodyController(rate_hz=50.0), TALOS, plan.sequence, plan, span=(5, 8))
    for i in range(len(run.times)):
        run.run_sample(i)
    late = run.recorded_motion(0.0)
    assert late.time_s[0] == pytest.approx(sequence.starts_s[5])
    assert late.time_s[-1] == pytest.approx(sequence.ends_s[8], abs=0.02)
    assert np.linalg.norm(late.com_m - late.com_reference_m, axis=1).max() < 1e-3
    np.testing.assert_allclose(late.com_v_m_s[0], late.com_v_reference_m_s[0], atol=1e-3)
    at = np.searchsorted(whole.time_s, late.time_s[-1] - 1e-6)
    assert np.abs(late.q[-1][7:] - whole.q[at][7:]).max() < 0.1, "the posture is that of the whole run in the end"


def test_a_part_that_would_begin_in_a_swing_begins_before_it(talos_check: MotionCheck) -> None:
    scenario = walk()
    results_of(talos_check, scenario)
    scenario["phases"][-1]["duration_s"] += 0.1
    assert len(scenario["phases"]) % 2 == 1, "two phases before the one next to the last, a foot swings"
    assert all(result.passed for result in results_of(talos_check, scenario).values())
