"""Scaling of a recorded walk to a robot, and the scenario of it."""

from dataclasses import replace
from itertools import pairwise
from math import cos, sin

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.pipelines.imitation.person_tracks import tracks_of_robot
from stridelab.pipelines.imitation.recorded_walk import Foothold, RecordedWalk, rises_of, walk_of_motion
from stridelab.pipelines.imitation.robot_walk import LEAST_FOOTHOLDS, RobotScale, scale_walk
from stridelab.pipelines.plan_problem import validate_scenario
from stridelab.robots.loader import load_robot
from stridelab.schemas.scenarios import Scenario
from support.recordings.flat_footed import FlatFootedWalk

HIPS_M = 0.9
HALF = RobotScale("talos", 0.45, 0.1)


def person(truth: FlatFootedWalk) -> RecordedWalk:
    return walk_of_motion(truth.motion, truth.contacts, truth.gait_steps, HIPS_M)


def test_lengths_scale_with_the_hips_and_times_with_their_root() -> None:
    """At pace 1 and with all of the steps, the Froude number is the person's."""
    truth = FlatFootedWalk(width_m=0.3)
    walk = scale_walk(person(truth), HALF)
    places = np.array([hold.position_m for hold in walk.footholds])
    assert np.diff(places[:, 0]) == pytest.approx(np.full(5, 0.5 * truth.length_m), abs=1e-3)
    assert np.abs(places[:, 1]) == pytest.approx(np.full(6, 0.25 * truth.width_m), abs=1e-3)
    assert walk.swing_s == pytest.approx(np.full(6, np.sqrt(0.5) * truth.swing_s))
    speed = 0.5 * truth.length_m / (np.sqrt(0.5) * (truth.swing_s + truth.both_s))
    assert speed**2 / HALF.hip_height_m == pytest.approx((truth.length_m / 0.5) ** 2 / HIPS_M)
    assert walk.widened_m == pytest.approx(0.0)


def test_a_share_shortens_steps_alone() -> None:
    truth = FlatFootedWalk(width_m=0.3)
    whole, short = scale_walk(person(truth), HALF), scale_walk(person(truth), HALF, step_share=0.7)
    for one, other in zip(whole.footholds, short.footholds, strict=True):
        assert other.position_m == pytest.approx([0.7 * one.position_m[0], one.position_m[1]])
    assert short.swing_s == pytest.approx(whole.swing_s)


def test_the_person_stands_where_and_when_the_robot_does() -> None:
    truth, pace = FlatFootedWalk(width_m=0.3), 0.6
    recorded, motion = person(truth), truth.motion
    points = {"com": motion.com_m} | {side: foot.outline_m.mean(axis=1) for side, foot in motion.feet.items()}
    for share in (1.0, 0.7):
        walk = scale_walk(recorded, HALF, step_share=share)
        phases = walk.scenario("walk", pace)["phases"]
        durations_s = [one["duration_s"] for one in phases]
        columns = tracks_of_robot(motion.time_s, points, recorded, walk, pace, durations_s)
        ends_s = np.cumsum(durations_s)
        for k, hold in enumerate(recorded.footholds[1:-1], 1):
            rests_s = ends_s[2 * k - 1] + 0.5 * durations_s[2 * k]
            own_s = truth.strike_s(k) + 0.5 * truth.both_s
            foot, com = (
                [np.interp(rests_s, columns["time_s"], columns[f"{name}_{axis}_m"]) for axis in "xy"]
                for name in (hold.side, "com")
            )
            if share == 1.0:
                middle = points[hold.side][motion.find_sample(own_s), :2] - hold.position_m
                assert foot == pytest.approx(walk.footholds[k].position_m + 0.5 * middle, abs=2e-3)
            # the body is scaled by the legs alone, its way by the share of the steps as well
            before = np.interp(rests_s - 0.5, columns["time_s"], columns["com_x_m"])
            assert com[0] - before == pytest.approx(share * 0.5 * 1.2 * 0.5 * pace / np.sqrt(0.5), rel=1e-3)
            reach_m = points[hold.side][motion.find_sample(own_s), 0] - motion.com_m[motion.find_sample(own_s), 0]
            assert foot[0] - com[0] == pytest.approx(0.5 * reach_m, abs=5e-3)
    unknown = replace(recorded, strikes_s=np.full(len(recorded.footholds), np.nan))
    assert tracks_of_robot(motion.time_s, points, unknown, walk, pace, durations_s) == {}


