"""One plan that many tests look at."""

import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from support.robots.sequences import foot, hand, phase, rest_to_rest, sequence


@pytest.fixture(scope="session")
def problem() -> CentroidalProblem:
    """One step up by 0.1 m with a hand on a sloping rail: all kinds of contacts, 3.7 s."""
    left, right, rail = foot("left", 0.0), foot("right", 0.0), hand(0.2, 0.9, slope=0.4, friction=0.6)
    up = foot("right", 0.25, 0.1)
    walk = sequence(
        phase(0.7, left, right),
        phase(0.4, left, right, rail),
        phase(0.9, left, rail),
        phase(0.3, left, up, rail),
        phase(1.4, left, up),
    )
    return rest_to_rest(walk)


@pytest.fixture(scope="session")
def plan(problem: CentroidalProblem) -> CentroidalPlan:
    """Its solution."""
    return solve(problem)
