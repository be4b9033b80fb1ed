"""What holds from phase to phase, at its tolerances: contacts that are one, soles on one place, ways through boxes."""

import math

import numpy as np
import pytest

from stridelab.contacts.planner.start_goal import scenario_without_phases
from stridelab.contacts.terrain import Box, Terrain
from stridelab.contacts.validation.phase_consistency import jump_faults, overlap_faults, same_place, soles_overlap
from stridelab.contacts.validation.surface_contact import SurfaceContact, swing_collisions
from stridelab.dynamics.spatial import Placement
from support.robots.scenario_bodies import SHAPES


def touch(effector: str, x_m: float, y_m: float, z_m: float = 0.0, yaw_deg: float = 0.0) -> SurfaceContact:
    half = math.radians(yaw_deg) / 2
    at = Placement.from_wxyz([x_m, y_m, z_m], [math.cos(half), 0.0, 0.0, math.sin(half)])
    return SurfaceContact(effector, SHAPES[effector], at, None, 0.3, 0.0, 0.1, ())


@pytest.mark.parametrize(
    ("moved_m", "turned_deg", "same"),
    [(0.0009, 0.0, True), (0.0011, 0.0, False), (0.0, 0.45, True), (0.0, 0.55, False)],
)
def test_a_contact_is_the_same_within_a_millimetre_and_half_a_degree(
    moved_m: float, turned_deg: float, same: bool
) -> None:
    one, other = touch("left_foot", 2.0, 0.3), touch("left_foot", 2.0 + moved_m, 0.3, 0.0, turned_deg)
    assert same_place(one, other) == same
    assert (not list(jump_faults(({"left_foot": one}, {"left_foot": other})))) == same


def test_soles_on_one_place_are_reported_once_for_every_pair_of_places() -> None:
    left, on_it, beside, again = (
        touch(name, x, y)
        for name, x, y in (
            ("left_foot", 0.0, 0.0),
            ("right_foot", 0.1, 0.0),
            ("right_foot", 0.0, -0.2),
            ("right_foot", -0.1, 0.0),
        )
    )
    stances = tuple({"left_foot": left, "right_foot": right} for right in (on_it, on_it, beside, again, on_it))
    assert [fault.where for fault in overlap_faults(stances)] == [
        "phases[0].contacts[right_foot]",
        "phases[3].contacts[right_foot]",
    ]


@pytest.mark.parametrize(
    ("x_m", "y_m", "z_m", "yaw_deg", "over"),
    [
        (0.19, 0.11, 0.0, 0.0, True),
        (0.21, 0.0, 0.0, 0.0, False),
        (0.0, 0.13, 0.0, 0.0, False),
        (0.0, 0.13, 0.0, 30.0, True),
        (0.19, 0.13, 0.0, 45.0, False),
        (0.0, 0.0, 0.049, 0.0, True),
        (0.0, 0.0, -0.051, 0.0, False),
    ],
)
def test_soles_overlap_where_no_edge_separates_them(
    x_m: float, y_m: float, z_m: float, yaw_deg: float, over: bool
) -> None:
    """Soles of 0.2 m by 0.12 m; one above the other by more than 5 cm is not in its place."""
    one, other = touch("left_foot", 1.0, 2.0), touch("right_foot", 1.0 + x_m, 2.0 + y_m, z_m, yaw_deg)
    assert soles_overlap(one, other) == soles_overlap(other, one) == over


@pytest.mark.parametrize(
    ("other", "at_m", "meets"),
    [
        ("right_hand", (0.0, 0.0, 0.0), True),
        ("right_hand", (0.039, 0.0, 0.0), True),
        ("right_hand", (0.041, 0.0, 0.0), False),
        ("left_foot", (0.0, 0.0, 0.0), True),
        ("left_foot", (0.119, 0.0, 0.0), True),
        ("left_foot", (0.121, 0.0, 0.0), False),
        ("left_foot", (0.0, 0.081, 0.0), False),
        ("left_foot", (0.0, 0.0, 0.049), True),
        ("left_foot", (0.0, 0.0, 0.051), False),
        ("left_foot", (0.0, 0.0, -0.041), False),
    ],
)
def test_a_hand_in_the_place_of_another_contact_is_named(
    other: str, at_m: tuple[float, float, float], meets: bool
) -> None:
    """Spheres of 2 cm on their contact points, and a sole of 0.2 m by 0.12 m with 5 cm of shoe above it."""
    hand, taken = touch("left_hand", 1.0 + at_m[0], 2.0 + at_m[1], at_m[2]), touch(other, 1.0, 2.0)
    stance = {"left_hand": hand, other: taken}
    second, first = ("right_hand", "left_hand") if other == "right_hand" else ("left_hand", "left_foot")
    expected = [(f"phases[0].contacts[{second}]", f"is in the place of {first}")] if meets else []
    assert [(fault.where, fault.message) for fault in overlap_faults((stance, stance))] == expected


@pytest.mark.parametrize(("edge_y_m", "depth_m"), [(0.02, 0.04), (0.05, 0.01), (0.058, None), (-0.03, 0.06)])
def test_a_swing_that_clips_the_side_of_a_wall_is_in_it_by_so_much(edge_y_m: float, depth_m: float | None) -> None:
    """A sole 0.12 m wide goes 0.6 m along x past a wall that begins at ``edge_y_m``, turned by a quarter."""
    turn = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    wall = Box("wall", Placement.from_wxyz([0.3, edge_y_m + 0.5, 0.5], turn), np.array([1.0, 0.12, 1.0]))
    start, end = touch("left_foot", 0.0, 0.0), touch("left_foot", 0.6, 0.0)
    result = list(swing_collisions(({"left_foot": start}, {}, {"left_foot": end}), Terrain.from_surfaces([wall])))
    assert [(phase, name, box) for phase, name, box, _ in result] == [(1, "left_foot", "wall")] * (depth_m is not None)
    assert [depth for *_, depth in result] == pytest.approx([] if depth_m is None else [depth_m], abs=1e-3)


def test_a_task_hands_its_surroundings_on() -> None:
    task = {"robot": "talos", "terrain": [{"name": "ground"}], "start": {}, "goal": {}}
    made = scenario_without_phases(task)
    assert (made["robot"], made["terrain"], made["friction"]) == ("talos", task["terrain"], 0.3)
    assert made["name"] == "Planned contacts"
    assert scenario_without_phases({**task, "friction": 0.5, "name": "Mine"}) | made == made
    assert scenario_without_phases({**task, "friction": 0.5, "name": "Mine"})["friction"] == 0.5
    assert set(made) == {"name", "description", "robot", "friction", "terrain"}
