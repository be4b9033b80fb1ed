"""From a scenario and values of its parameters to the outcome of every combination.

    scenario x values -> variation -> validation -> (4.20) -> feasible | refused | infeasible | failed

With ``whole_body``, a scenario is feasible only if the whole-body motion of ``plan-motion`` passes its certificate.
"""

import itertools
import math
import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.scenarios.variations import UNITS, current_value, vary_scenario
from stridelab.errors import InvalidInput, StridelabError
from stridelab.pipelines.plan_problem import (
    control_of,
    limits_of,
    load_densities,
    native_unused_reason,
    require_solver,
    solver_of,
    validate_scenario,
)
from stridelab.pipelines.progress import ItemMap, Json, ProgressCallback
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanMotionInput
from stridelab.schemas.sweeps import SweepAxis, SweepField, SweepInput, SweepOutcome, SweepSummary, SweepTask

REFERENCES: Final = ("carpentier2017thesis", "andersson2019casadi")
MAX_CHUNK: Final = 40
"""Maximum number of scenarios per process, which share the expressions compiled by CasADi."""
MAX_WHOLE_BODY_CHUNK: Final = 4
"""Maximum number of scenarios per process with the whole body, where a scenario takes seconds."""
MAX_REASON_LENGTH: Final = 200

Point = dict[SweepField, float]
"""One combination of values."""


@dataclass(frozen=True)
class SweepRow:
    """Result of one scenario."""

    outcome: SweepOutcome
    why: str
    solver: str
    objective: float
    iterations: int
    solve_time_s: float


@dataclass(frozen=True)
class SweepResult:
    """The combinations in the order of the values, the last field fastest, their rows, and the summary."""

    grid: list[Point]
    rows: list[SweepRow]
    summary: SweepSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the method and the robot."""
        return (*REFERENCES, *robot_card(self.summary.robot).references)


def sweep_scenarios(task: SweepTask, map_points: ItemMap, processes: int, progress: ProgressCallback) -> SweepResult:
    """Plan every scenario of the sweep; ``map_points`` plans a few of them in each of ``processes`` processes.

    Raises ``NotFound`` (``robot-not-found``), ``Unavailable`` (``reachability-of-another-robot``), ``NotEstimable``
    (``solver-unavailable``) and ``InvalidInput`` (``sweep-field-impossible``); errors of single scenarios are in their
    rows.
    """
    request, began = task.input, time.monotonic()
    progress(0.0, "looking at the scenario")
    require_solver(request.solver)
    body = task.scenario.model_dump(mode="json")
    axes = sweep_axes(body, request)
    grid = [dict(zip(request.vary, values, strict=True)) for values in itertools.product(*(a.values for a in axes))]
    vary_scenario(body, grid[0])
    load_densities(load_robot(task.scenario.robot), request.measure or DEFAULT_MEASURE)
    at_once = min(processes, len(grid))
    rows = _plan_grid(task, grid, map_points, at_once, progress)
    lacked = "the wrench as control" if request.formulation == "wrench" else None
    counts = Counter(row.outcome for row in rows)
    solvers = Counter(row.solver for row in rows if row.solver)
    summary = SweepSummary(
        scenario_name=task.scenario.name,
        robot=task.scenario.robot,
        scope="whole body" if request.whole_body else "centre of mass",
        axes=axes,
        points=len(rows),
        **{outcome: counts[outcome] for outcome in ("feasible", "refused", "infeasible", "failed")},
        solvers=dict(solvers),
        solver_because=native_unused_reason(request.solver, set(solvers), lacked),
        solve_time_s=math.fsum(row.solve_time_s for row in rows),
        wall_time_s=time.monotonic() - began,
        processes=at_once,
        warnings=_failure_remarks(rows),
    )
    return SweepResult(grid, rows, summary)


def sweep_axes(body: Json, request: SweepInput) -> list[SweepAxis]:
    """The values of every field, and the scenario's present value."""
    return [
        SweepAxis(
            field=field, unit=UNITS[field], values=np.linspace(a, b, n).tolist(), present=current_value(body, field)
        )
        for field, (a, b, n) in request.vary.items()
    ]


