"""What a robot can do beyond its level walk: largest turn, highest stair, fastest pace, largest pushes.

Every quantity is searched by bisection over multiples of its resolution: a value passes if its motion is planned,
certified and completes its replay in physics; a push passes if the robot does not fall. The searches take turns: each
value is tried by a process of its own, one per core at a time, and no value is begun after the time has ended.
"""

import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

from stridelab.contacts.scenarios.parts import Timing, Walker
from stridelab.contacts.scenarios.robot_scenes import scaled_stairs, scaled_timing
from stridelab.contacts.scenarios.stairs import CLIMBING, STROLLING, climb, turn_on_the_spot
from stridelab.errors import StridelabError
from stridelab.machine.cores import usable_cores
from stridelab.machine.models_folder import add_models_folder
from stridelab.machine.parallel import map_isolated
from stridelab.pipelines.motion_trial import at_pace, try_motion
from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.loader import load_robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.robots import Capability, CapabilityAttempt, CapabilityName
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.recovery.walking import TALOS_COM_HEIGHT_M
from stridelab.wholebody.shoe_check import largest_shoe_m

TURN_STEP_RAD: Final = math.radians(2.0)
TURN_MAX_RAD: Final = math.radians(40.0)
STAIR_STEP_M: Final = 0.01
STAIR_TIMINGS: Final = (CLIMBING, replace(CLIMBING, rest_s=0.6))
"""A stair that does not pass is tried with longer double supports: weak or wide hips must shift their weight slowly."""
STAIR_MAX_SHARE: Final = 0.4
"""Highest stair that is tried, over the height of the CoM; TALOS' leg is 0.85 of it."""
PACE_STEP: Final = 0.1
PACE_MAX: Final = 3.0
PUSH_STEP_M_S: Final = 0.05
PUSH_MAX_M_S: Final = 0.8
"""Pushes change the velocity of the whole mass by multiples of the step, up to the maximum."""
PUSHED_PHASE: Final = 5
"""The third step of the level walk; phase 0 is standing."""
TURNS: Final = 2
DIRECTIONS: Final = {"ahead": (1.0, 0.0), "back": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}
NAMES: Final[tuple[CapabilityName, ...]] = (
    "stair", "pace", "turn", "push-ahead", "push-back", "push-left", "push-right",
)  # fmt: skip
"""In the order in which they start: the longest first."""
LAST_TRIAL_S: Final = 60.0
"""Time for a value that was begun before the time ended."""
NO_WALK: Final = "needs a level walk that is certified and completed"
PRELOAD: Final = ("stridelab.pipelines.commissioning.capability_search", "mujoco")

Unit = Literal["rad", "m", "m/s", "N s"]
Outcome = tuple[str, dict[str, Any] | None]
"""Why a value does not pass, empty if it does, and its scenario."""


@dataclass(frozen=True, eq=False)
class LevelWalk:
    """The level walk from which the searches start; ``motion`` is None if it is not certified or not completed.

    ``models`` is the folder of the robot, ``scale`` the height of its CoM over that of TALOS, ``foot_y_m`` half the
    distance between its soles.
    """

    robot: str
    models: Path
    foot_y_m: float
    scale: float
    scenario: Scenario
    speed_m_s: float
    motion: WholeBodyMotion | None


@dataclass(frozen=True)
class CapabilityResult:
    """The capabilities in the order of ``NAMES``, and the scenarios of the largest turn, stair and pace by name."""

    capabilities: list[Capability]
    scenarios: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class _Search:
    """One quantity: values ``first + k * resolution`` for ``k`` up to ``number``; ``first`` itself is not tried."""

    unit: Unit
    first: float
    resolution: float
    number: int
    attempt: Callable[[float], Outcome]

    def value_of(self, number: int) -> float:
        return round(self.first + number * self.resolution, 6)


