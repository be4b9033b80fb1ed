"""The smoother on simulated walks of TALOS, whose CoM is known: what it gains, what its band is worth, what it refuses.

Few seeds; docs/theory/smoother.md has the figures of fifty.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.online_estimator import OnlineEstimator
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.reproduction.studies.estimator_study import StudyTrial, simulate_trial
from stridelab.simulation.noise import PRESETS

GAITS = ("robot", "human")


def told(trial: StudyTrial, **changed: float) -> SmootherPriors:
    """The sizes of the simulated noise, which the thesis' Kalman filter is given; nothing about angular momentum."""
    noise = trial.noise
    stated = {
        "marker_m": float(np.mean(trial.noise_sd_m)),
        "marker_corner_hz": noise.high_pass_hz,
        "force_n": noise.force_n,
        "moment_nm": noise.moment_nm,
        "plate_corner_hz": noise.high_pass_hz,
        "plate_force_n": noise.plate_bias_n,
        "plate_moment_nm": noise.plate_bias_nm,
        "walking_moment_nm": (0.0, 0.0),
        "clock_s": 0.0,
    }
    return SmootherPriors(**{**stated, **changed})


def error_m(trial: StudyTrial, estimate: ComEstimate) -> np.ndarray:
    first = round(estimate.time_s[0] * 200)
    return estimate.com_m - trial.truth.com_m[first : first + len(estimate.time_s)]


def horizontal(errors: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean([np.sum(e[:, :2] ** 2, axis=1).mean() for e in errors])))


@pytest.mark.parametrize(("noise", "share"), [("thesis", 0.15), ("white", 0.35)])
@pytest.mark.parametrize("gait", GAITS)
def test_horizontally_it_is_far_closer_than_the_filter_and_its_band_is_honest(gait: str, noise: str, share: float):
    ours, theirs, inside, lags_s = [], [], [], []
    for seed in range(2):
        trial = simulate_trial(gait, noise, seed)
        estimate = Smoother(priors=told(trial)).estimate(trial.geometric, trial.wrench, trial.mass_kg)
        filtered = ComplementaryFilter.thesis().estimate(trial.geometric, trial.wrench, trial.mass_kg)
        error = error_m(trial, estimate)
        ours.append(error)
        theirs.append(error_m(trial, filtered))
        inside.append((np.abs(error) < 1.96 * estimate.sd_m).mean(axis=0))
        assert estimate.sd_m[:, 2].min() >= trial.geometric.sd_m[2]
        assert np.sqrt(np.mean(estimate.sd_m[:, :2] ** 2)) < 4 * np.sqrt(np.mean(error[:, :2] ** 2))
        assert 0.8 < estimate.diagnostics["normalised_innovations"] < 1.3
        assert not estimate.remarks
        v = trial.truth.velocity_m_s[: len(error), :2]
        lags_s.append(-np.sum((error - error.mean(axis=0))[:, :2] * v, axis=0) / np.sum(v**2, axis=0))
    assert horizontal(ours) < share * horizontal(theirs)
    assert (np.mean(inside, axis=0)[:2] > 0.92).all()
    if noise == "thesis":  # white noise leaves the lag of one walk uncertain by 1.7 ms sideways
        assert (np.abs(lags_s) < 0.001).all()


def test_one_second_of_force_in_two():
    errors, bands = [], []
    for seed, start_s in enumerate((2.2, 3.4, 4.1)):
        trial = simulate_trial("human", "marker-like", seed).excerpt_between(start_s, start_s + 2.0, force_s=(0.5, 1.5))
        smoother = Smoother(priors=told(trial), beyond_window=True)
        estimate = smoother.estimate(trial.geometric, trial.wrench, trial.mass_kg)
        assert len(estimate.time_s) == 400
        error = error_m(trial, estimate)
        within = trial.wrench.complete
        errors.append(error[within])
        bands.append((np.abs(error[within]) < 1.96 * estimate.sd_m[within]).mean(axis=0))
        assert np.sqrt(np.mean(np.sum(error[~within, :2] ** 2, axis=1))) < 0.005
    assert horizontal(errors) < 0.0035
    assert (np.mean(bands, axis=0)[:2] > 0.9).all()


def test_a_declared_bias_of_the_plates_is_in_the_band_and_an_undeclared_one_raises_a_flag():
    noise = replace(PRESETS["thesis"], plate_bias_n=5.0, plate_bias_nm=3.0)
    seeds = [s for s in range(6) if biases_n(simulate_trial("robot", noise, s)) > 5.0][:2]
    assert len(seeds) == 2
    for seed in seeds:
        trial = simulate_trial("robot", noise, seed)
        declared = Smoother(priors=told(trial)).estimate(trial.geometric, trial.wrench, trial.mass_kg)
        assert (np.abs(error_m(trial, declared))[:, :2] < 1.96 * declared.sd_m[:, :2]).mean() > 0.9
        assert not declared.remarks
        silent = told(trial, plate_force_n=1.0, plate_moment_nm=1.0)
        flagged = Smoother(priors=silent).estimate(trial.geometric, trial.wrench, trial.mass_kg)
        assert [r.code for r in flagged.remarks] == ["undeclared-plate-bias"]


