"""Tracks of real walks as point masses: Newton and Euler hold, and the errors that are drawn have their sizes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from experiments.real_tracks import ESTIMATORS, ExactWalk, TrackErrors, draw_inputs, exact_walk
from experiments.track_floor import acceleration_covariance, least_error
from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.differentiation import window_span
from stridelab.estimation.latency import ClockError, remaining_clock_error
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.recordings.recording import WrenchTrack


@pytest.fixture(scope="module")
def walk(gait: Path) -> ExactWalk:
    (path,) = gait.glob("rehazenter-adult-walking/2014001/*_C4_*.c3d")
    return exact_walk(path)


def test_the_force_moves_the_centre_of_mass_and_its_moment_the_segments(walk: ExactWalk) -> None:
    t = walk.time_s
    speed = np.gradient(walk.com_m, t, axis=0)
    gained = cumulative_trapezoid(walk.force_n / walk.mass_kg - [0.0, 0.0, GRAVITY_M_S2], t, axis=0, initial=0.0)
    inner = slice(10, -10)
    assert np.ptp((speed - gained)[inner], axis=0).max() < 0.005
    momentum = np.zeros_like(speed)
    for name, track in walk.segment_m.items():
        arm = track - walk.com_m
        momentum += walk.mass_kg * walk.fraction[name] * np.cross(arm, np.gradient(arm, t, axis=0))
    gained = cumulative_trapezoid(walk.momentum_rate_nm, t, axis=0, initial=0.0)
    assert np.ptp((momentum - gained)[inner], axis=0).max() < 0.05 * np.ptp(momentum[inner], axis=0).max()


def test_the_drawn_errors_have_the_sizes_of_the_priors(walk: ExactWalk) -> None:
    offsets, moments = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        geometric, wrench, mass_kg = draw_inputs(walk, TrackErrors(markers="white", whole=True, rolls=False), rng)
        offsets.append([*(geometric.com_m - walk.com_m).mean(axis=0), mass_kg / walk.mass_kg - 1.0])
        seen = wrench.complete
        about = wrench.moment_nm - np.cross(walk.com_m, wrench.force_n) - walk.momentum_rate_nm
        moments.append(np.diff(about[seen], axis=0).std(axis=0) / np.sqrt(2.0))
    sizes = np.std(offsets, axis=0)
    assert sizes[:3] == pytest.approx(walk.sd_m, rel=0.35)
    assert sizes[3] == pytest.approx(SmootherPriors().mass_share, rel=0.3)
    assert np.mean(moments, axis=0)[2] == pytest.approx(SmootherPriors().moment_nm, rel=0.2)


def test_a_late_force_is_noticed_where_the_clocks_have_not_been_compared(walk: ExactWalk) -> None:
    errors = TrackErrors(markers="filtered", whole=True, rolls=False)
    geometric, wrench, mass_kg = draw_inputs(walk, errors, np.random.default_rng(4))
    late_s, prior_s, seen = 0.006, 0.005, wrench.complete
    late = replace(wrench, force_n=wrench.force_n.copy(), moment_nm=wrench.moment_nm.copy())
    for track in (late.force_n, late.moment_nm):
        track[seen] = CubicSpline(walk.time_s[seen], track[seen])(np.maximum(walk.time_s[seen] - late_s, 0.1))

    def clock(track: WrenchTrack) -> ClockError:
        return remaining_clock_error(geometric, track, window_span(geometric, track), mass_kg, prior_s)

    change_s, kept = clock(late).mean_s - clock(wrench).mean_s, 1.0 - (clock(late).sd_s / prior_s) ** 2
    assert kept > 0.6
    assert change_s == pytest.approx(kept * late_s, abs=0.001)
    compared = replace(late, clocks_compared=True)
    assert clock(compared) == clock(replace(late, withheld=~seen)) == ClockError(0.0, prior_s)
    found, trusted = (Smoother().estimate(geometric, track, mass_kg) for track in (late, compared))
    assert found.diagnostics["clock_ms"] == pytest.approx(1e3 * clock(late).mean_s)
    assert "clock_ms" not in trusted.diagnostics
    truth = walk.com_m[np.searchsorted(walk.time_s, found.time_s - 1e-9), 0]
    assert np.abs(found.com_m[:, 0] - truth).mean() < 0.7 * np.abs(trusted.com_m[:, 0] - truth).mean()
    assert found.sd_m[:, 0].mean() < 0.85 * trusted.sd_m[:, 0].mean()
    known = replace(compared, clock_sd_s=0.001)
    exact, stated, large = (
        smoother.estimate(geometric, track, mass_kg).sd_m
        for smoother, track in (
            (Smoother(), known),
            (Smoother(compared_clock=False), known),
            (Smoother(), replace(compared, clock_sd_s=0.02)),
        )
    )
    assert exact[:, 0].mean() < 0.85 * trusted.sd_m[:, 0].mean()
    assert stated == pytest.approx(trusted.sd_m, rel=1e-9)
    assert large == pytest.approx(trusted.sd_m, rel=1e-9)


def test_the_least_error_falls_with_what_is_known_of_clock_and_table(walk: ExactWalk) -> None:
    part = slice(30, 90)
    short = replace(
        walk,
        **{name: getattr(walk, name)[part] for name in ("time_s", "com_m", "force_n", "momentum_rate_nm")},
        segment_m={name: track[part] for name, track in walk.segment_m.items()},
        windows=(),
    )
    errors = TrackErrors(markers="white", whole=True, rolls=False)
    covariance = acceleration_covariance([walk], len(short.time_s))
    exact, shared, moments = (least_error(short, errors, covariance, c) for c in ("exact", "shared", "moments"))
    assert exact.clock_sd_s == 0.0 < shared.clock_sd_s < SmootherPriors().clock_s
    assert exact.square_m2[0] < shared.square_m2[0] < moments.square_m2[0]
    known = replace(short, sd_m=(1e-4, 1e-4, 1e-4))
    rest = least_error(known, errors, covariance, "exact").square_m2
    assert (rest < SmootherPriors().table_varying_m ** 2).all()
    assert (exact.square_m2 < np.square(walk.sd_m[:2])).all()


def test_every_estimator_takes_the_walk(walk: ExactWalk) -> None:
    rng = np.random.default_rng(1)
    geometric, wrench, mass_kg = draw_inputs(walk, TrackErrors(markers="filtered", whole=True, rolls=True), rng)
    for estimator in ESTIMATORS.values():
        estimate = estimator.estimate(geometric, wrench, mass_kg)
        inside = np.searchsorted(walk.time_s, estimate.time_s)
        assert np.abs(estimate.com_m - walk.com_m[inside])[:, :2].max() < 0.06
