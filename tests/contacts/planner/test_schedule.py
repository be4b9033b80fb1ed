"""Schedules of moves and what cannot be reached in them, against walks that are counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.pruning import fewest_moves, first_gap, prune_schedule
from stridelab.contacts.planner.schedule import Schedule, StartAndGoal, build_schedule
from stridelab.contacts.planner.step_limits import BALL_COVER, EffectorLimits, RobotLimits, StepDefaults
from stridelab.dynamics.spatial import Placement

WIDE = EffectorReach((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 2.0)
FOOT = EffectorLimits("surface", (0.1, 0.05), WIDE, WIDE)
LIMITS = RobotLimits(
    {"left_foot": FOOT, "right_foot": FOOT, "right_hand": replace(FOOT, kind="point")},
    0.5 / BALL_COVER,
    StepDefaults(0.4, 0.2, 0.2, 0.1),
)
"""A step reaches 0.5 m ahead and back, 0.2 m up and down, and 0.1 to 0.5 m to the foot's own side."""


def turned(yaw_deg: float, *place_m: float) -> Placement:
    half = np.radians(yaw_deg) / 2
    return Placement.from_wxyz(list(place_m), [float(np.cos(half)), 0.0, 0.0, float(np.sin(half))])


def standing(x_m: float, z_m: float = 0.0) -> dict[str, Placement]:
    return {"left_foot": turned(0.0, x_m, 0.1, z_m), "right_foot": turned(0.0, x_m, -0.1, z_m)}


def straight(x_m: float, z_m: float = 0.0) -> StartAndGoal:
    return StartAndGoal.from_stances(standing(0.0), standing(x_m, z_m), LIMITS.feet)


def plank(name: str, low_m: float, high_m: float, z_m: float = 0.0) -> Region:
    """A piece of level ground across the whole way."""
    corners = np.array([[x, y, z_m] for x in (low_m, high_m) for y in (-1.0, 1.0)])
    axes, box = np.eye(3)[:, :2], np.vstack([np.eye(2), -np.eye(2)])
    return Region(name, np.array([0.0, 0.0, z_m]), axes, box, np.array([high_m, 1.0, -low_m, 1.0]), np.eye(3), corners)


def scheduled(ends: StartAndGoal, steps: int, *planks: Region, first: str = "right_foot") -> Schedule:
    result = build_schedule(ends, LIMITS, lambda _effector, _yaw: planks, steps, first)
    assert result is not None
    return result


def names(plan: Schedule | None) -> list[list[str]]:
    """Names of the planks that are open to every foot of the chain."""
    assert plan is not None
    return [[region.surface for region in plan.nodes[i].choices] for i in plan.feet]


def test_headings_are_the_mean_of_both_soles_and_the_turn_is_the_shorter_one() -> None:
    start = {"left_foot": turned(160.0, 0.0, 0.1, 0.0), "right_foot": turned(180.0, 0.0, -0.1, 0.0)}
    goal = {"left_foot": turned(-175.0, 0.0, 0.1, 0.0), "right_foot": turned(-155.0, 0.0, -0.1, 0.0)}
    ends = StartAndGoal.from_stances(start, goal, LIMITS.feet)
    assert np.degrees([ends.yaw_rad, ends.turn_rad]) == pytest.approx([170.0, 25.0])


def test_hands_move_before_every_second_step_and_at_the_end() -> None:
    """Three steps from a hand in the air to one on the goal: the moves, where they may go, and the heading of each."""
    hold = turned(0.0, 0.7, -0.4, 0.9)
    goal = {name: turned(30.0, *at.position_m.tolist()) for name, at in standing(0.6).items()}
    ends = StartAndGoal.from_stances(standing(0.0), {**goal, "right_hand": hold}, LIMITS.feet)
    plan = scheduled(ends, 3, plank("ground", -1.0, 2.0))
    reported = [(node.effector, node.step, round(np.degrees(node.yaw_rad)), node.free) for node in plan.nodes]
    assert reported == [
        ("left_foot", 0, 0, False),
        ("right_foot", 0, 0, False),
        ("right_hand", 0, 0, False),
        ("right_hand", 0, 15, True),
        ("right_foot", 1, 15, False),
        ("left_foot", 2, 30, False),
        ("right_hand", 2, 30, True),
        ("right_foot", 3, 30, False),
        ("right_hand", 3, 30, False),
    ]
    fixed = [node.fixed for node in plan.nodes]
    assert fixed[:3] == [ends.start["left_foot"], ends.start["right_foot"], None]
    assert fixed[3:] == [None, None, goal["left_foot"], None, goal["right_foot"], hold]
    assert [bool(node.choices) for node in plan.nodes] == [i in {3, 4, 6} for i in range(9)]
    assert (plan.moves, plan.feet) == ((3, 4, 5, 6, 7, 8), (0, 4, 5, 7))
    assert [sorted(stance.values()) for stance in plan.stances] == [
        [0, 1, 2],
        [0, 1, 3],
        [0, 3, 4],
        [3, 4, 5],
        [4, 5, 6],
        [5, 6, 7],
        [5, 7, 8],
    ]