def biases_n(trial: StudyTrial) -> float:
    """Horizontal bias of the force that was drawn."""
    error = np.mean(trial.wrench.force_n - trial.truth.force_n, axis=0)
    return float(np.hypot(error[0], error[1]))


def test_a_window_in_which_no_foot_stands_alone_for_long_is_refused():
    """Half a second at a robot's cadence, around a double support."""
    trial = simulate_trial("robot", "marker-like", 0)
    side = np.sign(trial.truth.moment_nm[:, 0] / trial.truth.force_n[:, 2] - trial.truth.com_m[:, 1])
    changes = np.flatnonzero(np.diff(side)) / 200
    at = float(changes[(changes > 3.0)][0])
    trial = trial.excerpt_between(at - 1.0, at + 1.0, force_s=(0.75, 1.25))
    with pytest.raises(NotEstimable) as refused:
        Smoother().estimate(trial.geometric, trial.wrench, trial.mass_kg)
    assert refused.value.code == "no-single-support"
    message = re.search(r"is (\d\.\d\d) s of a step of (\d\.\d\d) s\. At least one", refused.value.message)
    assert message is not None
    assert float(message[1]) < 0.5
    assert float(message[2]) == pytest.approx(np.median(np.diff(changes)), rel=0.05)


def test_the_angular_momentum_of_the_segments_is_used_where_it_explains_the_moments():
    """Markers with small noise show it; under the thesis' joint noise its rate is noise, and the data refuse it."""
    trial = simulate_trial("human", "marker-like", 1).excerpt_between(3.0, 5.0, force_s=(0.5, 1.5))
    estimate = Smoother(priors=told(trial)).estimate(trial.geometric, trial.wrench, trial.mass_kg)
    bare = replace(trial.geometric, segments={})
    without = Smoother(priors=told(trial)).estimate(bare, trial.wrench, trial.mass_kg)
    assert horizontal([error_m(trial, estimate)]) < 0.0035
    assert estimate.sd_m[:, 0].mean() < without.sd_m[:, 0].mean()  # less is left to guess
    required = Smoother(priors=told(trial), segment_momentum=True)
    np.testing.assert_array_equal(required.estimate(trial.geometric, trial.wrench, trial.mass_kg).com_m, estimate.com_m)
    with pytest.raises(NotEstimable) as refused:
        required.estimate(bare, trial.wrench, trial.mass_kg)
    assert refused.value.code == "segments-missing"
    noisy = simulate_trial("human", "thesis", 0).excerpt_between(3.0, 6.0)
    estimates = [
        Smoother(priors=told(noisy)).estimate(geometric, noisy.wrench, noisy.mass_kg)
        for geometric in (noisy.geometric, replace(noisy.geometric, segments={}))
    ]
    np.testing.assert_array_equal(estimates[0].com_m, estimates[1].com_m)


def test_online_it_knows_only_the_past_and_is_still_closer_than_the_geometry():
    trial = simulate_trial("human", "thesis", 0)
    priors = told(trial, step_hz=1 / trial.step_time_s)
    online = Smoother(priors=priors).causal(mass_kg=trial.mass_kg, table_sd_m=trial.geometric.sd_m)
    assert isinstance(online, OnlineEstimator)
    inputs = zip(
        trial.truth.time_s.tolist(), trial.geometric.com_m, trial.wrench.force_n, trial.wrench.moment_nm, strict=True
    )
    samples = [online.step(*one) for one in inputs]
    error = np.array([s.com_m for s in samples]) - trial.truth.com_m
    of_geometry = trial.geometric.com_m - trial.truth.com_m
    late = slice(400, None)
    assert horizontal([error[late]]) < 0.2 * horizontal([of_geometry[late]])
    sd = np.array([s.sd_m for s in samples])
    assert ((np.abs(error) < 1.96 * sd)[:, :2]).mean() > 0.85
    assert (sd[:, 2] > 0.99 * trial.geometric.sd_m[2]).all()


def test_running_is_followed_through_flight():
    trial = simulate_trial("running", "marker-like", 0)
    estimate = Smoother(priors=told(trial)).estimate(trial.geometric, trial.wrench, trial.mass_kg)
    error = error_m(trial, estimate)
    of_geometry = trial.geometric.com_m[: len(error)] - trial.truth.com_m[: len(error)]
    assert horizontal([error]) < 0.6 * horizontal([of_geometry])
