"""The smoother sample by sample: any clock, any gap, and a state that does not grow."""

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.estimation.online_estimator import OnlineEstimator
from stridelab.estimation.smoother import Smoother
from stridelab.estimation.smoother.online_filter import SPACES, OnlineSmoother

MASS_KG = 70.0
TABLE_SD_M = (0.008, 0.008, 0.02)
SPEED_M_S = np.array([1.2, -0.3, 0.0])


def online(**asked: object) -> OnlineSmoother:
    return Smoother().causal(mass_kg=MASS_KG, table_sd_m=TABLE_SD_M, **asked)  # type: ignore[arg-type]


def gliding(estimator: OnlineSmoother, time_s: np.ndarray) -> np.ndarray:
    """Estimated velocities of a body in uniform motion, on a force that supports it through its centre."""
    force = np.array([0.0, 0.0, MASS_KG * GRAVITY_M_S2])
    reports = []
    for t in time_s.tolist():
        com = np.array([0.0, 0.0, 1.0]) + SPEED_M_S * t
        reports.append(estimator.step(t, com, force, np.cross(com, force)).velocity_m_s)
    return np.array(reports)


def test_it_is_an_online_estimator() -> None:
    assert isinstance(online(), OnlineEstimator)


@pytest.mark.parametrize("rate_hz", [60.0, 120.0, 240.0, 1000.0])
def test_the_velocity_is_right_at_any_rate(rate_hz: float) -> None:
    """A step rounded to 0.1 ms would be 10 mm/s off at 240 Hz."""
    reports = gliding(online(), np.arange(round(5 * rate_hz)) / rate_hz)
    np.testing.assert_allclose(reports[-1], SPEED_M_S, atol=1e-4)


def test_a_clock_that_jitters_changes_nothing_and_fills_no_memory() -> None:
    rng = np.random.default_rng(2)
    estimator = online(velocity_m_s=SPEED_M_S)
    reports = gliding(estimator, np.cumsum(rng.uniform(0.002, 0.02, 1000)))
    np.testing.assert_allclose(reports[-500:], np.broadcast_to(SPEED_M_S, (500, 3)), atol=1e-3)
    assert len(estimator._spaces) == SPACES


def test_a_stream_begins_with_geometry() -> None:
    with pytest.raises(NotEstimable) as refused:
        online().step(0.0, None, np.array([0.0, 0.0, 700.0]), np.zeros(3))
    assert refused.value.code == "geometry-missing"
    assert refused.value.message == "The first sample needs the CoM of the segment model."


def test_half_a_wrench_and_a_clock_that_stands_still_are_refused() -> None:
    com, force = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, MASS_KG * GRAVITY_M_S2])
    with pytest.raises(InvalidInput) as refused:
        online().step(0.0, com, force, None)
    assert refused.value.code == "force-without-moment"
    estimator = online()
    estimator.step(0.0, com, force, np.zeros(3))
    with pytest.raises(InvalidInput) as refused:
        estimator.step(0.0, com, force, np.zeros(3))
    assert refused.value.code == "time-not-increasing"
