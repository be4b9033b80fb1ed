"""The recursions against plain Gaussian conditioning: every error written out, one dense covariance, no filter."""

from dataclasses import dataclass, replace
from unittest import mock

import numpy as np
import pytest

from stridelab.estimation.smoother import kalman_rts
from stridelab.estimation.smoother.kalman_rts import (
    ForwardPass,
    Signals,
    compute_gains,
    filter_forward,
    log_likelihood,
    smooth_backward,
)
from stridelab.estimation.smoother.measurements import plate_bias_remarks, plate_bias_statistic
from stridelab.estimation.smoother.noise_levels import LEARNED, adult_momentum_m_s, learn_sizes, log_likelihoods
from stridelab.estimation.smoother.online_filter import CausalFilter
from stridelab.estimation.smoother.state_space import ACCELERATION, Sizes, resonator_model, state_space
from stridelab.estimation.smoother.stated_band import stated_variance_m2

RATE_HZ = 50.0
DT = 1 / RATE_HZ
N = 24
SEEN = np.ones(N, bool)
SEEN[:3] = SEEN[14:19] = SEEN[22:] = False
TURNING = SEEN.copy()
TURNING[3:5] = TURNING[10] = TURNING[21] = False
BRIDGED = np.zeros(N, bool)
BRIDGED[13:19] = True
PHI = 0.9


def same(x: float) -> np.ndarray:
    return np.full(3, x)


SIZES = Sizes(
    turned=np.array([True, True, False]),
    marker_m=same(0.01),
    marker_corner_hz=same(4.0),
    acceleration_m_s2=same(0.3),
    moment_m=same(0.02),
    plate_corner_hz=same(3.0),
    table_varying_m=same(0.004),
    table_varying_s=same(0.3),
    swing_m_s=np.array([0.004, 0.002, 0.0]),
    swing_hz=np.array([1.8, 0.9, 1.8]),
    damping=same(0.2),
    overtone_m_s=np.array([0.001, 0.0008, 0.0]),
    overtone_hz=np.array([3.6, 4.0, 1.8]),
    bias=np.array([[0.01, 0.05, 0.002, 0.3, 0.0], [0.012, 0.05, 0.004, 0.2, 0.0], [0.02, 0.1, 0.0, 0.0, 0.0]]),
    beyond_m_s2=same(2.0),
    beyond_s=same(0.1),
    bridged_m_s2=same(0.7),
    height_m=0.9,
    ends=(0.4, 0.2),
)


def some_signals() -> Signals:
    random = np.random.default_rng(3)
    return Signals(
        geometry_m=random.normal(0.0, 0.05, (N, 3)),
        moment_m=np.where(SEEN[:, None], random.normal(0.0, 0.05, (N, 3)), 0.0) * [1.0, 1.0, 0.0],
        acceleration_m_s2=random.normal(0.0, 0.5, (N, 3)),
        seen=SEEN,
        turning=TURNING,
        bridged=BRIDGED,
        phi=np.full(N, PHI),
        sway=np.zeros((N, 3)),
        segments_m=random.normal(0.0, 0.02, (N, 3)) * [1.0, 1.0, 0.0],
        velocity_m_s=np.array([0.1, -0.2, 0.0]),
    )


class Noise:
    """Columns of independent unit errors; a quantity is a row of coefficients."""

    def __init__(self) -> None:
        self.size = 800
        self.used = 0

    def draw(self, sd: float) -> np.ndarray:
        row = np.zeros(self.size)
        row[self.used] = sd
        self.used += 1
        return row

    def pair(self, covariance: np.ndarray) -> np.ndarray:
        values, vectors = np.linalg.eigh(covariance)
        return vectors @ np.array([self.draw(np.sqrt(max(v, 0.0))) for v in values])


@dataclass
class Dense:
    """Mean and coefficient rows of position, velocity and of all measurements of one axis."""

    c_mean: np.ndarray
    c: np.ndarray
    v: np.ndarray
    y_mean: np.ndarray
    y: np.ndarray


