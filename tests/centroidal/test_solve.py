"""From a problem to a plan that re-verifies itself."""

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solve import solve
from support.sequences import COM_HEIGHT_M, EFFECTORS, MASS_KG, MIXTURES, two_steps


def test_two_steps_on_the_flat_converge() -> None:
    walk = two_steps()
    start, end = (standing_com_m(walk.phases[i].contacts, COM_HEIGHT_M, EFFECTORS) for i in (0, -1))
    plan = solve(CentroidalProblem(walk, MASS_KG, EFFECTORS, MIXTURES, start, end))
    assert plan.converged, plan.status