@pytest.mark.parametrize(("steps", "first"), [(0, "right_foot"), (1, "right_foot"), (1, "left_foot")])
def test_a_foot_that_takes_no_step_must_stand_on_the_goal(steps: int, first: str) -> None:
    """One step moves the first foot alone, to the goal; no step none; a turn on the spot is a move."""
    other = "left_foot" if first == "right_foot" else "right_foot"
    for change in (turned(0.0, 0.3, 0.0, 0.0), turned(20.0, *standing(0.0)[other].position_m.tolist())):
        ends = StartAndGoal.from_stances(standing(0.0), {**standing(0.0), other: change}, LIMITS.feet)
        assert build_schedule(ends, LIMITS, lambda _effector, _yaw: (), steps, first) is None
    if steps:
        ends = StartAndGoal.from_stances(
            standing(0.0), {**standing(0.0), first: turned(0.0, 0.3, 0.0, 0.0)}, LIMITS.feet
        )
        plan = scheduled(ends, steps, first=first)
        assert [plan.nodes[i].effector for i in plan.feet] == [other, first]


def test_only_planks_on_a_way_are_left() -> None:
    """Four steps over 1.5 m: the first must land within 0.5 m, the second within 0.5 m of it and of the goal."""
    planks = [plank("a", -0.2, 0.1), plank("b", 0.45, 0.55), plank("c", 0.95, 1.05), plank("d", 1.4, 1.6)]
    planks.append(plank("high", 0.45, 0.55, 0.21))
    assert names(prune_schedule(scheduled(straight(1.5), 4, *planks), LIMITS)) == [[], ["b"], ["c"], [], []]
    assert prune_schedule(scheduled(straight(1.56), 4, *planks), LIMITS) is None
    assert prune_schedule(scheduled(straight(1.5), 3, *planks), LIMITS) is None


def test_the_gap_is_between_what_was_reached_and_what_was_not() -> None:
    """From 0.1 m to 0.75 m are 0.65 m, 0.15 m more than a step; 0.3 m up are 0.1 m more than one."""
    surfaces = dict.fromkeys(LIMITS.feet, ("near", "far"))
    near, far = plank("near", -0.3, 0.1), plank("far", 0.75, 2.0, 0.3)
    gap = first_gap(straight(1.2, 0.3), LIMITS, lambda _effector, _yaw: (near, far), surfaces)
    assert gap is not None
    assert (gap.from_surface, gap.to_surface, gap.step) == ("near", "far", 1)
    assert gap.missing_m == pytest.approx((0.15, 0.0, 0.1))
    between = plank("between", 0.3, 0.4, 0.15)
    assert first_gap(straight(1.2, 0.3), LIMITS, lambda _effector, _yaw: (near, between, far), surfaces) is None
    back = StartAndGoal(standing(1.2, 0.3), standing(0.0), 0.0, 0.0)
    turned_round = first_gap(
        back, LIMITS, lambda _effector, _yaw: (near, far), dict.fromkeys(surfaces, ("far", "near"))
    )
    assert turned_round is not None
    assert turned_round.missing_m == pytest.approx((-0.15, 0.0, -0.1))


@pytest.mark.parametrize(
    ("heights_m", "moves"), [((0.0, 0.1, 0.2), 3), ((0.0, 0.15, 0.30), 4), ((0.0, 0.15), 2), ((0.0, 0.3), 0)]
)
def test_moves_are_counted_with_both_feet_on_each_high_stair(heights_m: tuple[float, ...], moves: int) -> None:
    """A swing rises by 0.2 m at most: over stairs of 0.1 m the feet take turns, over those of 0.15 m both use each."""
    planks = [plank(str(k), 0.5 * k - 0.25, 0.5 * k + 0.25, z) for k, z in enumerate(heights_m)]
    ends = straight(0.5 * (len(heights_m) - 1), heights_m[-1])
    assert fewest_moves(ends, LIMITS, lambda _effector, _yaw: tuple(planks)) == moves


@pytest.mark.parametrize("aside_rad", [np.pi / 2, -np.pi / 2, 0.0])
def test_the_heading_turns_aside_and_back_in_steps_of_twelve_degrees(aside_rad: float) -> None:
    ends = replace(straight(3.0), turn_rad=0.5, aside_rad=aside_rad)
    headings = [ends.yaw_after(k, 24) for k in range(25)]
    assert headings[0] == pytest.approx(ends.yaw_rad)
    assert headings[-1] == pytest.approx(ends.yaw_rad + 0.5)
    assert headings[12] == pytest.approx(ends.yaw_rad + 0.5 * 12 / 23 + aside_rad)
    assert headings[23] - ends.aside_rad / 8 == pytest.approx(ends.yaw_rad + 0.5)
    assert np.abs(np.diff(headings)[:-1] - 0.5 / 23).max() <= np.deg2rad(12.0) + 1e-12
