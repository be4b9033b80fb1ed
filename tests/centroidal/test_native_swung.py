"""The C++ solver where a body is pushed onto the edge of a sole, and where limbs swing; held against ipopt."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.force_splines import Shape
from stridelab.centroidal.free_variables import FreePlacements
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability, unsupported_features
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.receding_horizon import RecedingHorizon, State
from stridelab.centroidal.solver import solve
from support.robots.sequences import bundled

availability = native_availability()
if isinstance(availability, NativeUnavailable):
    pytest.skip(f"no native solver: {availability.reason}", allow_module_level=True)


@pytest.mark.parametrize(("at_s", "push_m_s"), [(2.0, 0.05), (1.0, -0.05)])
def test_recovers_on_the_edge_of_a_sole(at_s: float, push_m_s: float) -> None:
    """Pushed away from the foot it has just begun to stand on, the body stands on its edge: no other point yields."""
    problem = bundled("flat-walk", control=CircularCones())
    there = solve(problem, "native").reference_at(at_s)
    horizon = RecedingHorizon(problem=problem, horizon_s=problem.sequence.duration_s)
    pushed = there.com_v_m_s + np.array([0.0, push_m_s, 0.0])
    rest = horizon.horizon_problem(at_s, State(there.com_m, pushed, there.l_nms))
    availability, reference = solve(rest, "native"), solve(rest, "ipopt")
    assert availability.converged
    assert availability.iterations < 40
    assert availability.objective == pytest.approx(reference.objective, rel=1e-5)
    np.testing.assert_allclose(availability.com_m, reference.com_m, atol=1e-4)


@pytest.mark.parametrize(("scenario", "shape"), [("flat-walk", "constant"), ("long-stride", "cubic")])
def test_plans_with_the_angular_momentum_of_the_limbs(scenario: str, shape: Shape) -> None:
    """Rates of a swing of 12 Nms, to and fro, cost what ipopt says they do."""
    walk = bundled(scenario, control=CircularCones(), shape=shape)
    time_s = walk.limb_times_s()
    rates = np.outer(np.sin(8.0 * np.pi * time_s[:-1] / time_s[-1]), [2.0, 20.0, 5.0])
    rates -= np.diff(time_s) @ rates / time_s[-1]
    swung = replace(walk, limbs_nm=rates)
    ours, theirs = solve(swung, "native"), solve(swung, "ipopt")
    assert ours.converged
    assert np.abs(ours.l_nms).max() > 3.0
    assert ours.objective == pytest.approx(theirs.objective, rel=2e-5)
    assert ours.com_m == pytest.approx(theirs.com_m, abs=1e-4)
    assert ours.l_nms == pytest.approx(theirs.l_nms, abs=1e-2)


@pytest.mark.parametrize(("scenario", "shape"), [("flat-walk", "constant"), ("long-stride", "cubic")])
def test_follows_a_reference_acceleration(scenario: str, shape: Shape) -> None:
    """Heave of 4 cm costs what ipopt says it does, and the path follows it."""
    walk = bundled(scenario, control=CircularCones(), shape=shape)
    time_s, omega = walk.limb_times_s(), 2.0 * np.pi
    velocity = 0.02 * omega * (1.0 - np.cos(omega * time_s))
    reference = np.zeros((len(time_s) - 1, 3))
    reference[:, 2] = np.diff(velocity - velocity[-1] * time_s / time_s[-1]) / np.diff(time_s)
    heaved = replace(walk, reference_m_s2=reference)
    ours, theirs = solve(heaved, "native"), solve(heaved, "ipopt")
    assert ours.converged
    assert ours.objective == pytest.approx(theirs.objective, rel=2e-5)
    assert ours.com_m == pytest.approx(theirs.com_m, abs=1e-4)
    assert np.ptp(ours.com_m[:, 2]) > np.ptp(solve(walk, "native").com_m[:, 2]) + 0.01


def test_limbs_and_contacts_that_move_are_too_much_at_once() -> None:
    walk = bundled("flat-walk", control=CircularCones(), placements=FreePlacements())
    both = replace(walk, limbs_nm=np.zeros((len(walk.grid().phase), 3)))
    assert unsupported_features(both) == "free placements and the limbs' momentum at once"
    assert unsupported_features(walk) is None
