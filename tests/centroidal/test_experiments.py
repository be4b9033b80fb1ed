"""The thesis' three experiments for TALOS, cold from its own start, with the proxies that ship."""

import numpy as np
import pytest

from stridelab.centroidal.solve import solve
from support.talos_problems import bundled

SCENARIOS = ("flat-walk", "long-stride", "six-stairs", "stairs-with-rail")


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_converges_cold_to_a_motion_that_the_legs_can_follow(scenario: str) -> None:
    problem = bundled(scenario)
    plan = solve(problem)
    assert plan.converged, plan.status
    assert plan.solver == "ipopt"
    assert plan.iterations <= 40  # more is the sign of a bad combination of proxies and contacts

    soles_m = [
        np.mean([c.placement.position_m[2] for c in contacts if c is not None])
        for contacts in (
            [plan.sequence.last_contact(foot, int(i)) for foot in ("left_foot", "right_foot")] for i in plan.phase
        )
    ]
    height_m = plan.com_m[:-1, 2] - soles_m
    assert height_m.min() > 0.75
    assert height_m.max() < 0.92
    assert np.abs(plan.l_nms).max() < 0.1
    if "right_hand" in plan.forces_n:
        hand_n = np.linalg.norm(plan.forces_n["right_hand"].sum(axis=1), axis=1)
        assert 1.0 < hand_n.max() < 80.0  # touched, and within what the arm can carry
