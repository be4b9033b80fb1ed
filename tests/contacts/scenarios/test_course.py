"""Courses of obstacles: the terrain by hand, stances that hold on it, and contact sequences over it."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.planner.start_goal import task_ends
from stridelab.contacts.scenarios.course import Bar, Block, Course, Element, Flight, Gap, Level, Ramp, Stones
from stridelab.errors import InvalidInput
from stridelab.reachability.planner_limits import planner_limits

TALOS = effector_shapes("talos")
EVERY: dict[str, list[Element]] = {
    "up": [Flight(3, 0.12, 0.30)],
    "down": [Flight(3, -0.12, 0.30)],
    "over": [Flight(2, 0.10, 0.30), Level(0.6, None), Flight(2, -0.10, 0.30)],
    "ramp": [Ramp(1.2, 0.12), Ramp(1.2, -0.12)],
    "stones": [Stones(4, 0.27, 0.12)],
    "beam": [Level(1.0, 0.45)],
    "bar": [Bar(0.05, 0.05)],
    "box": [Block(0.10, 0.45)],
    "gap": [Level(0.4, None), Gap(0.12), Level(0.4, None)],
}


def surfaces(elements: list[Element], **more: Any) -> dict[str, dict[str, Any]]:
    task = Course(elements, **more).contact_task(TALOS)
    return {surface["name"]: surface for surface in task["terrain"]}


def top(box: dict[str, Any], x_m: float) -> float:
    """Height of the upper face of a box that is rotated about y, at ``x_m``."""
    turn = Rotation.from_quat(np.roll(box.get("orientation_wxyz", (1.0, 0.0, 0.0, 0.0)), -1))
    n = turn.apply([0.0, 0.0, 1.0])
    p = np.array(box["center_m"]) + n * box["size_m"][2] / 2
    return float(p[2] - n[0] * (x_m - p[0]) / n[2])


def test_stairs_begin_in_front_of_the_toes_and_end_in_a_platform() -> None:
    """TALOS' sole reaches 0.10 m ahead; the first riser is 0.05 m farther, the others 0.3 m apart."""
    result = surfaces([Flight(4, 0.15, 0.30)])
    for k in range(4):
        box = result[f"1 stair {k + 1}"]
        assert box["center_m"][0] - box["size_m"][0] / 2 == pytest.approx(0.15 + 0.30 * k)
        assert top(box, 0.0) == pytest.approx(0.15 * (k + 1))
    end = result["end"]
    assert end["center_m"][0] - end["size_m"][0] / 2 == pytest.approx(0.15 + 4 * 0.30)
    assert top(end, 0.0) == pytest.approx(0.60)


def test_a_ramp_joins_both_of_its_ends() -> None:
    result = surfaces([Ramp(1.5, math.radians(10.0))])
    rise = 1.5 * math.tan(math.radians(10.0))
    assert top(result["1 ramp slab"], 0.15) == pytest.approx(0.0, abs=1e-5)
    assert top(result["1 ramp slab"], 1.65) == pytest.approx(rise, abs=1e-5)
    assert top(result["end"], 0.0) == pytest.approx(rise, abs=1e-6)


def test_stones_lean_by_the_angle_to_four_sides() -> None:
    result = surfaces([Stones(4, 0.27, 0.2)])
    normals = []
    for k in range(1, 5):
        turn = Rotation.from_quat(np.roll(result[f"1 stone {k}"]["orientation_wxyz"], -1))
        normals.append(turn.apply([0.0, 0.0, 1.0]))
        assert np.arccos(normals[-1][2]) == pytest.approx(0.2)
        y = result[f"1 stone {k}"]["center_m"][1]
        assert y < 0 if k % 2 else y > 0, "the right foot steps first"
    np.testing.assert_allclose(np.sum(normals, axis=0)[:2], 0.0, atol=1e-8)


