"""Comparison of CoM reachability densities by the number of stair and rail scenarios that a robot completes.

    Case -> contact sequence -> centroidal plan -> whole-body motion -> certificate (-> replay in physics)

A case succeeds if the scenario is valid, the plan converges, the whole body tracks it and every check of the
certificate passes. Every whole-body motion is also replayed in simulation; the replay is reported separately. Errors
are part of the result, together with the stage at which they occur, so that a grid always completes.

The cases are variations of experiments 2 and 3 of the thesis (4.6.3, 4.6.4) for TALOS and were fixed before any density
was evaluated on them. The rails are those of a prototype on which uniform densities succeeded, the highest of them
barely; the stairs vary height, depth, timing and footing.
"""

import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Literal

import numpy as np

from experiments.execution import run_scenario
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import Footing, HandRail, Stairs, climb, stairs_with_rail
from stridelab.errors import StridelabError
from stridelab.machine.parallel import map_isolated
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Check

Kind = Literal["rail", "stairs"]


@dataclass(frozen=True, eq=False)
class Case:
    """One scenario of the grid (``schemas.scenarios.Scenario`` as a mapping), named after its parameters."""

    name: str
    kind: Kind
    scenario: dict[str, Any]


@dataclass(frozen=True)
class Flight:
    """Parameters of a flight of stairs."""

    height_m: float
    depth_m: float
    timing: Timing
    footing: Footing = "both"


SLOW: Final = Timing(2.5, 1.4, 0.2)
FAST: Final = Timing(2.0, 0.8, 0.2)
HURRIED: Final = Timing(2.0, 0.8, 0.1)
PACES: Final = {SLOW: "slow", FAST: "fast", HURRIED: "hasty"}

RAILS: Final = (
    HandRail(0.22, 0.80, -0.50),
    HandRail(0.22, 0.85, -0.54),
    HandRail(0.22, 0.70, -0.50),
    HandRail(0.22, 0.80, -0.42),
    HandRail(0.22, 0.80, -0.58),
    HandRail(0.10, 0.80, -0.50),
    HandRail(0.35, 0.80, -0.50),
    HandRail(0.22, 0.90, -0.50),
    HandRail(0.30, 0.90, -0.55),
    HandRail(0.22, 1.00, -0.55),
    HandRail(0.22, 1.10, -0.55),
)
"""Rails beside four stairs of 15 cm, after a level step."""

FLIGHTS: Final = (
    Flight(0.05, 0.28, SLOW),
    Flight(0.05, 0.30, FAST),
    Flight(0.05, 0.35, SLOW),
    Flight(0.10, 0.28, SLOW),
    Flight(0.10, 0.30, SLOW),
    Flight(0.10, 0.30, HURRIED),
    Flight(0.10, 0.35, FAST),
    Flight(0.15, 0.28, SLOW),
    Flight(0.15, 0.30, SLOW),
    Flight(0.15, 0.30, FAST),
    Flight(0.15, 0.35, SLOW),
    Flight(0.15, 0.35, HURRIED),
    Flight(0.05, 0.30, FAST, "alternate"),
    Flight(0.10, 0.28, SLOW, "alternate"),
    Flight(0.10, 0.30, SLOW, "alternate"),
    Flight(0.20, 0.30, SLOW),
)
"""Flights of four stairs without a rail."""
_NUMBER: Final = 4
TOE_GAP_M: Final = 0.04
"""Smaller than in the bundled scenarios: the shins come close to the next stair."""


def climbing_cases() -> tuple[Case, ...]:
    """All cases: rails, then stairs."""
    return (*(rail_case(rail) for rail in RAILS), *(stairs_case(flight) for flight in FLIGHTS))


def rail_case(rail: HandRail) -> Case:
    """Experiment 3 with the given rail."""
    name = f"rail {rail.ahead_m:.2f} {rail.height_m:.2f} {rail.y_m:.2f}"
    return Case(name, "rail", stairs_with_rail(Stairs(_NUMBER, 0.15, toe_gap_m=TOE_GAP_M), rail))


def stairs_case(flight: Flight, number: int = _NUMBER) -> Case:
    """Experiment 2 with the given stairs."""
    name = f"stairs {flight.height_m:.2f} {flight.depth_m:.2f} {PACES[flight.timing]} {flight.footing}"
    stairs = Stairs(number, flight.height_m, flight.depth_m, toe_gap_m=TOE_GAP_M)
    return Case(name, "stairs", climb(stairs, flight.timing, flight.footing))


