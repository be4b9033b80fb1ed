"""Ranks of (2.19) and (2.23) as the thesis states them, and the direction that no wrench can see."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2, g
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.observability import (
    constant_jerk_matrix,
    force_and_geometry_matrix,
    force_matrix,
    observability_track,
    skew,
    summarise_observability,
)
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
    summary = summarise_observability(estimate(np.tile(g, (100, 1))))
    assert summary.rank_force == 3


def test_geometry_restores_all_but_the_bias_in_free_fall() -> None:
    """(c, b) only as their sum, c' and c'': 9 of 12."""
    assert summarise_observability(estimate(np.tile(g, (100, 1)))).rank_with_geometry == 9


def test_a_constant_jerk_makes_8_of_9_states_observable_and_which_one_stays_hidden() -> None:
    rng = np.random.default_rng(3)
    for c, v, a, u in rng.normal(size=(200, 4, 3)):
        matrix = constant_jerk_matrix(c, v, a, u)
        assert np.linalg.matrix_rank(matrix, tol=1e-9) == 8
        assert matrix @ np.concatenate([a - g, u, np.zeros(3)]) == pytest.approx(np.zeros(15), abs=1e-12)


def moment(state: np.ndarray, jerk: np.ndarray, t: float) -> np.ndarray:
    c, v, a = state.reshape(3, 3)
    return np.cross(c + v * t + a * t**2 / 2 + jerk * t**3 / 6, a + jerk * t - g)


@pytest.mark.parametrize("jerk", [np.zeros(3), np.array([1.0, -2.0, 0.5])])
def test_the_matrices_are_the_derivatives_of_the_moment(jerk: np.ndarray) -> None:
    """Independent truth: finite differences of the moment in time and in the state: (2.19) of (2.17), (2.15)."""
    state = np.random.default_rng(4).normal(size=9)
    com, velocity, acceleration = state.reshape(3, 3)
    matrix = constant_jerk_matrix(com, velocity, acceleration, jerk) * GRAVITY_M_S2
    t = np.linspace(-1.0, 1.0, 9)
    gradient = np.array(
        [[(moment(state + e, jerk, s) - moment(state - e, jerk, s)) / 2e-5 for s in t] for e in 1e-5 * np.eye(9)]
    )
    for order in range(4):  # the moment is a polynomial of degree 4 in t: its Taylor coefficients are exact by a fit
        taylor = np.array([[np.polyfit(t, gradient[i, :, k], 4)[4 - order] for i in range(9)] for k in range(3)])
        row = matrix[3 + 3 * order : 6 + 3 * order] / [1, 1, 2, 6][order]
        assert row == pytest.approx(taylor, abs=1e-6)


def test_the_rows_of_the_geometry_are_those_of_a_linear_system_with_a_constant_bias() -> None:
    """C, C A, C A^2 with the integrators of (2.15), (2.16), the bias of (2.21), (2.22), and y = c + b (2.20)."""
    A, C = np.zeros((12, 12)), np.zeros((3, 12))
    A[:6, 3:9] = np.eye(6)
    C[:, :3] = C[:, 9:] = np.eye(3)
    matrix = force_and_geometry_matrix(*np.random.default_rng(2).normal(size=(3, 3)))
    for order, first in enumerate((6, 12, 18)):
        assert (matrix[first : first + 3] == C @ np.linalg.matrix_power(A, order)).all()
    assert not (C @ np.linalg.matrix_power(A, 3)).any()


def test_a_shift_along_the_force_is_in_the_null_space() -> None:
    """(2.18)."""
    c, v, a = np.random.default_rng(1).normal(size=(3, 3))
    f = a - g
    assert force_matrix(c, v, a) @ np.concatenate([f, np.zeros(6)]) == pytest.approx(np.zeros(15), abs=1e-12)
    hidden = np.concatenate([f, np.zeros(6), -f])
    assert force_and_geometry_matrix(c, v, a) @ hidden == pytest.approx(np.zeros(21), abs=1e-12)


