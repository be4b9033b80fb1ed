"""Cold-started centroidal problems on random variations of the thesis' three experiments (4.6.2 to 4.6.4).

Stride, pace, height, friction and contact positions are drawn at random, for TALOS and HRP-2 alternately. Every
variation has one of four outcomes:

    converged    the solver reports convergence and ``verify`` confirms it
    infeasible   a linear program of the constraints has no solution: the motion does not exist
    stuck        the linear program has a solution, but the solver did not converge
    broken       an error of this package

The first two count as correct. Contacts are passed to the solver even if scenario validation rejects them, so that
treads narrower than a sole are included; the number of valid scenarios is part of the summary.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np

from stridelab.centroidal.infeasibility.elastic_lp import is_feasible
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import EffectorShape, effector_shapes
from stridelab.contacts.scenarios.parts import HRP2, TALOS, Scenario, Timing, Walker
from stridelab.contacts.scenarios.stairs import (
    CLIMBING,
    HOLDING_ON,
    STRIDING,
    Stairs,
    climb,
    long_stride,
    stairs_with_rail,
)
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.dynamics.spatial import Placement
from stridelab.errors import StridelabError
from stridelab.reachability.store import load_proxies
from stridelab.reproduction.studies.thesis_experiments import RAILS
from stridelab.robots.loader import load_robot

Experiment = Literal["stride", "stairs", "rail"]
EXPERIMENTS: Final[tuple[Experiment, ...]] = ("stride", "stairs", "rail")
Ending = Literal["converged", "infeasible", "stuck", "broken"]
WALKERS: Final = (TALOS, HRP2)
STRIDE: Final = (0.6, 1.05)
PACE: Final = (0.75, 1.3)
HEIGHT_M: Final = (0.0, 0.18)
FRICTION: Final = (0.3, 0.8)
JITTER_M: Final = 0.02
NUMBER: Final = re.compile(r"-?\d+(\.\d+)?")


@dataclass(frozen=True)
class Variation:
    """One random variation; ``stride`` and ``pace`` scale the lengths and durations of the experiment.

    ``height_m`` is the stair height (unused on level ground), ``seed`` determines the contact positions.
    """

    experiment: Experiment
    walker: Walker
    stride: float
    pace: float
    height_m: float
    friction: float
    seed: int


@dataclass(frozen=True)
class Outcome:
    """Outcome of a variation; ``reason`` is the status or error if it did not converge, times are CPU times.

    ``refusals`` are the distinct faults of scenario validation without their numbers; empty for a valid scenario.
    """

    variation: Variation
    ending: Ending
    refusals: tuple[str, ...] = ()
    reason: str = ""
    iterations: int = 0
    dynamics_gap: float = np.nan
    terminal_gap: float = np.nan
    cone_margin_n: float = np.nan
    solve_s: float = np.nan
    build_s: float = np.nan


def random_variations(number: int, seed: int = 0) -> tuple[Variation, ...]:
    """The first ``number`` variations of a random stream given by ``seed``; experiments and robots alternate."""
    drawn = []
    for k, child in enumerate(np.random.SeedSequence(seed).spawn(number)):
        rng = np.random.default_rng(child)
        stride, pace, height_m, friction = (float(rng.uniform(*ends)) for ends in (STRIDE, PACE, HEIGHT_M, FRICTION))
        which, walker = EXPERIMENTS[k % 3], WALKERS[(k // 3) % 2]
        drawn.append(Variation(which, walker, stride, pace, height_m, friction, int(rng.integers(2**31))))
    return tuple(drawn)


def scenario_of(variation: Variation) -> Scenario:
    """Scenario of a variation: contacts moved by up to ``JITTER_M`` within their surface, uniform friction."""
    scenario = _build_scenario(variation)
    scenario["friction"] = variation.friction
    for surface in scenario["terrain"]:
        surface.pop("friction", None)
    rng = np.random.default_rng(variation.seed)
    moved_positions: dict[tuple[Any, ...], list[float]] = {}
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            key = (contact["effector"], *contact["position_m"])
            if key not in moved_positions:  # the same contact in the next phase stays where it is
                axes = Placement.from_wxyz(contact["position_m"], contact["orientation_wxyz"]).rotation
                x, y = rng.uniform(-JITTER_M, JITTER_M, 2)
                shift = axes[:, 0] * x + (0.0 if contact["effector"].endswith("hand") else axes[:, 1] * y)
                moved_positions[key] = (np.array(contact["position_m"]) + shift).tolist()
            contact["position_m"] = moved_positions[key]
    return scenario


def unvalidated_sequence(scenario: Mapping[str, Any], shapes: Mapping[str, EffectorShape]) -> ContactSequence:
    """Contact sequence of a scenario without validation and without terrain."""

    def contact_of(c: Mapping[str, Any]) -> Contact:
        shape, friction = shapes[c["effector"]], float(scenario["friction"])
        place = Placement.from_wxyz(c["position_m"], c["orientation_wxyz"])
        return Contact(c["effector"], place, "unseen", friction, shape.kind, shape.half_size_m)

    phases = tuple(
        ContactPhase(float(p["duration_s"]), {c["effector"]: contact_of(c) for c in p["contacts"]})
        for p in scenario["phases"]
    )
    return ContactSequence(scenario["name"], scenario["robot"], float(scenario["friction"]), Terrain(()), phases)


def problem_of(variation: Variation) -> CentroidalProblem:
    """Rest-to-rest centroidal problem of a variation with the bundled reachability densities."""
    robot = load_robot(variation.walker.robot)
    sequence = unvalidated_sequence(scenario_of(variation), effector_shapes(robot.name))
    return from_rest_to_rest(robot, sequence, load_proxies(robot.name))


def solve_variation(variation: Variation) -> Outcome:
    """Solve one variation; a ``StridelabError`` gives the outcome ``broken``."""
    validation_faults: tuple[str, ...] = ()
    try:
        validation_faults = distinct_validation_faults(variation)
        problem = problem_of(variation)
        plan = solve(problem)
        ending: Ending = "converged" if plan.converged else "stuck" if is_feasible(problem) else "infeasible"
    except StridelabError as error:
        return Outcome(variation, "broken", validation_faults, error.message)
    verification = plan.verification
    return Outcome(
        variation,
        ending,
        validation_faults,
        "" if plan.converged else plan.status,
        plan.iterations,
        verification.dynamics_gap,
        verification.terminal_gap,
        verification.cone_margin_n,
        plan.solve_time_s,
        plan.build_time_s,
    )


def distinct_validation_faults(variation: Variation) -> tuple[str, ...]:
    """Distinct faults of scenario validation, with numbers replaced by ``#``."""
    report = validate_scenario(scenario_of(variation), effector_shapes(variation.walker.robot))
    return tuple(dict.fromkeys(NUMBER.sub("#", fault.message) for fault in report.faults))


