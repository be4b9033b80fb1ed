"""Where a load is zero, on ramps whose zero is known, with and without a dead band."""

import numpy as np
import pytest

from stridelab.recordings.recording import Plate
from stridelab.walking.plate_events import contact_intervals
from support.recordings.walks import corners

RATE_HZ = 1000.0
START_S, END_S = 0.3042, 0.9037
"""Where the load really begins and ends."""
SLOPES_N_S = (6000.0, 4500.0)


def plate(*, dead_band_n: float = 0.0, from_s: float = 0.0, to_s: float = 1.2, threshold_n: float = 20.0) -> Plate:
    t = np.arange(round(1000 * from_s), round(1000 * to_s)) / RATE_HZ
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
