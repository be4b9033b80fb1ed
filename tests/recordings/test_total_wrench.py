"""The total wrench at the marker instants: no phase, no block means, latency applied openly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from stridelab.recordings.plate_contacts import filter_both_ways, low_pass, wrench_track
from stridelab.recordings.recording import Recording, Window
from support.recordings.walks import WEIGHT_N, walk

RATE = 1500.0


def oscillating(frequency_hz: float = 3.0, late_s: float = 0.0) -> Recording:
    """Two plates share a force that oscillates; force samples at 1500 Hz, markers at 100 Hz."""
    recording = walk([2, 3], force_rate_hz=RATE)
    t = np.arange(len(recording.plates[0].force_n)) / RATE - late_s
    force = np.column_stack([50 * np.sin(2 * np.pi * frequency_hz * t), 0 * t, WEIGHT_N + 100 * np.cos(2 * np.pi * t)])
    moment = np.cross([0.4, 0.1, 0.0], force)
    plates = tuple(
        replace(plate, force_n=share * force, moment_nm=share * moment)
        for plate, share in zip(recording.plates, (0.3, 0.7), strict=True)
    )
    return replace(recording, plates=plates)


WINDOWS = (Window(0.5, 2.5),)


def test_the_sum_is_read_at_the_marker_instants() -> None:
    """Block means of 15 samples would be 4.7 ms early, 4 N here; this is a tenth of a newton."""
    recording = oscillating()
    track = wrench_track(recording, WINDOWS)
    inner = track.complete
    expected = 50 * np.sin(2 * np.pi * 3.0 * track.time_s)
    np.testing.assert_allclose(track.force_n[inner, 0], expected[inner], atol=0.1)
    np.testing.assert_allclose(track.moment_nm[inner], np.cross([0.4, 0.1, 0.0], track.force_n[inner]), atol=1e-6)


@pytest.mark.parametrize(
    ("marker_hz", "force_hz"), [(100.0, 1500.0), (100.0, 1000.0), (120.0, 1000.0), (200.0, 960.0), (100.0, 100.0)]
)
@pytest.mark.parametrize("latency_s", [0.0, 0.0137, -0.008])
def test_a_ramp_is_read_where_the_markers_are(marker_hz: float, force_hz: float, latency_s: float) -> None:
    """A ramp tells the time: means over blocks would read it half a block early, a causal filter late."""
    recording = oscillating()
    n = int(3.0 * force_hz) + 1
    slope = np.array([300.0, -200.0, 400.0])
    clock = np.outer(np.arange(n) / force_hz, slope) + np.array([0.0, 0.0, WEIGHT_N])
    plates = tuple(
        replace(plate, force_n=share * clock, moment_nm=share * clock[:, ::-1])
        for plate, share in zip(recording.plates, (0.3, 0.7), strict=True)
    )
    markers = {label: np.zeros((int(3.0 * marker_hz), 3)) for label in recording.markers_m}
    ramp = replace(recording, plates=plates, markers_m=markers, marker_rate_hz=marker_hz, force_rate_hz=force_hz)
    track = wrench_track(ramp, WINDOWS, latency_s=latency_s)
    read_at_s = (track.force_n[:, 0] / slope[0])[track.complete]
    np.testing.assert_allclose(read_at_s, track.time_s[track.complete] + latency_s, atol=1e-9)
    np.testing.assert_allclose(track.moment_nm[:, ::-1][track.complete], track.force_n[track.complete], atol=1e-9)


def test_a_late_force_is_read_later() -> None:
    late = wrench_track(oscillating(late_s=0.018), WINDOWS, latency_s=0.018)
    on_time = wrench_track(oscillating(), WINDOWS)
    inner = late.complete & on_time.complete
    np.testing.assert_allclose(late.force_n[inner], on_time.force_n[inner], atol=0.1)
    assert late.latency_applied_s == 0.018


def test_complete_is_the_inside_of_the_windows() -> None:
    track = wrench_track(oscillating(), WINDOWS)
    assert track.time_s[track.complete][[0, -1]].tolist() == [0.5, 2.5]
    assert not wrench_track(oscillating(), ()).complete.any()


def test_wrenches_beyond_the_recording_are_not_complete() -> None:
    recording = oscillating()
    everything = (Window(0.0, recording.duration_s),)
    late = wrench_track(recording, everything, latency_s=0.05)
    assert not late.complete[late.time_s > recording.duration_s - 0.045].any()
    early = wrench_track(recording, everything, latency_s=-0.05)
    assert not early.complete[early.time_s < 0.045].any()


def test_plates_that_are_switched_off_are_left_out() -> None:
    recording = oscillating()
    plates = (replace(recording.plates[0], use=False), recording.plates[1])
    track = wrench_track(replace(recording, plates=plates), WINDOWS)
    assert track.force_n[track.complete, 2].mean() == pytest.approx(0.7 * WEIGHT_N, rel=0.02)


def test_without_plates_there_is_no_wrench() -> None:
    track = wrench_track(replace(oscillating(), plates=()), WINDOWS)
    assert not track.complete.any()
    assert not track.force_n.any()


def test_low_pass_passes_a_line_and_removes_ringing() -> None:
    t = np.arange(3000) / RATE
    line = np.column_stack([t, 2 * t, 700 + 0 * t])
    np.testing.assert_allclose(low_pass(line, RATE), line, atol=1e-6 * 700)
    ringing = line + 50 * np.sin(2 * np.pi * 300 * t)[:, None]
    assert np.abs(low_pass(ringing, RATE) - line)[200:-200].max() < 0.1


def test_low_rates_and_short_tracks_are_returned_as_they_are() -> None:
    track = np.ones((100, 3))
    assert low_pass(track, 100.0) is track
    assert low_pass(track[:5], RATE).shape == (5, 3)


@pytest.mark.parametrize(
    ("n", "rate_hz", "band_hz", "pad"), [(500, 100.0, 8.0, 65), (5000, 1000.0, 0.7, 200), (3, 100.0, 8.0, 2)]
)
def test_the_filter_is_that_of_scipy(n: int, rate_hz: float, band_hz: float, pad: int) -> None:
    track = 800.0 + np.random.default_rng(0).standard_normal((n, 3)).cumsum(axis=0)
    sections = signal.butter(2, band_hz, fs=rate_hz, output="sos")
    expected = signal.sosfiltfilt(sections, track, axis=0, padlen=pad)
    np.testing.assert_allclose(filter_both_ways(track, rate_hz, band_hz, pad), expected, rtol=1e-10)
