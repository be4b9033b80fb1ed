"""Sample by sample gives what the batch gives; what is missing or wrong in a stream does no lasting harm."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal, stats

from stridelab.dynamics.wrench import Wrench
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import FilterState, filter_inputs, forward_pass
from stridelab.estimation.complementary.transfer_functions import complementary_filters
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.online_estimator import OnlineEstimator
from support.recordings.analytic_motions import Harmonics, Motion, sinusoid, uniform, walk

TABLE_SD_M = (0.009, 0.009, 0.02)
THESIS = ComplementaryFilter.thesis()


def stepped(online, t, g, f, nu):
    """CoM, velocity and band of a stream; rows that are NaN are not given."""

    def given(row):
        return None if np.isnan(row).any() else row

    samples = [
        online.step(time_s, given(g_k), given(f_k), given(nu_k))
        for time_s, g_k, f_k, nu_k in zip(t.tolist(), g, f, nu, strict=True)
    ]
    return tuple(np.array(rows) for rows in zip(*samples, strict=True))


def stream(motion, t):
    return motion.com.at(t), motion.force(t), motion.moment(t)


def test_the_filter_is_an_online_estimator():
    assert isinstance(THESIS.causal(70.0, TABLE_SD_M), OnlineEstimator)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 1000.0])
def test_the_online_step_equals_the_batch_forward_pass(rate_hz):
    """Both stand still for three samples, which every start agrees on; then anything may come."""
    rng = np.random.default_rng(1)
    motion, t = walk(), np.arange(int(2 * rate_hz)) / rate_hz
    g, f, nu = stream(motion, t)
    g, f, nu = (x + rng.normal(0, sd, x.shape) for x, sd in ((g, 0.01), (f, 10.0), (nu, 10.0)))
    f[20:30], nu[20:30] = 0.0, 0.0  # a flight phase
    g[:3], f[:3] = g[0], (0.0, 0.0, motion.mass_kg * 9.81)
    nu[:3] = np.cross(g[0], f[0])
    filters = complementary_filters(0.4, 4.0, rate_hz)
    resting = signal.lfilter_zi(filters.s2_h2.b, filters.s2_h2.a)[:, None] * g[0]
    nothing = np.zeros((2, 3))
    inputs = filter_inputs(g, Wrench(f, nu), motion.mass_kg)
    batch = forward_pass(filters, inputs, FilterState(h2=nothing, s2_h2=resting, h3=nothing))
    online = THESIS.causal(motion.mass_kg, TABLE_SD_M, velocity_m_s=np.zeros(3))
    assert_allclose(stepped(online, t, g, f, nu)[0], batch, atol=1e-12, rtol=0)


@pytest.mark.parametrize("stated", [True, False])
def test_a_uniform_motion_passes_unchanged_from_the_first_sample(stated):
    motion, t = uniform(), np.arange(300) / 100.0
    online = THESIS.causal(motion.mass_kg, TABLE_SD_M, motion.com.rate if stated else None)
    com, velocity, _ = stepped(online, t, *stream(motion, t))
    assert_allclose(com, motion.com.at(t), atol=1e-9, rtol=0)
    assert_allclose(velocity[1:], motion.com.at(t, 1)[1:], atol=1e-9, rtol=0)


def test_an_accelerated_motion_is_followed_without_a_lag_in_position_and_velocity():
    motion, t = sinusoid(1.0, 0.05), np.arange(1200) / 400.0
    com, velocity, _ = stepped(THESIS.causal(motion.mass_kg, TABLE_SD_M), t, *stream(motion, t))
    assert np.abs(com - motion.com.at(t)).max() < 1e-4
    assert np.abs(velocity - motion.com.at(t, 1))[1:].max() < 1e-3


def test_marker_noise_at_the_start_is_averaged_out_as_by_a_line_fit():
    """The end of a least-squares line through n samples has a standard deviation of about 2 / sqrt(n)."""
    motion, t, n = uniform(), np.arange(21) / 200.0, 20
    c, f, _ = stream(motion, t)
    ours, fitted = [], []
    for seed in range(60):
        noisy = c + np.random.default_rng(seed).normal(0, 1.0, c.shape)
        nowhere = np.cross(noisy, f)  # the axis through the noisy point: it says nothing
        com, _, _ = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, noisy, f, nowhere)
        ours.append(com[n] - c[n])
        line = np.polynomial.polynomial.polyfit(t, noisy, 1)
        fitted.append(line[0] + line[1] * t[n] - c[n])
    assert np.std(ours) == pytest.approx(np.std(fitted), rel=0.25)
    assert np.std(fitted) == pytest.approx(2 / np.sqrt(n), rel=0.15)


def test_a_wrong_velocity_is_forgotten_within_ten_time_constants():
    motion, t = uniform(), np.arange(300) / 100.0
    com, _, _ = stepped(THESIS.causal(motion.mass_kg, TABLE_SD_M, np.zeros(3)), t, *stream(motion, t))
    error = com - motion.com.at(t)
    assert np.abs(error[:5]).max() > 0.005
    assert np.abs(error[45:]).max() < 1e-4


def test_jitter_of_the_clock_is_taken_as_it_is():
    motion, rng = walk(), np.random.default_rng(2)
    even = np.arange(1000) / 500.0
    t = even + rng.uniform(-0.4, 0.4, 1000) / 500.0
    com = [stepped(THESIS.causal(motion.mass_kg, TABLE_SD_M), x, *stream(motion, x))[0] for x in (t, even)]
    truth = [motion.com.at(x) for x in (t, even)]
    assert_allclose(com[0] - truth[0], com[1] - truth[1], atol=2e-4)


def test_hidden_markers_are_bridged_by_the_force():
    motion, t = walk(), np.arange(1200) / 200.0
    g, f, nu = stream(motion, t)
    hidden = (t >= 3.0) & (t < 3.5)
    seen, _, _ = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, g, f, nu)
    g[hidden] = np.nan
    com, velocity, sd = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, g, f, nu)
    assert np.abs(com - seen).max() < 0.002
    assert np.abs(velocity - motion.com.at(t, 1))[1:].max() < 0.05
    assert (np.diff(sd[hidden], axis=0) >= 0).all()
    assert sd[hidden][-1, 2] > 1.2 * sd[~hidden][-1, 2]


def test_after_a_second_without_markers_the_filter_starts_anew():
    motion, t = uniform(), np.arange(800) / 200.0
    g, f, nu = stream(motion, t)
    hidden = (t >= 1.0) & (t < 2.5)
    g[hidden] = f[hidden] = nu[hidden] = np.nan
    g[t >= 2.5] += 0.5  # it has moved on otherwise
    com, velocity, sd = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, g, f, nu)
    assert_allclose(com[hidden], motion.com.at(t[hidden]), atol=1e-3)  # straight on
    assert sd[hidden][-1].max() > 1.0
    back = np.flatnonzero(t >= 2.5)[0]
    assert_allclose(com[back], g[back], atol=1e-4)
    assert_allclose(velocity[back + 1], motion.com.rate, atol=0.2)  # the axis calls for the old place
    assert sd[back].max() < 0.025


def test_without_force_the_geometry_is_followed():
    motion, t = walk(), np.arange(800) / 200.0
    g = motion.com.at(t)
    none = np.full_like(g, np.nan)
    com, velocity, sd = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, g, none, none)
    error = np.abs(com - g)[1:]
    assert error.max() < 0.006  # the lag of 4 Hz behind an acceleration that is not known
    assert np.abs(velocity - motion.com.at(t, 1))[1:].max() < 0.35
    assert (error < 1.96 * sd[1:]).mean() > 0.95


def test_force_that_begins_and_ends_leaves_no_step():
    """Without errors in the data any combination of inputs tells the same, up to the lag without force."""
    motion, t = Motion(walk().com), np.arange(1000) / 200.0
    g, f, nu = stream(motion, t)
    off = (t % 1.0) < 0.5
    f[off] = nu[off] = np.nan
    com, _, _ = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, g, f, nu)
    assert np.abs(com - g).max() < 0.008
    assert np.abs(np.diff(com - g, axis=0)).max() < 5e-4


SEEDS = 60
QUANTILES = stats.norm.ppf((np.arange(SEEDS) + 0.5) / SEEDS)
TABLES = np.stack([np.random.default_rng(axis).permutation(QUANTILES) for axis in range(3)], axis=1) * TABLE_SD_M
"""Errors of the table as they are spread, without the luck of the draw: they decide the result."""


def draw(seed, t, priors):
    """One stream whose errors are drawn from the priors."""
    rng = np.random.default_rng(seed)
    waves = tuple(
        (hz, np.sqrt(2) * 70 * rate / (2 * np.pi * hz) * axis, rng.uniform(0, 2 * np.pi))
        for hz, rate, axis in zip(
            (priors.step_hz / 2, priors.step_hz), priors.momentum_rate_nm_kg, np.eye(3)[:2], strict=True
        )
    )
    motion = Motion(walk().com, Harmonics(np.zeros(3), np.zeros(3), waves), 70.0)
    late = t - rng.normal(0, priors.clock_s)
    f_error = 70 * rng.normal(0, priors.acceleration_m_s2) + rng.normal(0, priors.force_n, (len(t), 3))
    nu_error = np.append(rng.normal(0, priors.moment_nm, 2), 0.0)
    c = motion.com.at(t)
    g = c + TABLES[seed] + rng.normal(0, priors.marker_m, c.shape)
    # the moment error is stated at the body: a force error comes with its lever arm
    nu = motion.moment(late) + np.cross(motion.com.at(late), f_error) + nu_error
    return c, g, motion.force(late) + f_error, nu


@pytest.mark.parametrize("method", [ComplementaryFilter(), THESIS], ids=["auto", "thesis"])
@pytest.mark.parametrize("partial", [False, True], ids=["force", "partial force"])
def test_the_band_is_the_spread_of_the_estimator(method, partial):
    t = np.arange(150) / 50.0
    errors, bands = [], []
    for seed in range(SEEDS):
        c, g, f, nu = draw(seed, t, ErrorPriors())
        if partial:
            off = (t < 0.5) | (t > 2.0)
            f[off] = nu[off] = np.nan
        com, _, sd = stepped(method.causal(70.0, TABLE_SD_M), t, g, f, nu)
        errors.append(com - c)
        bands.append(sd)
    result, stated = np.array(errors), np.array(bands)
    rms = np.sqrt((result**2).mean(axis=(0, 1)))
    assert np.sqrt((stated**2).mean(axis=(0, 1))) == pytest.approx(rms, rel=0.3)
    coverage = (np.abs(result) < 1.96 * stated).mean(axis=(0, 1))
    assert (coverage > 0.88).all()


def test_no_force_can_narrow_the_height():
    motion, t = walk(), np.arange(1000) / 200.0
    _, _, sd = stepped(ComplementaryFilter().causal(motion.mass_kg, TABLE_SD_M), t, *stream(motion, t))
    assert (sd[:, 2] >= TABLE_SD_M[2]).all()
    assert (sd[-1, :2] < TABLE_SD_M[:2]).all()


@pytest.mark.parametrize(
    ("second", "code"),
    [
        ((0.0, 0, 0, 0), "time-not-increasing"),
        ((-0.1, 0, 0, 0), "time-not-increasing"),
        ((1.5, 0, 0, 0), "time-jump"),
        ((np.nan, 0, 0, 0), "not-finite"),
        ((np.inf, 0, 0, 0), "not-finite"),
        ((0.01, np.nan, 0, 0), "not-finite"),
        ((0.01, 0, np.inf, 0), "not-finite"),
        ((0.01, 0, 0, np.nan), "not-finite"),
        ((0.01, 0, 0, None), "force-without-moment"),
        ((0.01, 0, None, 0), "force-without-moment"),
    ],
)
def test_bad_samples_are_refused_by_name(second, code):
    c, f = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 686.7])
    online = ComplementaryFilter().causal(70.0, TABLE_SD_M)
    online.step(0.0, c, f, np.zeros(3))
    time_s, *rest = second
    with pytest.raises(InvalidInput) as refused:
        online.step(time_s, *(None if x is None else y + x for x, y in zip(rest, (c, f, np.zeros(3)), strict=True)))
    assert refused.value.code == code


def test_a_stream_begins_with_geometry():
    online = ComplementaryFilter().causal(70.0, TABLE_SD_M)
    with pytest.raises(NotEstimable) as refused:
        online.step(0.0, None, np.array([0.0, 0.0, 700.0]), np.zeros(3))
    assert refused.value.code == "geometry-missing"


@pytest.mark.parametrize(
    ("method", "mass_kg", "code"),
    [
        (ComplementaryFilter(), 0.0, "mass-out-of-range"),
        (ComplementaryFilter(low_hz=2.0), 70.0, "cutoffs-out-of-range"),
        (ComplementaryFilter(low_hz=0.0), 70.0, "cutoffs-out-of-range"),
        (replace(ComplementaryFilter(), high_hz=np.inf), 70.0, "cutoffs-out-of-range"),
    ],
)
def test_senseless_parameters_are_refused_by_name(method, mass_kg, code):
    with pytest.raises(InvalidInput) as refused:
        method.causal(mass_kg, TABLE_SD_M)
    assert refused.value.code == code
