"""The boundary of pushes, where it must lie."""

import numpy as np
import pytest

from stridelab.centroidal.native import Missing, availability
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.solve import solve
from stridelab.experiments.push_boundary import push_boundary
from support.centroidal_problems import rest_to_rest
from support.sequences import foot, phase, sequence

found = availability()
if isinstance(found, Missing):
    pytest.skip(f"no native solver: {found.reason}", allow_module_level=True)


def test_a_shorter_time_to_recover_leaves_less_and_the_mirror_as_much() -> None:
    standing = sequence(phase(2.0, foot("left", 0.0), foot("right", 0.0)))
    problem = rest_to_rest(standing, control=CircularCones())
    plan = solve(problem, "native")
    early, late = (push_boundary(problem, plan, t, np.array([1.0, 0.0, 0.0])) for t in (0.5, 1.6))
    assert 0.0 < late.held_m_s < early.held_m_s
    left, right = (push_boundary(problem, plan, 0.5, np.array([0.0, y, 0.0])) for y in (1.0, -1.0))
    # Costs are a thousand times those of standing there, and which push is the last one found is to a tenth or two.
    assert left.held_m_s == pytest.approx(right.held_m_s, rel=0.2)
    assert left.held_m_s < left.lost_m_s
