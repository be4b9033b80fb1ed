"""The latency on the simulation study's robot: wrong links, noisy joints, and no joint centres to help."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from stridelab.errors import NotEstimable
from stridelab.estimation.latency import Latency, estimate_latency
from stridelab.recordings.recording import WrenchTrack
from stridelab.reproduction.studies.estimator_study import StudyTrial, simulate_trial
from stridelab.simulation.noise import PRESETS

LATE_S = (-0.010, 0.0, 0.018, 0.030)


def reader(trial: StudyTrial) -> Callable[[float], WrenchTrack]:
    """The force of a trial read at other instants, as from a file; beyond its ends nothing is measured."""
    track, t = trial.wrench, trial.wrench.time_s
    wrench = CubicSpline(t, np.column_stack([track.force_n, track.moment_nm]))

    def at(latency_s: float) -> WrenchTrack:
        read_s = t + latency_s
        known = (read_s >= t[0] - 1e-9) & (read_s <= t[-1] + 1e-9)
        read = wrench(np.clip(read_s, t[0], t[-1]))
        return replace(
            track,
            force_n=read[:, :3],
            moment_nm=read[:, 3:],
            complete=track.complete & known,
            latency_applied_s=latency_s,
        )

    return at


def found(trial: StudyTrial) -> Latency:
    return estimate_latency(trial.geometric, reader(trial), trial.mass_kg)


def trial(gait: str, noise: str, seed: int) -> StudyTrial:
    late = replace(PRESETS[noise], latency_s=LATE_S[seed % len(LATE_S)])
    return simulate_trial(gait, late, seed).excerpt_between(2.0, 6.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("gait", ["robot", "human"])
def test_a_latency_put_in_is_estimated_to_two_milliseconds_in_four_seconds(gait: str) -> None:
    trials = [trial(gait, "marker-like", seed) for seed in range(8)]
    errors = np.array([found(one).latency_s - one.noise.latency_s for one in trials])
    assert np.abs(errors).max() < 0.002
    assert np.sqrt(np.mean(errors**2)) < 0.001


def test_a_second_of_force_is_enough_at_a_human_cadence() -> None:
    trials = [trial("human", "marker-like", seed).excerpt_between(0.5, 2.5, force_s=(0.5, 1.5)) for seed in range(8)]
    errors = np.array([found(one).latency_s - one.noise.latency_s for one in trials])
    assert np.abs(errors).max() < 0.002


def test_the_noise_of_the_thesis_blurs_it_and_the_deviation_says_so() -> None:
    """Nine degrees per joint above 5 Hz: 15 mm of the CoM."""
    trials = [trial("human", "thesis", seed) for seed in range(8)]
    latencies = [found(one) for one in trials]
    errors = np.array([one.latency_s - made.noise.latency_s for one, made in zip(latencies, trials, strict=True)])
    assert np.sqrt(np.mean(errors**2)) < 0.002
    assert np.sqrt(np.mean((errors / [one.sd_s for one in latencies]) ** 2)) < 2.0


def test_a_second_of_nine_degrees_of_white_noise_tells_nothing_and_mostly_says_so() -> None:
    trials = [trial("robot", "white", seed).excerpt_between(0.5, 2.5, force_s=(0.5, 1.5)) for seed in range(8)]
    reports = [one for one in map(latency_or_none, trials) if one is not None and one.sd_s < 0.003]
    assert len(reports) <= 1


def latency_or_none(one: StudyTrial) -> Latency | None:
    try:
        return found(one)
    except NotEstimable:
        return None
