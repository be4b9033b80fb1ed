"""Flights with the sizes of building codes: their handrails, certified climbs, and a flight that is too steep."""

from collections.abc import Callable

import pytest

from experiments.building_codes import HOUSE, house_stairs, outdoor_stairs
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios.parts import TALOS, Scenario
from stridelab.errors import NotEstimable
from stridelab.pipelines.motion_trial import try_motion
from stridelab.pipelines.plan_contacts import compose_course, plan_contacts
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas import scenarios
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask

NO_PROGRESS: ProgressCallback = lambda _fraction, _message: None  # noqa: E731


def test_handrails_are_80_cm_above_the_nosings() -> None:
    rails = [surface for surface in house_stairs()["terrain"] if surface["kind"] == "rail"]
    assert sorted(rail["name"] for rail in rails) == ["left_handrail", "right_handrail"]
    nosing_x_m = TALOS.toe_m + HOUSE.toe_gap_m  # of the lowest stair
    slope = HOUSE.height_m / HOUSE.depth_m
    for rail in rails:
        (x0, y, z0), (x1, _, z1) = rail["from_m"], rail["to_m"]
        assert (z1 - z0) / (x1 - x0) == pytest.approx(slope, abs=1e-3)
        axis_m = z0 + slope * (nosing_x_m - x0)
        top_m = axis_m + rail["radius_m"] * (1 + slope**2) ** 0.5
        assert 0.80 <= top_m - HOUSE.height_m < 0.81
        assert abs(y) == 0.58


@pytest.mark.parametrize("build", [house_stairs, outdoor_stairs])
def test_talos_climbs_them_certified(build: Callable[[], Scenario]) -> None:
    posed = scenarios.Scenario.model_validate(build())
    task = PlanMotionTask(scenario=posed, input=PlanMotionInput(scenario=posed, replay=False))
    trial = try_motion(task, NO_PROGRESS)
    assert trial.certified, trial.reason


def test_a_flight_as_steep_as_a_ladder_is_refused() -> None:
    steep = scenarios.CourseStairs(kind="stairs", number=5, rise_m=0.25, depth_m=0.20)
    course = scenarios.Course(robot="talos", handrails=["left", "right"], elements=[steep])
    with pytest.raises(NotEstimable, match=r"would have to reach 0\.066 m farther up") as refusal:
        plan_contacts(compose_course(course, effector_shapes("talos")), NO_PROGRESS)
    assert refusal.value.code == "contacts-unreachable"
