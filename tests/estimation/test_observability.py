"""Ranks of (2.19) and (2.23) as the thesis states them, and the direction that no wrench can see."""

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2, g
from stridelab.estimation.estimate import ComEstimate
from stridelab.estimation.observability import force_and_geometry_matrix, force_matrix, observability, skew
from stridelab.recordings.recording import Window


def estimate(acceleration: np.ndarray) -> ComEstimate:
    n = len(acceleration)
    time_s = np.arange(n) / 100.0
    com = np.column_stack([time_s, 0 * time_s, 0.9 + 0 * time_s])
    return ComEstimate(
        method="test",
        time_s=time_s,
        com_m=com,
        velocity_m_s=np.tile([1.0, 0.0, 0.0], (n, 1)),
        acceleration_m_s2=acceleration,
        sd_m=np.zeros((n, 3)),
        window=Window(0.0, 1.0),
        references=(),
    )


def test_ranks_are_7_and_11_on_random_states() -> None:
    rng = np.random.default_rng(0)
    for c, v, a in rng.normal(size=(200, 3, 3)):
        assert np.linalg.matrix_rank(force_matrix(c, v, a)) == 7
        assert np.linalg.matrix_rank(force_and_geometry_matrix(c, v, a)) == 11


def test_free_fall_leaves_only_the_acceleration() -> None:
    found = observability(estimate(np.tile(g, (100, 1))))
    assert found.rank_force == 3


def test_a_shift_along_the_force_is_in_the_null_space() -> None:
    c, v, a = np.random.default_rng(1).normal(size=(3, 3))
    f = a - g
    assert force_matrix(c, v, a) @ np.concatenate([f, np.zeros(6)]) == pytest.approx(np.zeros(15), abs=1e-12)
    hidden = np.concatenate([f, np.zeros(6), -f])
    assert force_and_geometry_matrix(c, v, a) @ hidden == pytest.approx(np.zeros(21), abs=1e-12)


def test_standing_hides_the_height_and_leaning_forces_tilt_the_hidden_direction() -> None:
    still = observability(estimate(np.zeros((100, 3))))
    assert still.unobservable == pytest.approx((0, 0, 1))
    assert still.tilt_rad == pytest.approx(0, abs=1e-7)
    a = np.zeros((100, 3))
    a[:50, 0], a[50:, 0] = GRAVITY_M_S2, -GRAVITY_M_S2
    swaying = observability(estimate(a))
    assert swaying.tilt_rad == pytest.approx(np.pi / 4)
    assert swaying.turn_rad == pytest.approx(np.pi / 4)


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(2).normal(size=(2, 3))
    assert skew(a) @ b == pytest.approx(np.cross(a, b))
