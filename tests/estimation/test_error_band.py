"""The band against a Monte Carlo of the estimator itself, on a walk whose truth is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.error_band import FusedStretch, _error_signals
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import TABLE_SD_M, draw

PRIORS = ErrorPriors()
SEEDS = 60


def errors_and_bands(estimator, priors, window, seeds=SEEDS):
    errors, bands = [], []
    for seed in range(seeds):
        motion, geometric, wrench = draw(seed, priors, window)
        estimate = estimator.estimate(geometric, wrench, 70.0)
        errors.append(estimate.com_m - motion.com.at(estimate.time_s))
        bands.append(estimate.sd_m)
    return np.array(errors), np.array(bands)


@pytest.mark.parametrize("window", [Window(0.5, 1.5), Window(0.7, 1.3)])
@pytest.mark.parametrize(
    "estimator",
    [ComplementaryFilter(), ComplementaryFilter.thesis(), GeometryOnly()],
    ids=["auto", "thesis", "geometry"],
)
def test_the_band_is_the_spread_of_the_estimator(estimator, window):
    errors, bands = errors_and_bands(estimator, PRIORS, window)
    rms, stated = np.sqrt((errors**2).mean(axis=(0, 1))), np.sqrt((bands**2).mean(axis=(0, 1)))
    assert stated == pytest.approx(rms, rel=0.3)
    # 400 seeds give 0.92-0.99; with 60 the constant errors of each seed leave 0.03 of scatter
    coverage = (np.abs(errors) < 1.96 * bands).mean(axis=(0, 1))
    assert (coverage > 0.88).all()
    assert (coverage <= 1.0).all()


@pytest.mark.parametrize("estimator", [KalmanFilter.tuned(), RtsSmoother.tuned()], ids=["kalman", "rts"])
def test_the_band_of_the_jerk_model_is_its_spread_and_not_what_the_model_believes(estimator):
    errors, bands = errors_and_bands(estimator, PRIORS, Window(0.5, 1.5), seeds=30)
    rms, stated = np.sqrt((errors**2).mean(axis=(0, 1))), np.sqrt((bands**2).mean(axis=(0, 1)))
    assert stated == pytest.approx(rms, rel=0.35)
    assert ((np.abs(errors) < 1.96 * bands).mean(axis=(0, 1)) > 0.85).all()
    _, geometric, wrench = draw(0, PRIORS, Window(0.5, 1.5))
    believed = estimator.estimate(geometric, wrench, 70.0).diagnostics
    assert all(believed[f"model_sd_{axis}_m"] < 0.5 * sd for axis, sd in zip("xyz", rms, strict=True))


def test_each_source_alone_is_propagated():
    nothing = ErrorPriors(
        marker_m=1e-9,
        force_n=1e-6,
        acceleration_m_s2=(0.0, 0.0, 0.0),
        moment_nm=0.0,
        momentum_rate_nm_kg=(0.0, 0.0),
        clock_s=0.0,
    )
    window, none = Window(0.5, 1.5), (0.0, 0.0, 0.0)
    for name in ("marker_m", "force_n", "acceleration_m_s2", "moment_nm", "momentum_rate_nm_kg", "clock_s"):
        priors = replace(nothing, **{name: getattr(PRIORS, name)})
        rms, stated = [], []
        for seed in range(30):
            motion, geometric, wrench = draw(seed, priors, window, none)
            estimate = ComplementaryFilter(priors=priors).estimate(geometric, wrench, 70.0)
            rms.append(((estimate.com_m - motion.com.at(estimate.time_s)) ** 2).mean(axis=0))
            stated.append((estimate.sd_m**2).mean(axis=0))
        result, band = np.sqrt(np.mean(rms, axis=0)), np.sqrt(np.mean(stated, axis=0))
        loudest = np.argmax(result)
        assert band[loudest] == pytest.approx(result[loudest], rel=0.45), (name, result, band)


def test_no_force_can_narrow_the_height():
    _, geometric, wrench = draw(0, PRIORS, Window(0.5, 1.5))
    estimate = ComplementaryFilter().estimate(geometric, wrench, 70.0)
    assert (estimate.sd_m[:, 2] > 0.98 * TABLE_SD_M[2]).all()
    assert (estimate.sd_m[:, :2].min(axis=0) < 0.9 * np.array(TABLE_SD_M[:2])).all()


def test_angular_momentum_is_stated_about_the_walk_with_the_strides_and_about_its_side_with_the_steps():
    """By hand: f x L' / f^2 under a vertical force, for a walk that goes aslant."""
    t, ahead = np.arange(200) / 100.0, np.array([0.6, 0.8, 0.0])
    force = np.tile([0.0, 0.0, 686.7], (200, 1))
    stretch = FusedStretch(Wrench(force, 0 * force), np.tile(1.2 * ahead, (200, 1)), slice(0, 200), 100.0, 70.0)
    errors = list(
        _error_signals(stretch, (0.01, 0.01, 0.02), ErrorPriors(momentum_rate_nm_kg=(0.12, 0.33), step_hz=1.8))
    )
    assert len(errors) == 13
    for first, hz, rate, moved in ((8, 0.9, 0.12, [-0.8, 0.6, 0.0]), (10, 1.8, 0.33, [-0.6, -0.8, 0.0])):
        for k, wave in enumerate((np.cos, np.sin)):
            expected = np.outer(rate / 9.81 * wave(2 * np.pi * hz * t), moved)
            np.testing.assert_allclose(errors[first + k].axis_point_m, expected, atol=1e-12)
            assert not errors[first + k].geometry_m.any()
            assert not errors[first + k].acceleration_m_s2.any()
