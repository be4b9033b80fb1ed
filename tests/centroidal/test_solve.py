"""The behaviour of whole solutions: symmetry, rest, flight, the proxy's pull, two solvers, no solution at all."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.nlp.solvers import Limits, SolverName, run_solver
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from support.robots.sequences import (
    COM_HEIGHT_M,
    MASS_KG,
    MIXTURES,
    foot,
    mirrored,
    phase,
    rest_to_rest,
    sequence,
    two_steps,
)

MIRROR = np.array([1.0, -1.0, 1.0])


def test_a_mirrored_walk_has_the_mirrored_plan() -> None:
    walk = two_steps()
    plan, image = solve(rest_to_rest(walk)), solve(rest_to_rest(mirrored(walk)))
    assert plan.converged
    assert image.converged
    assert image.objective == pytest.approx(plan.objective, rel=1e-6)
    assert image.com_m == pytest.approx(plan.com_m * MIRROR, abs=1e-6)
    left, right = plan.forces_n["left_foot"].sum(axis=1), image.forces_n["right_foot"].sum(axis=1)
    assert right == pytest.approx(left * MIRROR, abs=0.05)


def test_a_moved_and_turned_walk_has_the_moved_and_turned_plan() -> None:
    walk = two_steps()
    plan = solve(rest_to_rest(walk))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([30.0, -20.0, 5.0])
    phases = tuple(
        replace(
            p,
            contacts={
                name: replace(
                    c,
                    placement=replace(
                        c.placement,
                        position_m=turn @ c.placement.position_m + shift,
                        rotation=turn @ c.placement.rotation,
                    ),
                )
                for name, c in p.contacts.items()
            },
        )
        for p in walk.phases
    )
    moved = solve(rest_to_rest(replace(walk, phases=phases)))
    assert moved.converged
    assert moved.com_m == pytest.approx(plan.com_m @ turn.T + shift, abs=1e-5)


def test_standing_still_costs_no_acceleration_and_carries_the_weight() -> None:
    walk = sequence(phase(1.0, foot("left", 0.0), foot("right", 0.0)))
    plan = solve(rest_to_rest(walk, proxies={}))
    assert plan.converged
    assert plan.cost_terms["com_acceleration"] == pytest.approx(0.0, abs=1e-6)
    assert plan.com_m == pytest.approx(np.tile([0.0, 0.0, COM_HEIGHT_M], (11, 1)), abs=1e-5)
    total = sum(f.sum(axis=1) for f in plan.forces_n.values())
    assert total == pytest.approx(np.tile([0.0, 0.0, 9.81 * MASS_KG], (10, 1)), abs=0.01)
    assert plan.forces_n["left_foot"].sum(axis=1)[:, 2] == pytest.approx(9.81 * MASS_KG / 2, rel=1e-3)


def test_in_flight_the_robot_falls_freely() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    hop = sequence(phase(0.6, left, right), phase(0.1), phase(0.6, left, right))
    plan = solve(rest_to_rest(hop))
    assert plan.converged, plan.status
    assert plan.com_a_m_s2[plan.phase == 1] == pytest.approx(np.tile([0.0, 0.0, -9.81], (2, 1)), abs=1e-6)


def test_without_the_log_density_the_com_leaves_the_proxies_support() -> None:
    """The claim of Fig. 4.9, on a step as long as those of the first experiment."""
    walk = two_steps(step_m=0.5)
    with_it = solve(rest_to_rest(walk, node_rate_hz=20.0))
    without = solve(rest_to_rest(walk, node_rate_hz=20.0, proxies={}))
    assert with_it.converged
    assert without.converged
    worst = []
    for plan in (with_it, without):
        inside = [
            MIXTURES[name].log_density(contact.placement.inverse().act(plan.com_m[k : k + 1]))[0]
            for k, i in enumerate(plan.phase)
            for name, contact in walk.phases[i].contacts.items()
        ]
        worst.append(min(inside))
    assert worst[0] > worst[1] + 0.5
    assert without.objective == without.cost_terms["com_acceleration"] + without.cost_terms["momentum_rate"]


def test_ipopt_and_fatrop_agree(problem: CentroidalProblem) -> None:
    ours, theirs = solve(problem, "ipopt"), solve(problem, "fatrop")
    assert ours.converged
    assert theirs.converged, theirs.status
    assert (ours.solver, theirs.solver) == ("ipopt", "fatrop")
    assert theirs.objective == pytest.approx(ours.objective, rel=5e-3)
    assert theirs.com_m == pytest.approx(ours.com_m, abs=5e-3)


def test_more_nodes_converge_to_the_same_motion() -> None:
    coarse, fine = (solve(rest_to_rest(two_steps(), node_rate_hz=rate)) for rate in (20.0, 40.0))
    assert fine.objective == pytest.approx(coarse.objective, rel=0.01)
    assert fine.com_m[::2] == pytest.approx(coarse.com_m, abs=5e-3)


def test_on_ice_the_far_end_is_reported_as_out_of_reach() -> None:
    problem = rest_to_rest(two_steps(friction=0.01))
    plan = solve(replace(problem, com_end_m=np.array([3.0, 0.0, COM_HEIGHT_M])))
    assert not plan.converged
    assert "No motion over these contacts ends at rest at the goal" in plan.status
    assert plan.solver == "ipopt"


def test_a_solver_out_of_iterations_is_followed_by_the_other_and_neither_raises(problem: CentroidalProblem) -> None:
    plan = solve(problem, limits=Limits(iterations=2))
    assert not plan.converged
    assert plan.solver == "fatrop"
    assert "ipopt: maximum iterations exceeded" in plan.status
    assert "fatrop:" in plan.status
    assert np.isfinite(plan.com_m).all()


@pytest.mark.parametrize("name", ["ipopt", "fatrop"])
def test_a_cost_that_is_not_a_number_never_reaches_a_solver(name: SolverName) -> None:
    programme = transcribe(rest_to_rest(sequence(phase(0.4, foot("left", 0.0), foot("right", 0.0)))))
    outcome = run_solver(name, replace(programme, p=np.full_like(programme.p, np.nan)))
    assert not outcome.success
    assert outcome.status == "the cost is not a number at the start"
    assert np.isfinite(outcome.point.w).all()


def test_the_momentum_that_limbs_take_is_planned_for() -> None:
    """Its rates cost nothing where the plan takes them, and the motion ends at rest as before."""
    walk = rest_to_rest(two_steps())
    grid = walk.grid()
    rates = np.outer(np.sin(2.0 * np.pi * grid.time_s[:-1] / grid.time_s[-1]), [0.0, 3.0, 0.0])
    rates -= grid.step_s @ rates / grid.time_s[-1]
    plan, swung = solve(walk), solve(replace(walk, limbs_nm=rates))
    assert swung.converged
    assert np.abs(plan.l_nms).max() < 0.1
    planned = np.vstack([np.zeros(3), np.cumsum(grid.step_s[:, None] * rates, axis=0)])
    assert swung.l_nms == pytest.approx(planned, abs=0.1)
    assert swung.objective == pytest.approx(plan.objective, rel=0.02)
