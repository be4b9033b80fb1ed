"""Contacts that do not lie on their surface as they should."""

import math
from copy import deepcopy
from functools import partial

import numpy as np
import pytest

from stridelab.contacts.scenarios.stairs import HandRail, flat_walk, six_stairs, stairs_with_rail
from stridelab.contacts.validation.surface_contact import _Ground
from support.robots.scenario_bodies import Made, contact, everywhere, faults, judged


def tilted(degrees: float) -> list[float]:
    half = math.radians(degrees) / 2
    return [math.cos(half), 0.0, math.sin(half), 0.0]


@pytest.mark.parametrize("height", [0.02, 0.006])
def test_a_foot_in_the_air(height: float) -> None:
    place = (0.3, -0.09, 0.1)
    lifted = [0.3, -0.09, 0.1 + height]
    report = judged(six_stairs(), lambda s: everywhere(s, "right_foot", place, position_m=lifted))
    ((where, message),) = faults(report)
    assert where == "phases[2].contacts[right_foot]"
    assert message == f"is in the air, {height:g} m above 'stair 1': lower it by {height:g} m"


def test_a_foot_inside_its_stair() -> None:
    report = judged(
        six_stairs(), lambda s: everywhere(s, "right_foot", (0.3, -0.09, 0.1), position_m=[0.3, -0.09, 0.08])
    )
    assert faults(report) == [
        ("phases[2].contacts[right_foot]", "is inside 'stair 1', 0.02 m below its upper face: raise it by 0.02 m")
    ]


def test_a_few_millimetres_do_not_matter() -> None:
    for height in (0.104, 0.096):
        lift = partial(everywhere, effector="right_foot", place=(0.3, -0.09, 0.1), position_m=[0.3, -0.09, height])
        assert judged(six_stairs(), lift).valid


def test_a_foot_on_the_ground_under_a_stair() -> None:
    report = judged(
        six_stairs(), lambda s: everywhere(s, "right_foot", (0.3, -0.09, 0.1), position_m=[0.45, -0.09, 0.0])
    )
    assert faults(report)[0] == (
        "phases[2].contacts[right_foot]",
        "is inside 'stair 2', 0.2 m below its upper face",
    )


def test_a_toe_in_the_next_riser() -> None:
    report = judged(
        six_stairs(), lambda s: everywhere(s, "right_foot", (0.3, -0.09, 0.1), position_m=[0.38, -0.09, 0.1])
    )
    assert faults(report)[0][1] == "is inside 'stair 2', 0.1 m below its upper face"


def test_a_foot_on_nothing() -> None:
    report = judged(
        six_stairs(), lambda s: everywhere(s, "right_foot", (0.0, -0.09, 0.0), position_m=[-2.5, -0.09, 0.0])
    )
    assert faults(report)[0] == (
        "phases[0].contacts[right_foot]",
        "is not on a surface: 'ground', the nearest one, is 0.5 m away",
    )


def test_no_terrain() -> None:
    report = judged(flat_walk(), lambda s: s["terrain"].clear())
    assert faults(report)[0][1] == "has no surface: the terrain has nothing to stand on"
    assert all(margin.surface is None and margin.height_m is None for margin in report.margins)


def test_a_foot_cannot_stand_on_a_rail() -> None:
    def change(s: Made) -> None:
        s["terrain"] = [s["terrain"][-1]]

    assert "nothing to stand on" in faults(judged(stairs_with_rail(), change))[0][1]


@pytest.mark.parametrize(("x", "past"), [(0.245, 0.015), (0.215, 0.045)])
def test_a_sole_over_the_edge(x: float, past: float) -> None:
    report = judged(six_stairs(), lambda s: everywhere(s, "right_foot", (0.3, -0.09, 0.1), position_m=[x, -0.09, 0.1]))
    ((where, message),) = faults(report)
    assert where == "phases[2].contacts[right_foot]"
    assert message == f"the sole is {past:g} m past the edge of 'stair 1': move it by ({past:g}, 0, 0) m"


def test_five_millimetres_over_the_edge_are_tolerated() -> None:
    moved = [0.2555, -0.09, 0.1]
    assert judged(six_stairs(), lambda s: everywhere(s, "right_foot", (0.3, -0.09, 0.1), position_m=moved)).valid


def test_two_boxes_side_by_side_carry_one_sole() -> None:
    def split(s: Made) -> None:
        ground = s["terrain"][0]
        s["terrain"] = [
            ground | {"name": "near", "center_m": [-1.0, 0.0, -0.1], "size_m": [2.0, 4.0, 0.2]},
            ground | {"name": "far", "center_m": [3.0, 0.0, -0.1], "size_m": [6.0, 4.0, 0.2]},
        ]

    report = judged(flat_walk(), split)
    assert report.valid
    assert report.margins[0].edge_m == pytest.approx(0.1)


def test_a_tilted_sole() -> None:
    for degrees, valid in ((4.0, False), (2.0, True)):
        tilt = partial(everywhere, effector="right_foot", place=(0.3, -0.09, 0.1), orientation_wxyz=tilted(degrees))
        report = judged(six_stairs(), tilt)
        assert report.valid is valid
    report = judged(
        six_stairs(), lambda s: everywhere(s, "right_foot", (0.3, -0.09, 0.1), orientation_wxyz=tilted(4.0))
    )
    assert faults(report) == [("phases[2].contacts[right_foot]", "its z axis is 4 degrees off the normal of 'stair 1'")]


