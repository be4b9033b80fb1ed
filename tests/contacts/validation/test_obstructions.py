"""Swings and the trunk between stances: what passes through the terrain is refused by name."""

import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.contacts.validation.validate import validate_scenario
from support.robots.scenario_bodies import Made, faults, judged


@pytest.mark.parametrize("size_m", [(0.02, 0.1, 0.3), (0.007, 4.0, 1.0), (0.02, 0.02, 0.6)], ids=str)
def test_a_swing_through_an_obstacle_is_refused(size_m: tuple[float, float, float]) -> None:
    """A board, a thin wall right across, and a post that passes between the points of the outline."""
    wall = {"name": "wall", "kind": "box", "center_m": [0.125, -0.07, size_m[2] / 2], "size_m": size_m}
    report = judged(flat_walk(), lambda s: s["terrain"].append(wall))
    where, message = faults(report)[0]
    assert where == "phases[1].contacts[right_foot]"
    assert message.startswith("its swing in phase 1 passes ")
    assert message.endswith(" cm deep through 'wall'")


def test_a_swing_from_a_contact_within_its_tolerance_is_free() -> None:
    """Contacts may be 5 mm inside their surface; a swing starts there."""

    def change(s: Made) -> None:
        for phase in s["phases"]:
            for one in phase["contacts"]:
                one["position_m"][2] = -0.004

    assert judged(flat_walk(), change).valid


@pytest.mark.parametrize(("height_m", "is_refused"), [(1.2, True), (0.5, False)])
def test_feet_to_both_sides_of_a_post_leave_no_way_for_the_trunk(height_m: float, is_refused: bool) -> None:
    post = {"name": "post", "kind": "box", "center_m": [0.2, 0.0, height_m / 2], "size_m": [0.03, 0.02, height_m]}
    walk = flat_walk()
    walk["terrain"].append(post)
    result = validate_scenario(walk, effector_shapes("talos")).faults
    assert [fault.message for fault in result] == ["the trunk would pass through 'post'"] * is_refused


def test_a_bar_at_the_height_of_the_trunk_is_refused() -> None:
    bar = {"name": "bar", "kind": "rail", "from_m": [0.2, -2.0, 0.7], "to_m": [0.2, 2.0, 0.7], "radius_m": 0.2}
    walk = flat_walk()
    walk["terrain"].append(bar)
    result = validate_scenario(walk, effector_shapes("talos")).faults
    assert [fault.message for fault in result] == ["the trunk would pass through 'bar'"]


def test_a_low_obstacle_is_stepped_over() -> None:
    def change(s: Made) -> None:
        s["terrain"].append(
            {"name": "sill", "kind": "box", "center_m": [0.125, -0.09, 0.05], "size_m": [0.02, 0.1, 0.1]}
        )

    report = judged(flat_walk(), change)
    assert report.valid
    assert report.remarks == ()