def written_out(axis: int, data: Signals, s: Sizes = SIZES) -> Dense:
    """The equations of the model's docstring, one after the other."""
    e = Noise()
    turned = bool(s.turned[axis])
    b0, ab, mu, factor = (e.draw(sd) for sd in s.bias[axis, :4])
    alpha, beta = np.exp(-2 * np.pi * s.marker_corner_hz[0] * DT), np.exp(-2 * np.pi * s.plate_corner_hz[0] * DT)
    w_sd = s.marker_m[0] * np.sqrt((1 + alpha) / 2)
    u_sd, n_sd = (x * np.sqrt((1 + beta) / 2) for x in (s.acceleration_m_s2[0], s.moment_m[0]))
    c_mean, v_mean = data.geometry_m[0, axis], data.velocity_m_s[axis]
    c, v = e.draw(1.0), e.draw(2.0)
    b = e.draw(s.table_varying_m[0])
    p, q, r = (e.draw(sd * np.sqrt((1 - a) / (1 + a))) for sd, a in ((w_sd, alpha), (u_sd, beta), (n_sd, beta)))
    swings = []
    for sd, hz, damping in (
        (s.swing_m_s[axis], s.swing_hz[axis], s.damping[0]),
        (s.overtone_m_s[axis], s.overtone_hz[axis], 0.5),
    ):
        a, noise, rest = (m[0] for m in resonator_model(np.array([sd]), np.array([hz]), np.array([damping]), DT))
        swings.append([e.pair(s.ends[0] ** 2 * rest), a, noise, s.ends[1] ** 2 / (1 - s.ends[1] ** 2) * rest])
    slow = np.exp(-DT / s.table_varying_s[0])
    out = Dense(np.zeros(N), np.zeros((N, e.size)), np.zeros((N, e.size)), np.zeros(0), np.zeros((0, e.size)))
    y_mean, rows = [], []
    for k in range(N):
        w, n, u = e.draw(w_sd), e.draw(n_sd), e.draw(u_sd)
        out.c_mean[k], out.c[k], out.v[k] = c_mean, c, v
        y_mean.append(c_mean)
        rows.append(c + b0 + b + w - p)
        if turned and data.turning[k]:
            y_mean.append(PHI * c_mean)
            rows.append(PHI * (c + s.height_m / 9.81 * ab + mu) + swings[0][0][1] + swings[1][0][1] + n - r)
            rows[-1] += data.segments_m[k, axis] * factor
        if k + 1 < N and SEEN[k] and SEEN[k + 1]:
            known, unknown = data.acceleration_m_s2[k, axis], -ab - u + q
        elif data.bridged[k]:
            known = data.acceleration_m_s2[k, axis]
            unknown = e.draw(s.bridged_m_s2[0] * np.sqrt(s.beyond_s[0] / DT)) - ab
        else:
            known, unknown = 0.0, e.draw(s.beyond_m_s2[0] * np.sqrt(s.beyond_s[0] / DT))
        c_mean, v_mean = c_mean + DT * v_mean + DT**2 / 2 * known, v_mean + DT * known
        c, v = c + DT * v + DT**2 / 2 * unknown, v + DT * unknown
        b = slow * b + e.draw(s.table_varying_m[0] * np.sqrt(1 - slow**2))
        p, q, r = alpha * p + (1 - alpha) * w, beta * q + (1 - beta) * u, beta * r + (1 - beta) * n
        for swing in swings:
            swing[0] = swing[1] @ swing[0] + e.pair(swing[2])
    for state, _, _, variance in swings if turned else []:
        for i in (0, 1):  # coming to rest: the swing after the last sample reads zero
            y_mean.append(0.0)
            rows.append(state[i] + e.draw(np.sqrt(variance[i, i])))
    assert e.used <= e.size
    out.y_mean, out.y = np.array(y_mean), np.array(rows)
    return out


def measured(axis: int, data: Signals) -> np.ndarray:
    y = []
    for k in range(N):
        y.append(data.geometry_m[k, axis])
        if SIZES.turned[axis] and data.turning[k]:
            y.append(data.moment_m[k, axis])
    return np.array(y + ([0.0] * 4 if SIZES.turned[axis] else []))


