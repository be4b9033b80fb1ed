"""The delay between force and markers is estimated where it was put in on purpose."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from experiments.people.sensors import draw_recording
from stridelab.body.geometric_com import GeometricCom
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import low_pass
from stridelab.estimation.latency import REPEATABILITY_SD_S, estimate_latency, repeated_sd_s
from stridelab.recordings.recording import Window, WrenchTrack
from support.recordings.analytic_motions import Harmonics, Motion, uniform, walk

WINDOW = Window(0.5, 1.5)
T = np.arange(200) / 100.0
WrenchAt = Callable[[float], WrenchTrack]


@pytest.mark.parametrize("late_s", [-0.010, 0.0, 0.008, 0.018, 0.030])
@pytest.mark.parametrize("heading", ["x", "-y"])
def test_an_injected_delay_is_recovered_to_two_milliseconds(late_s, heading):
    t = T
    motion = walk()
    rotation = np.eye(3) if heading == "x" else np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rng = np.random.default_rng(3)
    geometric = motion.geometric(t, noise_m=rng.normal(0, 0.0005, (200, 3)))
    turned = type(geometric)(t, geometric.com_m @ rotation.T, "truth", {}, {}, geometric.sd_m)

    def wrench_at(latency_s):
        w = motion.wrench_track(t, WINDOW, late_s, latency_s)
        noisy = w.force_n + rng.normal(0, 5, (200, 3))
        return type(w)(t, noisy @ rotation.T, w.moment_nm @ rotation.T, w.complete, w.windows, latency_s)

    result = estimate_latency(turned, wrench_at, motion.mass_kg)
    assert result.latency_s == pytest.approx(late_s, abs=0.002)
    assert 0.0002 < result.sd_s < 0.01
    assert result.correlation > 0.8


def test_the_standard_deviation_is_honest():
    """That of the likelihood: this noise has no scatter between trials."""
    t = T
    motion = walk()
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        geometric = motion.geometric(t, noise_m=rng.normal(0, 0.001, (200, 3)))
        noise = rng.normal(0, 5, (200, 3))

        def wrench_at(latency_s, noise=noise):
            w = motion.wrench_track(t, WINDOW, 0.018, latency_s)
            return type(w)(t, w.force_n + noise, w.moment_nm, w.complete, w.windows, latency_s)

        result = estimate_latency(geometric, wrench_at, motion.mass_kg)
        width_s = brentq(lambda w, sd_s=result.sd_s: repeated_sd_s(w) - sd_s, 0.0, 0.05)
        z.append((result.latency_s - 0.018) / width_s)
    assert 0.7 < np.std(z) < 1.3
    assert np.mean(np.abs(z) < 1.96) > 0.85


def test_slow_walks_scatter_as_stated_about_the_walks_of_their_session():
    """Latency and width in ms of twelve walks of one adult (Rehazenter 2014001); the two far ones are the slowest."""
    walks = np.array(
        [
            *[(16.9, 0.89), (17.5, 0.81), (18.8, 2.69), (38.6, 5.53), (30.6, 3.44), (18.9, 1.12)],
            *[(20.1, 1.07), (18.8, 1.05), (13.2, 1.37), (18.9, 1.1), (17.3, 0.96), (17.5, 0.67)],
        ]
    )
    weights = np.array([1e3 * repeated_sd_s(width_ms / 1e3) for width_ms in walks[:, 1]]) ** -2.0
    apart_ms = walks[:, 0] - np.average(walks[:, 0], weights=weights)
    assert np.sum(weights * apart_ms**2) / 11 < 1.5
    assert repeated_sd_s(0.0) == REPEATABILITY_SD_S


def standing(seed: int) -> tuple[GeometricCom, WrenchAt, float]:
    """Somebody who sways a few millimetres, unseen by the markers' noise, with clocks that agree."""
    rng = np.random.default_rng(seed)
    sway = Harmonics(
        np.array([0.4, 0.1, 0.95]), np.zeros(3), ((0.6, np.array([0.004, 0.003, 0.0]), float(rng.uniform(0, 6))),)
    )
    motion = Motion(sway)
    drift = np.cumsum(rng.normal(0, 2e-5, (200, 3)), axis=0)
    noise = low_pass(rng.normal(0, 6, (200, 3)), 100.0, 4.0)

    def wrench_at(latency_s: float) -> WrenchTrack:
        track = motion.wrench_track(T, WINDOW, 0.0, latency_s)
        return replace(track, force_n=track.force_n + noise)

    return motion.geometric(T, noise_m=drift), wrench_at, motion.mass_kg


@pytest.mark.parametrize("seed", range(12))
def test_somebody_who_stands_has_no_latency_whatever_resembles_what_by_chance(seed: int) -> None:
    with pytest.raises(NotEstimable, match="quiet stance") as error:
        estimate_latency(*standing(seed))
    assert error.value.code == "latency-unclear"


@pytest.mark.parametrize("late_s", [-0.3, -0.07, 0.07, 0.085, 0.15])
def test_a_lag_at_the_edge_of_the_search_is_no_finding(late_s: float) -> None:
    """Two swings as periodic as this resemble each other again after a period; the estimate is never far out."""
    motion = walk()
    geometric = motion.geometric(T)

    def wrench_at(latency_s: float) -> WrenchTrack:
        return motion.wrench_track(T, WINDOW, late_s, latency_s)

    with pytest.raises(NotEstimable) as error:
        estimate_latency(geometric, wrench_at, motion.mass_kg)
    assert error.value.code == "latency-unclear"


def test_a_lag_that_keeps_growing_is_given_up() -> None:
    """A force that runs away by 30 ms however late it is read: it is refused, no guess is returned."""
    motion = walk()

    def wrench_at(latency_s: float) -> WrenchTrack:
        return motion.wrench_track(T, WINDOW, 0.03 + latency_s, latency_s)

    with pytest.raises(NotEstimable) as error:
        estimate_latency(motion.geometric(T), wrench_at, motion.mass_kg)
    assert error.value.code == "latency-unclear"


def test_a_body_at_rest_has_no_latency_to_tell():
    t = T
    rng = np.random.default_rng(0)
    motion = uniform((0.0, 0.0, 0.0))
    geometric = motion.geometric(t, noise_m=rng.normal(0, 0.0005, (200, 3)))
    noise = rng.normal(0, 2, (200, 3))

    def wrench_at(latency_s):
        w = motion.wrench_track(t, WINDOW, 0.0, latency_s)
        return type(w)(t, w.force_n + noise, w.moment_nm, w.complete, w.windows, latency_s)

    with pytest.raises(NotEstimable, match="delay") as error:
        estimate_latency(geometric, wrench_at, motion.mass_kg)
    assert error.value.code == "latency-unclear"


def test_jumps_on_the_spot_show_the_latency_by_their_height_alone() -> None:
    misses = []
    for seed in range(6):
        drawn = draw_recording(seed, "hop", duration_s=4.0)
        latency = estimate_latency(drawn.geometric, drawn.wrench_at, drawn.mass_kg)
        misses.append(latency.latency_s - drawn.true_latency_s)
    assert np.abs(misses).max() < 0.002