@dataclass(eq=False)
class _Bisection:
    """State of the search of one quantity: number ``low`` passes, ``high`` fails, those between are not known.

    ``best`` is the scenario of the largest value that passed.
    """

    name: CapabilityName
    search: _Search
    low: int = 0
    high: int = field(init=False)
    late: bool = False
    attempts: list[CapabilityAttempt] = field(default_factory=list)
    best: dict[str, Any] | None = None
    seconds: float = 0.0

    def __post_init__(self) -> None:
        self.high = self.search.number + 1

    @property
    def most_attempts(self) -> int:
        return self.search.number.bit_length()

    @property
    def next_number(self) -> int | None:
        """The number to try next; None at the end."""
        return None if self.late or self.high - self.low <= 1 else (self.low + self.high) // 2

    def record_attempt(self, number: int, outcome: Outcome, seconds: float) -> None:
        """Continue with the ``outcome`` of ``number``."""
        reason, scenario = outcome
        passed = not reason
        self.attempts.append(CapabilityAttempt(value=self.search.value_of(number), passed=passed, reason=reason))
        self.seconds += seconds
        if passed:
            self.low, self.best = number, scenario
        else:
            self.high = number

    def to_capability(self) -> Capability:
        """What is known so far."""
        search, failed = self.search, self.high <= self.search.number
        if not self.attempts:
            return _not_tried(self.name, "the time ended")
        fault = next((one for one in self.attempts if one.value == search.value_of(self.high)), None)
        return Capability(
            name=self.name,
            value=search.value_of(self.low),
            unit=search.unit,
            resolution=round(search.resolution, 6),
            ended_by="time" if self.late else "fails" if failed else "range",
            reason=f"{fault.value:.4g} {search.unit}: {fault.reason}" if fault else "",
            attempts=self.attempts,
            seconds=round(self.seconds, 3),
        )


def search_capabilities(walk: LevelWalk, search_s: float, progress: ProgressCallback) -> CapabilityResult:
    """Search every capability for ``search_s`` in all; what fails is a reason in its capability, not an error."""
    ends_s = time.monotonic() + search_s
    add_models_folder(walk.models)
    names = [name for name in NAMES if search_s > 0.0 and (walk.motion is not None or name in ("turn", "stair"))]
    searches = {name: _Bisection(name, _search_of(name, walk)) for name in names}
    most, done = sum(search.most_attempts for search in searches.values()), 0
    while trying := [(search, k) for search in searches.values() if (k := search.next_number) is not None]:
        runs = map_isolated(
            partial(_try_value, walk, ends_s),
            [(search.name, number) for search, number in trying],
            preload=PRELOAD,
            timeout_s=max(ends_s - time.monotonic(), 0.0) + LAST_TRIAL_S,
            processes=usable_cores(),
            spans_nodes=False,
        )
        with closing(runs):
            for index, result in runs:
                search, number = trying[index]
                if isinstance(result, StridelabError):
                    search.record_attempt(number, (result.message, None), 0.0)
                elif result is None:
                    search.late = True
                else:
                    search.record_attempt(number, (result["reason"], result["scenario"]), result["seconds"])
                done += 1
                progress(min(done / most, 1.0), f"motion {done}, {_describe_capability(search.to_capability())}")
    why = "no time was given" if search_s <= 0.0 else NO_WALK
    found = {name: searches[name].to_capability() if name in searches else _not_tried(name, why) for name in NAMES}
    scenarios: dict[str, dict[str, Any]] = {one.name: one.best for one in searches.values() if one.best is not None}
    return CapabilityResult(list(found.values()), scenarios)


def _try_value(walk: LevelWalk, ends_s: float, item: tuple[CapabilityName, int]) -> dict[str, Any] | None:
    """Entry point of a process: try one value; None if the time has ended. What it returns is sent as JSON."""
    began_s = time.monotonic()
    if began_s >= ends_s:
        return None
    add_models_folder(walk.models)
    name, number = item
    search = _search_of(name, walk)
    reason, scenario = search.attempt(search.value_of(number))
    seconds = time.monotonic() - began_s
    return {"reason": reason, "scenario": None if reason else scenario, "seconds": seconds}


def one_stair(walk: LevelWalk, height_m: float, timing: Timing = CLIMBING) -> dict[str, Any]:
    """One stair of ``height_m``, as deep as that of TALOS scaled, and as the shoes need; both feet step onto it.

    ``timing`` is that of TALOS.
    """
    walker = Walker(walk.robot, walk.foot_y_m, *largest_shoe_m(load_robot(walk.robot)))
    return climb(scaled_stairs(walker, walk.scale, 1, height_m), scaled_timing(timing, walk.scale), "both", walker)


