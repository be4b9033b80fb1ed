"""Robots that are steered in physics, without a service."""

from functools import cache

from stridelab.pipelines.commissioning.commission_robot import foot_places_m, scaled_walk
from stridelab.pipelines.live.live_replay import LiveReplay
from stridelab.pipelines.plan_motion import plan_scenario_motion
from stridelab.robots.loader import load_robot
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.motion import WholeBodyMotion


def steerable_robot(name: str, floor_m: float) -> LiveReplay:
    """A robot that stands on a level floor of this edge."""
    return LiveReplay(load_robot(name), _short_walk(name, floor_m), {})


@cache
def _short_walk(name: str, floor_m: float) -> WholeBodyMotion:
    """Any motion that begins with the robot standing; it is left for the first command."""
    robot = load_robot(name)
    walk = scaled_walk(robot, foot_places_m(robot), 0.7)[0]
    for box in walk["terrain"]:
        box["size_m"][:2] = [floor_m, floor_m]
    return plan_scenario_motion(Scenario.model_validate(walk))
