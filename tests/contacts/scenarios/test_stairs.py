"""The bundled scenarios: files equal builders, numbers are those of the experiments, nothing is in the way."""

import json
import runpy
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from experiments.bundled_scenarios import BUNDLED
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import HRP2, TALOS, Timing, Walker
from stridelab.contacts.scenarios.stairs import (
    HandRail,
    Stairs,
    climb,
    descent,
    flat_walk,
    six_stairs,
    stairs_with_rail,
)
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.sequence_swings import swing_of
from stridelab.contacts.terrain import Rail, depth_in_box_m
from stridelab.contacts.validation.surface_contact import outline_points_m
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.machine.models_folder import models_dir
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.schemas.scenarios import Scenario
from support.robots.scenario_bodies import SHAPES

SCRIPT = Path(__file__).parents[3] / "scripts" / "make_scenarios.py"


def bundled(name: str) -> ContactSequence:
    scenario = BUNDLED[name]()
    return sequence_of(scenario, effector_shapes(scenario["robot"]))


@pytest.mark.parametrize("name", BUNDLED)
def test_the_files_are_what_the_builders_make(name: str, tmp_path: Path) -> None:
    runpy.run_path(str(SCRIPT))["make_scenarios"](tmp_path)
    shipped = (models_dir() / "scenarios" / f"{name}.json").read_text(encoding="utf-8")
    assert shipped == (tmp_path / f"{name}.json").read_text(encoding="utf-8")
    assert json.loads(shipped) == BUNDLED[name]()


def test_nothing_else_is_bundled() -> None:
    assert {path.stem for path in (models_dir() / "scenarios").glob("*.json")} == set(BUNDLED)


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_scenarios_keep_the_contract_and_pass_the_judge(name: str) -> None:
    scenario = Scenario.model_validate(BUNDLED[name]()).model_dump(mode="json")
    report = validate_scenario(scenario, effector_shapes(scenario["robot"]))
    assert report.faults == ()
    assert not [remark for remark in report.remarks if remark.code == "swing-obstructed"]


@pytest.mark.parametrize(
    ("name", "duration_s", "phases"),
    [
        ("flat-walk", 9.8, 17),
        ("long-stride", 8.0, 11),
        ("six-stairs", 24.0, 25),
        ("stairs-with-rail", 36.4, 31),
        ("stairs-with-rail-hrp2", 36.4, 31),
        ("stairs-down", 17.6, 17),
    ],
)
def test_durations(name: str, duration_s: float, phases: int) -> None:
    sequence = bundled(name)
    assert sequence.duration_s == pytest.approx(duration_s)
    assert len(sequence.phases) == phases


def test_long_strides_span_90_centimetres_but_the_first_and_the_last() -> None:
    sequence = bundled("long-stride")
    swings = [swing_of(sequence, "right_foot" if k % 4 == 1 else "left_foot", k) for k in range(1, 11, 2)]
    lengths = [curve.end.position_m[0] - curve.start.position_m[0] for curve in swings]
    np.testing.assert_allclose(lengths, [0.45, 0.90, 0.90, 0.90, 0.45])


def test_six_stairs_are_climbed_right_foot_first() -> None:
    sequence = bundled("six-stairs")
    for i in range(1, 7):
        right, left = sequence.phases[4 * i - 2].contacts, sequence.phases[4 * i].contacts
        for contact in (right["right_foot"], left["left_foot"]):
            side = 0.09 if contact.effector == "left_foot" else -0.09
            np.testing.assert_allclose(contact.placement.position_m, [0.30 * i, side, 0.10 * i], atol=1e-9)
            assert contact.surface == f"stair {i}"
    first = sequence.terrain.boxes[1]
    assert first.placement.position_m[0] - first.size_m[0] / 2 == pytest.approx(0.105 + 0.055)


def test_the_hand_lies_on_the_rail_with_its_axes() -> None:
    sequence = bundled("stairs-with-rail")
    (rail,) = sequence.terrain.rails
    d = (rail.to_m - rail.from_m) / np.linalg.norm(rail.to_m - rail.from_m)
    assert np.degrees(np.arctan2(d[2], d[0])) == pytest.approx(26.565, abs=1e-3)
    hands = [phase.contacts["right_hand"] for phase in sequence.phases if "right_hand" in phase.contacts]
    for hand in hands:
        R = hand.placement.rotation
        axis = hand.placement.position_m - rail.radius_m * R[:, 2]
        np.testing.assert_allclose(R[:, 0], d, atol=1e-6)
        np.testing.assert_allclose(np.cross(axis - rail.from_m, d), 0.0, atol=1e-6)
        assert R[1, 2] == 0.0
        assert R[2, 2] > 0.0
        assert (hand.surface, hand.friction, hand.kind) == ("rail", 0.6, "point")
    np.testing.assert_allclose(hands[0].placement.position_m, [-0.30 + 0.22, -0.58, -0.15 + 0.80], atol=1e-6)
    feet = {c.friction for phase in sequence.phases for c in phase.contacts.values() if c.kind == "surface"}
    assert feet == {0.3}


@pytest.mark.parametrize("name", BUNDLED)
def test_soles_clear_the_treads_on_their_way(name: str) -> None:
    """The corners of a swinging sole never get inside a box; past the lift-off they are well above what they leave."""
    sequence = bundled(name)
    shapes = effector_shapes(sequence.robot)
    for k, phase in enumerate(sequence.phases):
        for effector in ("left_foot", "right_foot"):
            if effector in phase.contacts:
                continue
            curve = swing_of(sequence, effector, k)
            for t in np.linspace(0.0, curve.duration_s, 120):
                sole = curve.state_at(float(t)).placement.act(outline_points_m(shapes[effector]))
                for box in sequence.terrain.boxes:
                    assert depth_in_box_m(box, sole).max() < 1e-3
                    if 0.3 * curve.duration_s < t < 0.7 * curve.duration_s:
                        assert depth_in_box_m(box, sole).max() < -0.01


