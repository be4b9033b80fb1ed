"""Tracks of real walks as point masses: Newton and Euler hold, and the errors that are drawn have their sizes."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from experiments.real_tracks import ESTIMATORS, ExactWalk, TrackErrors, draw_inputs, exact_walk
from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.smoother import SmootherPriors


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


def test_every_estimator_takes_the_walk(walk: ExactWalk) -> None:
    rng = np.random.default_rng(1)
    geometric, wrench, mass_kg = draw_inputs(walk, TrackErrors(markers="filtered", whole=True, rolls=True), rng)
    for estimator in ESTIMATORS.values():
        estimate = estimator.estimate(geometric, wrench, mass_kg)
        inside = np.searchsorted(walk.time_s, estimate.time_s)
        assert np.abs(estimate.com_m - walk.com_m[inside])[:, :2].max() < 0.06
