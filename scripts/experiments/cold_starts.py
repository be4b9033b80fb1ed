"""Reliability of the C++ solver from a cold start, compared with the feasibility of the problems.

Feasibility is decided by an ``Oracle``, a conic solver of the constraints alone. The kinds of problems are

    drawn      random variations of the thesis' experiments (``centroidal_variations``) with exact friction cones
    hasty      variations with durations divided by a factor in ``SPEEDUP_RANGE``; some are infeasible
    moved      every bundled scenario, mirrored or not, turned about the vertical and translated by ``TRANSLATION_M``
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from experiments.bundled_scenarios import BUNDLED
from experiments.centroidal_variations import problem_of, random_variations
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot

Kind = Literal["drawn", "hasty", "moved"]
Answer = Literal["feasible", "infeasible", "unknown"]
Oracle = Callable[[CentroidalProblem], Answer]
SPEEDUP_RANGE: Final = (1.0, 12.0)
TRANSLATION_M: Final = 100.0
SIDES: Final = {"left": "right", "right": "left"}
MIRROR: Final = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class ColdStart:
    """Results of the oracle and of the solver on one problem; ``cpu_s`` is the solver's processor time."""

    kind: Kind
    name: str
    exists: Answer
    converged: bool
    proved: bool
    status: str
    iterations: int
    cpu_s: float

    @property
    def agrees_with_oracle(self) -> bool:
        """Whether the solver converged on a feasible problem or proved an infeasible one infeasible."""
        return self.converged if self.exists == "feasible" else self.proved and self.exists == "infeasible"


def mirror_sequence(sequence: ContactSequence) -> ContactSequence:
    """Mirror the sequence at the plane y = 0."""
    return _map_contacts(
        sequence, lambda T: Placement(MIRROR @ T.position_m, MIRROR @ T.rotation @ MIRROR), _other_side
    )


def transform_sequence(sequence: ContactSequence, pose: Placement) -> ContactSequence:
    """Transform the sequence to a frame in which the world frame has the pose ``pose``."""
    return _map_contacts(sequence, lambda T: pose @ T, lambda name: name)


def random_problems(number: int, seed: int = 0) -> Iterator[tuple[str, CentroidalProblem]]:
    """Names and problems of the first ``number`` random variations."""
    for variation in random_variations(number, seed):
        yield str(variation), replace(problem_of(variation), control=CircularCones())


def shortened_problems(number: int, seed: int = 1) -> Iterator[tuple[str, CentroidalProblem]]:
    """Names and problems of variations with shortened durations; factors are log-uniform in ``SPEEDUP_RANGE``."""
    rng = np.random.default_rng(seed)
    for variation in random_variations(number, seed):
        by = float(np.exp(rng.uniform(*np.log(SPEEDUP_RANGE))))
        yield f"{by:.2f} times as fast: {variation}", shorten_durations(problem_of(variation), by)


def shorten_durations(problem: CentroidalProblem, factor: float) -> CentroidalProblem:
    """Divide all phase durations by ``factor``; uses circular friction cones."""
    sequence = problem.sequence.with_durations(problem.sequence.durations_s / factor)
    return replace(problem, sequence=sequence, control=CircularCones())


def moved_problems(number: int, seed: int = 2) -> Iterator[tuple[str, CentroidalProblem]]:
    """Names and problems of every bundled scenario at ``number`` random poses, every other one mirrored."""
    rng = np.random.default_rng(seed)
    for name, build in BUNDLED.items():
        scenario = build()
        robot = load_robot(scenario["robot"])
        original = sequence_of(scenario, effector_shapes(robot.name))
        for k in range(number):
            placed = mirror_sequence(original) if k % 2 else original
            yaw_rad, direction = rng.uniform(-np.pi, np.pi), rng.normal(size=3)
            away_m = (TRANSLATION_M * direction / np.linalg.norm(direction)).tolist()
            place = Placement.from_wxyz(away_m, (np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)))
            problem = from_rest_to_rest(robot, transform_sequence(placed, place), load_proxies(robot.name))
            yield f"{name}, place {k}", replace(problem, control=CircularCones())


def compare_with_oracle(kind: Kind, name: str, problem: CentroidalProblem, oracle: Oracle) -> ColdStart:
    """Run the oracle and the C++ solver on one problem."""
    exists = oracle(problem)
    plan = solve(problem, "native")
    proved = "infeasible" in plan.status
    return ColdStart(kind, name, exists, plan.converged, proved, plan.status, plan.iterations, plan.solve_time_s)


def summary_by_kind(results: Sequence[ColdStart]) -> Mapping[str, Mapping[str, object]]:
    """Summary by kind: number of problems, outcomes, iterations and processor times."""
    return {
        kind: _summary_of_kind([c for c in results if c.kind == kind])
        for kind in dict.fromkeys(c.kind for c in results)
    }


def _summary_of_kind(results: Sequence[ColdStart]) -> Mapping[str, object]:
    converged = [c for c in results if c.converged] or list(results)
    ms = 1e3 * np.array([c.cpu_s for c in results])
    wrong = [c for c in results if (c.converged and c.exists == "infeasible") or (c.proved and c.exists == "feasible")]
    return {
        "problems": len(results),
        "by_the_oracle": dict(Counter(c.exists for c in results)),
        "converged_of_feasible": sum(c.converged for c in results if c.exists == "feasible"),
        "proved_of_infeasible": sum(c.proved for c in results if c.exists == "infeasible"),
        "wrong": len(wrong),
        "iterations_median": float(np.median([c.iterations for c in converged])),
        "iterations_most": max(c.iterations for c in converged),
        "cpu_ms_median": round(float(np.median(ms)), 2),
        "cpu_ms_most": round(float(ms.max()), 1),
    }


def _map_contacts(
    sequence: ContactSequence, place: Callable[[Placement], Placement], rename: Callable[[str], str]
) -> ContactSequence:
    moved = sequence.map_contacts(lambda _, c: replace(c, effector=rename(c.effector), placement=place(c.placement)))
    return replace(moved, terrain=Terrain(()))


def _other_side(effector: str) -> str:
    side, _, part = effector.partition("_")
    return f"{SIDES[side]}_{part}"
