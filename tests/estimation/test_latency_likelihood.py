"""A segment whose mass the table has wrong moves the CoM out of phase; the likelihood knows what that looks like."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.estimation.differentiation import window_span
from stridelab.estimation.latency_likelihood import (
    ClockLikelihood,
    PathNoise,
    _cosine_spectrum,
    _orthogonal_complement,
    _slow_columns,
    _table_errors,
    clock_likelihood,
)
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import walk

T = np.arange(200) / 100.0
LATE_S = 0.018
LAGS_S = np.arange(-0.05, 0.0501, 0.001)
SHARES = {"trunk": 0.7, "swinging": 0.3}


def body(wrong: float, noise_m: float = 2e-4) -> GeometricCom:
    """Two segments whose true CoM is that of the walk; the swinging one's mass is overstated by ``wrong``."""
    rng = np.random.default_rng(1)
    c = walk().com.at(T)
    swing = np.column_stack([0.15 * np.sin(2 * np.pi * 1.8 * T), 0 * T, 0.05 * np.cos(2 * np.pi * 1.8 * T + 0.7)])
    tracks = {"swinging": c + swing, "trunk": c - swing * SHARES["swinging"] / SHARES["trunk"]}
    believed = {"trunk": SHARES["trunk"], "swinging": SHARES["swinging"] * (1.0 + wrong)}
    whole = sum(believed.values())
    segments = {
        name: SegmentTrack(believed[name] / whole, track + noise_m * rng.standard_normal(track.shape))
        for name, track in tracks.items()
    }
    com = sum(segment.mass_fraction * segment.com_m for segment in segments.values())
    return GeometricCom(T, np.asarray(com), "made", segments, {}, (0.02, 0.02, 0.02))


def likelihood(geometric: GeometricCom) -> ClockLikelihood:
    motion = walk()
    wrench = motion.wrench_track(T, Window(0.4, 1.6), LATE_S)
    span = window_span(geometric, wrench)
    return clock_likelihood(geometric, wrench, span, motion.mass_kg, np.eye(3), LAGS_S)


def likeliest_s(geometric: GeometricCom) -> float:
    likelihood_of_latency = likelihood(geometric)
    return float(likelihood_of_latency.lag_s[np.argmax(likelihood_of_latency.log_likelihood)])


@pytest.mark.parametrize("wrong", [-0.2, 0.0, 0.2])
def test_the_lag_is_right_whatever_the_mass_of_a_segment(wrong: float) -> None:
    assert likeliest_s(body(wrong)) == pytest.approx(LATE_S, abs=0.0011)


def test_a_wrong_mass_does_not_make_the_same_walk_look_like_another_one() -> None:
    """The path of the markers alone resembles that of the force less; another motion stays another one."""
    wrong = body(-0.4)
    assert likelihood(replace(wrong, segments={})).correlation < 0.8
    assert likelihood(wrong).correlation > 0.98
    other = np.column_stack([0.06 * np.sin(2 * np.pi * 1.3 * T), 0 * T, 0.06 * np.cos(2 * np.pi * 1.3 * T)])
    moved = {name: replace(track, com_m=track.com_m + other) for name, track in wrong.segments.items()}
    assert likelihood(replace(wrong, com_m=wrong.com_m + other, segments=moved)).correlation < 0.8


def test_without_the_segments_a_wrong_mass_is_a_lag() -> None:
    """What the regressors are for: the same path, and nothing known of where it comes from."""
    misled = [likeliest_s(replace(body(wrong), segments={})) - LATE_S for wrong in (-0.2, 0.2)]
    assert max(map(abs, misled)) > 0.003


def test_a_wrong_table_widens_the_likelihood_only_where_segments_can_explain_it() -> None:
    sharp, free = likelihood(replace(body(0.0), segments={})), likelihood(body(0.0))
    drop = [float(np.ptp(one.log_likelihood[np.abs(LAGS_S - LATE_S) < 0.0041])) for one in (sharp, free)]
    assert drop[1] < drop[0]


