"""Windows of quick and high swings: gentler, above their surfaces in time, and clear of every edge."""

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Scenario, Timing
from stridelab.contacts.scenarios.stairs import Stairs, climb, flat_walk, six_stairs, stairs_with_rail
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.sequence_swings import swing_of
from stridelab.contacts.swing import STAIR, SwingCurve
from stridelab.contacts.terrain import depth_in_box_m
from stridelab.wholebody.certificate.clearance import LEG_CLEARANCE_M

QUICK = Timing(1.5, 0.98, 0.2)
SOLE_M = (0.10, 0.06)


def swings(scenario: Scenario) -> tuple[ContactSequence, list[SwingCurve]]:
    """The swings of both feet of TALOS."""
    sequence = sequence_of(scenario, effector_shapes("talos"))
    feet = ("left_foot", "right_foot")
    phases = [(name, k) for k, phase in enumerate(sequence.phases) for name in feet if name not in phase.contacts]
    return sequence, [swing_of(sequence, name, k) for name, k in phases]


def peak_m_s2(curve: SwingCurve) -> float:
    times_s = np.linspace(0.0, curve.duration_s, 200)
    return float(max(np.linalg.norm(curve.state_at(t).acceleration_m_s2) for t in times_s.tolist()))


@pytest.mark.parametrize("scenario", [flat_walk(), six_stairs(), stairs_with_rail()])
def test_slow_swings_have_the_usual_windows(scenario: Scenario) -> None:
    assert all(curve.windows is None for curve in swings(scenario)[1])


@pytest.mark.parametrize(("height_m", "depth_m"), [(0.15, 0.32), (0.17, 0.28), (0.185, 0.31)])
def test_a_foot_that_climbs_two_treads_in_a_second_is_accelerated_less(height_m: float, depth_m: float) -> None:
    two_treads = swings(climb(Stairs(4, height_m, depth_m), QUICK, "alternate"))[1][1]
    usual = SwingCurve(
        two_treads.start, two_treads.end, two_treads.duration_s, "surface", rise_m=two_treads.rise_m, windows=STAIR
    )
    assert peak_m_s2(usual) > 15.0
    assert peak_m_s2(two_treads) < 0.6 * peak_m_s2(usual)


@pytest.mark.parametrize(("height_m", "depth_m"), [(0.15, 0.32), (0.17, 0.28), (0.185, 0.31), (0.178, 0.252)])
def test_gentler_windows_clear_every_tread(height_m: float, depth_m: float) -> None:
    gap_m = min(0.06, depth_m - 0.207)
    sequence, curves = swings(climb(Stairs(4, height_m, depth_m, toe_gap_m=gap_m), QUICK, "alternate"))
    x, y = SOLE_M
    corners = np.array([[i * x, j * y, 0.0] for i in (1, 0, -1) for j in (1, -1)])
    for curve in (one for one in curves if one.windows is not None):
        positions, rotations = curve.poses_at(np.linspace(0.125, 0.875, 61))
        points = (positions[:, None] + np.einsum("tij,kj->tki", rotations, corners)).reshape(-1, 3)
        # a point closer than the clearance would be inside a box that is larger by it
        shifts = LEG_CLEARANCE_M * np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        assert all(
            depth_in_box_m(box, points + shift).max(initial=-1.0) <= 0.0
            for box in sequence.terrain.boxes
            for shift in shifts
        )
