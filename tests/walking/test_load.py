"""Where a load is zero, on ramps whose zero is known, with and without a dead band."""

import numpy as np
import pytest

from stridelab.recordings.recording import Plate
from stridelab.walking.plate_events import PlateEvent, contact_intervals, plate_events
from support.recordings.walks import corners

RATE_HZ = 1000.0
START_S, END_S = 0.3042, 0.9037
"""Where the load really begins and ends."""
SLOPES_N_S = (6000.0, 4500.0)


def plate(
    *,
    dead_band_n: float = 0.0,
    from_s: float = 0.0,
    to_s: float = 1.2,
    threshold_n: float = 20.0,
    rate_hz: float = RATE_HZ,
) -> Plate:
    t = np.arange(round(rate_hz * from_s), round(rate_hz * to_s)) / rate_hz
    load = np.clip(np.minimum(SLOPES_N_S[0] * (t - START_S), SLOPES_N_S[1] * (END_S - t)), 0.0, 700.0)
    force = np.zeros((len(t), 3))
    force[:, 2] = np.where(load > dead_band_n, load, 0.0)
    return Plate(1, 2, corners([0.0, 0.0, 0.0]), force, 0 * force, np.zeros(3), threshold_n=threshold_n)


def test_without_a_dead_band_the_threshold_is_used() -> None:
    ((start_s, end_s),) = contact_intervals(plate(), RATE_HZ)
    assert start_s is not None
    assert end_s is not None
    assert START_S + 20.0 / SLOPES_N_S[0] <= start_s <= START_S + 20.0 / SLOPES_N_S[0] + 0.001
    assert END_S - 20.0 / SLOPES_N_S[1] - 0.001 <= end_s <= END_S - 20.0 / SLOPES_N_S[1]


def test_a_steep_load_is_no_dead_band() -> None:
    """From 18.5 to 48.5 N within a sample: the sample before shows that nothing was cut off."""
    rise_n_s = 30000.0
    start_s = 0.3 + 11.5 / rise_n_s
    steep = plate()
    steep.force_n[:500, 2] = np.clip(rise_n_s * (np.arange(500) / RATE_HZ - start_s), 0.0, 700.0)
    ((begins_s, _),) = contact_intervals(steep, RATE_HZ)
    assert begins_s == pytest.approx(start_s + 20.0 / rise_n_s, abs=1e-6)


@pytest.mark.parametrize("noise_n", [2.0, 5.0, 9.0])
def test_noise_of_the_plate_begins_and_ends_no_contact(noise_n: float) -> None:
    """At 5 N one sample in 30 ms of forty exceeds 20 N, at 9 N one of eight of them all."""
    errors_s = []
    for seed in range(40):
        noisy = plate()
        noisy.force_n[:] += np.random.default_rng(seed).normal(0.0, noise_n, noisy.force_n.shape)
        ((start_s, end_s),) = contact_intervals(noisy, RATE_HZ)
        assert start_s is not None
        assert end_s is not None
        errors_s += [start_s - START_S - 20.0 / SLOPES_N_S[0], end_s - END_S + 20.0 / SLOPES_N_S[1]]
    assert np.abs(errors_s).max() < 0.006


