"""Linear programs by hand, and what the program of a walk takes for even steps."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.milp import FREE_COST, LinearProgram, PlanningBudget, StepProgram
from stridelab.contacts.planner.schedule import StartAndGoal, build_schedule
from stridelab.contacts.planner.step_limits import (
    BALL_COVER,
    DIRECTIONS,
    EffectorLimits,
    RobotLimits,
    StepDefaults,
    ball_rows,
)
from stridelab.dynamics.spatial import Placement

REACH = EffectorReach((-0.6, -0.4, 0.5), (0.6, 0.4, 1.0), 1.1)
FOOT = EffectorLimits("surface", (0.1, 0.05), REACH, REACH)
ARM = EffectorReach((-0.8, -0.8, -0.3), (0.8, 0.8, 0.3), 0.9)
HAND = EffectorLimits("point", (0.0, 0.0), ARM, ARM)
LIMITS = RobotLimits({"left_foot": FOOT, "right_foot": FOOT, "right_hand": HAND}, 0.7, StepDefaults(0.4, 0.2, 0.2, 0.1))


@pytest.mark.parametrize(("whole", "x", "objective"), [(False, [3.0, 1.5], -21.0), (True, [4.0, 0.0], -20.0)])
def test_a_program_of_a_textbook(whole: bool, x: list[float], objective: float) -> None:
    """Most of 5 x + 4 y with 6 x + 4 y <= 24 and x + 2 y <= 6: the corner of both, or the best whole numbers."""
    program = LinearProgram()
    (first,), (second,) = (
        program.add_variables(1, 0.0, cost=-5.0, integer=whole),
        program.add_variables(1, 0.0, cost=-4.0, integer=whole),
    )
    program.add_row([(first, 4.0), (second, 4.0), (first, 2.0)], high=24.0)
    program.add_row([(first, 1.0), (second, 2.0)], high=6.0)
    answer = program.solve(PlanningBudget(10.0))
    assert answer.x is not None
    assert answer.x == pytest.approx(x, abs=1e-6)
    assert (answer.objective, answer.proven) == (pytest.approx(objective), True)


def test_variables_are_free_unless_bounded() -> None:
    """Least x + y + z / 2 with x >= -3 by a row, y >= -2 by its bound, z <= -5 and x + z >= -9."""
    program = LinearProgram()
    x, _ = program.add_variables(1, cost=1.0) + program.add_variables(1, -2.0, cost=1.0)
    (z,) = program.add_variables(1, high=-5.0, cost=0.5)
    program.add_row([(x, 1.0)], low=-3.0)
    program.add_row([(x, 1.0), (z, 1.0)], low=-9.0)
    answer = program.solve(PlanningBudget(10.0))
    assert answer.x is not None
    assert answer.x == pytest.approx([-3.0, -2.0, -6.0])


def test_a_program_without_a_solution_is_proven_to_have_none() -> None:
    program = LinearProgram()
    (x,) = program.add_variables(1, 0.0, 1.0)
    program.add_row([(x, 1.0)], low=2.0)
    answer = program.solve(PlanningBudget(10.0))
    assert (answer.x, answer.objective, answer.proven) == (None, np.inf, True)


def test_directions_cover_a_ball() -> None:
    """26 of length one; what they let through lies in the ball, and rows that cut nothing off a box are left out."""
    assert DIRECTIONS.shape == (26, 3)
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=1), 1.0)
    points = np.random.default_rng(0).normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1)[:, np.newaxis]
    most = (points @ DIRECTIONS.T).max(axis=1)
    assert BALL_COVER <= most.min() <= BALL_COVER + 0.01
    low, high = np.array([-0.2, -0.2, 0.0]), np.array([0.2, 0.2, 1.0])
    rows, offset = ball_rows(0.9, low, high)
    assert offset == pytest.approx(0.9 * BALL_COVER)
    inside = np.random.default_rng(1).uniform(low, high, (2000, 3))
    np.testing.assert_array_equal(
        (inside @ rows.T <= offset).all(axis=1), (inside @ DIRECTIONS.T <= offset).all(axis=1)
    )
    assert 0 < len(rows) < 13
    assert (rows[:, 2] > 0.0).all()


def test_feet_that_are_turned_against_each_other_are_farther_apart() -> None:
    """The corners of soles of 0.1 m half length, turned by 12 degrees, do not overlap at the least distance."""
    turn_rad = np.deg2rad(12.0)
    still, moving = (np.array(LIMITS.effectors[name].half_size_m) for name in ("right_foot", "left_foot"))
    near_m = LIMITS.offset_box_m("left_foot", turn_rad)[0][1]
    corners = np.array([(i, j) for i in (-1, 1) for j in (-1, 1)]) * still
    side_m = (corners @ [np.sin(turn_rad), np.cos(turn_rad)]).max()
    gap_m = LIMITS.offset_box_m("left_foot")[0][1] - still[1] - moving[1]
    assert near_m - moving[1] - side_m >= gap_m - 1e-12
    assert near_m - moving[1] - side_m < gap_m + 0.01
    assert LIMITS.offset_box_m("right_foot", -turn_rad)[1][1] == pytest.approx(-near_m)


def test_a_step_keeps_the_feet_apart_and_the_com_within_reach_of_both() -> None:
    """The box of a step is what two boxes about one CoM leave, within the largest step, width and stair."""
    d = 0.7 * BALL_COVER
    low, high = LIMITS.offset_box_m("left_foot")
    np.testing.assert_allclose(low, [-d, 0.1, -0.2])
    np.testing.assert_allclose(high, [d, d, 0.2])
    low, high = LIMITS.offset_box_m("right_foot")
    np.testing.assert_allclose(low, [-d, -d, -0.2])
    np.testing.assert_allclose(high, [d, -0.1, 0.2])
    short = replace(FOOT, heading=EffectorReach((-0.1, -0.1, 0.6), (0.2, 0.15, 0.7), 1.1))
    low, high = replace(LIMITS, effectors={**LIMITS.effectors, "right_foot": short}).offset_box_m("right_foot")
    np.testing.assert_allclose(low, [-d, -0.4 - 0.15, -0.2])
    np.testing.assert_allclose(high, [d, -0.1, 0.2])
    both = replace(LIMITS, effectors={"left_foot": short, "right_foot": short})
    np.testing.assert_allclose(both.offset_box_m("left_foot"), [[-0.3, 0.1, -0.1], [0.3, 0.25, 0.1]])


def ends(x_m: float, hand: bool = False) -> StartAndGoal:
    sides = {"left_foot": 0.12, "right_foot": -0.12}
    stances = [{name: Placement.from_wxyz([x, y, 0.0]) for name, y in sides.items()} for x in (0.0, x_m)]
    if hand:
        for stance, x in zip(stances, (0.1, x_m + 0.1), strict=True):
            stance["right_hand"] = Placement.from_wxyz([x, -0.4, 0.8])
    return StartAndGoal.from_stances(stances[0], stances[1], LIMITS.feet)


def ground(low_m: float, high_m: float, *, rail: bool = False) -> Region:
    """Level ground as wide as the way, or a rail beside it."""
    axes = np.eye(3)[:, : 1 if rail else 2]
    origin = np.array([0.0, -0.4, 0.8]) if rail else np.zeros(3)
    corners = np.array([[x, y, 0.0] for x in (low_m, high_m) for y in ((0.0,) if rail else (-1.0, 1.0))]) + origin
    A = np.vstack([axes[: axes.shape[1]], -axes[: axes.shape[1]]])
    b = np.array([high_m, -low_m] if rail else [high_m, 1.0, -low_m, 1.0])
    return Region("rail" if rail else "ground", origin, axes, A, b, np.eye(3), corners)


def solved(way: StartAndGoal, steps: int, floor: Region, *rails: Region) -> tuple[float, list[list[float] | None]]:
    """The objective and where the placements that were chosen are."""
    plan = build_schedule(
        way, LIMITS, lambda name, _yaw: rails if name == "right_hand" else (floor,), steps, "right_foot"
    )
    assert plan is not None
    program = StepProgram(plan, LIMITS, way)
    placed = program.placements_of(program.solve(PlanningBudget(20.0)))
    chosen = [i for i, node in enumerate(plan.nodes) if node.fixed is None]
    places = [placed.placements[i] for i in chosen]
    assert [placed.regions[i] is None for i in chosen] == [at is None for at in places]
    return placed.objective, [
        None if at is None else [round(float(v), 6) + 0.0 for v in at.position_m] for at in places
    ]


def test_even_steps_cost_nothing() -> None:
    """Four steps over 0.9 m: 0.3 m further each time, half the usual width aside; the last two close up."""
    objective, places = solved(ends(0.9), 4, ground(-1.0, 2.0))
    assert objective == pytest.approx(0.0, abs=1e-7)
    assert places == [[0.3, -0.1, 0.0], [0.6, 0.1, 0.0]]


def test_a_place_that_is_not_there_costs_how_far_it_is() -> None:
    """The first even step, to 0.3 m, and the second, to 0.6 m, with ground from 0.35 to 0.5 m only."""
    objective, places = solved(ends(0.9), 4, ground(0.35, 0.5))
    assert objective == pytest.approx(0.15)
    assert places == [[0.35, -0.1, 0.0], [0.5, 0.1, 0.0]]


def test_a_hand_follows_along_the_rail_or_hangs_free() -> None:
    """As far ahead of the feet as at the start, its way aside free; without a rail every placement has its price.

    Two hand moves are open, with the feet at the start and at 0.6 m.
    """
    objective, places = solved(ends(0.9, hand=True), 4, ground(-1.0, 2.0), ground(-1.0, 2.0, rail=True))
    assert objective == pytest.approx(0.0, abs=1e-7)
    assert places == [[0.1, -0.4, 0.8], [0.3, -0.1, 0.0], [0.6, 0.1, 0.0], [0.7, -0.4, 0.8]]
    objective, places = solved(ends(0.9, hand=True), 4, ground(-1.0, 2.0), ground(0.0, 0.4, rail=True))
    assert objective == pytest.approx(0.3)
    assert places[3] == [0.4, -0.4, 0.8]
    objective, places = solved(ends(0.9, hand=True), 4, ground(-1.0, 2.0), ground(5.0, 6.0, rail=True))
    assert objective == pytest.approx(2 * FREE_COST)
    assert (places[0], places[3]) == (None, None)


def test_with_slack_only_what_is_missing_counts_and_no_foot_is_left_out() -> None:
    """The goal is 1.5 m ahead, the only ground 0.4 m behind: the step on to the goal lacks 1.9 m less a step."""
    way = ends(1.5)
    plan = build_schedule(way, LIMITS, lambda _name, _yaw: (ground(-0.5, -0.4),), 4, "right_foot")
    assert plan is not None
    program = StepProgram(plan, LIMITS, way, slack=True)
    assert program.slack is not None
    answer = program.solve(PlanningBudget(20.0))
    assert answer.x is not None
    lacking_m = 1.9 - 0.7 * BALL_COVER
    assert answer.objective == pytest.approx(lacking_m)
    assert answer.x[list(program.slack)] == pytest.approx([0.0, 0.0, lacking_m, 0.0])
    assert [at is None for at in program.placements_of(answer).placements] == [False] * 6