def _plan_grid(
    task: SweepTask, grid: list[Point], map_points: ItemMap, at_once: int, progress: ProgressCallback
) -> list[SweepRow]:
    max_size = MAX_WHOLE_BODY_CHUNK if task.input.whole_body else MAX_CHUNK
    size = max(1, min(max_size, math.ceil(len(grid) / (4 * at_once))))
    starts = range(0, len(grid), size)
    about = task.model_dump(mode="json")
    items: list[Json] = [{"task": about, "points": grid[k : k + size]} for k in starts]
    rows: list[SweepRow | None] = [None] * len(grid)
    done = 0
    for index, answer in map_points(plan_chunk, items):
        first = starts[index]
        points = grid[first : first + size]
        if isinstance(answer, StridelabError):
            chunk_rows = [SweepRow("failed", f"{answer.code}: {answer.message}", "", math.nan, 0, 0.0) for _ in points]
        else:
            chunk_rows = [
                SweepRow(**{**row, "objective": math.nan if row["objective"] is None else row["objective"]})
                for row in answer["rows"]
            ]
        rows[first : first + size] = chunk_rows
        done += len(points)
        progress(0.99 * done / len(grid), f"{done} of {len(grid)} scenarios")
    return [row for row in rows if row is not None]


def plan_chunk(item: Json) -> Json:
    """Plan a few scenarios; returns their rows. Runs in a separate process."""
    task = SweepTask.model_validate(item["task"])
    robot = load_robot(task.scenario.robot)
    proxies = load_densities(robot, task.input.measure or DEFAULT_MEASURE)
    body = task.scenario.model_dump(mode="json")
    requested = solver_of(task.input)
    # no fallback from the C++ solver to another one: all points of a map use one solver
    solver = "native" if requested == "auto" and task.input.formulation != "wrench" else requested
    if task.input.whole_body:  # with it come half of the libraries
        from stridelab.pipelines.sweep_whole_body import find_whole_body_failure
    rows = []
    for values in item["points"]:
        try:
            scenario = task.scenario.model_validate(vary_scenario(body, values))
            sequence, _ = validate_scenario(scenario)
        except (InvalidInput, ValueError) as error:
            rows.append(SweepRow("refused", _short_message(error), "", math.nan, 0, 0.0))
            continue
        try:
            posed = from_rest_to_rest(robot, sequence, proxies)
            problem = replace(posed, control=control_of(task.input), node_rate_hz=task.input.node_rate_hz)
            plan = solve(problem, solver, limits_of(task.input))
        except StridelabError as error:
            rows.append(SweepRow("failed", _short_message(error), "", math.nan, 0, 0.0))
            continue
        stopped = ""
        if plan.converged and task.input.whole_body:
            fields = task.input.model_dump(include={"formulation", "solver", "node_rate_hz", "measure"})
            request = PlanMotionInput(scenario=scenario, **fields)
            stopped = find_whole_body_failure(robot, proxies, sequence, request)[:MAX_REASON_LENGTH]
        rows.append(
            SweepRow(
                "feasible" if plan.converged and not stopped else "infeasible",
                stopped if plan.converged else plan.status[:MAX_REASON_LENGTH],
                plan.solver,
                plan.objective if plan.converged else math.nan,
                plan.iterations,
                plan.solve_time_s,
            )
        )
    return {"rows": [{**vars(row), "objective": None if math.isnan(row.objective) else row.objective} for row in rows]}


def _short_message(error: Exception) -> str:
    text = error.message if isinstance(error, StridelabError) else str(error).splitlines()[0]
    return text[:MAX_REASON_LENGTH]


def _failure_remarks(rows: list[SweepRow]) -> list[Remark]:
    failed = [row.why for row in rows if row.outcome == "failed"]
    if not failed:
        return []
    return [Remark(code="sweep-points-failed", message=f"{len(failed)} scenarios could not be planned: {failed[0]}")]
