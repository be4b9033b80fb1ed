"""Options of ``plan-motion``: they reach the solver, what is out of range is named, and every control plans."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from experiments.bundled_scenarios import BUNDLED
from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.nlp.callbacks import Iterate, IterationCallback
from stridelab.centroidal.nlp.solvers import DEFAULT_LIMITS, Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.errors import NotEstimable
from stridelab.pipelines import plan_centroidal, plan_problem
from stridelab.schemas.plans import PlanMotionSummary
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.plan_motion import run as plan_motion
from support.command_line import RecordedProgress
from support.robots.plans import plan_task

NOT_BUILT = "It was not built."


@pytest.mark.parametrize(
    ("requested", "missing", "control", "solver", "cpu_s"),
    [
        ({}, NOT_BUILT, PYRAMIDS, "casadi", DEFAULT_LIMITS.cpu_s),
        ({}, None, CircularCones(), "auto", DEFAULT_LIMITS.cpu_s),
        ({"solver": "native"}, None, CircularCones(), "native", DEFAULT_LIMITS.cpu_s),
        ({"solver": "casadi"}, None, PYRAMIDS, "casadi", DEFAULT_LIMITS.cpu_s),
        ({"formulation": "circular-cones", "solver": "casadi"}, None, CircularCones(), "casadi", DEFAULT_LIMITS.cpu_s),
        ({"formulation": "wrench", "solver": "fatrop"}, None, ContactWrench(), "fatrop", DEFAULT_LIMITS.cpu_s),
        ({"shape": "cubic"}, None, CircularCones(), "auto", DEFAULT_LIMITS.cpu_s),
        ({"shape": "cubic"}, NOT_BUILT, PYRAMIDS, "casadi", DEFAULT_LIMITS.cpu_s),
        ({"shape": "cubic", "solver": "ipopt"}, None, PYRAMIDS, "ipopt", DEFAULT_LIMITS.cpu_s),
        ({"free_durations": True}, None, CircularCones(), "auto", DEFAULT_LIMITS.cpu_s),
        (
            {"free_durations": True, "formulation": "circular-cones"},
            None,
            CircularCones(),
            "auto",
            DEFAULT_LIMITS.cpu_s,
        ),
        ({"time_limit_s": 7.0}, NOT_BUILT, PYRAMIDS, "ipopt", 7.0),
        ({"time_limit_s": 7.0, "solver": "fatrop"}, None, PYRAMIDS, "fatrop", 7.0),
        ({"time_limit_s": 7.0}, None, CircularCones(), "auto", 7.0),
    ],
)
def test_options_reach_the_solver(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    requested: dict[str, Any],
    missing: str | None,
    control: Control,
    solver: str,
    cpu_s: float,
) -> None:
    monkeypatch.setattr(plan_problem, "native_unavailable_reason", lambda: missing)
    seen: list[Any] = []

    def stopped(
        problem: CentroidalProblem, name: str, limits: Limits, *, on_iteration: IterationCallback
    ) -> CentroidalPlan:
        seen.extend((problem.control, problem.node_rate_hz, name, limits.cpu_s))
        on_iteration(Iterate(3, -1.25, 0.0021))
        raise NotEstimable("stopped", "far enough")

    monkeypatch.setattr(plan_centroidal, "solve", stopped)
    progress = RecordedProgress()
    with pytest.raises(NotEstimable, match="far enough"):
        plan_motion.run(plan_task(node_rate_hz=12.5, **requested), tmp_path, progress)
    assert seen == [control, 12.5, solver, cpu_s]
    assert progress.messages[-1] == "centroidal: iteration 3, cost -1.25, infeasibility 2.1e-03"


def test_hands_are_bounded_by_their_arms_unless_the_wrench_is_the_control(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bounds: list[Any] = []

    def stopped(problem: CentroidalProblem, *_: Any, on_iteration: IterationCallback) -> CentroidalPlan:
        bounds.append(problem.bounds.normal_force_max_n)
        raise NotEstimable("stopped", "far enough")

    monkeypatch.setattr(plan_centroidal, "solve", stopped)
    rail = Scenario.model_validate(BUNDLED["stairs-with-rail-hrp2"]())
    for formulation in ("forces", "circular-cones", "wrench"):
        with pytest.raises(NotEstimable, match="far enough"):
            plan_motion.run(plan_task(rail, formulation=formulation), tmp_path, RecordedProgress())
    assert set(bounds[0]) == {"right_hand"}
    assert 20.0 < bounds[0]["right_hand"] < 150.0
    assert bounds[1:] == [bounds[0], {}]


@pytest.mark.parametrize(
    "requested",
    [{"formulation": "wrench"}, {"shape": "cubic"}, {"formulation": "circular-cones", "node_rate_hz": 20.0}],
)
def test_every_control_plans(tmp_path: Path, requested: dict[str, Any]) -> None:
    progress = RecordedProgress()
    outcome = plan_motion.run(plan_task(whole_body=False, **requested), tmp_path, progress)
    summary = PlanMotionSummary.model_validate(outcome.summary)
    assert summary.converged
    took_cones = (
        requested.get("formulation", "circular-cones") if summary.solver == "native" else requested.get("formulation")
    )
    assert summary.formulation == (took_cones or "forces")
    assert (summary.solver == "native") == (summary.solver_because is None)
    assert summary.shape == requested.get("shape", "constant")
    nodes = len(pq.read_table(tmp_path / "centroidal.parquet"))
    assert nodes == 1 + round(summary.duration_s * requested.get("node_rate_hz", 10.0))
    ticking = [m for m in progress.messages if m.startswith("centroidal: iteration")]
    assert len(ticking) >= summary.iterations


@pytest.mark.parametrize(
    ("requested", "shape"),
    [
        ({}, "cubic"),
        ({"formulation": "circular-cones"}, "cubic"),
        ({"shape": "constant"}, "constant"),
        ({"formulation": "wrench"}, "constant"),
        ({"solver": "fatrop"}, "constant"),
        ({"whole_body": False}, "constant"),
        ({"whole_body": False, "shape": "cubic"}, "cubic"),
    ],
)
def test_bodies_follow_splines_unless_something_else_is_requested(requested: dict[str, Any], shape: str) -> None:
    assert plan_centroidal.force_shape(plan_task(**requested).input) == shape


@pytest.mark.parametrize("requested", [None, "cubic"])
def test_without_splines_constants_stay_unless_splines_were_requested(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, requested: str | None
) -> None:
    def stepping(problem: CentroidalProblem, *args: Any, **options: Any) -> CentroidalPlan:
        solution = solve(problem, *args, **options)
        return solution if problem.shape == "constant" else replace(solution, converged=False, status="no way")

    monkeypatch.setattr(plan_centroidal, "solve", stepping)
    task = plan_task(shape=requested)
    if requested is not None:
        with pytest.raises(NotEstimable, match="no way") as refusal:
            plan_motion.run(task, tmp_path, RecordedProgress())
        assert refusal.value.code == "plan-not-converged"
        return
    summary = PlanMotionSummary.model_validate(plan_motion.run(task, tmp_path, RecordedProgress()).summary)
    assert summary.shape == "constant"
    assert [remark.code for remark in summary.warnings] == ["forces-jump"]


def test_splines_do_not_change_chosen_durations(tmp_path: Path) -> None:
    task = plan_task(free_durations=True, duration_range=(0.8, 1.2))
    summary = PlanMotionSummary.model_validate(plan_motion.run(task, tmp_path, RecordedProgress()).summary)
    assert summary.shape == "cubic"
    assert summary.phase_durations is not None
    chosen_s = [phase.chosen_s for phase in summary.phase_durations]
    assert chosen_s != [phase.given_s for phase in summary.phase_durations]
    stored = Scenario.model_validate_json((tmp_path / "scenario.json").read_text())
    assert [phase.duration_s for phase in stored.phases] == chosen_s


@pytest.mark.parametrize("solver", ["auto", "ipopt", "fatrop"])
def test_a_time_limit_ends_the_solver_and_says_so(tmp_path: Path, solver: str) -> None:
    with pytest.raises(NotEstimable) as failure:
        plan_motion.run(plan_task(whole_body=False, time_limit_s=1e-6, solver=solver), tmp_path, RecordedProgress())
    assert failure.value.code == "plan-time-limit"
    assert failure.value.faults[0].where == "time_limit_s"
    assert failure.value.faults[-1].where == "stage: centroidal"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("requested", "named"),
    [
        ({"formulation": "moments"}, "formulation"),
        ({"solver": "magic"}, "solver"),
        ({"node_rate_hz": 1.0}, "node_rate_hz"),
        ({"node_rate_hz": float("nan")}, "node_rate_hz"),
        ({"shape": "cubic", "formulation": "wrench"}, "shape"),
        ({"shape": "cubic", "solver": "fatrop"}, "shape"),
        ({"shape": "linear"}, "shape"),
        ({"time_limit_s": 0.0}, "time_limit_s"),
        ({"time_limit_s": 301.0}, "time_limit_s"),
    ],
)
def test_options_out_of_range_are_named(requested: dict[str, Any], named: str) -> None:
    with pytest.raises(ValidationError, match=named):
        plan_task(**requested)
