"""A re-aimed swing: it lands at the given place and time, over what it has to clear, within its acceleration."""

import numpy as np
import pytest

from stridelab.wholebody.recovery.step_choice import FALL_M_S2, fall_time_s
from stridelab.wholebody.recovery.swing_aim import BEHIND_M, MOST_M_S2, SEARCH_M_S, AimedSwing

DT_S = 0.004


def swung(targets: list[tuple[float, float]], T: float = 0.4, clear_m: float = 0.05) -> tuple[AimedSwing, np.ndarray]:
    """A swing from the origin; the target changes evenly over its time."""
    swing, n = AimedSwing(np.zeros(3), np.zeros(3)), round(T / DT_S)
    swing.clear_m = clear_m
    path = []
    for k in range(n):
        place = np.array(targets[min(k * len(targets) // n, len(targets) - 1)])
        swing.advance(place, 0.0, T - k * DT_S, DT_S)
        path.append(swing.position_m)
    return swing, np.array(path)


@pytest.mark.parametrize("targets", [[(0.4, 0.1)], [(0.3, 0.0), (0.4, 0.1), (0.4, 0.1), (0.4, 0.1)]])
def test_a_swing_lands_at_its_last_target(targets: list[tuple[float, float]]) -> None:
    swing, path = swung(targets)
    assert swing.position_m == pytest.approx([*targets[-1], 0.0], abs=0.01)
    assert np.abs(swing.velocity_m_s).max() < 0.35
    assert 0.03 < path[:, 2].max() < 0.06
    assert path[:, 2].min() > -0.005
    assert np.abs(np.diff(path, 2, axis=0)).max() / DT_S**2 < 2.0 * MOST_M_S2


def test_a_late_sole_searches_for_the_ground() -> None:
    swing, _ = swung([(0.2, 0.0)])
    before = swing.position_m.copy()
    for _ in range(10):
        swing.advance(np.array([0.2, 0.0]), 0.0, -0.1, DT_S)
    assert swing.position_m - before == pytest.approx([0.0, 0.0, -10 * DT_S * SEARCH_M_S])


def test_the_reference_waits_for_a_sole_that_is_left_behind() -> None:
    swing = AimedSwing(np.array([0.2, 0.0, 0.05]), np.array([1.0, 0.0, 0.0]))
    swing.follow(np.array([0.19, 0.0, 0.05]), np.zeros(3))
    assert swing.position_m[0] == 0.2
    swing.follow(np.array([0.1, 0.0, 0.05]), np.zeros(3))
    assert swing.position_m[0] == pytest.approx(0.1 + BEHIND_M)
    assert swing.velocity_m_s[0] < 1.0


@pytest.mark.parametrize("drop_m", [0.05, 0.1, 0.15, 0.25])
def test_a_sole_that_comes_down_is_expected_when_it_lands(drop_m: float) -> None:
    """Otherwise each new choice of its step postpones the landing, until the robot has fallen."""
    T = float(fall_time_s(drop_m, 0.0))
    share = np.linspace(0.0, 1.0, 101)
    z = drop_m * (1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share**2))
    down_m_s = 30.0 * drop_m / T * (share * (1.0 - share)) ** 2
    expected_s = [float(fall_time_s(at, v)) for at, v in zip(z, down_m_s, strict=True)]
    assert (np.array(expected_s) <= T * (1.04 - share)).all()
    peak_m_s2 = np.abs(60.0 * drop_m / T**2 * share * (1.0 - share) * (1.0 - 2.0 * share)).max()
    assert peak_m_s2 == pytest.approx(FALL_M_S2, rel=2e-3)


@pytest.mark.parametrize("riser_m", [0.1, 0.17])
def test_a_step_down_passes_the_edge_before_it_comes_down(riser_m: float) -> None:
    """From the middle of a tread of 0.3 m to that of the lower one; the sole is 0.2 m long."""
    swing, T = AimedSwing(np.array([0.0, 0.0, riser_m]), np.zeros(3)), 0.42
    swing.clear_m = riser_m + 0.05
    for k in range(round(T / DT_S) - 1):
        swing.advance(np.array([-0.3, 0.0]), 0.0, T - k * DT_S, DT_S)
        if swing.position_m[0] + 0.1 > -0.15:
            assert swing.position_m[2] > riser_m - 0.01
    assert swing.position_m == pytest.approx([-0.3, 0.0, 0.0], abs=0.01)
    assert swing.velocity_m_s[2] == pytest.approx(-0.1, abs=0.05)
