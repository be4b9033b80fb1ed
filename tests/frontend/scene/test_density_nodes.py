"""Densities of a plan stand at its contacts: a foot's with its touch, a hand's with the heading of each phase."""

import math

import numpy as np
import pytest

from stridelab.schemas.scenarios import Scenario, ScenarioContact, ScenarioPhase
from stridelab_web.scene.contacts import placed_contacts
from stridelab_web.scene.density_nodes import headings_rad, reach_places, shown_level_sets
from support.fakes import reachability, robots


def turned(effector: str, yaw_rad: float, x: float = 0.0) -> ScenarioContact:
    wxyz = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
    return ScenarioContact(effector=effector, position_m=(x, 0.0, 0.0), orientation_wxyz=wxyz)


RAIL = ScenarioContact(effector="right_hand", position_m=(0.3, -0.5, 0.9), orientation_wxyz=(0.0, 1.0, 0.0, 0.0))
LEFT, RIGHT, AHEAD = turned("left_foot", 0.0), turned("right_foot", 0.0), turned("right_foot", 0.6, 0.3)
TURNING = Scenario(
    name="turn",
    description="",
    robot="boxes",
    friction=0.3,
    terrain=[],
    phases=[
        ScenarioPhase(duration_s=1.0, contacts=[LEFT, RIGHT, RAIL]),
        ScenarioPhase(duration_s=0.5, contacts=[LEFT, RAIL]),
        ScenarioPhase(duration_s=2.0, contacts=[LEFT, AHEAD, RAIL]),
    ],
)


def test_the_heading_is_that_of_the_soles_and_of_those_that_were_left() -> None:
    assert headings_rad(TURNING) == pytest.approx([0.0, 0.0, 0.3])
    hands = TURNING.model_copy(update={"phases": [ScenarioPhase(duration_s=1.0, contacts=[RAIL])]})
    assert headings_rad(hands) == [0.0]


def test_a_foot_has_one_place_per_touch_and_a_hand_one_per_phase() -> None:
    places = reach_places(TURNING)
    reports = [(place.name, place.start_s, place.end_s) for place in places]
    assert reports == [
        ("/reach/1/0", 0.0, 3.5),
        ("/reach/2/0", 0.0, 1.0),
        ("/reach/3/0", 0.0, 1.0),
        ("/reach/3/1", 1.0, 1.5),
        ("/reach/3/2", 1.5, 3.5),
        ("/reach/4/0", 1.5, 3.5),
    ]


def test_places_are_there_as_long_as_their_contacts() -> None:
    scenario = robots.scenario()
    held_s = {touch.number: touch.end_s - touch.start_s for touch in placed_contacts(scenario)}
    shown_s = dict.fromkeys(held_s, 0.0)
    for place in reach_places(scenario):
        shown_s[int(place.name.split("/")[2])] += place.end_s - place.start_s
    assert shown_s == pytest.approx(held_s)


def test_a_density_in_the_heading_frame_turns_with_the_soles_only() -> None:
    last = reach_places(TURNING)[4]
    upright, tilted = (
        shown_level_sets(reachability.reach(each))["right_hand"][0] for each in ("conditioned", "uniform")
    )
    assert last.orientation_wxyz(upright) == pytest.approx((math.cos(0.15), 0, 0, math.sin(0.15)))
    assert last.orientation_wxyz(tilted) == RAIL.orientation_wxyz


def test_the_level_set_of_four_fifths_is_shown() -> None:
    result, level = shown_level_sets(reachability.reach("uniform"))["left_foot"]
    assert (result.card.effector, level.mass) == ("left_foot", 0.8)
    assert np.ptp(np.array(level.vertices_m), axis=0) == pytest.approx([0.3] * 3)
    assert shown_level_sets(None) == {}