def test_feet_in_the_same_place() -> None:
    report = judged(flat_walk(), lambda s: everywhere(s, "right_foot", (0.0, -0.09, 0.0), position_m=[0.05, 0.0, 0.0]))
    assert faults(report) == [("phases[0].contacts[right_foot]", "overlaps left_foot")]


def test_both_hands_in_one_place_of_the_rail() -> None:
    def take_same_place(s: Made) -> None:
        for phase in s["phases"]:
            held = [one for one in phase["contacts"] if one["effector"] == "right_hand"]
            phase["contacts"] += [one | {"effector": "left_hand"} for one in held]

    named = [one for one in faults(judged(stairs_with_rail(), take_same_place)) if "in the place of" in one[1]]
    assert named
    assert all(where.endswith(("contacts[left_hand]", "contacts[right_hand]")) for where, _ in named)


FIRST_HOLD = (-0.08, -0.58, 0.65)


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.02), (0.0, 0.03, 0.0), (0.0, 0.0, -0.02)])
def test_a_hand_off_the_rail(offset: tuple[float, float, float]) -> None:
    moved = (np.array(FIRST_HOLD) + offset).tolist()
    report = judged(stairs_with_rail(), lambda s: everywhere(s, "right_hand", FIRST_HOLD, position_m=moved))
    ((where, message),) = faults(report)
    assert where == "phases[0].contacts[right_hand]"
    assert "off the upper side of 'rail'" in message


def test_a_hand_past_the_end_of_the_rail() -> None:
    report = judged(stairs_with_rail(rail=HandRail(overhang_m=-0.05)), lambda s: None)
    assert "off the upper side of 'rail'" in dict(faults(report))["phases[0].contacts[right_hand]"]


def test_a_hand_with_the_wrong_normal() -> None:
    report = judged(
        stairs_with_rail(), lambda s: everywhere(s, "right_hand", FIRST_HOLD, orientation_wxyz=[1.0, 0.0, 0.0, 0.0])
    )
    assert faults(report) == [("phases[0].contacts[right_hand]", "its z axis is 26.6 degrees off the normal of 'rail'")]


def test_a_vertical_rail_cannot_be_leant_on() -> None:
    def change(s: Made) -> None:
        s["terrain"][-1].update(from_m=[-0.10, -0.58, 0.0], to_m=[-0.10, -0.58, 2.0])

    assert "vertical rail" in dict(faults(judged(stairs_with_rail(), change)))["phases[0].contacts[right_hand]"]


def test_a_hand_may_lean_on_a_box() -> None:
    def change(s: Made) -> None:
        s["terrain"][-1] = {"name": "shelf", "kind": "box", "center_m": [0.0, -0.5, 0.5], "size_m": [6.0, 0.1, 0.1]}
        s["phases"] = s["phases"][:1]
        contact(s, 0, "right_hand").update(position_m=[-0.08, -0.5, 0.55], orientation_wxyz=[1.0, 0.0, 0.0, 0.0])

    report = judged(stairs_with_rail(), change)
    assert report.valid
    assert [margin.surface for margin in report.margins if margin.effector == "right_hand"] == ["shelf"]


def test_a_hand_may_push_against_a_wall() -> None:
    def change(s: Made) -> None:
        s["terrain"][-1] = {"name": "wall", "kind": "box", "center_m": [0.0, -0.7, 1.0], "size_m": [6.0, 0.2, 2.0]}
        s["phases"] = s["phases"][:1]
        turned = [np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]
        contact(s, 0, "right_hand").update(position_m=[-0.08, -0.6, 0.9], orientation_wxyz=turned)

    report = judged(stairs_with_rail(), change)
    assert report.valid
    (margin,) = (m for m in report.margins if m.effector == "right_hand")
    assert (margin.surface, margin.height_m) == ("wall", pytest.approx(0.0, abs=1e-9))
    assert margin.edge_m == pytest.approx(0.9)


def test_a_hand_off_a_wall() -> None:
    def change(s: Made) -> None:
        s["terrain"][-1] = {"name": "wall", "kind": "box", "center_m": [0.0, -0.7, 1.0], "size_m": [6.0, 0.2, 2.0]}
        s["phases"] = s["phases"][:1]
        turned = [np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]
        contact(s, 0, "right_hand").update(position_m=[-0.08, -0.57, 0.9], orientation_wxyz=turned)

    assert faults(judged(stairs_with_rail(), change)) == [
        ("phases[0].contacts[right_hand]", "is in the air, 0.03 m off 'wall': move it by (0, -0.03, 0) m")
    ]


@pytest.mark.parametrize("seed", range(20))
def test_boxes_far_away_make_no_difference(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Looking at the near boxes only finds what looking at all of them finds, in a heap of boxes."""
    rng = np.random.default_rng(seed)

    def change(s: Made) -> None:
        s["terrain"] += [
            {
                "name": f"crate {i}",
                "kind": "box",
                "center_m": rng.uniform([-0.5, -0.7, -0.3], [1.5, 0.7, 1.0]).tolist(),
                "size_m": rng.uniform(0.05, 0.6, 3).tolist(),
                "orientation_wxyz": rng.normal(size=4).tolist(),
            }
            for i in range(12)
        ]

    scenario = stairs_with_rail()
    change(scenario)
    near = judged(deepcopy(scenario), lambda s: None)
    monkeypatch.setattr(_Ground, "_nearby_boxes", lambda self, *_: list(range(len(self.boxes))))
    everything = judged(scenario, lambda s: None)
    assert faults(near) == faults(everything)
    assert near.margins == everything.margins