Stage = Literal["scenario", "plan", "whole body", "certificate", "crash"]
STAGES: Final[tuple[Stage, ...]] = ("scenario", "plan", "whole body", "certificate", "crash")
"""Stages at which a case can fail; ``crash`` is a process that ended without a result."""

Proxies = Mapping[str, Proxy]


@dataclass(frozen=True)
class CaseResult:
    """Result of one case.

    ``stage`` and ``reason`` describe a failure; they are ``None`` and empty for a success. ``com_height_m`` is the
    minimum and maximum height of the planned CoM above the mean of the soles in contact. ``checks`` are those of the
    certificate, empty without a motion; ``replayed`` and ``replay_error_m`` (the largest CoM error of the replay) are
    then ``None``. ``cpu_s`` includes the replay.
    """

    case: str
    kind: Kind
    stage: Stage | None
    reason: str = ""
    iterations: int | None = None
    com_height_m: tuple[float, float] | None = None
    checks: tuple[Check, ...] = ()
    replayed: bool | None = None
    replay_error_m: float | None = None
    cpu_s: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Whether the whole-body motion exists and passes every check."""
        return self.stage is None

    def check_named(self, name: str) -> Check | None:
        """The check with this name; None without a motion."""
        return next((check for check in self.checks if check.name == name), None)


@dataclass(frozen=True)
class GridReport:
    """Results of all cases for one choice of densities."""

    label: str
    results: tuple[CaseResult, ...]

    def of_kind(self, kind: Kind) -> "GridReport":
        """The results of one kind of case."""
        return GridReport(self.label, tuple(result for result in self.results if result.kind == kind))

    @property
    def n_successes(self) -> int:
        """Number of successful cases."""
        return sum(result.succeeded for result in self.results)

    @property
    def n_replayed(self) -> int:
        """Number of cases with a completed replay, whether or not the certificate passes."""
        return sum(result.replayed is True for result in self.results)

    @property
    def failures_by_stage(self) -> Mapping[Stage, int]:
        """Number of failed cases by stage."""
        return {stage: n for stage in STAGES if (n := sum(result.stage == stage for result in self.results))}


def run_grid(
    robot: Robot,
    proxies: Proxies,
    cases: Sequence[Case],
    processes: int = 2,
    tell: Callable[[CaseResult], None] | None = None,
) -> tuple[CaseResult, ...]:
    """Run every case with ``proxies`` in parallel processes; returns the results in the order of ``cases``.

    ``tell`` is called with every result as soon as it is available. Case names must be unique. Each case runs in its
    own process: a crash affects only that case, and all processes end with the parent.
    """
    results: dict[int, CaseResult] = {}
    work = partial(run_case, robot, dict(proxies))
    computed = map_isolated(work, cases, preload=[__name__], processes=processes, codec=pickle)
    for index, answer in computed:
        case = cases[index]
        if isinstance(answer, StridelabError):
            answer = CaseResult(case.name, case.kind, "crash", answer.message)
        results[index] = answer
        if tell is not None:
            tell(answer)
    return tuple(results[index] for index in range(len(cases)))


def run_case(robot: Robot, proxies: Proxies, case: Case) -> CaseResult:
    """Run one case in this process."""
    started = time.process_time()
    run = run_scenario(robot, case.scenario, proxies, from_rest_to_rest)
    reason = run.error or run.failed_checks
    return CaseResult(
        case=case.name,
        kind=case.kind,
        stage=run.stage if reason else None,
        reason=reason,
        iterations=run.plan.iterations if run.plan is not None else None,
        com_height_m=com_height_m(robot, run.plan) if run.plan is not None else None,
        checks=run.checks,
        replayed=run.replay.completed if run.replay is not None else None,
        replay_error_m=run.replay.com_error_max_m if run.replay is not None else None,
        cpu_s=time.process_time() - started,
    )


def com_height_m(robot: Robot, plan: CentroidalPlan) -> tuple[float, float]:
    """Minimum and maximum height of the planned CoM above the mean of the soles in contact."""
    phases = plan.sequence.phases
    soles_m = [
        np.mean([c.placement.position_m[2] for e, c in p.contacts.items() if robot.effectors[e].kind == "surface"])
        for p in phases
    ]
    height_m = plan.com_m[:-1, 2] - np.array(soles_m)[plan.phase]
    return float(height_m.min()), float(height_m.max())
