"""Speed of the whole-body stage and of the replay; run by ``make bench`` (skipped otherwise).

``times_faster`` is the length of the motion over the process seconds it took, on one core.
"""

import time
from functools import cache

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from experiments.execution import CASES, replay_motion
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion

MOTIONS = [("talos", "wall-step"), ("talos", "six-stairs"), ("hrp2", "wall-step"), ("hrp2", "stairs-with-rail")]


@cache
def planned(robot_name: str, name: str) -> CentroidalPlan:
    robot, sequence = load_robot(robot_name), sequence_of(CASES[robot_name][name](), effector_shapes(robot_name))
    return solve(from_rest_to_rest(robot, sequence, load_proxies(robot_name)))


@cache
def followed(robot_name: str, name: str) -> WholeBodyMotion:
    plan = planned(robot_name, name)
    return WholeBodyController().run(load_robot(robot_name), plan.sequence, plan)


@pytest.mark.parametrize(("robot_name", "name"), MOTIONS)
def test_whole_body(benchmark: BenchmarkFixture, robot_name: str, name: str) -> None:
    """Every sample of a bundled scenario at 250 Hz."""
    robot, plan = load_robot(robot_name), planned(robot_name, name)
    took_s: list[float] = []

    def once() -> None:
        took_s.append(WholeBodyController().run(robot, plan.sequence, plan).solve_time_s)

    benchmark.pedantic(once, rounds=3)
    benchmark.extra_info["times_faster"] = round(plan.sequence.duration_s / sorted(took_s)[1], 1)


@pytest.mark.parametrize(("robot_name", "name"), MOTIONS[:1])
def test_certificate(benchmark: BenchmarkFixture, robot_name: str, name: str) -> None:
    """Every check of a motion, measured anew."""
    robot, plan, motion = load_robot(robot_name), planned(robot_name, name), followed(robot_name, name)
    proxies = load_proxies(robot_name)
    benchmark.pedantic(lambda: certify(robot, plan.sequence, plan, proxies, motion), rounds=3)


@pytest.mark.parametrize(("robot_name", "name"), MOTIONS[:3])
def test_replay(benchmark: BenchmarkFixture, robot_name: str, name: str) -> None:
    """In physics at 1 kHz, with the stabiliser, and a second of rest at the end."""
    motion = followed(robot_name, name)
    took_s: list[float] = []
    played_s: list[float] = []

    def once() -> None:
        started = time.process_time()
        played_s.append(float(replay_motion(robot_name, motion).time_s[-1]))
        took_s.append(time.process_time() - started)

    benchmark.pedantic(once, rounds=3)
    benchmark.extra_info["times_faster"] = round(played_s[0] / sorted(took_s)[1], 1)