def _try_stair(walk: LevelWalk, height_m: float) -> Outcome:
    """The first of ``STAIR_TIMINGS`` with which the stair passes, or why it does not with the last."""
    for timing in STAIR_TIMINGS:
        outcome = _try_scenario(one_stair(walk, height_m, timing))
        if not outcome[0]:
            break
    return outcome


def _search_of(name: CapabilityName, walk: LevelWalk) -> _Search:
    """The values of a capability, and how one of them is tried."""
    robot = load_robot(walk.robot)
    if name == "turn":
        half_m = (robot.effectors["left_foot"].contact_half_size_m or (0.1, 0.05))[0]
        walker, timing = Walker(walk.robot, walk.foot_y_m, half_m, half_m), scaled_timing(STROLLING, walk.scale)
        turn = lambda angle: _try_scenario(turn_on_the_spot(TURNS, angle, timing, walker))  # noqa: E731
        return _Search("rad", 0.0, TURN_STEP_RAD, round(TURN_MAX_RAD / TURN_STEP_RAD), turn)
    if name == "stair":
        highest_m = STAIR_MAX_SHARE * walk.scale * TALOS_COM_HEIGHT_M
        return _Search("m", 0.0, STAIR_STEP_M, math.floor(highest_m / STAIR_STEP_M), partial(_try_stair, walk))
    if name == "pace":
        given = walk.speed_m_s
        pace = lambda speed: _try_scenario(at_pace(walk.scenario, speed / given).model_dump(mode="json"))  # noqa: E731
        return _Search("m/s", given, PACE_STEP * given, round((PACE_MAX - 1.0) / PACE_STEP), pace)
    step_ns = PUSH_STEP_M_S * robot.mass_kg
    x, y = DIRECTIONS[name.removeprefix("push-")]
    push = lambda impulse_ns: _try_push(walk, (impulse_ns * x, impulse_ns * y, 0.0))  # noqa: E731
    return _Search("N s", 0.0, step_ns, round(PUSH_MAX_M_S / PUSH_STEP_M_S), push)


def _try_scenario(scenario: dict[str, Any]) -> Outcome:
    """Plan, certify and, if certified, replay a scenario."""
    posed = Scenario.model_validate(scenario)
    task = PlanMotionTask(scenario=posed, input=PlanMotionInput(scenario=posed, replay=True))
    trial = try_motion(task, _ignore_progress, resumes=False)
    return "" if trial.passed else trial.reason or "not completed", scenario


def _try_push(walk: LevelWalk, impulse_ns: tuple[float, float, float]) -> Outcome:
    """Replay the level walk with a push in the middle of its third step; a plan that is left is not resumed."""
    from stridelab.wholebody.replay.disturbances import Disturbances, Push
    from stridelab.wholebody.replay.replay import PhysicsReplay

    if walk.motion is None:
        raise AssertionError("pushes need a motion")
    durations_s = [phase.duration_s for phase in walk.scenario.phases]
    time_s = math.fsum(durations_s[:PUSHED_PHASE]) + 0.5 * durations_s[PUSHED_PHASE]
    pushed = Disturbances(pushes=(Push(time_s, impulse_ns),))
    robot, sequence = load_robot(walk.robot), walk.motion.sequence
    replay = PhysicsReplay().run(robot, sequence, walk.motion, _ignore_progress, disturbances=pushed)
    falls_s = replay.fall_time_s
    return "" if falls_s is None else f"falls {falls_s - time_s:.2f} s after the push", None


def _not_tried(name: CapabilityName, reason: str) -> Capability:
    units: dict[CapabilityName, tuple[Unit, float]] = {
        "turn": ("rad", TURN_STEP_RAD), "stair": ("m", STAIR_STEP_M), "pace": ("m/s", PACE_STEP),
    }  # fmt: skip
    unit, resolution = units.get(name, ("N s", PUSH_STEP_M_S))
    return Capability(
        name=name, value=None, unit=unit, resolution=round(resolution, 6), ended_by="not-tried", reason=reason
    )


def _describe_capability(capability: Capability) -> str:
    if capability.value is None:
        return f"{capability.name} not tried"
    if capability.value == 0.0:
        return f"{capability.name} none"
    more = "at least " if capability.ended_by in ("range", "time") else ""
    return f"{capability.name} {more}{capability.value:.3g} {capability.unit}"


def _ignore_progress(_fraction: float, _message: str) -> None:
    """The progress counts motions."""
