"""``sweep``: plans a scenario for every combination of parameter values, in parallel over the cores.

    scenario x values -> variation -> validation -> (4.20) -> feasible | refused | infeasible | failed

With ``whole_body``, a scenario is feasible only if the whole-body motion of ``plan-motion`` passes its certificate.

Writes ``sweep`` (Parquet and CSV), one row per scenario in the order of the values, the last field fastest.
"""

import itertools
import math
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import hand_bounds_n
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.scenarios.variations import UNITS, present, varied
from stridelab.contacts.sequence import ContactSequence
from stridelab.cores import usable_cores
from stridelab.errors import InvalidInput, StridelabError
from stridelab.pipelines.plan_centroidal import planned
from stridelab.pipelines.plan_problem import (
    because,
    checked,
    control_of,
    densities,
    limits_of,
    require_solver,
    solver_of,
)
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanMotionInput
from stridelab.schemas.sweeps import SweepAxis, SweepField, SweepInput, SweepOutcome, SweepSummary
from stridelab.schemas.tasks import SweepTask
from stridelab.service.kinds.base import Json, Outcome
from stridelab.service.kinds.result_tables import write_table
from stridelab.service.processes.isolated_map import each_apart
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.momentum_consistency import agree

REFERENCES: Final = ("carpentier2017thesis", "andersson2019casadi")
HEAVY: Final = "stridelab.service.kinds.sweep"
CHUNK: Final = 40
"""Maximum number of scenarios per process, which share the expressions compiled by CasADi."""
CHUNK_S: Final = 1800.0
BODIES: Final = 4
"""Maximum number of scenarios per process with the whole body, where a scenario takes seconds."""
SAID: Final = 200


@dataclass(frozen=True)
class Row:
    """Result of one scenario."""

    outcome: SweepOutcome
    why: str
    solver: str
    objective: float
    iterations: int
    solve_time_s: float


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(SweepTask.model_validate(task), folder, progress).to_json()


def run(task: SweepTask, folder: Path, progress: ProgressCallback, processes: int | None = None) -> Outcome:
    """Plan every scenario of the sweep into ``folder``; the summary is a ``SweepSummary``.

    Raises ``NotFound`` (``robot-not-found``), ``Unavailable`` (``reachability-of-another-robot``), ``NotEstimable``
    (``solver-unavailable``) and ``InvalidInput`` (``sweep-field-impossible``); errors of single scenarios are in the
    table.
    """
    request, began = task.input, time.monotonic()
    progress(0.0, "looking at the scenario")
    require_solver(request.solver)
    body = task.scenario.model_dump(mode="json")
    axes = axes_of(body, request)
    grid = [dict(zip(request.vary, values, strict=True)) for values in itertools.product(*(a.values for a in axes))]
    varied(body, grid[0])
    densities(load_robot(task.scenario.robot), request.measure or DEFAULT_MEASURE)
    at_once = min(processes or usable_cores(), len(grid))
    rows = _planned(task, grid, at_once, progress)
    lacked = "the wrench as control" if request.formulation == "wrench" else None
    counts = Counter(row.outcome for row in rows)
    solvers = Counter(row.solver for row in rows if row.solver)
    summary = SweepSummary(
        scenario_name=task.scenario.name,
        robot=task.scenario.robot,
        scope="whole body" if request.whole_body else "centre of mass",
        axes=axes,
        points=len(rows),
        feasible=counts["feasible"],
        refused=counts["refused"],
        infeasible=counts["infeasible"],
        failed=counts["failed"],
        solvers=dict(solvers),
        solver_because=because(request.solver, set(solvers), lacked),
        solve_time_s=math.fsum(row.solve_time_s for row in rows),
        wall_time_s=time.monotonic() - began,
        processes=at_once,
        warnings=_remarks(rows),
    )
    about = {"scenario": task.scenario.name, "robot": task.scenario.robot, "vary": request.model_dump()["vary"]}
    files = write_table(folder, "sweep", _columns(grid, rows), about)
    progress(1.0, "done")
    references = (*REFERENCES, *robot_card(task.scenario.robot).references)
    return Outcome(summary.model_dump(mode="json"), references, files)


def axes_of(body: Json, request: SweepInput) -> list[SweepAxis]:
    """The values of every field, and the scenario's present value."""
    return [
        SweepAxis(field=field, unit=UNITS[field], values=np.linspace(a, b, n).tolist(), present=present(body, field))
        for field, (a, b, n) in request.vary.items()
    ]