def test_speed_start_and_a_constant_error_of_the_plates_do_not_matter() -> None:
    motion, geometric = walk(), body(0.0)
    wrench = motion.wrench_track(T, Window(0.4, 1.6), LATE_S)
    biased = replace(wrench, force_n=wrench.force_n + np.array([8.0, -5.0, 12.0]))
    elsewhere = replace(
        geometric,
        com_m=geometric.com_m + np.outer(T, [0.3, 0.1, 0.0]) + 2.0,
        segments={
            k: replace(s, com_m=s.com_m + np.outer(T, [0.3, 0.1, 0.0]) + 2.0) for k, s in geometric.segments.items()
        },
    )
    R = np.eye(3)
    plain = clock_likelihood(geometric, wrench, window_span(geometric, wrench), motion.mass_kg, R, LAGS_S)
    moved = clock_likelihood(elsewhere, biased, window_span(elsewhere, biased), motion.mass_kg, R, LAGS_S)
    assert moved.log_likelihood - moved.log_likelihood.max() == pytest.approx(
        plain.log_likelihood - plain.log_likelihood.max(), abs=0.3
    )
    assert plain.correlation > 0.99


def test_errors_of_the_table_are_a_mass_and_both_parts_of_its_lever() -> None:
    """A thigh from (0, 0, 1) to (0, 0, 0.6) whose centre lies 0.15 m down and 0.02 m ahead, 0.1 of the mass."""
    at = {"l_hip": [0.0, 0.0, 1.0], "l_knee": [0.0, 0.0, 0.6]}
    joints = {name: np.tile(place, (5, 1)) for name, place in at.items()}
    thigh = SegmentTrack(0.1, np.tile([0.02, 0.0, 0.85], (5, 1)))
    com = np.tile([0.0, 0.1, 0.9], (5, 1))
    whole = GeometricCom(T[:5], com, "made", {"l_thigh": thigh}, joints, (0.02, 0.02, 0.02))
    result = _table_errors(whole, slice(1, 4))
    expected = [[0.002, -0.01, -0.005], [0.0, 0.0, -0.015], [0.002, 0.0, 0.0]]
    assert [x.shape for x in result] == [(3, 3)] * 3
    np.testing.assert_allclose([x[0] for x in result], expected, atol=1e-15)
    assert len(_table_errors(replace(whole, joint_centres_m={}), slice(1, 4))) == 1


@pytest.mark.parametrize(("n", "lines"), [(100, 1), (200, 2), (300, 4)])
def test_slow_is_a_parabola_and_what_has_less_than_0_7_hertz(n: int, lines: int) -> None:
    """Half-periods of the window: 0.5, 0.25 and 1/6 Hz apart at 100 Hz."""
    columns = _slow_columns(n, 100.0)
    assert columns.shape == (n, 3 + lines)
    t = (np.arange(n) + 0.5) / n
    for wave, inside in ((np.cos(np.pi * lines * t), True), (np.cos(np.pi * (lines + 1) * t), False)):
        left = _orthogonal_complement(columns).T @ _cosine_spectrum(wave)
        assert (np.linalg.norm(left) < 1e-9 * np.linalg.norm(wave)) == inside


def test_noise_that_is_looser_across_is_plain_noise_in_axes_that_are_scaled(monkeypatch: pytest.MonkeyPatch) -> None:
    """By 2, at the same volume: with both paths drawn as much narrower across, and wider along and up."""
    scale = 2.0 ** (np.array([1.0, -2.0, 1.0]) / 3.0)
    motion, geometric = walk(), replace(body(0.0), segments={})
    wrench = motion.wrench_track(T, Window(0.4, 1.6), LATE_S)
    scaled = replace(geometric, com_m=geometric.com_m * scale), replace(wrench, force_n=wrench.force_n * scale)
    result = []
    for (path, force), noise in (((geometric, wrench), PathNoise(lateral=2.0)), (scaled, PathNoise())):
        monkeypatch.setattr("stridelab.estimation.latency_likelihood._NOISES", (noise,))
        span = window_span(path, force)
        result.append(clock_likelihood(path, force, span, motion.mass_kg, np.eye(3), LAGS_S).log_likelihood)
    assert result[0] == pytest.approx(result[1], abs=1e-6)
