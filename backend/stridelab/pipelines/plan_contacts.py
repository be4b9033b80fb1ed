"""From a stance, a goal stance and a terrain to a scenario with contacts (section 4.2), and courses to such tasks."""

from collections.abc import Mapping
from typing import Any, Final

from stridelab.contacts.effector_geometry import EffectorShape, effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.scenarios.course import Bar, Block, Course, Element, Flight, Gap, Level, Ramp, Stones
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary
from stridelab.schemas.scenarios import Course as CourseInput
from stridelab.schemas.scenarios import Scenario

REFERENCES: Final = ("carpentier2017thesis", "deits2014footstep", "huangfu2018highs")
"""Citation keys of the method."""
ELEMENTS: Final[Mapping[str, type[Any]]] = {
    "level": Level,
    "stairs": Flight,
    "ramp": Ramp,
    "stones": Stones,
    "bar": Bar,
    "box": Block,
    "gap": Gap,
}
"""Element of a course by the ``kind`` of its schema; the fields have the same names."""


def plan_contacts(request: PlanContactsInput, progress: ProgressCallback) -> PlanContactsSummary:
    """Plan the contacts of ``request``; the scenario of the summary passes the validation.

    Raises ``InvalidInput`` (``stance-invalid``), ``NotEstimable`` (``contacts-unreachable``, ``contacts-too-far``,
    ``contact-plan-timeout``, ``contact-plan-refused``), and ``NotFound`` (``robot-not-found``,
    ``reachability-not-learned``).
    """
    progress(0.0, "reading the robot's reach")
    effectors = effector_shapes(request.robot)
    planner = ContactPlanner(effectors, planner_limits(request.robot))
    plan = planner.plan(request.model_dump(mode="json"), progress)
    report = validate_scenario(plan.scenario, effectors)
    return PlanContactsSummary.from_object(
        plan,
        scenario=Scenario.model_validate(plan.scenario),
        duration_s=report.duration_s,
        warnings=[Remark(code=remark.code, message=remark.message) for remark in report.remarks],
    )


def compose_course(request: CourseInput, effectors: Mapping[str, EffectorShape]) -> PlanContactsInput:
    """Compose the body of ``POST /jobs/plan-contacts``.

    Raises ``InvalidInput`` (``course-too-long``, ``course-without-hand``, ``course-without-feet``).
    """
    elements: list[Element] = [ELEMENTS[e.kind](**e.model_dump(exclude={"kind"})) for e in request.elements]
    sides = tuple(dict.fromkeys(request.handrails))
    task = Course(elements, sides, request.width_m).contact_task(effectors)
    head = {"robot": request.robot, "friction": request.friction, "name": request.name}
    return PlanContactsInput.model_validate({**head, **task})
