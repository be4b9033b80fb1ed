"""Optimality conditions and iterations that a plan reports, and warm starts."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.nlp.callbacks import Iterate
from stridelab.centroidal.nlp.kkt import Solution, kkt_residuals
from stridelab.centroidal.nlp.nlp import OBJECTIVE_SCALE
from stridelab.centroidal.nlp.solvers import TIME_LIMIT_STATUS, Limits
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.centroidal.verification import motion_of, verify


@pytest.fixture(scope="module")
def solution(plan: CentroidalPlan) -> Solution:
    assert plan.solution is not None
    return plan.solution


def test_the_first_order_conditions_hold_at_the_solution(solution: Solution) -> None:
    (attempt,) = solution.attempts
    assert attempt.success
    assert attempt.residuals is not None
    assert attempt.residuals.stationarity < 1e-5
    assert attempt.residuals.feasibility < 1e-10
    assert attempt.residuals.complementarity < 1e-7


def test_the_first_order_conditions_fail_beside_the_solution(problem: CentroidalProblem, solution: Solution) -> None:
    of = transcribe(problem)
    beside = replace(solution.point, w=solution.point.w + 1e-3)
    residuals = kkt_residuals(of.compiled.nlp, of.p, of.box, beside)
    assert residuals.feasibility > 1e-4
    assert residuals.stationarity > 1e-3
    loose = replace(solution.point, lambda_w=solution.point.lambda_w + 1.0)
    assert kkt_residuals(of.compiled.nlp, of.p, of.box, loose).stationarity == pytest.approx(1.0, abs=1e-4)


def test_every_iteration_is_in_the_log_and_the_last_is_the_plan(plan: CentroidalPlan, solution: Solution) -> None:
    log = solution.attempts[0].log
    assert len(log.objective) == len(log.primal) == len(log.dual) == len(log.barrier) == plan.iterations + 1
    assert log.objective[-1] == pytest.approx(sum(plan.cost_terms.values()), rel=1e-9)
    assert log.primal[-1] < 1e-10
    assert log.dual[0] > log.dual[-1]


def test_iterations_are_reported_while_they_run(problem: CentroidalProblem) -> None:
    iterates: list[Iterate] = []
    plan = solve(problem, "ipopt", on_iteration=iterates.append)
    assert plan.solution is not None
    log = plan.solution.attempts[0].log
    assert [at.number for at in iterates] == list(range(plan.iterations + 1))
    assert [at.objective for at in iterates] == pytest.approx(log.objective.tolist())
    assert iterates[0].infeasibility == pytest.approx(log.primal[0], rel=1e-9)
    assert iterates[-1].infeasibility < 1e-10
    again: list[Iterate] = []
    solve(problem, "ipopt", on_iteration=again.append)
    assert again == iterates


def test_fatrop_reports_iterations_too(problem: CentroidalProblem) -> None:
    iterates: list[Iterate] = []
    plan = solve(problem, "fatrop", on_iteration=iterates.append)
    assert plan.converged
    assert [at.number for at in iterates] == list(range(len(iterates)))
    assert abs(len(iterates) - plan.iterations) <= 1
    assert iterates[-1].objective == pytest.approx(sum(plan.cost_terms.values()), rel=1e-3)
    assert iterates[-1].infeasibility < 1e-6 < iterates[0].infeasibility


def test_a_plan_is_checked_again_without_its_solver(problem: CentroidalProblem, plan: CentroidalPlan) -> None:
    again = verify(plan.sequence, plan.mass_kg, motion_of(plan), problem.com_start_m, problem.com_end_m)
    assert vars(again) == vars(plan.verification)


def test_a_warm_start_is_short_and_ends_in_the_same_place(
    problem: CentroidalProblem, plan: CentroidalPlan, solution: Solution
) -> None:
    again = solve(problem, "ipopt", start=solution.point)
    assert again.converged
    assert again.iterations <= plan.iterations // 2
    assert again.com_m == pytest.approx(plan.com_m, abs=1e-5)


def test_a_warm_start_helps_a_neighbour(problem: CentroidalProblem, solution: Solution) -> None:
    near = replace(problem, com_end_m=problem.com_end_m + np.array([0.005, 0.0, -0.005]))
    cold, warm = solve(near, "ipopt"), solve(near, "ipopt", start=solution.point)
    assert warm.converged
    assert warm.iterations < cold.iterations
    assert sum(warm.cost_terms.values()) == pytest.approx(sum(cold.cost_terms.values()), abs=1e-4)


def test_a_start_of_another_structure_is_ignored(problem: CentroidalProblem, solution: Solution) -> None:
    finer = replace(problem, node_rate_hz=15.0)
    assert solve(finer, "ipopt", start=solution.point).iterations == solve(finer, "ipopt").iterations


def test_a_solver_out_of_time_stops(problem: CentroidalProblem) -> None:
    plan = solve(problem, limits=Limits(cpu_s=1e-3))
    assert not plan.converged
    assert plan.solver == "ipopt"  # no other solver is called
    assert TIME_LIMIT_STATUS in plan.status
    assert plan.iterations < 10


def test_fatrop_gets_as_many_iterations_as_fit_its_time(problem: CentroidalProblem) -> None:
    plan = solve(problem, "fatrop", Limits(cpu_s=0.05))
    assert not plan.converged
    assert plan.iterations < 20
    assert TIME_LIMIT_STATUS in plan.status


def test_the_scale_is_that_of_the_log(problem: CentroidalProblem, solution: Solution) -> None:
    of = transcribe(problem)
    value = float(of.compiled.nlp.value(of.guess, of.p)) / OBJECTIVE_SCALE
    # the solver moves the start off its bounds before it counts
    assert solution.attempts[0].log.objective[0] == pytest.approx(value, rel=0.5)
