"""The centroidal problems of the thesis' experiments (4.6.2 to 4.6.4), for HRP-2 and for TALOS."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Literal

from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import HRP2, TALOS, Walker
from stridelab.contacts.scenarios.stairs import HandRail, Stairs, flat_walk, long_stride, six_stairs, stairs_with_rail
from stridelab.reachability.card import Measure
from stridelab.reachability.store import DEFAULT_MEASURE, load_proxies
from stridelab.robots.loader import load_robot

Experiment = Literal[1, 2, 3]
EXPERIMENTS: Final[tuple[Experiment, ...]] = (1, 2, 3)
WALKERS: Final[Mapping[str, Walker]] = {"hrp2": HRP2, "talos": TALOS}
RAILS: Final = {"talos": HandRail(), "hrp2": HandRail(ahead_m=0.22, height_m=0.60, y_m=-0.45)}
"""Rails within reach of the arms."""


def experiment_scenario(experiment: Experiment, robot: str) -> dict[str, Any]:
    """Scenario of an experiment: long strides, six stairs of 10 cm, or four of 15 cm beside a rail."""
    walker = WALKERS[robot]
    if experiment == 1:
        return long_stride(walker=walker)
    if experiment == 2:
        return six_stairs(walker=walker)
    return stairs_with_rail(Stairs(4, 0.15), RAILS[robot], walker=walker)


def experiment_problem(experiment: Experiment, robot: str, measure: Measure = DEFAULT_MEASURE) -> CentroidalProblem:
    """Rest-to-rest centroidal problem of an experiment with the bundled densities of a measure.

    As in the thesis, the plan uses the whole friction of a rail.
    """
    sequence = sequence_of(experiment_scenario(experiment, robot), effector_shapes(robot))
    problem = from_rest_to_rest(load_robot(robot), sequence, load_proxies(robot, measure))
    return replace(problem, rail_friction_share=1.0)


def flat_walk_problem(robot: str = "talos") -> CentroidalProblem:
    """Rest-to-rest problem of eight steps of 0.25 m on flat ground."""
    sequence = sequence_of(flat_walk(walker=WALKERS[robot]), effector_shapes(robot))
    return from_rest_to_rest(load_robot(robot), sequence, load_proxies(robot, DEFAULT_MEASURE))