def errors_of_noisy_plates(noise_n: float, rate_hz: float, count: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Errors of strikes and lift-offs on ramps with white noise in every axis, and their stated deviations."""
    errors_s, stated_s = [], []
    for seed in range(count):
        noisy = plate(rate_hz=rate_hz)
        noisy.force_n[:] += np.random.default_rng([21, seed]).normal(0.0, noise_n, noisy.force_n.shape)
        (both,) = plate_events(noisy, rate_hz)
        for event, true_s in zip(both, (START_S + 20.0 / SLOPES_N_S[0], END_S - 20.0 / SLOPES_N_S[1]), strict=True):
            assert isinstance(event, PlateEvent)
            errors_s.append(event.at_s - true_s)
            stated_s.append(event.sd_s)
    return np.array(errors_s), np.array(stated_s)


@pytest.mark.parametrize(("noise_n", "rate_hz"), [(1.0, 1000.0), (2.0, 500.0), (5.0, 1000.0), (5.0, 2000.0)])
def test_the_stated_error_is_that_of_the_noise_of_the_empty_plate(noise_n: float, rate_hz: float) -> None:
    errors_s, stated_s = errors_of_noisy_plates(noise_n, rate_hz)
    assert np.sqrt(np.mean(stated_s**2)) == pytest.approx(np.sqrt(np.mean(errors_s**2)), rel=0.15)
    assert 0.92 <= np.mean(np.abs(errors_s) <= 1.96 * stated_s) <= 0.98


def test_means_of_samples_are_nearer_than_the_first_sample_above_the_threshold() -> None:
    """The noise of one sample is 5 N on a slope of 5 N/ms."""
    errors_s, _ = errors_of_noisy_plates(5.0, 1000.0)
    assert np.sqrt(np.mean(errors_s**2)) < 0.75e-3


def test_without_noise_only_the_interval_between_samples_is_uncertain() -> None:
    """A load that starts within the interval crosses the threshold later than the line between the samples does."""
    ((strike, _),) = plate_events(plate(), RATE_HZ)
    assert strike is not None
    assert strike.at_s == pytest.approx(START_S + 20.0 / SLOPES_N_S[0], abs=1e-6)
    assert strike.sd_s == pytest.approx(0.02 / RATE_HZ)
    late_s, stated_s = [], []
    for offset_ms in np.arange(0.05, 1.0, 0.1):
        steep = plate()
        steep.force_n[:500, 2] = np.clip(2e4 * (np.arange(500) / RATE_HZ - 0.3 - 1e-3 * offset_ms), 0.0, 700.0)
        steep.force_n[:300, 2] = 6.0  # no dead band
        ((strike, _),) = plate_events(steep, RATE_HZ)
        assert strike is not None
        late_s.append(strike.at_s - 0.3 - 1e-3 * offset_ms - 20.0 / 2e4)
        stated_s.append(strike.sd_s)
    assert np.abs(late_s).max() > 1e-5
    assert np.all(np.abs(late_s) <= 1.96 * np.array(stated_s) + 1e-7)
    assert np.max(stated_s) < 0.0005


def test_a_plate_that_stores_zeros_shows_its_noise_while_it_is_loaded() -> None:
    """Force below 10 N is stored as zero: the empty plate has no noise, the loaded one has 3 N."""
    quiet = plate()
    rng = np.random.default_rng(0)
    quiet.force_n[:] += rng.normal(0.0, 3.0, quiet.force_n.shape)
    quiet.force_n[quiet.force_n[:, 2] < 10.0] = 0.0
    noisy = plate()
    noisy.force_n[:] += rng.normal(0.0, 3.0, noisy.force_n.shape)
    ((zeroed, _),), ((plain, _),) = plate_events(quiet, RATE_HZ), plate_events(noisy, RATE_HZ)
    assert zeroed is not None
    assert plain is not None
    assert zeroed.sd_s == pytest.approx(plain.sd_s, rel=0.4)


def test_behind_a_dead_band_the_error_is_that_of_the_extrapolation() -> None:
    for dead_band_n in (35.0, 80.0):
        ((strike, lift_off),) = plate_events(plate(dead_band_n=dead_band_n), RATE_HZ)
        for event, slope in zip((strike, lift_off), SLOPES_N_S, strict=True):
            assert event is not None
            assert dead_band_n / slope <= event.sd_s * np.sqrt(3.0) <= dead_band_n / slope + 0.001


def test_a_light_foot_is_no_noise() -> None:
    """Up to 35 N for 20 ms before the heel loads, with a pause of 5 ms: the empty plate has 5 N."""
    light = plate()
    light.force_n[265:299, 2] = np.linspace(0.0, 35.0, 34)
    light.force_n[:200, 0] = 5.0
    ((start_s, _),) = contact_intervals(light, RATE_HZ)
    assert start_s == pytest.approx(0.265 + 34 * 20.0 / 35.0 / RATE_HZ, abs=0.001)


@pytest.mark.parametrize("dead_band_n", [35.0, 53.0, 80.0])
def test_behind_a_dead_band_the_time_of_zero_load_is_extrapolated(dead_band_n: float) -> None:
    ((start_s, end_s),) = contact_intervals(plate(dead_band_n=dead_band_n), RATE_HZ)
    assert start_s == pytest.approx(START_S, abs=1e-6)
    assert end_s == pytest.approx(END_S, abs=1e-6)


def test_a_lower_threshold_detects_a_dead_band_sooner() -> None:
    ((start_s, _),) = contact_intervals(plate(dead_band_n=20.0, threshold_n=10.0), RATE_HZ)
    assert start_s == pytest.approx(START_S, abs=1e-6)


def test_contacts_cut_off_by_the_recording_have_no_times() -> None:
    assert contact_intervals(plate(from_s=0.5), RATE_HZ)[0][0] is None
    assert contact_intervals(plate(to_s=0.7), RATE_HZ)[0][1] is None


def test_the_extrapolation_is_limited() -> None:
    """A load that appears all at once and hardly changes: 20 ms before and 30 ms after at most."""
    force = np.zeros((1000, 3))
    force[300:800, 2] = 60.0 + 0.01 * np.arange(500)
    steady = Plate(1, 2, corners([0.0, 0.0, 0.0]), force, 0 * force, np.zeros(3))
    ((start_s, end_s),) = contact_intervals(steady, RATE_HZ)
    assert start_s == pytest.approx(0.28)
    assert end_s == pytest.approx(0.829)
