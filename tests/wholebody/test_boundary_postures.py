"""Plans that no posture fits at a phase boundary are refused; those of samples are not."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.errors import NotEstimable
from stridelab.pipelines.plan_motion import CENTROIDAL, plan_motion, stage_shares
from stridelab.pipelines.progress import Stages
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.service.samples.scenarios import bundled_scenarios
from stridelab.wholebody.boundary_postures import require_boundary_postures
from support.robots.scenario_bodies import everywhere

TALOS = load_robot("talos")


@pytest.fixture(scope="module")
def plan() -> CentroidalPlan:
    return centroidal_plan(bundled_scenarios()["flat-walk"])


def centroidal_plan(scenario: dict[str, Any], **options: Any) -> CentroidalPlan:
    body = Scenario.model_validate(scenario)
    request = PlanMotionInput(scenario=body, **{"whole_body": False, **options})
    stages = Stages(lambda _fraction, _message: None, stage_shares(request))
    return plan_motion(PlanMotionTask(scenario=body, input=request), stages).plan


def moved(plan: CentroidalPlan, by_m: Callable[[np.ndarray], np.ndarray]) -> CentroidalPlan:
    """The plan with its CoM moved by ``by_m`` of the times of the nodes (n,) to (n, 3)."""
    return replace(plan, com_m=plan.com_m + by_m(plan.time_s))


def test_the_plan_of_a_sample_fits(plan: CentroidalPlan) -> None:
    require_boundary_postures(TALOS, plan)


@pytest.mark.parametrize(("up_m", "fits"), [(0.005, True), (0.4, False)])
def test_a_com_that_the_legs_do_not_reach_is_refused_with_a_joint(
    plan: CentroidalPlan, up_m: float, fits: bool
) -> None:
    raised = moved(plan, lambda time_s: np.outer(time_s > 0.0, [0.0, 0.0, up_m]))
    if fits:
        require_boundary_postures(TALOS, raised)
        return
    with pytest.raises(NotEstimable) as refusal:
        require_boundary_postures(TALOS, raised)
    assert refusal.value.code == "stance-unreachable"
    assert "where phase 1 begins" in refusal.value.message
    assert " mm, with the " in refusal.value.message
    assert "knee" in refusal.value.message
    assert refusal.value.faults[0].where.startswith("phases[1]")


def test_a_drag_out_of_reach_is_refused_before_the_whole_body(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = bundled_scenarios()["flat-walk"]
    everywhere(scenario, "left_foot", (0.0, 0.09, 0.0), position_m=[-0.72, 0.3, 0.0])

    def run(*_: Any, **__: Any) -> None:
        raise AssertionError("the whole body is not computed")

    monkeypatch.setattr("stridelab.pipelines.plan_motion.WholeBodyController.run", run)
    with pytest.raises(NotEstimable) as refusal:
        centroidal_plan(scenario, whole_body=True)
    assert refusal.value.code == "stance-unreachable"
    assert refusal.value.faults[-1].where == f"stage: {CENTROIDAL}"


def test_the_refusal_does_not_depend_on_earlier_calls(plan: CentroidalPlan) -> None:
    raised = moved(plan, lambda time_s: np.outer(time_s > 0.0, [0.0, 0.0, 0.4]))
    assert refusal_of(TALOS, raised) == refusal_of(TALOS, raised)


def refusal_of(robot: Robot, plan: CentroidalPlan) -> str:
    with pytest.raises(NotEstimable) as refusal:
        require_boundary_postures(robot, plan)
    return refusal.value.message