def _planned(
    task: SweepTask, grid: list[dict[SweepField, float]], at_once: int, progress: ProgressCallback
) -> list[Row]:
    max_size = BODIES if task.input.whole_body else CHUNK
    size = max(1, min(max_size, math.ceil(len(grid) / (4 * at_once))))
    starts = range(0, len(grid), size)
    about = task.model_dump(mode="json")
    items: list[Json] = [{"task": about, "points": grid[k : k + size]} for k in starts]
    rows: list[Row | None] = [None] * len(grid)
    done = 0
    answers = each_apart(plan_chunk, items, preload=(HEAVY,), timeout_s=CHUNK_S, processes=at_once)
    for index, answer in answers:
        first = starts[index]
        points = grid[first : first + size]
        if isinstance(answer, StridelabError):
            chunk_rows = [Row("failed", f"{answer.code}: {answer.message}", "", math.nan, 0, 0.0) for _ in points]
        else:
            chunk_rows = [
                Row(**{**row, "objective": math.nan if row["objective"] is None else row["objective"]})
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
    proxies = densities(robot, task.input.measure or DEFAULT_MEASURE)
    body = task.scenario.model_dump(mode="json")
    requested = solver_of(task.input)
    # no fallback from the C++ solver to another one: all points of a map use one solver
    solver = "native" if requested == "auto" and task.input.formulation != "wrench" else requested
    rows = []
    for values in item["points"]:
        try:
            scenario = task.scenario.model_validate(varied(body, values))
            sequence, _ = checked(scenario)
        except (InvalidInput, ValueError) as error:
            rows.append(Row("refused", _short(error), "", math.nan, 0, 0.0))
            continue
        try:
            posed = from_rest_to_rest(robot, sequence, proxies)
            problem = replace(posed, control=control_of(task.input), node_rate_hz=task.input.node_rate_hz)
            plan = solve(problem, solver, limits_of(task.input))
        except StridelabError as error:
            rows.append(Row("failed", _short(error), "", math.nan, 0, 0.0))
            continue
        stopped = ""
        if plan.converged and task.input.whole_body:
            fields = task.input.model_dump(include={"formulation", "solver", "node_rate_hz", "measure"})
            stopped = _body_stopped(robot, proxies, sequence, PlanMotionInput(scenario=scenario, **fields))
        rows.append(
            Row(
                "feasible" if plan.converged and not stopped else "infeasible",
                stopped if plan.converged else plan.status[:SAID],
                plan.solver,
                plan.objective if plan.converged else math.nan,
                plan.iterations,
                plan.solve_time_s,
            )
        )
    return {"rows": [{**vars(row), "objective": None if math.isnan(row.objective) else row.objective} for row in rows]}


def _body_stopped(robot: Robot, proxies: Mapping[str, Proxy], sequence: ContactSequence, asked: PlanMotionInput) -> str:
    """Reason why the whole-body motion of ``plan-motion`` fails; empty if its certificate passes."""
    control = control_of(asked)
    bounds = PathBounds(None, hand_bounds_n(robot, sequence) if control.has_point_forces else {})
    posed = from_rest_to_rest(robot, sequence, proxies)
    problem = replace(posed, control=control, bounds=bounds, node_rate_hz=asked.node_rate_hz)
    try:
        problem, plan = planned(problem, asked, lambda _fraction, _message: None)
        agreed = agree(robot, problem, plan, solve, WholeBodyController().run)
    except StridelabError as error:
        return _short(error)
    certificate = certify(robot, sequence, agreed.plan, proxies, agreed.motion)
    failed = [f"{one.name} {one.value:.3g} {one.unit}" for one in certificate.checks if not one.passed]
    return f"The certificate fails: {', '.join(failed)}."[:SAID] if failed else ""


def _short(error: Exception) -> str:
    text = error.message if isinstance(error, StridelabError) else str(error).splitlines()[0]
    return text[:SAID]


def _columns(grid: list[dict[SweepField, float]], rows: list[Row]) -> dict[str, np.ndarray]:
    names = {field: f"{field}_{UNITS[field]}" if UNITS[field] else field for field in grid[0]}
    columns = {name: np.array([point[field] for point in grid]) for field, name in names.items()}
    columns["feasible"] = np.array([row.outcome == "feasible" for row in rows])
    columns["outcome"] = np.array([row.outcome for row in rows])
    columns["objective"] = np.array([row.objective for row in rows])
    columns["iterations"] = np.array([row.iterations for row in rows])
    columns["solve_time_s"] = np.array([row.solve_time_s for row in rows])
    columns["solver"] = np.array([row.solver for row in rows])
    columns["why"] = np.array([row.why for row in rows])
    return columns


def _remarks(rows: list[Row]) -> list[Remark]:
    failed = [row.why for row in rows if row.outcome == "failed"]
    if not failed:
        return []
    return [Remark(code="sweep-points-failed", message=f"{len(failed)} scenarios could not be planned: {failed[0]}")]
