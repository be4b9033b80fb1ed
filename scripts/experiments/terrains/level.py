"""Scenarios on level ground: arcs, turns on the spot, sidesteps, quick and long walks, beams, bars to step over."""

import math
from dataclasses import replace

import numpy as np

from experiments.terrains.bounds import Bounds
from experiments.terrains.draw import Draw
from experiments.terrains.steps import Pose, Steps, wide_ground
from stridelab.contacts.scenarios.parts import Scenario, box


def arc(draw: Draw, bounds: Bounds) -> Scenario:
    """A walk along an arc to the left, alternating feet."""
    number, step_m, turn_deg = draw.integer(5, 9), draw.number(bounds.step_m), draw.number(bounds.arc_deg)
    steps = Steps.from_pose(bounds.walker, draw.timing(bounds.level_s, bounds.rest_s), Pose(0.0, 0.0))
    _walk(steps, [(step_m, math.radians(turn_deg))] * number, draw.foot())
    text = f"{number} steps of {step_m:.2f} m, each turned by {turn_deg:.0f} degrees."
    return steps.as_scenario("Arc", text, [wide_ground()])


def turn(draw: Draw, bounds: Bounds) -> Scenario:
    """A turn to the left on the spot, the left foot first."""
    turn_deg = draw.number(bounds.turn_deg)
    number = min(6, max(2, round(180.0 / turn_deg)))
    steps = Steps.from_pose(bounds.walker, draw.timing(bounds.level_s, bounds.rest_s), Pose(0.0, 0.0))
    for i in range(1, number + 1):
        for name in ("left_foot", "right_foot"):
            steps.move_foot(name, Pose(0.0, 0.0, i * math.radians(turn_deg)))
    return steps.as_scenario("Turn", f"{number} turns of {turn_deg:.0f} degrees on the spot.", [wide_ground()])


def sidestep(draw: Draw, bounds: Bounds) -> Scenario:
    """Steps to the left, some of them ahead or back as well."""
    side_m, ahead_m, number = draw.number(bounds.side_m), draw.number((-0.08, 0.12)), draw.integer(2, 5)
    steps = Steps.from_pose(bounds.walker, draw.timing(bounds.level_s, bounds.rest_s), Pose(0.0, 0.0))
    for i in range(1, number + 1):
        for name in ("left_foot", "right_foot"):
            steps.move_foot(name, Pose(i * ahead_m, i * side_m))
    text = f"{number} steps aside of {side_m:.2f} m, {ahead_m:+.2f} m ahead."
    return steps.as_scenario("Sidesteps", text, [wide_ground()])


def walk(draw: Draw, bounds: Bounds) -> Scenario:
    """A quick straight walk, or 18 to 30 steps with a turn now and then."""
    if draw.coin():
        number, step_m = draw.integer(6, 10), draw.number(bounds.quick_step_m)
        timing = draw.timing(bounds.quick_s, bounds.quick_rest_s)
        steps = Steps.from_pose(bounds.walker, timing, Pose(0.0, 0.0))
        _walk(steps, [(step_m, 0.0)] * number, draw.foot())
        text = f"{number} steps of {step_m:.2f} m in {timing.move_s + timing.rest_s:.2f} s each."
        return steps.as_scenario("Quick walk", text, [wide_ground()])
    number, step_m = draw.integer(18, 30), draw.number(bounds.step_m)
    turn_deg = draw.number(bounds.arc_deg) * draw.sign()
    steps = Steps.from_pose(bounds.walker, draw.timing(bounds.level_s, bounds.rest_s), Pose(0.0, 0.0))
    turns = [math.radians(turn_deg) if i % 8 >= 5 else 0.0 for i in range(number)]
    _walk(steps, [(step_m, one) for one in turns], draw.foot())
    text = f"{number} steps of {step_m:.2f} m, three of every eight turned by {turn_deg:.0f} degrees."
    return steps.as_scenario("Long walk", text, [wide_ground()])


def beam(draw: Draw, bounds: Bounds) -> Scenario:
    """One foot before the other along a beam, from a stance on it."""
    walker, (half_long, half_wide) = bounds.walker, bounds.half_size_m
    width_m, height_m = draw.number(bounds.beam_width_m), draw.number((0.05, 0.20))
    long_m = max(2 * half_long, walker.toe_m + walker.heel_m)
    step_m = draw.number((long_m + 0.03, long_m + 0.08))
    narrow = replace(walker, foot_y_m=max(0.0, min(walker.foot_y_m, width_m / 2 - half_wide - 0.005)))
    number, first = draw.integer(3, 6), draw.foot()
    other = "left_foot" if first == "right_foot" else "right_foot"
    feet = (Pose(0.0, 0.0, 0.0, height_m), Pose(step_m, 0.0, 0.0, height_m))
    start = (feet[0].foot(first, narrow.foot_y_m), feet[1].foot(other, narrow.foot_y_m))
    steps = Steps.from_contacts(narrow, draw.timing(bounds.careful_s, bounds.rest_s), *start)
    for i in range(number):
        steps.move_foot((first, other)[i % 2], Pose((i + 2) * step_m, 0.0, 0.0, height_m))
    plank = box("beam", (-0.4, (number + 2) * step_m + 0.3), (-width_m / 2, width_m / 2), (0.0, height_m))
    return steps.as_scenario("Beam", f"{number} steps along a beam {width_m:.2f} m wide.", [wide_ground(), plank])


def bar(draw: Draw, bounds: Bounds) -> Scenario:
    """Over bars that lie across the way, both feet between them."""
    walker = bounds.walker
    height_m, depth_m = draw.number(bounds.bar_height_m), draw.number(bounds.bar_depth_m)
    room_m, number = draw.number((0.03, 0.05)), draw.integer(1, 2)
    stride_m = walker.toe_m + walker.heel_m + depth_m + 2 * room_m
    steps = Steps.from_pose(walker, draw.timing(bounds.careful_s, bounds.rest_s), Pose(0.0, 0.0))
    bars, first = [], draw.foot()
    other = "left_foot" if first == "right_foot" else "right_foot"
    for i in range(number):
        front_m = i * stride_m + walker.toe_m + room_m
        bars.append(box(f"bar {i + 1}", (front_m, front_m + depth_m), (-0.6, 0.6), (0.0, height_m)))
        for name in (first, other):
            steps.move_foot(name, Pose((i + 1) * stride_m, 0.0))
    text = f"Over {number} bars {100 * height_m:.0f} cm high and {100 * depth_m:.0f} cm deep."
    return steps.as_scenario("Bars", text, [wide_ground(), *bars])


def _walk(steps: Steps, moves: list[tuple[float, float]], first: str) -> None:
    """Alternating steps, each ahead by a length and turned by an angle; the other foot closes the stance."""
    pose, name = Pose(0.0, 0.0), first
    for ahead_m, turn_rad in moves:
        yaw = pose.yaw_rad + turn_rad
        middle = yaw - turn_rad / 2
        pose = Pose(pose.x_m + ahead_m * np.cos(middle), pose.y_m + ahead_m * np.sin(middle), yaw)
        steps.move_foot(name, pose)
        name = "left_foot" if name == "right_foot" else "right_foot"
    steps.move_foot(name, pose)