def test_handrails_follow_the_slope_of_the_stairs() -> None:
    """Parallel to the line through the noses, ahead of it as the hand is ahead of the feet."""
    result = surfaces([Flight(4, 0.15, 0.30)], handrails=("left", "right"))
    rails = [result[f"right rail {k}"] for k in (1, 2, 3)]
    slopes = [(r["to_m"][2] - r["from_m"][2]) / (r["to_m"][0] - r["from_m"][0]) for r in rails]
    assert slopes == pytest.approx([0.0, 0.5, 0.0], abs=1e-5)
    for before, after in itertools.pairwise(rails):
        assert before["to_m"] == after["from_m"]
    for k in (1, 2, 3):
        mirrored = result[f"left rail {k}"]
        for end in ("from_m", "to_m"):
            assert mirrored[end][1] == -result[f"right rail {k}"][end][1]


@pytest.mark.parametrize("robot", ["talos", "hrp2", "g1"])
@pytest.mark.parametrize("handrails", [(), ("right",), ("left", "right")], ids=["free", "right", "both"])
def test_both_stances_hold_on_every_course(robot: str, handrails: tuple[Any, ...]) -> None:
    for elements in EVERY.values():
        task = Course(elements, handrails).contact_task(effector_shapes(robot))
        ends = task_ends({"robot": robot, "friction": 0.5, **task}, effector_shapes(robot))
        assert len(ends.start) == len(ends.goal) == 2 + len(handrails)


@pytest.mark.parametrize("name", EVERY)
def test_contacts_are_planned_over_every_course(name: str) -> None:
    task = {"robot": "talos", "friction": 0.5, **Course(EVERY[name]).contact_task(TALOS)}
    plan = ContactPlanner(TALOS, planner_limits("talos")).plan(task)
    used = {phase["duration_s"] for phase in plan.scenario["phases"]}
    assert plan.steps >= 4
    assert min(used) > 0


def test_both_feet_step_on_each_of_high_stairs() -> None:
    """One foot per stair of 15 cm would rise by 30 cm in one swing, which TALOS' body cannot; 8 cm it can."""
    for rise, steps in ((0.15, 9), (0.08, 7)):
        task = {"robot": "talos", "friction": 0.5, **Course([Flight(4, rise, 0.30)]).contact_task(TALOS)}
        plan = ContactPlanner(TALOS, planner_limits("talos")).plan(task)
        assert plan.steps == steps
        feet: dict[str, list[float]] = {"left_foot": [], "right_foot": []}
        for phase in plan.scenario["phases"]:
            for contact in phase["contacts"]:
                feet[contact["effector"]].append(contact["position_m"][2])
        highest = max(np.abs(np.diff(heights)).max() for heights in feet.values())
        assert highest <= planner_limits("talos").defaults.rise_max_m + 1e-6


def test_what_cannot_be_composed_is_named() -> None:
    with pytest.raises(InvalidInput, match=r"16\.1 m long") as refusal:
        Course([Level(8.0, None), Level(8.0, None)]).contact_task(TALOS)
    assert (refusal.value.code, refusal.value.faults[0].where) == ("course-too-long", "elements")
    legs = {name: shape for name, shape in TALOS.items() if "foot" in name}
    with pytest.raises(InvalidInput, match="no right hand") as refusal:
        Course([Level(1.0, None)], ("right",)).contact_task(legs)
    assert refusal.value.code == "course-without-hand"
    with pytest.raises(InvalidInput) as refusal:
        Course([Level(1.0, None)]).contact_task({"left_foot": TALOS["left_foot"]})
    assert refusal.value.code == "course-without-feet"


@pytest.mark.parametrize("robot", ["talos", "hrp2", "g1"])
def test_each_hand_stays_on_its_own_rail(robot: str) -> None:
    """Arms reach across the trunk, so that the right hand moved to where the left one already was."""
    task = {"robot": robot, **Course([Level(1.0, None)], ("left", "right")).contact_task(effector_shapes(robot))}
    plan = ContactPlanner(effector_shapes(robot), planner_limits(robot)).plan(task)
    for phase in plan.scenario["phases"]:
        at_m = {contact["effector"]: contact["position_m"] for contact in phase["contacts"]}
        assert at_m.get("left_hand", [0.0, 1.0])[1] > 0.0 > at_m.get("right_hand", [0.0, -1.0])[1]
