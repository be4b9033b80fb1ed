"""Scenarios become contact sequences and come back."""

from typing import Any

import numpy as np
import pytest

from experiments.bundled_scenarios import BUNDLED
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import scenario_of, sequence_of
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box, Rail
from stridelab.contacts.validation.validate import build_validated
from stridelab.errors import InvalidInput
from stridelab.schemas.scenarios import Scenario
from support.robots.scenario_bodies import SHAPES


def same(a: ContactSequence, b: ContactSequence) -> None:
    assert (a.name, a.robot, a.friction, a.effectors) == (b.name, b.robot, b.friction, b.effectors)
    assert a.start_com_height_m == b.start_com_height_m
    for one, other in zip(a.terrain.surfaces, b.terrain.surfaces, strict=True):
        assert (one.name, one.friction, type(one)) == (other.name, other.friction, type(other))
        if isinstance(one, Box) and isinstance(other, Box):
            np.testing.assert_allclose(one.placement.position_m, other.placement.position_m)
            np.testing.assert_allclose(one.placement.rotation, other.placement.rotation, atol=1e-12)
            np.testing.assert_allclose(one.size_m, other.size_m)
        if isinstance(one, Rail) and isinstance(other, Rail):
            np.testing.assert_allclose((*one.from_m, *one.to_m), (*other.from_m, *other.to_m))
            assert one.radius_m == other.radius_m
    for first, second in zip(a.phases, b.phases, strict=True):
        assert first.duration_s == second.duration_s
        assert list(first.contacts) == list(second.contacts)
        for name, contact in first.contacts.items():
            twin = second.contacts[name]
            assert (contact.surface, contact.friction, contact.kind) == (twin.surface, twin.friction, twin.kind)
            np.testing.assert_allclose(contact.placement.position_m, twin.placement.position_m)
            np.testing.assert_allclose(contact.placement.rotation, twin.placement.rotation, atol=1e-12)


def test_a_validated_scenario_is_built_without_looking_for_faults() -> None:
    for name, robot in (("stairs-with-rail", "talos"), ("stepping-stones-hrp2", "hrp2")):
        scenario = Scenario.model_validate(BUNDLED[name]()).model_dump(mode="json")
        same(build_validated(scenario, effector_shapes(robot)), sequence_of(scenario, effector_shapes(robot)))


@pytest.mark.parametrize("name", BUNDLED)
def test_there_and_back(name: str) -> None:
    shapes = effector_shapes(BUNDLED[name]()["robot"])
    sequence = sequence_of(BUNDLED[name](), shapes)
    scenario = Scenario.model_validate(scenario_of(sequence, "again"))
    assert scenario.description == "again"
    same(sequence, sequence_of(scenario.model_dump(mode="json"), shapes))


def test_a_box_may_be_turned_by_yaw_or_by_a_quaternion() -> None:
    scenario = BUNDLED["flat-walk"]()
    scenario["terrain"][0]["yaw_rad"] = 0.3
    turned = scenario["terrain"][0] | {"orientation_wxyz": [2 * np.cos(0.15), 0.0, 0.0, 2 * np.sin(0.15)]}
    del turned["yaw_rad"]
    other: dict[str, Any] = scenario | {"terrain": [turned]}
    same(sequence_of(scenario, SHAPES), sequence_of(other, SHAPES))


def test_a_surface_with_friction_of_its_own_lends_it_to_its_contacts() -> None:
    scenario = BUNDLED["six-stairs"]()
    scenario["terrain"][2]["friction"] = 0.7
    sequence = sequence_of(scenario, SHAPES)
    result = {c.surface: c.friction for phase in sequence.phases for c in phase.contacts.values()}
    assert result["stair 2"] == 0.7
    assert {friction for name, friction in result.items() if name != "stair 2"} == {0.3}


def test_an_invalid_scenario_tells_all_its_faults() -> None:
    scenario = BUNDLED["six-stairs"]()
    scenario["phases"][3]["duration_s"] = -1.0
    scenario["phases"][6]["contacts"][0]["orientation_wxyz"] = [0.0, 0.0, 0.0, 0.0]
    with pytest.raises(InvalidInput, match=r"phases\[3\].*and 1 more") as caught:
        sequence_of(scenario, SHAPES)
    assert caught.value.code == "scenario-invalid"
    assert [fault.where for fault in caught.value.faults] == [
        "phases[3].duration_s",
        "phases[6].contacts[left_foot]",
    ]