def test_standing_hides_the_height_and_leaning_forces_tilt_the_hidden_direction() -> None:
    still = summarise_observability(estimate(np.zeros((100, 3))))
    assert still.unobservable == pytest.approx((0, 0, 1))
    assert still.tilt_rad == pytest.approx(0, abs=1e-7)
    a = np.zeros((100, 3))
    a[:50, 0], a[50:, 0] = GRAVITY_M_S2, -GRAVITY_M_S2
    swaying = summarise_observability(estimate(a))
    assert swaying.tilt_rad == pytest.approx(np.pi / 4)
    assert swaying.turn_rad == pytest.approx(np.pi / 4)


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(2).normal(size=(2, 3))
    assert skew(a) @ b == pytest.approx(np.cross(a, b))


def test_flight_inside_a_recording_is_seen_sample_by_sample() -> None:
    a = np.zeros((100, 3))
    a[40:70] = g + np.array([0.0, 0.0, 0.5])  # plates that read 5 % of the weight while they are empty
    track = observability_track(estimate(a))
    flight = np.arange(100)[track.flight]
    assert flight.tolist() == list(range(40, 70))
    assert np.unique(track.rank_force[track.flight]).tolist() == [3]
    assert np.unique(track.rank_force[~track.flight]).tolist() == [7]
    assert np.unique(track.rank_with_geometry[~track.flight]).tolist() == [11]
    assert np.isnan(track.direction[track.flight]).all()
    assert track.direction[~track.flight] == pytest.approx(np.tile([0.0, 0.0, 1.0], (70, 1)))
    summary = summarise_observability(estimate(a))
    assert (summary.rank_force, summary.flight_s) == (3, pytest.approx(0.30))
    assert "0.30 s there is no ground contact" in summary.sentence
    assert "7 of 9" in summary.sentence


def test_the_hidden_direction_is_that_of_the_force_at_every_sample() -> None:
    """Independent truth: moving the CoM along it leaves the moment of the measured force unchanged."""
    a = np.random.default_rng(5).normal(size=(100, 3))
    made = estimate(a)
    n = observability_track(made).direction
    f = a - g
    assert np.cross(made.com_m + 0.1 * n, f) == pytest.approx(np.cross(made.com_m, f), abs=1e-12)
    assert np.linalg.norm(n, axis=1) == pytest.approx(np.ones(100))


def test_the_ranks_do_not_depend_on_where_the_laboratory_has_its_origin() -> None:
    a = np.random.default_rng(6).normal(size=(100, 3))
    near = estimate(a)
    far = replace(near, com_m=near.com_m + np.array([200.0, -300.0, 50.0]))
    assert observability_track(far).rank_force.tolist() == observability_track(near).rank_force.tolist() == [7] * 100
    assert observability_track(far).rank_with_geometry.tolist() == [11] * 100


@pytest.mark.parametrize(
    ("acceleration", "words"),
    [
        (np.zeros((100, 3)), ("7 of 9", "11 of 12", "the height", "here upright")),
        (np.tile([0.0009 * GRAVITY_M_S2, 0.0, 0.0], (100, 1)), ("here upright",)),  # the sway of a person who stands
        (np.tile([0.0175 * GRAVITY_M_S2, 0.0, 0.0], (100, 1)), ("up to 1 degree off",)),
        (np.tile([0.1763 * GRAVITY_M_S2, 0.0, 0.0], (100, 1)), ("up to 10 degrees off", "the height")),
        (np.tile(g, (100, 1)), ("free fall", "3 of 9", "markers alone")),
        (np.tile([GRAVITY_M_S2, 0.0, 0.0], (100, 1)), ("along (0.71, 0.00, 0.71)", "45 degrees off the vertical")),
    ],
)
def test_the_sentence_says_what_cannot_be_known(acceleration: np.ndarray, words: tuple[str, ...]) -> None:
    message = summarise_observability(estimate(acceleration)).sentence
    for word in words:
        assert word in message