def test_talos_is_refused_a_stair_of_one_and_a_half_metres() -> None:
    obstructed, fault = validate_scenario(six_stairs(Stairs(1, 1.5)), effector_shapes("talos")).faults
    assert fault.where == "phases[2].contacts[right_foot]"
    assert "too far from left_foot" in fault.message
    assert (obstructed.where, obstructed.message) == ("phases[2]", "the trunk would pass through 'stair 1'")


def test_builders_take_other_stairs() -> None:
    scenario = six_stairs(Stairs(3, 0.15, depth_m=0.32, width_m=0.9), Timing(1.0, 1.0, 0.3))
    sequence = sequence_of(scenario, SHAPES)
    assert scenario["name"] == "Three stairs"
    assert len(sequence.terrain.boxes) == 4
    assert sequence.duration_s == pytest.approx(1.0 + 6 * 1.0 + 5 * 0.3 + 1.0)
    np.testing.assert_allclose(sequence.phases[-1].contacts["left_foot"].placement.position_m, [0.96, 0.09, 0.45])


def test_stairs_may_be_climbed_with_one_foot_on_each() -> None:
    """Right and left in turn, from the first stair on, level again on the top: one move more than stairs."""
    stairs = Stairs(3, 0.12, depth_m=0.28)
    scenario = climb(stairs, Timing(1.5, 1.0, 0.25), "alternate")
    assert scenario["name"] == "3 stairs of 12 cm"
    assert scenario["description"] == "3 stairs 12 cm high and 28 cm deep, one foot on each, from rest to rest."
    assert [surface["name"] for surface in scenario["terrain"]] == ["ground", "stair 1", "stair 2", "stair 3"]
    sequence = sequence_of(scenario, SHAPES)
    stood = [{name: at.surface for name, at in phase.contacts.items()} for phase in sequence.phases[::2]]
    assert [(at["right_foot"], at["left_foot"]) for at in stood] == [
        ("ground", "ground"),
        ("stair 1", "ground"),
        ("stair 1", "stair 2"),
        ("stair 3", "stair 2"),
        ("stair 3", "stair 3"),
    ]
    assert [phase.duration_s for phase in sequence.phases] == [1.5, 1.0, 0.25, 1.0, 0.25, 1.0, 0.25, 1.0, 1.5]
    both = climb(stairs, Timing(1.5, 1.0, 0.25))
    assert both["phases"] == six_stairs(stairs, Timing(1.5, 1.0, 0.25))["phases"]
    assert "both feet on each" in both["description"]


def test_builders_take_other_rails_and_walks() -> None:
    sequence = sequence_of(stairs_with_rail(rail=HandRail(0.30, 0.90, -0.55, radius_m=0.03)), SHAPES)
    assert [type(surface) for surface in sequence.terrain.surfaces][-1] is Rail
    np.testing.assert_allclose(sequence.phases[-1].contacts["right_hand"].placement.position_m, [1.5, -0.55, 1.5])
    assert len(sequence_of(flat_walk(steps=4, step_m=0.3), SHAPES).phases) == 9


@pytest.mark.parametrize("walker", [TALOS, HRP2])
def test_feet_stand_as_in_the_reference_posture(walker: Walker) -> None:
    """To a centimetre; the shoe reaches at least as far as the part that carries."""
    robot = load_robot(walker.robot)
    model, index = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    for effector, side in (("left_foot", 1.0), ("right_foot", -1.0)):
        assert data.oMf[index[effector]].translation[1] == pytest.approx(side * walker.foot_y_m, abs=0.01)
        half = robot.effectors[effector].contact_half_size_m
        assert half is not None
        assert half[0] <= walker.toe_m <= half[0] + 0.02
        assert half[0] <= walker.heel_m <= half[0] + 0.02


@pytest.mark.parametrize("walker", [TALOS, HRP2])
def test_toes_and_heels_keep_off_the_risers(walker: Walker) -> None:
    up, down = Stairs(3, 0.10).ascending_boxes(walker), Stairs(3, 0.10).descending_boxes(walker)
    for i in range(3):
        riser = up[i]["center_m"][0] - up[i]["size_m"][0] / 2
        assert riser - (0.30 * i + walker.toe_m) == pytest.approx(0.055)
        assert 0.30 * (i + 1) - walker.heel_m - riser > 0.005
        edge = down[i]["center_m"][0] + down[i]["size_m"][0] / 2
        assert 0.30 * (i + 1) - walker.heel_m - edge == pytest.approx(0.055)
        assert edge - (0.30 * i + walker.toe_m) > 0.005


def test_downstairs_ends_on_the_ground() -> None:
    sequence = sequence_of(descent(Stairs(2, 0.15)), effector_shapes("talos"))
    soles = [phase.contacts["right_foot"] for phase in sequence.phases if "right_foot" in phase.contacts]
    assert list(dict.fromkeys(sole.surface for sole in soles)) == ["stair 2", "stair 1", "ground"]
    np.testing.assert_allclose(soles[0].placement.position_m, [0.0, -0.09, 0.30])
    np.testing.assert_allclose(soles[-1].placement.position_m, [0.60, -0.09, 0.0], atol=1e-12)
