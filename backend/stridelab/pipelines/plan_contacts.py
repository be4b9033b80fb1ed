"""From a stance, a goal stance and a terrain to a scenario with a contact sequence (section 4.2)."""

from typing import Final

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary
from stridelab.schemas.scenarios import Scenario

REFERENCES: Final = ("carpentier2017thesis", "deits2014footstep", "huangfu2018highs")
"""Citation keys of the method."""


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