def count_faults(outcomes: Sequence[Outcome]) -> Mapping[str, int]:
    """Number of rejected variations by fault; a variation may have several faults."""
    return dict(Counter(reason for outcome in outcomes for reason in outcome.refusals).most_common())


def solve_variations(
    variations: Sequence[Variation], tell: Callable[[Outcome], None] | None = None
) -> tuple[Outcome, ...]:
    """Solve variations sequentially; ``tell`` is called with every outcome."""
    outcomes = []
    for variation in variations:
        outcomes.append(solve_variation(variation))
        if tell is not None:
            tell(outcomes[-1])
    return tuple(outcomes)


def outcome_summary(outcomes: Sequence[Outcome]) -> Mapping[str, float | int]:
    """Summary statistics; ``right`` is the share of converged and infeasible variations."""
    by = {ending: sum(o.ending == ending for o in outcomes) for ending in get_args(Ending)}
    converged = [o for o in outcomes if o.ending == "converged"]
    return {
        "variations": len(outcomes),
        **by,
        "right": (by["converged"] + by["infeasible"]) / len(outcomes),
        "judged_valid": sum(not o.refusals for o in outcomes),
        "iterations_median": float(np.median([o.iterations for o in converged])),
        "iterations_most": max(o.iterations for o in converged),
        "dynamics_gap_most": max(o.dynamics_gap for o in converged),
        "terminal_gap_most": max(o.terminal_gap for o in converged),
        "cone_margin_least_n": min(o.cone_margin_n for o in converged),
        "solve_median_s": float(np.median([o.solve_s for o in converged])),
        "solve_most_s": max(o.solve_s for o in converged),
    }


def _build_scenario(variation: Variation) -> Scenario:
    v = variation
    if v.experiment == "stride":
        return long_stride(step_m=0.45 * v.stride, timing=_scale_timing(STRIDING, v.pace), walker=v.walker)
    depth_m = 0.30 * v.stride
    if v.experiment == "stairs":
        return climb(Stairs(6, v.height_m, depth_m), _scale_timing(CLIMBING, v.pace), "both", v.walker)
    rail = RAILS[v.walker.robot]
    return stairs_with_rail(Stairs(4, v.height_m, depth_m), rail, _scale_timing(HOLDING_ON, v.pace), v.walker)


def _scale_timing(timing: Timing, pace: float) -> Timing:
    return Timing(pace * timing.ends_s, pace * timing.move_s, pace * timing.rest_s)
