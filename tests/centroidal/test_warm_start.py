"""Starts that one plan gives to another problem."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.boundary_conditions import Start
from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.nlp.kkt import kkt_residuals
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.centroidal.warm_start import warm_start_point
from stridelab.errors import InvalidInput
from support.robots.sequences import rest_to_rest, two_steps

CONTROLS = [Pyramids(), ContactWrench()]
"""From a warm start circular cones take as long as from a cold one: at the apex the row's slope is zero."""


def slower(problem: CentroidalProblem, factor: float) -> CentroidalProblem:
    phases = tuple(replace(p, duration_s=factor * p.duration_s) for p in problem.sequence.phases)
    return replace(problem, sequence=replace(problem.sequence, phases=phases))


def shorter(problem: CentroidalProblem, new: CentroidalProblem, plan: CentroidalPlan, after_s: float = 0.0) -> None:
    cold, warm = solve(new, "ipopt"), solve(new, "ipopt", start=warm_start_point(plan, new, after_s))
    assert warm.converged, warm.status
    assert warm.iterations < cold.iterations
    assert sum(warm.cost_terms.values()) == pytest.approx(sum(cold.cost_terms.values()), abs=2e-3)
    assert warm.com_m == pytest.approx(cold.com_m, abs=1e-3)


@pytest.mark.parametrize("control", [*CONTROLS, CircularCones()], ids=str)
def test_to_itself_a_plan_is_its_own_solution(problem: CentroidalProblem, control: Control) -> None:
    posed = replace(problem, control=control)
    plan, of = solve(posed, "ipopt"), transcribe(posed)
    assert plan.solution is not None
    point = warm_start_point(plan, posed)
    assert point.w == pytest.approx(plan.solution.point.w, abs=1e-12)
    residuals = kkt_residuals(of.compiled.nlp, of.p, of.box, point)
    assert residuals.feasibility < 1e-9
    assert residuals.complementarity < 1e-7


def test_seen_from_another_origin_it_still_solves_the_equations_and_its_first_order_conditions() -> None:
    """The walk from its second phase on, the origin where the CoM is then: only rows at both ends lack multipliers."""
    walk = rest_to_rest(two_steps())
    plan = solve(walk)
    k = int(np.flatnonzero(plan.phase == 1)[0])
    rest = replace(
        walk,
        sequence=replace(walk.sequence, phases=walk.sequence.phases[1:]),
        com_start_m=plan.com_m[k],
        start=Start(plan.com_v_m_s[k], plan.l_nms[k]),
    )
    of, point = transcribe(rest), warm_start_point(plan, rest, float(plan.time_s[k]))
    residuals = kkt_residuals(of.compiled.nlp, of.p, of.box, point)
    assert residuals.feasibility < 1e-9
    slope = of.compiled.nlp.gradient(point.w, of.p).full().ravel()
    J = of.compiled.nlp.jacobian(point.w, of.p).sparse()
    lack = slope + J.T @ point.lambda_g + point.lambda_w
    between = lack[of.layout.state[1] : of.layout.wrench[-1, 0]]
    assert np.abs(between).max() < 1e-5


@pytest.mark.parametrize("control", CONTROLS, ids=str)
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_start_carried_to_other_durations_takes_fewer_iterations(
    problem: CentroidalProblem, control: Control, factor: float
) -> None:
    posed = replace(problem, control=control)
    shorter(posed, slower(posed, factor), solve(posed, "ipopt"))


@pytest.mark.parametrize("control", CONTROLS, ids=str)
def test_a_start_carried_to_a_finer_grid_takes_fewer_iterations(problem: CentroidalProblem, control: Control) -> None:
    posed = replace(problem, control=control)
    shorter(posed, replace(posed, node_rate_hz=20.0), solve(posed, "ipopt"))


@pytest.mark.parametrize("control", CONTROLS, ids=str)
def test_a_start_for_the_rest_of_a_pushed_motion_takes_fewer_iterations(control: Control) -> None:
    walk = rest_to_rest(two_steps(), control=control)
    plan = solve(walk, "ipopt")
    k = int(np.flatnonzero(plan.phase == 2)[0])
    rest = replace(
        walk,
        sequence=replace(walk.sequence, phases=walk.sequence.phases[2:]),
        com_start_m=plan.com_m[k],
        start=Start(plan.com_v_m_s[k] + np.array([0.01, -0.01, 0.0]), plan.l_nms[k]),
    )
    shorter(walk, rest, plan, float(plan.time_s[k]))


def test_times_beyond_the_plan_start_cold() -> None:
    walk = rest_to_rest(two_steps())
    plan = solve(walk)
    later = warm_start_point(plan, walk, after_s=100.0)
    of = transcribe(walk)
    assert later.w[of.layout.wrench[0]] == of.guess[of.layout.wrench[0]]
    assert not later.lambda_g.any()
    assert of.node_states(later.w)[:, :3] == pytest.approx(
        np.tile(plan.com_m[-1] - walk.com_start_m, (len(plan.time_s), 1))
    )


def test_a_plan_from_a_file_is_no_start(problem: CentroidalProblem, plan: CentroidalPlan) -> None:
    with pytest.raises(InvalidInput) as caught:
        warm_start_point(replace(plan, solution=None), problem)
    assert caught.value.code == "plan-without-solution"
