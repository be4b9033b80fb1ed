"""Motions that begin in motion, ends that are no rest, and bounds on the way."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.boundary_conditions import PathBounds, Start, capture_region
from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.free_variables import FreeDurations
from stridelab.centroidal.infeasibility.elastic_lp import is_feasible
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import SolverChoice, solve
from stridelab.errors import InvalidInput
from support.robots.sequences import foot, hand, phase, rest_to_rest, sequence, two_steps


@pytest.fixture(scope="module")
def walk() -> CentroidalProblem:
    return rest_to_rest(two_steps())


@pytest.fixture(scope="module")
def walked(walk: CentroidalProblem) -> CentroidalPlan:
    return solve(walk)


def test_the_rest_of_an_optimal_motion_is_optimal(walk: CentroidalProblem, walked: CentroidalPlan) -> None:
    """Bellman: from the state at the end of the second phase, the same path again."""
    k = int(np.flatnonzero(walked.phase == 2)[0])
    rest = replace(
        walk,
        sequence=replace(walk.sequence, phases=walk.sequence.phases[2:]),
        com_start_m=walked.com_m[k],
        start=Start(walked.com_v_m_s[k], walked.l_nms[k]),
    )
    again = solve(rest)
    assert again.converged, again.status
    assert again.com_m == pytest.approx(walked.com_m[k:], abs=1e-4)
    assert again.com_v_m_s[0] == pytest.approx(walked.com_v_m_s[k])


def test_angular_momentum_at_the_start_is_slowed_down(walk: CentroidalProblem) -> None:
    plan = solve(replace(walk, start=Start(l_nms=np.array([0.0, 2.0, 0.0]))))
    assert plan.converged, plan.status
    assert plan.l_nms[0] == pytest.approx([0.0, 2.0, 0.0])
    assert plan.l_nms[-1] == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_capturable_end_costs_less_than_rest_and_can_be_stopped(
    walk: CentroidalProblem, walked: CentroidalPlan
) -> None:
    """(4.9f)."""
    horizon = replace(walk.sequence, phases=walk.sequence.phases[:3])
    cut = replace(walk, sequence=horizon, terminal="capturable")
    plan = solve(cut)
    assert plan.converged, plan.status
    assert plan.com_v_m_s[-1, 0] > 0.01
    assert plan.com_v_m_s[-1, 2] == pytest.approx(0.0, abs=1e-9)
    assert plan.l_nms[-1] == pytest.approx(np.zeros(3), abs=1e-8)
    stopped = solve(replace(cut, terminal="rest"))
    assert sum(plan.cost_terms.values()) < sum(stopped.cost_terms.values())
    last = horizon.phases[-1].contacts
    still = sequence(phase(3.0, *last.values()))
    at_rest = replace(
        rest_to_rest(still, proxies={}),
        com_start_m=plan.com_m[-1],
        com_end_m=np.append(np.mean([c.placement.position_m[:2] for c in last.values()], axis=0), plan.com_m[-1, 2]),
        start=Start(plan.com_v_m_s[-1], plan.l_nms[-1]),
    )
    assert solve(at_rest).converged


def test_a_moving_end_has_the_given_velocity_and_momentum(walk: CentroidalProblem, walked: CentroidalPlan) -> None:
    """The first phases of a plan, cut where they end in it, are planned again as they were."""
    k = int(np.flatnonzero(walked.phase == 2)[0])
    first = replace(
        walk,
        sequence=replace(walk.sequence, phases=walk.sequence.phases[:2]),
        com_end_m=walked.com_m[k],
        terminal="moving",
        end=Start(walked.com_v_m_s[k], walked.l_nms[k]),
    )
    again = solve(first)
    assert again.converged, again.status
    assert again.com_m == pytest.approx(walked.com_m[: k + 1], abs=1e-4)
    assert again.com_v_m_s[-1] == pytest.approx(walked.com_v_m_s[k], abs=1e-8)
    assert again.l_nms[-1] == pytest.approx(walked.l_nms[k], abs=1e-6)
    other = solve(replace(first, end=Start(walked.com_v_m_s[k] + [0.05, 0.0, 0.0], walked.l_nms[k])))
    assert other.converged, other.status
    assert other.com_v_m_s[-1] - again.com_v_m_s[-1] == pytest.approx([0.05, 0.0, 0.0], abs=1e-8)
    assert is_feasible(first)
    assert not is_feasible(replace(first, end=Start(np.array([9.0, 0.0, 0.0]), walked.l_nms[k])))


def test_derivatives_of_a_capturable_end_against_finite_differences(walk: CentroidalProblem) -> None:
    of = transcribe(replace(walk, terminal="capturable", bounds=PathBounds(normal_force_max_n={"left_foot": 500.0})))
    rng, e = np.random.default_rng(2), 1e-5
    w, lam = of.guess + 0.1 * rng.standard_normal(of.layout.n), rng.standard_normal(of.layout.n_rows)
    programme = of.compiled.nlp
    upper = programme.hessian(w, of.p, 0.0, lam, 1.0).full()
    H = upper + np.triu(upper, 1).T
    for d in rng.standard_normal((4, of.layout.n)):
        up, down = (programme.jacobian(w + s * e * d, of.p).full() for s in (1.0, -1.0))
        assert H @ d == pytest.approx((up - down).T @ lam / (2 * e), abs=1e-6)
        change = (programme.rows(w + e * d, of.p) - programme.rows(w - e * d, of.p)).full().ravel() / (2 * e)
        assert programme.jacobian(w, of.p).full() @ d == pytest.approx(change, abs=1e-6)


def test_the_capture_point_of_a_square() -> None:
    square = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    region = capture_region([square], np.array([0.0, 0.0, 0.981]))
    assert region.omega_1_s == pytest.approx(np.sqrt(10.0))
    assert region.excess_m(np.zeros(3), np.array([0.3, 0.0, 0.0])) == 0.0
    assert region.excess_m(np.zeros(3), np.array([0.4, 0.0, 0.0])) == pytest.approx(0.4 / np.sqrt(10.0) - 0.1)


@pytest.mark.parametrize("contacts", [[], [hand(0.2, 0.9)]])
def test_without_support_nothing_can_be_captured(walk: CentroidalProblem, contacts: list) -> None:
    in_the_air = sequence(phase(1.0, foot("left", 0.0)), phase(0.2, *contacts))
    with pytest.raises(InvalidInput) as caught:
        solve(replace(walk, sequence=in_the_air, terminal="capturable", proxies={}))
    assert caught.value.code == "no-support-to-capture"


def test_the_com_stays_in_its_window(walk: CentroidalProblem, walked: CentroidalPlan) -> None:
    free = walked.com_m[1:-1, 2]
    middle = float(0.5 * (free.max() + max(walk.com_start_m[2], walk.com_end_m[2])))
    assert free.max() > middle + 1e-3
    plan = solve(replace(walk, bounds=PathBounds(com_height_m=(0.5, middle))))
    assert plan.converged, plan.status
    assert plan.com_m[1:-1, 2].max() <= middle + 1e-9
    assert sum(plan.cost_terms.values()) > sum(walked.cost_terms.values())


@pytest.mark.parametrize(("solver", "control"), [("ipopt", PYRAMIDS), ("native", CircularCones())])
def test_the_com_stays_between_heights_of_single_nodes(
    walk: CentroidalProblem, walked: CentroidalPlan, solver: SolverChoice, control: Control
) -> None:
    """One node higher and one lower than they would be: bounds from one side, at these nodes alone."""
    low, high = 5, 12
    between_m = np.tile([-np.inf, np.inf], (len(walked.phase), 1))
    between_m[low, 0] = walked.com_m[low, 2] + 0.01
    between_m[high, 1] = walked.com_m[high, 2] - 0.01
    plan = solve(replace(walk, control=control, bounds=PathBounds(com_between_m=between_m)), solver)
    assert plan.converged, plan.status
    assert plan.com_m[[low, high], 2] == pytest.approx([between_m[low, 0], between_m[high, 1]], abs=1e-5)
    assert (plan.com_m[:-1, 2] < between_m[:, 1] + 1e-6).all()


@pytest.mark.parametrize(("rows", "free"), [(1, False), (None, True)])
def test_heights_of_nodes_need_their_grid(walk: CentroidalProblem, rows: int | None, free: bool) -> None:
    between_m = np.tile([0.0, 2.0], (rows or len(walk.grid().phase), 1))
    durations = FreeDurations(0.8, 1.2) if free else None
    with pytest.raises(InvalidInput) as caught:
        replace(walk, durations=durations, bounds=PathBounds(com_between_m=between_m))
    assert caught.value.code == "bounds-need-grid"


def test_no_point_pushes_harder_than_it_may(walk: CentroidalProblem, walked: CentroidalPlan) -> None:
    most = walked.forces_n["left_foot"][:, :, 2].max()
    limit_n = 0.9 * float(most)
    bounded = replace(walk, bounds=PathBounds(normal_force_max_n={"left_foot": limit_n}))
    for name in ("ipopt", "fatrop"):
        plan = solve(bounded, name)
        assert plan.converged, plan.status
        assert plan.forces_n["left_foot"][:, :, 2].max() <= limit_n * (1 + 1e-6)
        assert plan.forces_n["left_foot"][:, :, 2].max() > 0.99 * limit_n


def test_the_hand_is_held_to_what_the_arm_carries(problem: CentroidalProblem, plan: CentroidalPlan) -> None:
    limit_n = 0.5 * float(plan.forces_n["right_hand"].max())
    limited = solve(replace(problem, bounds=PathBounds(normal_force_max_n={"right_hand": limit_n})))
    assert limited.converged, limited.status
    normal = problem.contact("right_hand", 1).placement.rotation[:, 2]
    assert (limited.forces_n["right_hand"] @ normal).max() <= limit_n * (1 + 1e-6)


@pytest.mark.parametrize(
    ("settings", "where"),
    [
        ({"com_height_m": (0.9, 0.8)}, "com_height_m"),
        ({"com_height_m": (-0.1, 0.8)}, "com_height_m"),
        ({"com_between_m": np.array([[0.5, 0.9], [0.9, 0.5]])}, "com_between_m"),
        ({"normal_force_max_n": {"right_hand": 0.0}}, "normal_force_max_n.right_hand"),
        ({"normal_force_max_n": {"right_hand": float("nan")}}, "normal_force_max_n.right_hand"),
    ],
)
def test_bounds_that_leave_nothing_are_named(settings: dict, where: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        PathBounds(**settings)
    assert [fault.where for fault in caught.value.faults] == [where]


def test_the_wrench_as_control_has_no_point_forces(problem: CentroidalProblem) -> None:
    with pytest.raises(InvalidInput) as caught:
        replace(problem, control=ContactWrench(), bounds=PathBounds(normal_force_max_n={"right_hand": 50.0}))
    assert caught.value.code == "bounds-need-forces"


def test_a_start_is_made_of_numbers() -> None:
    with pytest.raises(InvalidInput) as caught:
        Start(np.array([0.0, np.nan, 0.0]))
    assert caught.value.code == "start-not-finite"
