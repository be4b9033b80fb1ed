"""Every bundled scenario carried out: planned, followed by the whole body, certified, replayed in physics.

What depends on the robot (its feet, where its hand reaches a rail or a wall) is here; the rest is that of the builders.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import hand_bounds_n
from stridelab.centroidal.native.availability import Native, availability
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.bundled import BUNDLED
from stridelab.contacts.scenarios.obstacles import stand_up
from stridelab.contacts.scenarios.parts import HRP2, Walker
from stridelab.contacts.scenarios.stairs import descent, flat_walk, long_stride, six_stairs
from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import StridelabError
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Check
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.disturbances import NONE, Disturbances
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.sensors import Observe, as_sensed

Scenario = dict[str, Any]
Builder = Callable[[], Scenario]
T = TypeVar("T")
G1: Final = Walker("g1", 0.1185, 0.107, 0.101)
"""Half the distance of the soles in the reference posture; toe and heel of the shoe."""


def _of_hrp2() -> dict[str, Builder]:
    return {
        "long-stride": lambda: long_stride(walker=HRP2),
        "six-stairs": lambda: six_stairs(walker=HRP2),
        "stairs-with-rail": BUNDLED["stairs-with-rail-hrp2"],
        "flat-walk": lambda: flat_walk(walker=HRP2),
        "stairs-down": lambda: descent(walker=HRP2),
        "stepping-stones": BUNDLED["stepping-stones-hrp2"],
        "wall-step": BUNDLED["wall-step-hrp2"],
        "stand-up": lambda: stand_up(0.70, hand_m=(0.20, -0.45, 0.60), walker=HRP2),
    }


CASES: Final[Mapping[str, Mapping[str, Builder]]] = {
    "talos": {name: BUNDLED[name] for name in _of_hrp2()},
    "hrp2": _of_hrp2(),
    "g1": {
        "long-stride": lambda: long_stride(step_m=0.25, walker=G1),
        "flat-walk": lambda: flat_walk(step_m=0.15, walker=G1),
    },
}
"""Builders by robot and name, the thesis' three experiments first."""


@dataclass(frozen=True)
class Execution:
    """What became of one scenario; ``failed`` says at which error it ended, empty where it came to its end.

    ``cpu_s`` are process seconds by stage, ``replay`` the numbers of the replay, ``missed`` what one that is not
    ``completed`` lacks.
    """

    robot: str
    name: str
    duration_s: float = 0.0
    failed: str = ""
    checks: tuple[Check, ...] = ()
    cpu_s: Mapping[str, float] | None = None
    replay: Mapping[str, float] | None = None
    completed: bool = False
    fell: bool = False
    missed: tuple[str, ...] = ()

    def value(self, check: str) -> float:
        """The value of a check; NaN where there is none."""
        return next((c.value for c in self.checks if c.name == check), float("nan"))

    @property
    def certified(self) -> bool:
        """Whether there is a motion that passes every check."""
        return bool(self.checks) and all(check.passed for check in self.checks)


def posed(robot: Robot, sequence: ContactSequence, proxies: Mapping[str, Proxy]) -> CentroidalProblem:
    """As ``plan-motion`` poses it for a body: forces that do not jump, hands that bear what their arms can."""
    return replace(
        from_rest_to_rest(robot, sequence, proxies),
        control=CircularCones() if isinstance(availability(), Native) else PYRAMIDS,
        shape="cubic",
        bounds=PathBounds(None, hand_bounds_n(robot, sequence)),
    )


def followed(robot_name: str, name: str) -> WholeBodyMotion:
    """The whole body's motion alone. Raises ``NotEstimable`` where the body cannot follow."""
    robot = load_robot(robot_name)
    sequence = sequence_of(CASES[robot_name][name](), effector_shapes(robot_name))
    plan = solve(posed(robot, sequence, load_proxies(robot_name)))
    return WholeBodyController().run(robot, sequence, plan)


def execute(robot_name: str, name: str) -> Execution:
    """Carry out one scenario."""
    robot = load_robot(robot_name)
    cpu_s: dict[str, float] = {}
    duration_s, checks = 0.0, tuple[Check, ...]()
    try:
        sequence = sequence_of(CASES[robot_name][name](), effector_shapes(robot_name))
        duration_s = sequence.duration_s
        proxies = load_proxies(robot_name)
        plan = _timed(cpu_s, "plan", lambda: solve(posed(robot, sequence, proxies)))
        if not plan.converged:
            return Execution(robot_name, name, duration_s, plan.status, cpu_s=cpu_s)
        motion = _timed(cpu_s, "whole body", lambda: WholeBodyController().run(robot, sequence, plan))
        checks = _timed(cpu_s, "certificate", lambda: certify(robot, sequence, plan, proxies, motion)).checks
        played = _timed(cpu_s, "replay", lambda: replayed(robot_name, motion))
    except StridelabError as error:
        return Execution(robot_name, name, duration_s, error.message, checks, cpu_s)
    missed = tuple(one.message for one in played.remarks)
    return Execution(
        robot_name, name, duration_s, "", checks, cpu_s, numbers(played), played.completed, played.fell, missed
    )


def replayed(
    robot_name: str, motion: WholeBodyMotion, disturbed: Disturbances = NONE, observe: Observe = as_sensed
) -> Replay:
    """The replay of a motion in a world that may be disturbed, seen through an estimator."""
    return PhysicsReplay().run(load_robot(robot_name), motion.sequence, motion, _silent, observe, disturbed)


def numbers(replay: Replay) -> dict[str, float]:
    """The figures of a replay that are asked about."""
    found = {
        "com_error_max_m": replay.com_error_max_m,
        "com_error_rms_m": replay.com_error_rms_m,
        "foot_slip_max_m": replay.foot_slip_max_m,
        "landing_error_max_m": replay.landing_error_max_m,
        "torque_ratio_max": replay.torque_ratio_max,
    }
    if replay.hand_force_mean_n is not None and replay.hand_contact_share is not None:
        found |= {"hand_force_mean_n": replay.hand_force_mean_n, "hand_contact_share": replay.hand_contact_share}
    return found


def _timed(cpu_s: dict[str, float], stage: str, work: Callable[[], T]) -> T:
    started = time.process_time()
    found = work()
    cpu_s[stage] = time.process_time() - started
    return found


def _silent(_fraction: float, _message: str) -> None:
    """Nobody watches."""