def test_narrow_steps_are_widened_to_what_the_soles_need() -> None:
    truth = FlatFootedWalk(width_m=0.1)
    walk = scale_walk(person(truth), HALF)
    left = np.array([hold.position_m[1] for hold in walk.footholds])
    assert np.abs(np.diff(left)) == pytest.approx(np.full(5, HALF.step_width_min_m))
    assert walk.widened_m == pytest.approx(HALF.step_width_min_m - 0.5 * truth.width_m, abs=1e-3)


@pytest.mark.parametrize("turn", [0.3, -0.2])
def test_a_walk_askew_in_its_frame_is_straightened(turn: float) -> None:
    walk = person(FlatFootedWalk(width_m=0.3))
    R = np.array([[cos(turn), -sin(turn)], [sin(turn), cos(turn)]])
    turned = replace(
        walk,
        footholds=tuple(
            Foothold(hold.side, R @ hold.position_m + [2.0, -1.0], hold.yaw_rad + turn) for hold in walk.footholds
        ),
    )
    for one, other in zip(scale_walk(walk, HALF).footholds, scale_walk(turned, HALF).footholds, strict=True):
        assert other.position_m == pytest.approx(one.position_m, abs=2e-3)
        assert other.yaw_rad == pytest.approx(one.yaw_rad, abs=2e-3)


def test_the_last_stride_is_repeated_where_few_steps_are_recorded() -> None:
    truth = FlatFootedWalk(steps=3, width_m=0.3)
    walk = scale_walk(person(truth), HALF)
    assert len(walk.footholds) == LEAST_FOOTHOLDS
    assert walk.repeated == LEAST_FOOTHOLDS - 4
    sides = [hold.side for hold in walk.footholds]
    assert all(a != b for a, b in pairwise(sides))
    assert np.diff([hold.position_m[0] for hold in walk.footholds]) == pytest.approx(np.full(5, 0.3), abs=1e-3)
    assert len(walk.swing_s) == len(walk.double_support_s) == LEAST_FOOTHOLDS


def recorded_climb(rise_m: float, steps: int = 5) -> RecordedWalk:
    """A walk with a foot on every stair but the first two footholds, whose heights the markers give within 1 cm."""
    truth = FlatFootedWalk(steps=steps, width_m=0.3)
    noise = 0.01 * np.cos(np.arange(steps + 1))
    heights = 1.3 + rise_m * np.maximum(np.arange(steps + 1) - 1, 0) + noise
    return walk_of_motion(truth.motion, truth.contacts, truth.gait_steps, HIPS_M, heights.tolist())


@pytest.mark.parametrize("rise_m", [0.17, -0.15])
def test_footholds_at_several_heights_are_treads(rise_m: float) -> None:
    recorded = recorded_climb(rise_m)
    rises_m = rises_of(recorded.footholds)
    assert rises_m[0] == 0.0, "within 5 cm is one tread"
    assert rises_m[1:] == pytest.approx(np.full(4, rise_m), abs=0.02)
    assert min(hold.height_m for hold in recorded.footholds) == 0.0
    assert not recorded.is_level
    scale = RobotScale.of_robot(load_robot("talos"))
    walk = scale_walk(recorded, scale, step_share=0.5)
    assert walk.rise_m == pytest.approx(0.5 * walk.length_scale * rise_m, abs=0.005)
    assert walk.deepened_m > 0.0
    body = walk.scenario("Stairs", 0.5)
    boxes = [
        (box["center_m"][0] - box["size_m"][0] / 2, box["center_m"][0] + box["size_m"][0] / 2,
         box["center_m"][2] + box["size_m"][2] / 2)
        for box in body["terrain"]
    ]  # fmt: skip
    assert [one[1] for one in boxes[:-1]] == pytest.approx([one[0] for one in boxes[1:]], abs=1e-5)
    assert len(boxes) == 5
    for phase in body["phases"]:
        for contact in phase["contacts"]:
            x, _, z = contact["position_m"]
            (top,) = [(low, high) for low, high, height in boxes if low < x < high and abs(height - z) < 1e-5]
            assert top[0] < x - scale.heel_m
            assert x + scale.toe_m < top[1]
    first, last = body["phases"][0]["contacts"], body["phases"][-1]["contacts"]
    for ends in (first, last):
        assert ends[0]["position_m"][2] == ends[1]["position_m"][2]
    sequence, _ = validate_scenario(Scenario.model_validate(body))
    assert [len(phase.contacts) for phase in sequence.phases] == [2, 1] * 6 + [2]


