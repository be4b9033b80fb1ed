"""Options of ``plan-motion``: they reach the solver, what is out of range is named, and every control plans."""

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.iterates import Iterate, Tell
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solvers import DEFAULT_LIMITS, Limits
from stridelab.contacts.bundled import BUNDLED
from stridelab.errors import NotEstimable
from stridelab.schemas.plans import PlanMotionSummary
from stridelab.schemas.scenarios import Scenario
from stridelab.service.jobs.kinds import plan_motion, plan_options
from support.planning import plan_task
from support.quiet import Told

NOT_BUILT = "It was not built."


@pytest.mark.parametrize(
    ("asked", "missing", "control", "solver", "cpu_s"),
    [
        ({}, NOT_BUILT, PYRAMIDS, "casadi", DEFAULT_LIMITS.cpu_s),
        ({}, None, CircularCones(), "auto", DEFAULT_LIMITS.cpu_s),
        ({"solver": "native"}, None, CircularCones(), "native", DEFAULT_LIMITS.cpu_s),
        ({"solver": "casadi"}, None, PYRAMIDS, "casadi", DEFAULT_LIMITS.cpu_s),
        ({"formulation": "circular-cones", "solver": "casadi"}, None, CircularCones(), "casadi", DEFAULT_LIMITS.cpu_s),
        ({"formulation": "wrench", "solver": "fatrop"}, None, ContactWrench(), "fatrop", DEFAULT_LIMITS.cpu_s),
        ({"shape": "cubic"}, None, PYRAMIDS, "auto", DEFAULT_LIMITS.cpu_s),
        ({"free_durations": True}, None, CircularCones(), "auto", DEFAULT_LIMITS.cpu_s),
        ({"time_limit_s": 7.0}, NOT_BUILT, PYRAMIDS, "ipopt", 7.0),
        ({"time_limit_s": 7.0, "solver": "fatrop"}, None, PYRAMIDS, "fatrop", 7.0),
        ({"time_limit_s": 7.0}, None, CircularCones(), "auto", 7.0),
    ],
)
def test_options_reach_the_solver(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    asked: dict[str, Any],
    missing: str | None,
    control: Control,
    solver: str,
    cpu_s: float,
) -> None:
    monkeypatch.setattr(plan_options, "native_missing", lambda: missing)
    seen: list[Any] = []

    def stopped(problem: CentroidalProblem, name: str, limits: Limits, *, tell: Tell) -> CentroidalPlan:
        seen.extend((problem.control, problem.node_rate_hz, name, limits.cpu_s))
        tell(Iterate(3, -1.25, 0.0021))
        raise NotEstimable("stopped", "far enough")

    monkeypatch.setattr(plan_motion, "solve", stopped)
    told = Told()
    with pytest.raises(NotEstimable, match="far enough"):
        plan_motion.run(plan_task(node_rate_hz=12.5, **asked), tmp_path, told)
    assert seen == [control, 12.5, solver, cpu_s]
    assert told.messages[-1] == "centroidal: iteration 3, cost -1.25, infeasibility 2.1e-03"


def test_hands_are_bounded_by_their_arms_unless_the_wrench_is_the_control(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bounds: list[Any] = []

    def stopped(problem: CentroidalProblem, *_: Any, tell: Tell) -> CentroidalPlan:
        bounds.append(problem.bounds.normal_force_max_n)
        raise NotEstimable("stopped", "far enough")

    monkeypatch.setattr(plan_motion, "solve", stopped)
    rail = Scenario.model_validate(BUNDLED["stairs-with-rail-hrp2"]())
    for formulation in ("forces", "circular-cones", "wrench"):
        with pytest.raises(NotEstimable, match="far enough"):
            plan_motion.run(plan_task(rail, formulation=formulation), tmp_path, Told())
    assert set(bounds[0]) == {"right_hand"}
    assert 20.0 < bounds[0]["right_hand"] < 150.0
    assert bounds[1:] == [bounds[0], {}]


@pytest.mark.parametrize(
    "asked", [{"formulation": "wrench"}, {"shape": "cubic"}, {"formulation": "circular-cones", "node_rate_hz": 20.0}]
)
def test_every_control_plans(tmp_path: Path, asked: dict[str, Any]) -> None:
    told = Told()
    outcome = plan_motion.run(plan_task(whole_body=False, **asked), tmp_path, told)
    summary = PlanMotionSummary.model_validate(outcome.summary)
    assert summary.converged
    took_cones = asked.get("formulation", "circular-cones") if summary.solver == "native" else asked.get("formulation")
    assert summary.formulation == (took_cones or "forces")
    assert (summary.solver == "native") == (summary.solver_because is None)
    assert summary.shape == asked.get("shape", "constant")
    nodes = len(pq.read_table(tmp_path / "centroidal.parquet"))
    assert nodes == 1 + round(summary.duration_s * asked.get("node_rate_hz", 10.0))
    ticking = [m for m in told.messages if m.startswith("centroidal: iteration")]
    assert len(ticking) >= summary.iterations


@pytest.mark.parametrize("solver", ["auto", "ipopt", "fatrop"])
def test_a_time_limit_ends_the_solver_and_says_so(tmp_path: Path, solver: str) -> None:
    with pytest.raises(NotEstimable) as failure:
        plan_motion.run(plan_task(whole_body=False, time_limit_s=1e-6, solver=solver), tmp_path, Told())
    assert failure.value.code == "plan-time-limit"
    assert failure.value.faults[0].where == "time_limit_s"
    assert failure.value.faults[-1].where == "stage: centroidal"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"formulation": "moments"}, "formulation"),
        ({"solver": "magic"}, "solver"),
        ({"node_rate_hz": 1.0}, "node_rate_hz"),
        ({"node_rate_hz": float("nan")}, "node_rate_hz"),
        ({"shape": "cubic", "formulation": "wrench"}, "shape"),
        ({"shape": "cubic", "free_durations": True}, "shape"),
        ({"shape": "linear"}, "shape"),
        ({"time_limit_s": 0.0}, "time_limit_s"),
        ({"time_limit_s": 301.0}, "time_limit_s"),
    ],
)
def test_options_out_of_range_are_named(asked: dict[str, Any], named: str) -> None:
    with pytest.raises(ValidationError, match=named):
        plan_task(**asked)
