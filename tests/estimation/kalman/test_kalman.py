"""The Kalman filter of section 2.5.3: against a textbook's loop, against its own statistics, and as it is printed."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.errors import InvalidInput
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.kalman.filter import KalmanFilter
from stridelab.estimation.kalman.jerk_model import SIGMA_JERK_RANGE_M_S3, InputNoise, JerkModel, split_stretches
from stridelab.estimation.kalman.passes import Axis
from stridelab.recordings.recording import Window
from support.oracles.estimators import textbook
from support.recordings.analytic_motions import masked_record, uniform, walk

STARTS = {"known": np.diag([1e-4, 1e-2, 1e-1]), "unknown": np.diag([1.0, 25.0, 100.0])}


def relative(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference of two covariances, in units of their standard deviations."""
    scale = np.sqrt(np.einsum("kii,kjj->kij", theirs, theirs))
    return float((np.abs(ours - theirs) / scale).max())


def axis_of(rate_hz: float, sigma: float, start: np.ndarray, measured: np.ndarray, printed: bool = False) -> Axis:
    return Axis(JerkModel(1 / rate_hz, sigma, printed), (1e-4, 1e-2, 4e-4), split_stretches(measured), start)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize(("rate_hz", "sigma", "n"), [(100.0, 20.0, 400), (200.0, 1.0, 900), (1000.0, 1.0, 1500)])
def test_partitioning_is_the_textbook_filter_to_the_last_digits(rate_hz: float, sigma: float, n: int, start: str):
    """(2.28)-(2.31)."""
    y, measured = masked_record(rate_hz, n)
    axis = axis_of(rate_hz, sigma, STARTS[start], measured)
    x0 = np.array([y[0, 0], 0.0, 0.0])
    A, B = axis.model.A, axis.model.B
    theirs = textbook(A, B @ B.T * sigma**2, np.array(axis.variance), y, x0, axis.start_covariance)
    predicted, filtered = axis.predict_states(y[None], x0[None]), axis.filter_states(y[None], x0[None])
    assert len(axis.stretches) == 5
    assert_allclose(predicted.mean[0], theirs.predicted, atol=1e-9)
    assert_allclose(filtered.mean[0], theirs.filtered, atol=1e-9)
    assert relative(predicted.covariance, theirs.predicted_covariance) < 1e-8
    assert relative(filtered.covariance, theirs.filtered_covariance) < 1e-8


def test_the_printed_matrix_through_the_textbook_filter_is_the_same_too():
    y, measured = masked_record(200.0, 400)
    axis = axis_of(200.0, 1.0, STARTS["unknown"], measured, printed=True)
    x0 = np.array([y[0, 0], 0.0, 0.0])
    A, B = axis.model.A, axis.model.B
    theirs = textbook(A, B @ B.T, np.array(axis.variance), y, x0, axis.start_covariance)
    assert_allclose(axis.filter_states(y[None], x0[None]).mean[0], theirs.filtered, atol=1e-9)


def test_several_sets_of_signals_do_not_touch_each_other():
    y, measured = masked_record(200.0, 300)
    other = masked_record(200.0, 300, seed=1)[0]
    axis = axis_of(200.0, 1.0, STARTS["known"], measured)
    start = np.array([[3.0, 0.0, 0.0], [-1.0, 1.0, 0.0]])
    both = axis.smooth_states(np.stack([y, other]), start).mean
    for k, alone in enumerate((y, other)):
        assert_allclose(both[k], axis.smooth_states(alone[None], start[k : k + 1]).mean[0], rtol=0, atol=1e-12)


def test_the_gain_becomes_that_of_the_riccati_equation():
    axis = axis_of(200.0, 20.0, STARTS["unknown"], np.ones((6000, 3), dtype=bool))
    model, P = axis.model, axis.start_covariance
    C, R = np.array([[1.0, 0, 0], [0, 0, 1], [1, 0, 0]]), np.diag(axis.variance)
    W = model.B @ model.B.T * 20.0**2
    for _ in range(6000):
        P = model.A @ (P - P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C @ P)) @ model.A.T + W
    result = axis.predict_states(np.zeros((1, 6000, 3)), np.zeros((1, 3))).covariance[-1]
    assert relative(result[None], P[None]) < 1e-9