@pytest.fixture(scope="module")
def passed():
    data = some_signals()
    space = state_space(SIZES, RATE_HZ)
    gains = compute_gains(space, data)
    forward = filter_forward(space, data, gains)
    return data, space, gains, forward


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_covariance_of_position_and_velocity_is_that_of_gaussian_conditioning(passed, axis):
    data, _, result, forward = passed
    covariance = smooth_backward(result, forward, 2)[1][:, axis]
    dense = written_out(axis, data)
    states = np.stack([dense.c, dense.v], axis=1)
    information = np.linalg.inv(dense.y @ dense.y.T)
    for ours, state in zip(covariance, states, strict=True):
        shared = state @ dense.y.T
        expected = state @ state.T - shared @ information @ shared.T
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.abs((ours - expected) / scale).max() < 1e-4


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_mean_and_band_are_those_of_gaussian_conditioning(passed, axis):
    data, _, result, forward = passed
    mean, covariance = smooth_backward(result, forward, 2)
    dense = written_out(axis, data)
    gain = np.linalg.solve(dense.y @ dense.y.T, dense.y @ dense.c.T).T
    expected = dense.c_mean + gain @ (measured(axis, data) - dense.y_mean)
    sd = np.sqrt(np.diag(dense.c @ dense.c.T - gain @ dense.y @ dense.c.T))
    assert np.abs(mean[:, axis, 0] - expected).max() < 1e-7
    assert np.abs(np.sqrt(covariance[:, axis, 0, 0]) / sd - 1).max() < 1e-5


