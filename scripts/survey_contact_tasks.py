"""Survey the contact planner on tasks that a seed draws (``experiments.terrains.tasks``), one JSON line per task.

survey_contact_tasks.py --seed 31411                           the planner only
survey_contact_tasks.py --seed 31411 --only 3 7 --certify      its first plan, as a certified motion
survey_contact_tasks.py --seed 31411 --only 3 --replay         and replayed in physics
"""

import argparse
import json
import sys
import time
from typing import Any

from experiments.terrains.tasks import DrawnTask, draw_tasks
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.errors import InvalidInput, NotEstimable, StridelabError
from stridelab.pipelines.plan_motion import REPLAY, plan_motion, replay_motion, stage_shares
from stridelab.pipelines.progress import Stages
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario

ROBOTS = ("talos", "hrp2", "g1")


def plan_task(drawn: DrawnTask, planner: ContactPlanner) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Outcome of one task, and the scenario if it was solved.

    Outcomes are ``solved``, ``refused right`` (an impassable task, and the refusal names what was drawn too narrow or
    too high), ``refused wrong`` and ``invalid``.
    """
    began_s = time.process_time()
    row: dict[str, Any] = {"index": drawn.index, "robot": drawn.robot, "kind": drawn.kind, "blockers": drawn.blockers}
    scenario = None
    try:
        plan = planner.plan(drawn.task)
        scenario = plan.scenario
        row |= {"outcome": "solved", "steps": plan.steps}
    except NotEstimable as error:
        is_named = any(repr(name) in error.message for name in drawn.blockers)
        is_right = error.code == "contacts-unreachable" and is_named
        outcome = "invalid" if error.code == "contact-plan-refused" else f"refused {'right' if is_right else 'wrong'}"
        row |= {"outcome": outcome, "code": error.code, "message": error.message}
    except InvalidInput as error:
        row |= {"outcome": "invalid", "code": error.code, "message": error.message}
    return row | {"cpu_s": round(time.process_time() - began_s, 2)}, scenario


def try_motion(scenario: dict[str, Any], *, replay: bool) -> dict[str, Any]:
    """Certificate, and replay, of the motion of a scenario."""
    began_s = time.process_time()
    body = Scenario.model_validate(scenario)
    request = PlanMotionInput(scenario=body, replay=replay)
    stages = Stages(lambda _share, _message: None, stage_shares(request))
    try:
        result = plan_motion(PlanMotionTask(scenario=body, input=request), stages)
        replayed = None
        if replay and result.motion is not None:
            with stages.run_stage(REPLAY, "physics") as report:
                replayed = replay_motion(request, result.robot, result.motion, report)
    except StridelabError as error:
        return {"certified": False, "why": f"{error.code}: {error.message}"}
    row: dict[str, Any] = {"certified": bool(result.certificate and result.certificate.passed)}
    if result.stopped is not None:
        row["why"] = f"{result.stopped.code} {result.stopped.names} phase {result.stopped.phase}"
    elif result.certificate is not None and not result.certificate.passed:
        failed = [check for check in result.certificate.checks if not check.passed]
        row["why"] = "; ".join(
            f"{c.name} {c.value:.4g} {c.unit} (limit {c.limit:.4g}) {c.effector or ''} phase {c.phase}" for c in failed
        )
    if replayed is not None:
        row |= {"completed": replayed.completed, "fell": replayed.fell}
    return row | {"motion_cpu_s": round(time.process_time() - began_s, 1)}


def main() -> None:
    """Survey."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--number", type=int, default=24)
    parser.add_argument("--only", type=int, nargs="*")
    parser.add_argument("--certify", action="store_true")
    parser.add_argument("--replay", action="store_true")
    options = parser.parse_args()
    planners = {name: ContactPlanner(effector_shapes(name), planner_limits(name)) for name in ROBOTS}
    for drawn in draw_tasks(options.number, options.seed, {n: p.limits.defaults for n, p in planners.items()}):
        if options.only and drawn.index not in options.only:
            continue
        row, scenario = plan_task(drawn, planners[drawn.robot])
        if scenario is not None and (options.certify or options.replay):
            row |= try_motion(scenario, replay=options.replay)
        sys.stdout.write(json.dumps(row) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