def draw(rate_hz: float, n: int, sigma: float, variance: tuple[float, ...], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A record that obeys the model: true states and measurements."""
    rng = np.random.default_rng(seed)
    model = JerkModel(1 / rate_hz, sigma)
    x = np.zeros((n, 3))
    for k in range(1, n):
        x[k] = model.A @ x[k - 1] + model.B[:, 0] * rng.normal(0, sigma)
    return x, x[:, [0, 2, 0]] + rng.normal(size=(n, 3)) * np.sqrt(variance)


def test_innovations_of_a_record_that_obeys_the_model_are_white_and_of_their_stated_size():
    n, seeds = 1000, 20
    nis, correlations, inside = [], [], []
    for seed in range(seeds):
        axis = axis_of(200.0, 20.0, np.diag([1e-6, 1e-6, 1e-6]), np.ones((n, 3), dtype=bool))
        x, y = draw(200.0, n, 20.0, axis.variance, seed)
        predicted = axis.predict_states(y[None], np.zeros((1, 3)))
        C = np.array([[1.0, 0, 0], [0, 0, 1], [1, 0, 0]])
        e = y - predicted.mean[0] @ C.T
        S = C @ predicted.covariance @ C.T + np.diag(axis.variance)
        nis.append(np.einsum("ki,kij,kj->k", e, np.linalg.inv(S), e).mean() / 3)
        whitened = np.linalg.solve(np.linalg.cholesky(S), e[:, :, None])[:, :, 0]
        correlations.append([(whitened[lag:].T @ whitened[: n - lag] / n) for lag in (1, 2, 5, 20, 50)])
        filtered = axis.filter_states(y[None], np.zeros((1, 3)))
        sd = np.sqrt(np.einsum("kii->ki", filtered.covariance))
        inside.append((np.abs(filtered.mean[0] - x) < 1.96 * sd).mean(axis=0))
    # NIS / 3 has sd sqrt(2 / 3 n) = 0.026 per seed; a correlation 1 / sqrt(n) per seed
    assert np.mean(nis) == pytest.approx(1.0, abs=4 * 0.026 / np.sqrt(seeds))
    assert np.abs(np.mean(correlations, axis=0)).max() < 4 / np.sqrt(n * seeds)
    assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.03)


@pytest.fixture(scope="module")
def walked():
    """A walk whose geometry, force and axis agree except for angular momentum: two seconds at 200 Hz, all measured."""
    t = np.arange(400) / 200.0
    motion = walk()
    return motion, motion.geometric(t), motion.wrench_track(t, Window(0.0, 1.995))


@pytest.mark.parametrize("estimator", [KalmanFilter(), KalmanFilter.tuned()])
def test_a_body_that_coasts_is_followed_without_error_once_its_speed_is_known(estimator: KalmanFilter):
    t, motion = np.arange(600) / 200.0, uniform()
    estimate = estimator.estimate(motion.geometric(t), motion.wrench_track(t, Window(0.0, 2.995)), motion.mass_kg)
    late = estimate.time_s > 1.5
    assert_allclose(estimate.com_m[late], motion.com.at(estimate.time_s[late]), atol=2e-3)
    assert_allclose(estimate.velocity_m_s[late], np.tile(motion.com.rate, (late.sum(), 1)), atol=1e-2)


def test_as_printed_it_loses_the_position(walked):
    motion, geometric, wrench = walked
    repaired = KalmanFilter().estimate(geometric, wrench, motion.mass_kg)
    printed = KalmanFilter.as_printed().estimate(geometric, wrench, motion.mass_kg)
    late = slice(200, None)
    truth = motion.com.at(repaired.time_s)[late]
    assert np.abs(repaired.com_m[late] - truth).max() < 0.1
    # the state forgets the position at every step, so the estimate stays near the origin while the body leaves it
    error = np.linalg.norm(printed.com_m[late] - truth, axis=1)
    assert error.min() > 0.9
    assert error.max() > 2.0
    assert (printed.sd_m[late][:, 0] > 0.9).all()  # and its band knows


def test_the_lag_is_that_of_the_tuning_and_goes_away_with_it(walked):
    motion, geometric, wrench = walked
    lag_s = [
        KalmanFilter(sigma_jerk_m_s3=sigma).estimate(geometric, wrench, motion.mass_kg).diagnostics["lag_y_s"]
        for sigma in (1.0, 5.0, 20.0)
    ]
    assert 0.025 < lag_s[0] < 0.045
    assert lag_s[0] > lag_s[1] > lag_s[2] > 0
    assert lag_s[2] < 0.0005


def test_the_stated_lag_is_the_delay_of_a_sinusoid():
    rate_hz, hz, n = 200.0, 0.9, 4000
    axis = axis_of(rate_hz, 1.0, STARTS["unknown"], np.ones((n, 3), dtype=bool))
    t = np.arange(n) / rate_hz
    w = 2 * np.pi * hz
    y = np.column_stack([np.sin(w * t), -(w**2) * np.sin(w * t), np.sin(w * t)])
    late = t > 10
    result = axis.filter_states(y[None], np.zeros((1, 3))).mean[0, late, 0]
    a, b = np.linalg.lstsq(np.column_stack([np.sin(w * t), np.cos(w * t)])[late], result, rcond=None)[0]
    assert axis.lag_s(hz) == pytest.approx(-np.arctan2(b, a) / w, abs=1e-6)


@pytest.mark.parametrize(("ahead", "aside"), [(0, 1), (1, 0)])
def test_stated_errors_become_noise_axis_by_axis(ahead: int, aside: int):
    """By hand, for 70 kg: the table and the markers, 5 N and 0.05 m/s^2, and moments over the weight.

    The rate of L about the lateral axis moves the central axis ahead, that about the axis of the walk aside.
    """
    priors = ErrorPriors(marker_m=0.003, momentum_rate_nm_kg=(0.12, 0.33), moment_nm=2.0)
    noise = InputNoise.from_priors((0.004, 0.004, 0.004), priors, np.tile(1.3 * np.eye(3)[ahead], (5, 1)), 70.0)
    assert noise.geometry_m == pytest.approx((0.005, 0.005, 0.005 * np.sqrt(2)))
    assert noise.force_n == pytest.approx((np.hypot(5, 3.5), np.hypot(5, 3.5), np.hypot(5, 10.5)))
    assert noise.axis_m[ahead] == pytest.approx(np.hypot(0.33, 2 / 70) / 9.81)
    assert noise.axis_m[aside] == pytest.approx(np.hypot(0.12, 2 / 70) / 9.81)
    assert noise.axis_m[2] == noise.geometry_m[2]


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("sigma_jerk_m_s3", lambda: KalmanFilter(sigma_jerk_m_s3=0.0)),
        ("sigma_jerk_m_s3", lambda: KalmanFilter(sigma_jerk_m_s3=float("nan"))),
        ("start_sd", lambda: KalmanFilter(start_sd=(1.0, -5.0, 10.0))),
        ("noise.geometry_m", lambda: InputNoise(geometry_m=(0.01, 0.0, 0.01))),
        ("noise.force_n", lambda: InputNoise(force_n=(-1.0, 10.0, 10.0))),
        ("noise.axis_m", lambda: InputNoise(axis_m=(0.01, 0.01, float("inf")))),
    ],
)
def test_priors_that_are_not_positive_are_refused_by_name(field: str, make):
    with pytest.raises(InvalidInput) as refusal:
        make()
    assert refusal.value.code == "prior-not-positive"
    assert refusal.value.faults[0].where == field
    assert field in refusal.value.message


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("sigma_jerk_m_s3", lambda: KalmanFilter(sigma_jerk_m_s3=1e8)),
        ("start_sd", lambda: KalmanFilter(start_sd=(1.0, 5.0, 1e9))),
        ("noise.geometry_m", lambda: InputNoise(geometry_m=(1e-9, 0.01, 0.01))),
        ("noise.force_n", lambda: InputNoise(force_n=(10.0, 10.0, 1e6))),
    ],
)
def test_priors_that_make_no_sense_are_refused_by_name(field: str, make):
    with pytest.raises(InvalidInput) as refusal:
        make()
    assert refusal.value.code == "prior-out-of-range"
    assert refusal.value.faults[0].where == field


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 2000.0])
@pytest.mark.parametrize("sigma", SIGMA_JERK_RANGE_M_S3)
def test_what_is_allowed_is_solved_or_refused_in_a_sentence(rate_hz: float, sigma: float):
    """A body at rest at 1 m, exactly measured, is estimated wherever the standard deviations lie."""
    n = 200
    measured = np.ones((n, 3), dtype=bool)
    measured[:50, 1:] = False
    measured[120:140, 2] = False
    y, start = np.tile([1.0, 0.0, 1.0], (1, n, 1)), np.array([[1.0, 0.0, 0.0]])
    refused = []
    for geometry, force, point in itertools.product((1e-4, 1.0), (1e-3, 10.0), (1e-4, 1.0)):
        variance = (geometry**2, force**2, point**2)
        axis = Axis(JerkModel(1 / rate_hz, sigma), variance, tuple(split_stretches(measured)), STARTS["unknown"])
        try:
            result = [axis.filter_states(y, start), axis.smooth_states(y, start)]
        except InvalidInput as refusal:
            refused.append((refusal.code, sigma))
            continue
        assert max(np.abs(track.mean[0, :, 0] - 1.0).max() for track in result) < 1e-4
    assert set(refused) <= {("filter-not-solvable", 1000.0)}
    assert len(refused) <= 2
