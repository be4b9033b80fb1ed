"""u_f in pyramids, u_f in circular cones and u_c: the same equations, three ways to keep the cones."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench, ForceDistribution, point_contacts
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import Contact
from stridelab.contacts.wrench_cones.wrench_feasibility import conic_margin
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput, NotEstimable
from support.robots.sequences import EFFECTORS, foot, hand, phase, rest_to_rest, sequence

BODY_WEIGHT = 1e-6
"""Of it a force may lie outside its cone."""


@pytest.fixture(scope="module")
def by_wrench(problem: CentroidalProblem) -> CentroidalPlan:
    return solve(replace(problem, control=ContactWrench()))


def test_a_plan_by_the_wrench_converges_and_has_point_forces_in_their_cones(
    problem: CentroidalProblem, by_wrench: CentroidalPlan
) -> None:
    assert by_wrench.converged, by_wrench.status
    check = by_wrench.verification
    assert check.dynamics_gap < 1e-8
    assert check.terminal_gap < 1e-6
    assert check.cone_margin_n > -BODY_WEIGHT * problem.weight_n
    assert set(by_wrench.forces_n) == set(problem.sequence.effectors)


def test_no_plan_by_the_wrench_is_better_than_that_by_forces(plan: CentroidalPlan, by_wrench: CentroidalPlan) -> None:
    """Its cone is inside theirs. What the forces are weighed with, it does not see."""
    squares = ("com_acceleration", "momentum_rate")
    costs = [sum(v for k, v in p.cost_terms.items() if k in squares or k.startswith("log")) for p in (plan, by_wrench)]
    efforts = plan.cost_terms["surface_force"] + plan.cost_terms["point_force"]
    assert costs[1] > costs[0] - efforts


def test_circular_cones_give_what_many_rays_give(problem: CentroidalProblem, plan: CentroidalPlan) -> None:
    """And rays, being inside, cost more than the circle."""
    total = {}
    for control in (CircularCones(), Pyramids(24)):
        circular = solve(replace(problem, control=control))
        assert circular.converged, circular.status
        total[control] = sum(circular.cost_terms.values())
    eight = sum(plan.cost_terms.values())
    circle, many = total.values()
    assert circle <= many + 1e-5 <= eight + 2e-5
    assert many == pytest.approx(circle, abs=2e-3)


def test_in_flight_the_wrench_is_zero() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    hop = sequence(phase(0.6, left, right), phase(0.1), phase(0.6, left, right))
    plan = solve(rest_to_rest(hop, control=ContactWrench()))
    assert plan.converged, plan.status
    assert plan.com_a_m_s2[plan.phase == 1] == pytest.approx(np.tile([0.0, 0.0, -9.81], (2, 1)), abs=1e-6)


def test_sharing_gives_the_wrench_within_the_cones_wherever_there_are_forces(problem: CentroidalProblem) -> None:
    """(4.5) back to (4.4)."""
    touches = problem.contact_patches(3, problem.com_start_m)
    contacts, sharing, rng = point_contacts(touches), ForceDistribution(touches), np.random.default_rng(4)
    n_checked = 0
    for wrench in rng.normal([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.1, 0.1, 0.1, 0.05, 0.05, 0.05], (100, 6)):
        f = sharing.minimum_cost_forces(wrench)
        assert contacts.grasp_matrix() @ f.ravel() == pytest.approx(wrench, abs=1e-12)
        local = np.einsum("nk,nkj->nj", f, contacts.rotation)
        least = (contacts.friction * local[:, 2] - np.hypot(local[:, 0], local[:, 1])).min()
        if conic_margin(contacts, wrench).margin_n > 0.01:  # more than what the pyramids lack
            n_checked += 1
            assert least >= -1e-9
    assert n_checked > 10


def test_sharing_spares_the_hand(problem: CentroidalProblem, by_wrench: CentroidalPlan) -> None:
    """Against any other forces that give the same wrench and lie in the cones: those of the largest margin."""
    touches = problem.contact_patches(3, problem.com_start_m)
    weights = np.concatenate([np.full(len(t.points_m), t.force_weight) for t in touches])
    k = int(np.flatnonzero(by_wrench.phase == 3)[0])
    forces = np.vstack([by_wrench.forces_n[t.effector][k] for t in touches])
    contacts = point_contacts(touches)
    other = conic_margin(contacts, contacts.grasp_matrix() @ forces.ravel()).forces_n
    assert weights @ (forces**2).sum(axis=1) < weights @ (other**2).sum(axis=1)


def test_the_thesis_cone_shrunk_to_a_fifth_is_more_cautious_than_ours() -> None:
    walk = sequence(phase(1.0, foot("left", 0.0), foot("right", 0.0)), phase(1.5, foot("left", 0.0)))
    problem = replace(rest_to_rest(walk), com_end_m=np.array([0.0, 0.09, 0.82]))
    ours, theirs = (solve(replace(problem, control=c)) for c in (ContactWrench(), ContactWrench("thesis", alpha=0.2)))
    assert ours.converged
    assert theirs.converged, theirs.status
    assert ours.objective < theirs.objective


def test_a_cone_of_all_contacts_leans_on_the_hand(problem: CentroidalProblem, by_wrench: CentroidalPlan) -> None:
    leaning = solve(replace(problem, control=ContactWrench(contacts="all")))
    assert leaning.converged, leaning.status
    most = [np.linalg.norm(p.forces_n["right_hand"], axis=2).max() for p in (leaning, by_wrench)]
    assert most[0] > 2.0 * most[1]


@pytest.mark.parametrize("contacts", ["soles", "all"])
def test_the_cone_of_the_wrench_is_inside_that_of_the_contacts_wherever_they_are(
    problem: CentroidalProblem, contacts: Literal["soles", "all"]
) -> None:
    """(4.6)."""
    rng = np.random.default_rng(6)
    for origin_m in (problem.com_start_m, np.array([40.0, -7.0, 3.0])):
        touches = problem.contact_patches(3, origin_m)
        group = ContactWrench(contacts=contacts).generators(touches)["wrench"]
        tau = rng.normal(size=(20, group.lorentz))
        tau /= np.linalg.norm(tau, axis=1, keepdims=True)
        for wrench in np.hstack([0.999 * tau, np.ones((20, 1))]) @ group.wrench.T:
            assert conic_margin(point_contacts(touches), wrench).margin_n > 0.0


@pytest.mark.parametrize("alpha", [0.0, -0.1, 1.1, float("nan")])
def test_a_shrink_factor_shrinks(alpha: float) -> None:
    with pytest.raises(InvalidInput) as caught:
        ContactWrench("thesis", alpha=alpha)
    assert caught.value.code == "alpha-out-of-range"


def test_fewer_than_eight_rays_are_too_few() -> None:
    with pytest.raises(InvalidInput) as caught:
        Pyramids(7)
    assert caught.value.code == "rays-too-few"


def test_a_phase_on_one_hand_has_a_cone_of_three_dimensions() -> None:
    left, right, rail = foot("left", 0.0), foot("right", 0.0), hand(0.0, 0.9, friction=0.6)
    swing = sequence(phase(0.6, left, right, rail), phase(0.1, rail), phase(0.6, left, right, rail))
    problem = rest_to_rest(swing, control=ContactWrench())
    assert problem.control.generators(problem.contact_patches(1, problem.com_start_m))["wrench"].lorentz == 2
    plan = solve(problem)
    assert plan.converged, plan.status
    assert plan.forces_n["right_hand"][plan.phase == 1].any()


def test_hands_that_can_squeeze_each_other_have_no_cone() -> None:
    sides = [
        Placement.from_wxyz((0.0, y, 1.0), (np.cos(a), np.sin(a), 0.0, 0.0)) for y, a in ((-0.5, -0.785), (0.5, 0.785))
    ]
    gripping = sequence(
        phase(1.0, foot("left", 0.0), foot("right", 0.0)),
        phase(
            0.2, *(Contact(name, at, "wall", 0.6) for name, at in zip(("right_hand", "left_hand"), sides, strict=True))
        ),
    )
    hands = {**EFFECTORS, "left_hand": replace(EFFECTORS["right_hand"], name="left_hand")}
    standing = rest_to_rest(sequence(gripping.phases[0]), proxies={})
    problem = replace(standing, sequence=gripping, effectors=hands, control=ContactWrench())
    with pytest.raises(NotEstimable) as caught:
        solve(problem)
    assert caught.value.code == "wrench-cone-not-pointed"
