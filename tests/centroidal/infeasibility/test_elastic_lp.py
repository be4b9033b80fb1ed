"""The constraints relaxed, against statics and the laws of motion."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.boundary_conditions import PathBounds, Start
from stridelab.centroidal.infeasibility.elastic_lp import HARD, EndMiss, is_feasible, solve_elastic
from stridelab.centroidal.infeasibility.lp_constraints import N_RAYS, Where
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.reach_box import reach_box
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import Contact
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from support.robots.sequences import COM_HEIGHT_M, MASS_KG, foot, hand, phase, rest_to_rest, sequence, two_steps

WEIGHT_N = MASS_KG * GRAVITY_M_S2
FACE = np.cos(np.pi / N_RAYS)


def cone_margins_n(problem: CentroidalProblem) -> Mapping[Where, float]:
    relaxed = solve_elastic(problem, cones=1.0)
    assert relaxed is not None
    return relaxed.margins_n


def end_miss(problem: CentroidalProblem) -> EndMiss:
    relaxed = solve_elastic(problem, end=1.0)
    assert relaxed is not None
    return relaxed.miss


def push(duration_s: float, distance_m: float, friction: float = 0.3) -> CentroidalProblem:
    """Both feet stay; the CoM goes ``distance_m`` ahead."""
    standing = sequence(phase(duration_s, foot("left", 0.0, friction=friction), foot("right", 0.0, friction=friction)))
    return replace(rest_to_rest(standing, node_rate_hz=20.0), com_end_m=np.array([distance_m, 0.0, COM_HEIGHT_M]))


def on_slope(side: str, angle_rad: float, friction: float) -> Contact:
    y = 0.09 if side == "left" else -0.09
    place = Placement.from_wxyz((0.0, y, 0.0), (np.cos(angle_rad / 2), 0.0, np.sin(angle_rad / 2), 0.0))
    return Contact(f"{side}_foot", place, "slope", friction)


def test_a_feasible_problem_needs_no_relaxation(problem: CentroidalProblem) -> None:
    assert is_feasible(problem)
    assert set(cone_margins_n(problem).values()) == {0.0}
    miss = end_miss(problem)
    assert miss.is_met
    assert miss.com_m == pytest.approx(np.zeros(3), abs=1e-7)


def test_nothing_pushes_farther_than_friction_allows() -> None:
    """However hard the feet push, ``|c_x''| <= mu (c_z'' + g)``: from rest to rest at most ``mu g T^2 / 2``."""
    friction, duration_s = 0.3, 0.3
    law_m = friction * GRAVITY_M_S2 * duration_s**2 / 2
    assert not is_feasible(push(duration_s, 1.01 * law_m))
    assert is_feasible(
        push(duration_s, 0.4 * FACE * law_m)
    )  # half of it at an even height, without the rest at the end
    miss = end_miss(push(duration_s, law_m + 1.0))
    assert not miss.is_met
    assert np.abs(miss.com_m[0]) + np.abs(miss.velocity_m_s[0]) * duration_s >= 1.0


@pytest.mark.parametrize("friction", [0.05, 0.2])
def test_on_a_slope_that_is_too_steep_the_margin_is_that_of_statics(friction: float) -> None:
    """From rest to rest over one stance the mean force is the weight: ``sum margins = mu N - T``, down the slope."""
    a = np.deg2rad(15.0)
    problem = rest_to_rest(sequence(phase(1.0, on_slope("left", a, friction), on_slope("right", a, friction))))
    margins = cone_margins_n(problem)
    points = 4
    expected = WEIGHT_N * (friction * FACE * np.cos(a) - np.sin(a))
    assert expected < 0.0
    assert points * sum(margins.values()) == pytest.approx(expected, rel=1e-6)
    assert not is_feasible(problem)


def test_enough_friction_holds_the_slope() -> None:
    a = np.deg2rad(15.0)
    problem = rest_to_rest(sequence(phase(1.0, on_slope("left", a, 0.35), on_slope("right", a, 0.35))))
    assert is_feasible(problem)


def test_the_contact_in_the_way_is_named() -> None:
    """Both feet stand well, then the right one alone on a steep, slippery place; the body limits are hard."""
    left, right, steep = foot("left", 0.0), foot("right", 0.0), on_slope("right", 0.6, 0.1)
    walk = sequence(phase(1.0, left, right), phase(0.5, left), phase(3.0, steep), phase(1.0, left, right))
    relaxed = solve_elastic(rest_to_rest(walk), cones=1.0, body=HARD)
    assert relaxed is not None
    assert [at for at, margin in relaxed.margins_n.items() if margin < 0.0] == [(2, "right_foot")]
    assert is_feasible(rest_to_rest(walk)), "with a jump of many metres it can be done"


def test_out_of_reach_is_named_with_its_metres() -> None:
    """Feet farther apart than the boxes of their densities: what is missing is the gap between the boxes."""
    far_m = 2.6
    walk = sequence(phase(1.0, foot("left", 0.0)), phase(1.0, foot("left", 0.0), foot("right", far_m)))
    problem = rest_to_rest(walk)
    relaxed = solve_elastic(problem, body=1.0)
    assert relaxed is not None
    boxes = {name: reach_box(problem.proxies[name].mixture) for name in ("left_foot", "right_foot")}
    gap_m = far_m + boxes["right_foot"].low_m[0] - boxes["left_foot"].high_m[0]
    assert gap_m > 0.0
    assert relaxed.beyond_m[1, "left_foot"] + relaxed.beyond_m[1, "right_foot"] >= gap_m - 1e-6
    assert not relaxed.is_feasible
    assert solve_elastic(problem, body=HARD) is None
    near = solve_elastic(rest_to_rest(two_steps()), body=HARD)
    assert near is not None
    assert near.is_feasible


def test_on_a_hand_alone_the_robot_does_not_stay_in_place() -> None:
    """The CoM would have to get to the hand, half a metre away, and back; given time, it can (and turns over)."""
    start = np.array([0.0, 0.0, COM_HEIGHT_M])

    def alone(duration_s: float) -> CentroidalProblem:
        walk = sequence(phase(duration_s, hand(0.2, 0.9)))
        return replace(rest_to_rest(two_steps()), sequence=walk, com_start_m=start, com_end_m=start)

    assert not is_feasible(alone(0.5))
    assert not end_miss(alone(0.5)).is_met
    assert is_feasible(alone(3.0))


def test_without_contacts_the_robot_falls_freely() -> None:
    T = 0.5
    problem = replace(rest_to_rest(two_steps()), sequence=sequence(phase(T)))
    assert not is_feasible(problem)
    assert solve_elastic(problem, cones=1.0) is None
    miss = end_miss(problem)
    drop = problem.com_start_m - problem.com_end_m + [0.0, 0.0, -GRAVITY_M_S2 * T**2 / 2]
    assert miss.com_m == pytest.approx(drop, abs=1e-9)
    assert miss.velocity_m_s == pytest.approx([0.0, 0.0, -GRAVITY_M_S2 * T], abs=1e-9)
    assert miss.acceleration_m_s2 == pytest.approx([0.0, 0.0, -GRAVITY_M_S2], abs=1e-9)
    assert miss.momentum_nms == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_motion_that_goes_on_and_can_be_stopped(problem: CentroidalProblem) -> None:
    """Begun with 0.3 m/s over two feet it ends where its capture point is; begun with 3 m/s it cannot."""
    standing = rest_to_rest(sequence(phase(0.4, foot("left", 0.0), foot("right", 0.0))))

    def begun(speed_m_s: float) -> CentroidalProblem:
        return replace(standing, start=Start(np.array([speed_m_s, 0.0, 0.0])), terminal="capturable")

    assert is_feasible(begun(0.1))
    fast = begun(3.0)
    assert not is_feasible(fast)
    missed = end_miss(fast)
    assert not missed.is_met
    assert missed.com_m[0] > 0.1
    plans = [solve(begun(speed)) for speed in (0.1, 3.0)]
    assert [plan.converged for plan in plans] == [True, False]
    assert is_feasible(replace(standing, start=Start(np.array([0.1, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))))


def test_bounds_of_the_problem_are_limits_of_the_body() -> None:
    walk = rest_to_rest(two_steps())
    highest = np.tile([-np.inf, 0.7], (len(walk.grid().phase), 1))
    for low in (PathBounds(com_height_m=(0.3, 0.7)), PathBounds(com_between_m=highest)):
        relaxed = solve_elastic(replace(walk, bounds=low), body=1.0)
        assert relaxed is not None
        assert relaxed.beyond_m[0, "left_foot"] + relaxed.beyond_m[0, "right_foot"] >= COM_HEIGHT_M - 0.7 - 1e-6
    weak = replace(walk, bounds=PathBounds(normal_force_max_n={"left_foot": 100.0}))
    bearing = solve_elastic(weak, body=1.0, end=1.0)
    assert bearing is not None
    assert max(bearing.loads_n.values()) > 400.0
