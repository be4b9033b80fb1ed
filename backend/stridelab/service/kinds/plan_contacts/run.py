"""``plan-contacts``: plans contacts from a stance to a goal stance over a terrain, as a scenario (section 4.2).

Writes ``scenario.json``, the body of ``POST /scenarios``.
"""

from pathlib import Path
from typing import Final

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanContactsSummary
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.tasks import PlanContactsTask
from stridelab.service.kinds.base import ArtifactFile, Json, Outcome
from stridelab.service.kinds.result_tables import write_text_atomically

SCENARIO_FILE: Final = "scenario.json"
REFERENCES: Final = ("carpentier2017thesis", "deits2014footstep", "huangfu2018highs")


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(PlanContactsTask.model_validate(task), folder, progress).to_json()


def run(task: PlanContactsTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Plan into ``folder``; the summary is a ``PlanContactsSummary``.

    Raises ``InvalidInput`` (``stance-invalid``), ``NotEstimable`` (``contacts-unreachable``, ``contacts-too-far``,
    ``contact-plan-timeout``, ``contact-plan-refused``), and ``NotFound`` (``robot-not-found``,
    ``reachability-not-learned``).
    """
    request = task.input
    progress(0.0, "reading the robot's reach")
    effectors = effector_shapes(request.robot)
    planner = ContactPlanner(effectors, planner_limits(request.robot))
    plan = planner.plan(request.model_dump(mode="json"), progress)
    report = validate_scenario(plan.scenario, effectors)
    scenario = Scenario.model_validate(plan.scenario)
    summary = PlanContactsSummary(
        scenario=scenario,
        steps=plan.steps,
        duration_s=report.duration_s,
        objective_m=plan.objective_m,
        programs=plan.programs,
        solve_time_s=plan.solve_time_s,
        warnings=[Remark(code=remark.code, message=remark.message) for remark in report.remarks],
    )
    text = scenario.model_dump_json(indent=2, exclude_none=True) + "\n"
    write_text_atomically(folder / SCENARIO_FILE, text)
    progress(1.0, "done")
    return Outcome(summary.model_dump(mode="json"), REFERENCES, (ArtifactFile(SCENARIO_FILE, "application/json"),))