@pytest.mark.parametrize("times", [1.0, 10.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_stated_variance_is_that_of_the_same_gains_under_other_errors(passed, axis, times):
    data, _, result, forward = passed
    errors = replace(
        SIZES,
        table_varying_m=same(0.001),
        swing_m_s=0.3 * SIZES.swing_m_s,
        overtone_m_s=0.6 * SIZES.overtone_m_s,
        bias=SIZES.bias * [1.0, 0.5, 2.0 * times, 1.0, 1.0],
    )
    variance = smooth_backward(result, forward, 1)[1][..., 0, 0]
    stated = stated_variance_m2(SIZES, errors, data, RATE_HZ, variance)[:, axis]
    weighed, met = written_out(axis, data), written_out(axis, data, errors)
    gain = np.linalg.solve(weighed.y @ weighed.y.T, weighed.y @ weighed.c.T).T
    expected = np.sum((met.c - gain @ met.y) ** 2, axis=1)
    assert np.abs(stated / expected - 1.0).max() < 0.003
    assert np.abs(variance[:, axis] / expected - 1.0).max() > 0.05  # which is not that of the weights


def test_the_likelihood_is_that_of_the_same_gaussian_up_to_a_constant(passed):
    data, space, result, forward = passed
    ours = log_likelihood(space, result, forward)
    values = np.array([getattr(SIZES, name) for name in LEARNED])
    logs = np.log(np.where(values > 0, values, 1.0))
    assert log_likelihoods(SIZES, logs[None], data, RATE_HZ)[0] == pytest.approx(ours, abs=1e-6)

    def exact(axis: int) -> float:
        dense = written_out(axis, data)
        cov = dense.y @ dense.y.T
        e = measured(axis, data) - dense.y_mean
        return -0.5 * float(e @ np.linalg.solve(cov, e) + np.linalg.slogdet(cov)[1])

    unseen = {0: int((~TURNING).sum()), 1: int((~TURNING).sum()), 2: N}
    for axis in range(3):
        assert ours[axis] + 0.5 * unseen[axis] * np.log(1e8) == pytest.approx(exact(axis), abs=1e-3)


def test_sample_by_sample_it_is_the_same_filter(passed):
    """Position given all samples up to k, from dense conditioning on exactly those."""
    data, space, _, _ = passed
    no_segments, not_bridged = np.zeros((N, 3)), np.zeros(N, bool)  # and all moments
    data = replace(data, segments_m=no_segments, bridged=not_bridged, turning=SEEN)
    online = CausalFilter(space, data.geometry_m[0], data.velocity_m_s, phi=PHI)
    for k in range(N):
        if k:
            driven = SEEN[k] and SEEN[k - 1]
            online.advance(space, data.acceleration_m_s2[k - 1] if driven else None)
        mean, variance = online.update(data.geometry_m[k], data.moment_m[k] if SEEN[k] else None)
        for axis in range(3):
            dense = written_out(axis, data)
            m = k + 1 + (int(SEEN[: k + 1].sum()) if axis < 2 else 0)
            y = dense.y[:m]
            gain = np.linalg.solve(y @ y.T, y @ dense.c[k])
            expected = dense.c_mean[k] + gain @ (measured(axis, data)[:m] - dense.y_mean[:m])
            assert mean[0, axis] == pytest.approx(expected, abs=1e-7)
            assert variance[axis] == pytest.approx(dense.c[k] @ dense.c[k] - gain @ y @ dense.c[k], rel=1e-4)


def test_a_bias_of_the_plates_is_held_against_what_the_data_could_tell(passed):
    """By hand: half of the prior variance is learnt on both axes, then too little to mean anything."""
    _, space, _, forward = passed
    prior = space.constant_sd[:2, ACCELERATION] ** 2

    def told(share: float) -> ForwardPass:
        cov, constants = forward.constants_cov.copy(), forward.constants.copy()
        cov[:2, ACCELERATION, ACCELERATION] = (1.0 - share) * prior
        constants[:2, ACCELERATION] = 0.3, -0.1
        return replace(forward, constants=constants, constants_cov=cov)

    assert plate_bias_statistic(space, told(0.5)) == pytest.approx((0.3**2 + 0.1**2) / (0.5 * 0.05**2))
    assert plate_bias_statistic(space, told(0.04)) == 0.0
    along_y = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    (remark,) = plate_bias_remarks(space, told(0.5), 70.0, 2.0, along_y)
    assert "+7.0 N along x and +21.0 N along y, and 2 N is declared" in remark.message
    assert plate_bias_remarks(space, told(0.04), 70.0, 2.0, along_y) == ()


def test_vertically_the_noise_of_the_geometry_is_learnt_from_its_roughness():
    """Twice as rough upwards is twice the noise there, and changes nothing horizontally."""
    data = some_signals()
    louder = replace(data, geometry_m=data.geometry_m * [1.0, 1.0, 2.0])
    one, other = (learn_sizes(SIZES, signals, RATE_HZ).marker_m for signals in (data, louder))
    assert other == pytest.approx(one * [1.0, 1.0, 2.0], rel=1e-9)


def test_the_momentum_of_an_adult():
    """1.0 and 1.5 Nms at 70 kg and 1.70 m, over the weight; with the stature squared at the same mass."""
    assert adult_momentum_m_s(70.0, 0.55 * 1.7) == pytest.approx((1.0 / 686.7, 1.5 / 686.7))
    assert adult_momentum_m_s(70.0, 0.55 * 0.85) == pytest.approx((0.25 / 686.7, 0.375 / 686.7))


def test_the_covariance_of_white_noise_settles(monkeypatch):
    """Its memory has no variance and unbounded information, which must not keep the recursion from converging."""
    n = 3000
    seen = np.ones(n, bool)
    zeros = np.zeros((n, 3))
    data = Signals(zeros, zeros, zeros, seen, seen, ~seen, np.ones(n), zeros, zeros, np.zeros(3))
    every = np.zeros(3)
    space = state_space(replace(SIZES, marker_corner_hz=every, plate_corner_hz=every), RATE_HZ)
    gains = compute_gains(space, data)
    forward = filter_forward(space, data, gains)
    step = mock.Mock(wraps=kalman_rts._smoothed_covariance)
    monkeypatch.setattr(kalman_rts, "_smoothed_covariance", step)
    covariance = smooth_backward(gains, forward, 2)[1]
    assert step.call_count < n / 3
    monkeypatch.setattr(kalman_rts, "SETTLED", -1.0)
    assert covariance == pytest.approx(smooth_backward(gains, forward, 2)[1], rel=1e-6)
    assert step.call_count > n
