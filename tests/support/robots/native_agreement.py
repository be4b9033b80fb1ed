"""The C++ solver and ipopt on the same problem, in the same cones."""

import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve


def total(plan: CentroidalPlan) -> float:
    return sum(plan.cost_terms.values())


def assert_same(problem: CentroidalProblem) -> CentroidalPlan:
    ours, theirs = solve(problem, "native"), solve(problem, "ipopt")
    assert ours.converged, ours.status
    assert theirs.converged, theirs.status
    assert total(ours) == pytest.approx(total(theirs), rel=1e-5, abs=1e-4)
    assert ours.com_m == pytest.approx(theirs.com_m, abs=1e-4)
    assert ours.solution is not None
    residuals = ours.solution.attempts[-1].residuals
    assert residuals is not None
    assert residuals.kkt_error <= 1e-6
    return ours
