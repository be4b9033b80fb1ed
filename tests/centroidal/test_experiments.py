"""The thesis' three experiments, cold from its own start, with the proxies that ship: what must be reached."""

from typing import Any

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from support.robots.sequences import bundled, rail_of_hrp2

SCENARIOS = ("flat-walk", "long-stride", "six-stairs", "stairs-with-rail")


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_converges_cold_to_a_motion_that_the_legs_can_follow(scenario: str) -> None:
    problem = bundled(scenario)
    plan = solve(problem)
    assert plan.converged, plan.status
    assert plan.solver == "ipopt"
    assert plan.iterations <= 40  # more is the sign of a bad combination of proxies and contacts

    soles_m = [
        np.mean([c.placement.position_m[2] for c in contacts if c is not None])
        for contacts in (
            [plan.sequence.last_contact(foot, int(i)) for foot in ("left_foot", "right_foot")] for i in plan.phase
        )
    ]
    height_m = plan.com_m[:-1, 2] - soles_m
    assert height_m.min() > 0.75
    assert height_m.max() < 0.92
    assert np.abs(plan.l_nms).max() < 0.1
    if "right_hand" in plan.forces_n:
        hand_n = np.linalg.norm(plan.forces_n["right_hand"].sum(axis=1), axis=1)
        assert 1.0 < hand_n.max() < 80.0  # touched, and within what the arm can carry


EXPERIMENTS = ("long-stride", "six-stairs", "stairs-with-rail", "stairs-with-rail-hrp2")
CONTROLS = [Pyramids(), ContactWrench(), ContactWrench(contacts="all")]
CASES = [(name, control) for name in EXPERIMENTS for control in CONTROLS]
CASES += [(name, CircularCones()) for name in EXPERIMENTS[:2]]  # on the rails they take seconds


def posed(experiment: str, **settings: Any) -> CentroidalProblem:
    if experiment == "stairs-with-rail-hrp2":
        return rail_of_hrp2(**settings)
    return bundled(experiment, **settings)


def assert_solved(problem: CentroidalProblem, plan: CentroidalPlan) -> None:
    check = plan.verification
    assert plan.converged, plan.status
    assert check.dynamics_gap < 1e-8
    assert check.terminal_gap < 1e-6
    assert min(check.cone_margin_n, check.normal_force_min_n) > -1e-6 * problem.weight_n
    assert plan.solution is not None
    residuals = plan.solution.attempts[-1].residuals
    assert residuals is not None
    assert residuals.kkt_error < 3e-5


@pytest.mark.parametrize(("experiment", "control"), CASES, ids=str)
def test_every_control_converges_and_verifies(experiment: str, control: Control) -> None:
    problem = posed(experiment, control=control)
    plan = solve(problem, "ipopt")
    assert_solved(problem, plan)
    assert plan.iterations <= 100


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_continuous_forces_converge_cold_without_a_jump(experiment: str) -> None:
    problem = posed(experiment, shape="cubic")
    plan = solve(problem)
    assert_solved(problem, plan)
    assert plan.iterations <= 40
    for t in plan.time_s[1:-1]:
        before, after = plan.forces_at(float(t) - 1e-9), plan.forces_at(float(t))
        assert max(np.abs(after[name] - before[name]).max() for name in after) < 1e-3


@pytest.mark.parametrize("experiment", EXPERIMENTS[2:])
def test_the_thesis_shrink_factor_leaves_the_cone_where_a_hand_holds_on(experiment: str) -> None:
    """This is detected: its objective is better than that of the exact problem, its forces do not exist.

    As in the thesis, the plan may use the whole friction of the rail.
    """
    exact = solve(posed(experiment, rail_friction_share=1.0), "ipopt")
    thesis = ContactWrench("thesis", "all", 0.3)
    beyond = solve(posed(experiment, control=thesis, rail_friction_share=1.0), "ipopt")
    assert beyond.objective < exact.objective
    assert not beyond.converged
    assert "does not verify" in beyond.status


@pytest.mark.parametrize("control", [Pyramids(), ContactWrench()], ids=str)
@pytest.mark.parametrize("experiment", EXPERIMENTS[:2])
def test_ipopt_and_fatrop_find_the_same_motion(experiment: str, control: Control) -> None:
    problem = posed(experiment, control=control)
    ours, theirs = solve(problem, "ipopt"), solve(problem, "fatrop")
    assert_solved(problem, theirs)
    assert sum(theirs.cost_terms.values()) == pytest.approx(sum(ours.cost_terms.values()), rel=1e-4)
    assert theirs.com_m == pytest.approx(ours.com_m, abs=1e-3)


@pytest.mark.parametrize("free", [{"durations": FreeDurations()}, {"placements": FreePlacements()}], ids=str)
def test_free_variables_lower_the_cost(free: dict[str, Any]) -> None:
    given, problem = solve(bundled("long-stride"), "ipopt"), bundled("long-stride", **free)
    plan = solve(problem, "ipopt")
    assert_solved(problem, plan)
    assert sum(plan.cost_terms.values()) < sum(given.cost_terms.values()) - 0.5
