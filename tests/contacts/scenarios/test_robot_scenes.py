"""The bundled scenes, scaled to robots by the length of their legs and arms."""

from itertools import pairwise
from typing import get_args

import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.hand_scenes import RAIL_HAND_M, TALOS_ARM
from stridelab.contacts.scenarios.robot_scenes import HAND_SCENES, SCENES, TALOS_LEG_M
from stridelab.errors import InvalidInput
from stridelab.pipelines.commissioning.robot_walker import walker_facts
from stridelab.pipelines.scenarios.scaled_scenes import scene_for_robot
from stridelab.robots.loader import load_robot
from stridelab.schemas.robots import WalkerFacts
from stridelab.schemas.scenarios import Scenario, SceneName
from stridelab.wholebody.shoe_check import shoe_faults


def scaled_with_facts(scene: str, robot: str) -> tuple[Scenario, WalkerFacts]:
    facts = walker_facts(load_robot(robot))
    assert facts is not None
    return scene_for_robot(scene, robot, facts), facts


def rises_m(scenario: Scenario) -> set[float]:
    """Heights of the soles' steps between one phase and the next."""
    heights = [{c.effector: c.position_m[2] for c in phase.contacts} for phase in scenario.phases[::2]]
    steps = [after[k] - before[k] for before, after in pairwise(heights) for k in after]
    return {round(step, 6) for step in steps} - {0.0}


@pytest.mark.parametrize("robot", ["talos", "hrp2", "g1"])
@pytest.mark.parametrize("scene", [*SCENES, *HAND_SCENES])
def test_every_scene_is_valid_for_every_robot(scene: str, robot: str) -> None:
    scenario, _ = scaled_with_facts(scene, robot)
    sequence = sequence_of(scenario.model_dump(mode="json"), effector_shapes(robot))  # raises for an invalid one
    assert shoe_faults(load_robot(robot), sequence) == []
    assert scenario.robot == robot


@pytest.mark.parametrize("robot", ["talos", "hrp2", "g1"])
def test_stairs_are_as_high_for_the_legs_as_those_of_talos(robot: str) -> None:
    scenario, facts = scaled_with_facts("six-stairs", robot)
    (rise_m,) = rises_m(scenario)
    assert rise_m == pytest.approx(0.10 * facts.leg_m / TALOS_LEG_M, abs=1e-3)
    assert len([box for box in scenario.terrain if box.name.startswith("stair")]) == 6
    down, _ = scaled_with_facts("stairs-down", robot)
    assert rises_m(down) == {-rise_m}


def test_the_scale_is_that_of_the_legs_of_talos() -> None:
    facts = walker_facts(load_robot("talos"))
    assert facts is not None
    assert facts.leg_m == pytest.approx(TALOS_LEG_M, abs=5e-4)
    assert facts.shoulder_m == pytest.approx(TALOS_ARM.shoulder_m, abs=1e-3)
    assert facts.arm_m == pytest.approx(TALOS_ARM.length_m, abs=1e-3)


def test_a_hand_is_as_far_from_the_shoulder_for_the_length_of_the_arm() -> None:
    scenario, facts = scaled_with_facts("stand-up", "g1")
    assert facts.shoulder_m is not None
    assert facts.arm_m is not None
    (hand,) = (c.position_m for c in scenario.phases[0].contacts if c.effector == "right_hand")
    for own, shoulder, usual, usual_shoulder in zip(
        hand, facts.shoulder_m, RAIL_HAND_M, TALOS_ARM.shoulder_m, strict=True
    ):
        assert (own - shoulder) / facts.arm_m == pytest.approx((usual - usual_shoulder) / TALOS_ARM.length_m, abs=2e-3)


def test_a_scene_of_a_hand_is_refused_without_an_arm() -> None:
    facts = WalkerFacts(leg_m=0.8, foot_y_m=0.1, toe_m=0.1, heel_m=0.1)
    with pytest.raises(InvalidInput, match="no arm of at least four joints") as refusal:
        scene_for_robot("stand-up", "legs", facts)
    assert refusal.value.code == "robot-not-scalable"


def test_treads_are_deep_enough_for_long_shoes() -> None:
    facts = WalkerFacts(leg_m=0.4, foot_y_m=0.06, toe_m=0.14, heel_m=0.1)
    stairs = [box for box in scene_for_robot("six-stairs", "long", facts).terrain if box.name.startswith("stair")]
    noses_m = [box.center_m[0] - 0.5 * box.size_m[0] for box in stairs]  # type: ignore[union-attr]
    treads_m = [after - before for before, after in pairwise(noses_m)]
    assert min(treads_m) >= 0.14 + 0.1 + 0.02


def test_the_names_of_the_contract_are_those_of_the_scenes() -> None:
    assert set(get_args(SceneName)) == SCENES.keys() | HAND_SCENES.keys()


def test_other_scenes_and_a_robot_without_legs_are_refused_by_name() -> None:
    facts = WalkerFacts(leg_m=0.8, foot_y_m=0.1, toe_m=0.1, heel_m=0.1)
    with pytest.raises(InvalidInput, match="these can: flat-walk, long-stride, six-stairs, stairs-down") as refusal:
        scene_for_robot("wall-step", "g1", facts)
    assert refusal.value.code == "scene-not-scalable"
    with pytest.raises(InvalidInput, match="save its card again") as refusal:
        scene_for_robot("six-stairs", "old", None)
    assert refusal.value.code == "robot-not-scalable"
