"""The boundary of pushes, where it must lie."""

import numpy as np
import pytest

from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.receding_horizon import RecedingHorizon, State
from stridelab.centroidal.solver import solve
from support.robots.sequences import foot, phase, push_boundary, rest_to_rest, sequence

result = native_availability()
if isinstance(result, NativeUnavailable):
    pytest.skip(f"no native solver: {result.reason}", allow_module_level=True)


def test_a_shorter_time_to_recover_leaves_less_and_the_mirror_as_much() -> None:
    standing = sequence(phase(2.0, foot("left", 0.0), foot("right", 0.0)))
    problem = rest_to_rest(standing, control=CircularCones())
    plan = solve(problem, "native")
    early, late = (push_boundary(problem, plan, t, np.array([1.0, 0.0, 0.0])) for t in (0.5, 1.6))
    assert 0.0 < late.held_m_s < early.held_m_s
    left, right = (push_boundary(problem, plan, 0.5, np.array([0.0, y, 0.0])) for y in (1.0, -1.0))
    for boundary in (left, right):
        assert 0.6 < boundary.held_m_s < boundary.lost_m_s  # the last ones are luck: a thousand times the cost
    there, horizon = plan.reference_at(0.5), RecedingHorizon(problem=problem, horizon_s=2.0)
    for push_m_s in (0.2, 0.4, 0.6):
        states = [
            State(there.com_m, there.com_v_m_s + np.array([0.0, y, 0.0]), there.l_nms) for y in (push_m_s, -push_m_s)
        ]
        here, mirrored = (solve(horizon.horizon_problem(0.5, state), "native") for state in states)
        assert here.converged
        assert mirrored.converged
        assert mirrored.objective == pytest.approx(here.objective, rel=1e-5)
