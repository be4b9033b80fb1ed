"""``plan-receding``: a scenario carried out by plans of a receding horizon, pushed on the way if asked.

Leaves ``receding`` (Parquet and CSV), one row per period: where the CoM was, and what its replan took; and the motion
as a plan has it, ``centroidal`` with ``scenario.json``, for whoever shows plans.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.centroidal.horizon import Disturb, RecedingHorizon, State
from stridelab.centroidal.resting import from_rest_to_rest
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.schemas.base import Remark
from stridelab.schemas.receding import PlanRecedingSummary, Push
from stridelab.service.jobs.kinds.kind import Json, Outcome, ProgressCallback
from stridelab.service.jobs.kinds.plan_artifacts import write_json
from stridelab.service.jobs.kinds.plan_options import CONTROLS, taken
from stridelab.service.jobs.kinds.plan_posing import checked, densities
from stridelab.service.jobs.kinds.receding_tables import carried_out_columns, period_columns
from stridelab.service.jobs.kinds.tables_io import write_table
from stridelab.service.jobs.kinds.tasks import PlanRecedingTask

REFERENCES: Final = ("carpentier2017thesis",)
SOLVER_REFERENCES: Final[Mapping[str, tuple[str, ...]]] = {
    "native": (),
    "ipopt": ("andersson2019casadi", "wachter2006ipopt"),
}
ROUNDING: Final = 1e-9
FELL_BEHIND: Final = "replans-failed"


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(PlanRecedingTask.model_validate(task), folder, progress).to_json()


def run(task: PlanRecedingTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Carry the scenario out into ``folder``; the summary is a ``PlanRecedingSummary``.

    Raises ``InvalidInput`` (``scenario-invalid``, ``horizon-invalid``), ``NotFound`` (``robot-not-found``),
    ``Unavailable`` (``reachability-of-another-robot``) and ``NotEstimable`` (``horizon-lost``).
    """
    request = task.input
    progress(0.0, "looking at the scenario")
    sequence, noted = checked(task.scenario)
    robot = load_robot(sequence.robot)
    posed = from_rest_to_rest(robot, sequence, densities(robot, request.measure or DEFAULT_MEASURE))
    problem = replace(posed, control=CONTROLS[taken(request.formulation)], node_rate_hz=request.node_rate_hz)
    horizon = RecedingHorizon(
        problem=problem, horizon_s=request.horizon_s, period_s=request.period_s, warm=request.warm
    )
    total_s = sequence.duration_s

    def follow(time_s: float, state: State) -> State:
        progress(0.99 * min(time_s / total_s, 1.0), f"{min(time_s, total_s):.1f} of {total_s:.1f} s")
        return pushed(request.pushes, request.period_s)(time_s, state)

    done = horizon.run(follow)
    took_ms = 1e3 * np.array([replan.took_s for replan in done.replans])
    iterations = np.array([replan.iterations for replan in done.replans])
    (solver,) = {replan.plan.solver for replan in done.replans}
    carried_on = sum(replan.carried_on for replan in done.replans)
    if carried_on:
        message = f"in {carried_on} of {len(took_ms)} periods no solution was found, and the plan before went on"
        noted = (*noted, Remark(code=FELL_BEHIND, message=message))
    summary = PlanRecedingSummary(
        scenario_name=sequence.name,
        robot=robot.name,
        duration_s=total_s,
        solver=solver,
        replans=len(done.replans),
        carried_on=carried_on,
        iterations_median=float(np.median(iterations)),
        iterations_max=int(iterations.max()),
        replan_median_ms=float(np.median(took_ms)),
        replan_p99_ms=float(np.quantile(took_ms, 0.99)),
        replan_max_ms=float(took_ms.max()),
        goal_gap_m=float(np.linalg.norm(done.com_m[-1] - problem.com_end_m)),
        warnings=list(noted),
    )
    about = {"scenario": sequence.name, "robot": robot.name, "horizon_s": request.horizon_s}
    files = (
        *write_table(folder, "receding", period_columns(done), about),
        *write_table(folder, "centroidal", carried_out_columns(sequence, done), about),
        write_json(folder, "scenario.json", task.scenario),
    )
    progress(1.0, "done")
    references = (*REFERENCES, *SOLVER_REFERENCES[solver], *robot_card(robot.name).references)
    return Outcome(summary.model_dump(mode="json"), references, files)


def pushed(pushes: list[Push], period_s: float) -> Disturb:
    """The state after the pushes of the period that ends at a time; a period begins with its first moment."""

    def disturb(time_s: float, state: State) -> State:
        period = round(time_s / period_s)
        due = [push.velocity_m_s for push in pushes if math.floor(push.time_s / period_s + ROUNDING) + 1 == period]
        return replace(state, com_v_m_s=state.com_v_m_s + np.sum([*due, (0.0, 0.0, 0.0)], axis=0))

    return disturb
