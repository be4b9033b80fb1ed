"""Execution of the bundled scenarios: centroidal plan, whole-body motion, certificate and replay in simulation.

Robot-specific parameters of the scenarios (feet, hand positions on rails and walls) are defined here.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, TypeVar

from experiments.bundled_scenarios import BUNDLED
from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import hand_bounds_n
from stridelab.centroidal.native.availability import NativeSolver, native_availability
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.hand_scenes import stand_up
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
from stridelab.wholebody.replay.disturbances import UNDISTURBED, Disturbances
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.sensors import StateObserver, as_sensed

Scenario = dict[str, Any]
Builder = Callable[[], Scenario]
T = TypeVar("T")
RunStage = Literal["scenario", "plan", "whole body", "certificate"]
G1: Final = Walker("g1", 0.1185, 0.107, 0.101)
"""Half the distance between the soles in the reference posture; toe and heel lengths of the shoe."""


def _hrp2_scenarios() -> dict[str, Builder]:
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
    "talos": {name: BUNDLED[name] for name in (*_hrp2_scenarios(), "house-stairs", "outdoor-stairs")},
    "hrp2": _hrp2_scenarios(),
    "g1": {
        "long-stride": lambda: long_stride(step_m=0.25, walker=G1),
        "flat-walk": lambda: flat_walk(step_m=0.15, walker=G1),
    },
}
"""Scenario builders by robot and name; the thesis' three experiments come first."""


@dataclass(frozen=True)
class Execution:
    """Result of one scenario; ``failed`` is the error that stopped it, empty if all stages ran.

    ``cpu_s`` are process seconds by stage, ``replay`` the figures of the replay, ``missed`` the reasons why a replay is
    not ``completed``.
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

    def check_value(self, check: str) -> float:
        """The value of a check; NaN if missing."""
        return next((c.value for c in self.checks if c.name == check), float("nan"))

    @property
    def is_certified(self) -> bool:
        """Whether the motion exists and passes every check."""
        return bool(self.checks) and all(check.passed for check in self.checks)


def whole_body_problem(robot: Robot, sequence: ContactSequence, proxies: Mapping[str, Proxy]) -> CentroidalProblem:
    """Centroidal problem as posed by ``plan-motion`` for a whole body: continuous forces and hand force limits."""
    return replace(
        from_rest_to_rest(robot, sequence, proxies),
        control=CircularCones() if isinstance(native_availability(), NativeSolver) else PYRAMIDS,
        shape="cubic",
        bounds=PathBounds(None, hand_bounds_n(robot, sequence)),
    )


def whole_body_motion(robot_name: str, name: str) -> WholeBodyMotion:
    """Whole-body motion of one scenario. Raises ``NotEstimable`` if the body cannot track the plan."""
    robot = load_robot(robot_name)
    sequence = sequence_of(CASES[robot_name][name](), effector_shapes(robot_name))
    plan = solve(whole_body_problem(robot, sequence, load_proxies(robot_name)))
    return WholeBodyController().run(robot, sequence, plan)


@dataclass
class ScenarioRun:
    """One scenario on its way from contacts to replay; ``stage`` is the last one that can fail it.

    ``error`` is what ended it, empty if all stages ran; ``cpu_s`` are process seconds by completed stage.
    """

    stage: RunStage = "scenario"
    error: str = ""
    duration_s: float = 0.0
    plan: CentroidalPlan | None = None
    checks: tuple[Check, ...] = ()
    replay: Replay | None = None
    cpu_s: dict[str, float] = field(default_factory=dict)

    @property
    def failed_checks(self) -> str:
        """The failed checks of the certificate as text."""
        return "; ".join(describe_check(check) for check in self.checks if not check.passed)


def run_scenario(
    robot: Robot,
    scenario: Scenario,
    proxies: Mapping[str, Proxy] | None = None,
    pose: Callable[[Robot, ContactSequence, Mapping[str, Proxy]], CentroidalProblem] = whole_body_problem,
) -> ScenarioRun:
    """Plan, track, certify and replay a scenario; an error of this package ends it and becomes part of the result.

    ``proxies`` None uses the default densities of the robot; ``pose`` states the centroidal problem.
    """
    run = ScenarioRun()

    def timed(name: str, work: Callable[[], T]) -> T:
        started = time.process_time()
        result = work()
        run.cpu_s[name] = time.process_time() - started
        return result

    try:
        sequence = sequence_of(scenario, effector_shapes(robot.name))
        run.duration_s = sequence.duration_s
        densities = load_proxies(robot.name) if proxies is None else proxies
        run.stage = "plan"
        plan = run.plan = timed("plan", lambda: solve(pose(robot, sequence, densities)))
        if not plan.converged:
            run.error = plan.status
            return run
        run.stage = "whole body"
        motion = timed("whole body", lambda: WholeBodyController().run(robot, sequence, plan))
        run.stage = "certificate"
        run.checks = timed("certificate", lambda: certify(robot, sequence, plan, densities, motion)).checks
        run.replay = timed("replay", lambda: replay_motion(robot.name, motion))
    except StridelabError as error:
        run.error = error.message
    return run


def execute_scenario(robot_name: str, name: str) -> Execution:
    """Plan, track, certify and replay one scenario."""
    run = run_scenario(load_robot(robot_name), CASES[robot_name][name]())
    execution = Execution(robot_name, name, run.duration_s, run.error, run.checks, run.cpu_s)
    if run.replay is None:
        return execution
    return replace(
        execution,
        replay=replay_figures(run.replay),
        completed=run.replay.completed,
        fell=run.replay.fell,
        missed=tuple(remark.message for remark in run.replay.remarks),
    )


def replay_motion(
    robot_name: str,
    motion: WholeBodyMotion,
    disturbances: Disturbances = UNDISTURBED,
    observe: StateObserver = as_sensed,
) -> Replay:
    """Replay a motion with optional disturbances; ``observe`` is the state estimator."""
    return PhysicsReplay().run(load_robot(robot_name), motion.sequence, motion, ignore_progress, observe, disturbances)


def replay_figures(replay: Replay) -> dict[str, float]:
    """Reported figures of a replay."""
    figures = {
        "com_error_max_m": replay.com_error_max_m,
        "com_error_rms_m": replay.com_error_rms_m,
        "foot_slip_max_m": replay.foot_slip_max_m,
        "landing_error_max_m": replay.landing_error_max_m,
        "torque_ratio_max": replay.torque_ratio_max,
    }
    if replay.hand_force_mean_n is not None and replay.hand_contact_share is not None:
        figures |= {"hand_force_mean_n": replay.hand_force_mean_n, "hand_contact_share": replay.hand_contact_share}
    return figures


def describe_check(check: Check) -> str:
    """A failed check as text: name, value, limit, unit, effector and time."""
    sign = "<" if check.at_least else ">"
    where = f" ({check.effector}, {check.time_s:.1f} s)" if check.effector and check.time_s is not None else ""
    return f"{check.name} {check.value:.3g} {sign} {check.limit:.3g} {check.unit}{where}"


def ignore_progress(_fraction: float, _message: str) -> None:
    """Progress callback that does nothing."""
