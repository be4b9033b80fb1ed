"""Scenarios on uneven ground: ramps, spiral stairs, tilted stones, flights of stairs, rails."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.terrains.bounds import Bounds
from experiments.terrains.draw import Draw
from experiments.terrains.steps import Pose, Steps, mirrored, turned_box, wide_ground
from stridelab.contacts.scenarios.parts import Scenario, Timing, box, contact
from stridelab.contacts.scenarios.stairs import HandRail, Stairs, climb, descent

STONE_FRICTION = 0.7
RAMP_FRICTION = 0.6


def ramp(draw: Draw, bounds: Bounds) -> Scenario:
    """Up or down a ramp from a level platform, alternating feet, to a stance on the ramp."""
    walker, pitch = bounds.walker, math.radians(draw.number(bounds.slope_deg, 1))
    number, step_m = draw.integer(4, 7), draw.number(bounds.step_m)
    timing = draw.timing(bounds.careful_s, bounds.rest_s)
    edge_m, high_m = walker.toe_m + 0.03, 2.0
    along = Rotation.from_euler("y", -pitch)
    steps = Steps.from_pose(walker, timing, Pose(0.0, 0.0, 0.0, high_m))
    first_m, name = walker.heel_m + 0.03, draw.foot()
    for i in range(number + 1):
        at_m = first_m + min(i, number - 1) * step_m
        x, _, z = (np.array([edge_m, 0.0, high_m]) + along.apply([at_m, 0.0, 0.0])).tolist()
        steps.move_foot(name, Pose(x, 0.0, 0.0, z, pitch))
        name = "left_foot" if name == "right_foot" else "right_foot"
    long_m = first_m + number * step_m + 0.5
    middle = np.array([edge_m, 0.0, high_m]) + along.apply([long_m / 2, 0.0, 0.0])
    platform = box("platform", (-0.6, edge_m), (-0.8, 0.8), (high_m - 0.2, high_m))
    slope = turned_box("ramp", middle, (long_m, 1.6, 0.2), along, RAMP_FRICTION)
    text = f"{number} steps of {step_m:.2f} m on a ramp of {math.degrees(pitch):.0f} degrees."
    return steps.as_scenario("Ramp", text, [wide_ground(), platform, slope])


def spiral(draw: Draw, bounds: Bounds) -> Scenario:
    """Up a spiral stair that turns to the left, both feet on every tread."""
    walker, height_m = bounds.walker, draw.number(bounds.stair_height_m)
    radius_m, depth_m, gap_m = draw.number((1.2, 1.8)), draw.number(bounds.stair_depth_m), draw.number((0.05, 0.06))
    # treads narrow towards the axis: the inner foot needs the room that the riser's turn takes from it
    inner_m = (walker.foot_y_m + bounds.half_size_m[1]) * depth_m / radius_m
    depth_m, gap_m = depth_m + inner_m, gap_m + inner_m
    number, angle = draw.integer(2, 4), depth_m / radius_m
    steps = Steps.from_pose(walker, draw.timing(bounds.careful_s, bounds.rest_s), Pose(0.0, 0.0))
    boxes = []
    behind_m = depth_m - walker.toe_m - gap_m
    for i in range(1, number + 1):
        pose = _on_circle(i * angle, radius_m, i * height_m)
        for name in ("left_foot", "right_foot"):
            steps.move_foot(name, pose)
        long_m = behind_m + (walker.toe_m + 0.12 if i < number else 0.8)
        turn = Rotation.from_euler("z", pose.yaw_rad)
        middle = np.array([pose.x_m, pose.y_m, pose.z_m]) + turn.apply([long_m / 2 - behind_m, 0.0, 0.0])
        boxes.append(turned_box(f"tread {i}", middle, (long_m, 0.7, i * height_m), turn, 0.5))
    text = f"{number} treads of {100 * height_m:.0f} cm about an axis at {radius_m:.2f} m."
    return steps.as_scenario("Spiral stairs", text, [wide_ground(), *boxes])


def stones(draw: Draw, bounds: Bounds) -> Scenario:
    """Over tilted and turned stones, one for every step, to level ground."""
    walker, (half_long, half_wide) = bounds.walker, bounds.half_size_m
    size = (2 * half_long + 0.06, 2 * half_wide + 0.05, 0.20)
    step_m = draw.number((walker.toe_m + walker.heel_m + 0.05, walker.toe_m + walker.heel_m + 0.09))
    steps = Steps.from_pose(walker, draw.timing(bounds.careful_s, bounds.rest_s), Pose(0.0, 0.0))
    number, name, boxes = draw.integer(3, 5), draw.foot(), []
    for i in range(1, number + 1):
        angles = [draw.sign() * draw.number(bounds.tilt_deg) * share for share in (draw.number((0.2, 1.0)), 0.5)]
        turn = Rotation.from_euler("zyx", [draw.number((-8.0, 8.0)), *angles], degrees=True)
        side = 1.0 if name == "left_foot" else -1.0
        top = np.array([i * step_m, side * (walker.foot_y_m + draw.number((0.0, 0.03))), draw.number((0.04, 0.09))])
        steps.move(contact(name, (top[0], top[1], top[2]), turn.as_quat(scalar_first=True).tolist()))
        boxes.append(turned_box(f"stone {i}", top, size, turn, STONE_FRICTION))
        name = "left_foot" if name == "right_foot" else "right_foot"
    for _ in range(2):
        steps.move_foot(name, Pose((number + 1) * step_m + 0.07, 0.0))
        name = "left_foot" if name == "right_foot" else "right_foot"
    return steps.as_scenario("Stones", f"{number} tilted stones, {step_m:.2f} m apart.", [wide_ground(), *boxes])


def stairs(draw: Draw, bounds: Bounds) -> Scenario:
    """Up or down, both feet on every tread."""
    flight, timing = _flight(draw, bounds, draw.number(bounds.stair_height_m)), _climbing(draw, bounds)
    return (climb(flight, timing, "both", bounds.walker) if draw.coin() else descent(flight, timing, bounds.walker)) | {
        "name": "Stairs"
    }


def alternate(draw: Draw, bounds: Bounds) -> Scenario:
    """Up, one foot on every tread."""
    flight, timing = _flight(draw, bounds, draw.number(bounds.alternate_height_m)), _climbing(draw, bounds)
    return climb(flight, timing, "alternate", bounds.walker) | {"name": "Alternate stairs"}


def rail(draw: Draw, bounds: Bounds) -> Scenario:
    """Up stairs with the left hand on a rail, or both hands on two rails."""
    both = draw.coin()
    flight = replace(_flight(draw, bounds, draw.number(bounds.stair_height_m)), number=draw.integer(2, 3))
    ahead_m, height_m, aside_m = (
        draw.number(one) for one in (bounds.rail_ahead_m, bounds.rail_height_m, bounds.rail_aside_m)
    )
    hand_rail = HandRail(ahead_m, height_m, -aside_m)
    slope, walker = flight.height_m / flight.depth_m, bounds.walker
    timing = draw.timing((1.6, 2.0), (0.3, 0.4))

    def hands_at(x_m: float) -> list[dict[str, Any]]:
        right = hand_rail.hand_contact(x_m, slope)
        x, y, z = right["position_m"]
        left = {**right, "effector": "left_hand", "position_m": [x, -y, z]}
        return [right, left] if both else [left]

    def pose_at(stair: int) -> Pose:
        x, z = flight.foothold(stair)
        return Pose(x, 0.0, 0.0, z)

    feet = [pose_at(0).foot(name, walker.foot_y_m) for name in ("left_foot", "right_foot")]
    steps = Steps.from_contacts(walker, timing, *feet, *hands_at(0.0))
    for i in range(1, flight.number + 1):
        for hand in hands_at(i * flight.depth_m):
            steps.move(hand)
        for name in ("right_foot", "left_foot"):
            steps.move_foot(name, pose_at(i))
    right_rail = hand_rail.rail_surface(0.0, flight.number * flight.depth_m, slope) | {"name": "right rail"}
    with_rail = steps.as_scenario("Rail", "", [right_rail])
    left_rail = mirrored(with_rail)["terrain"][0] | {"name": "left rail"}
    rails = [right_rail, left_rail] if both else [left_rail]
    text = f"{flight.number} stairs of {100 * flight.height_m:.0f} cm with {'both hands' if both else 'the left hand'}."
    return with_rail | {"terrain": [wide_ground(), *flight.ascending_boxes(walker), *rails], "description": text}


def _flight(draw: Draw, bounds: Bounds, height_m: float) -> Stairs:
    depth_m, gap_m = draw.number(bounds.stair_depth_m), draw.number(bounds.stair_gap_m)
    return Stairs(draw.integer(3, 5), height_m, depth_m, toe_gap_m=gap_m)


def _climbing(draw: Draw, bounds: Bounds) -> Timing:
    return draw.timing(bounds.careful_s, bounds.rest_s)


def _on_circle(angle_rad: float, radius_m: float, z_m: float) -> Pose:
    """A pose on a circle about the left side that starts at the origin along x."""
    return Pose(radius_m * math.sin(angle_rad), radius_m * (1.0 - math.cos(angle_rad)), angle_rad, z_m)