def test_repeated_strides_go_on_climbing() -> None:
    walk = scale_walk(recorded_climb(0.17, steps=3), HALF)
    assert walk.repeated == 2
    rises = np.diff([hold.height_m for hold in walk.footholds])
    assert rises[1:] == pytest.approx(np.full(4, 0.5 * 0.17), abs=0.01)


def test_the_person_climbs_beside_the_robot() -> None:
    """The CoM is as high above the tread as the person's, scaled; its way up has the share of the stairs."""
    recorded = replace(recorded_climb(0.17), com_height_m=0.9)
    truth, share = FlatFootedWalk(width_m=0.3), 0.5
    heights = np.array([hold.height_m for hold in recorded.footholds])
    strikes = recorded.strikes_s[1:]
    com = truth.motion.com_m.copy()
    com[:, 2] = 0.9 + 3.0 + np.interp(truth.motion.time_s, strikes, 0.5 * (heights[1:] + heights[:-1]))
    walk = scale_walk(recorded, HALF, step_share=share)
    durations_s = [one["duration_s"] for one in walk.scenario("walk", 0.5)["phases"]]
    columns = tracks_of_robot(truth.motion.time_s, {"com": com}, recorded, walk, 0.5, durations_s)
    ends_s = np.cumsum(durations_s)
    for k in range(2, len(recorded.footholds)):
        middle = 0.5 * (walk.footholds[k].height_m + walk.footholds[k - 1].height_m)
        at_strike = np.interp(ends_s[2 * k - 1], columns["time_s"], columns["com_z_m"])
        assert at_strike == pytest.approx(0.5 * 0.9 + middle, abs=0.01)


def test_the_scenario_stands_at_both_ends_and_steps_in_turn() -> None:
    truth = FlatFootedWalk(toe_out_rad=0.5)
    scale = RobotScale.of_robot(load_robot("talos"))
    walk = scale_walk(person(truth), scale, step_share=0.6)
    body = walk.scenario("Walk", 0.5)
    sequence, _ = validate_scenario(Scenario.model_validate(body))
    counts = [len(phase.contacts) for phase in sequence.phases]
    assert counts == [2, 1] * 6 + [2]
    for phase in (sequence.phases[0], sequence.phases[-1]):
        left, right = (phase.contacts[f"{side}_foot"].placement.position_m for side in ("left", "right"))
        assert left[0] == pytest.approx(right[0])
        assert left[1] - right[1] >= scale.step_width_min_m - 1e-6
    assert sequence.durations_s[1] == pytest.approx(2.0 * walk.swing_s[1], abs=1e-3)
    assert sequence.durations_s[2] == pytest.approx(2.0 * walk.double_support_s[1], abs=1e-3)
    R = sequence.phases[0].contacts["left_foot"].placement.rotation
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(np.radians(15.0), abs=1e-6)  # toes far out are turned back


@pytest.mark.parametrize(("robot", "height_m"), [("talos", 0.75), ("g1", 0.6), ("hrp2", 0.7)])
def test_hips_of_the_bundled_robots(robot: str, height_m: float) -> None:
    """Published leg lengths: TALOS 0.38 + 0.325 + 0.107 m, HRP-2 0.3 + 0.3 + 0.105 m, G1 about 0.3 + 0.3 m."""
    assert RobotScale.of_robot(load_robot(robot)).hip_height_m == pytest.approx(height_m, abs=0.09)


def test_a_robot_without_soles_is_refused() -> None:
    robot = load_robot("talos")
    handed = replace(robot, effectors={k: v for k, v in robot.effectors.items() if "hand" in k})
    with pytest.raises(InvalidInput) as caught:
        RobotScale.of_robot(handed)
    assert caught.value.code == "feet-missing"
