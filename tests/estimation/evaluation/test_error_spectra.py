"""Spectra of errors against signals whose power is known."""

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.estimation.evaluation.error_spectra import crossing_hz, error_spectrum

RATE_HZ = 100.0
T = np.arange(4096) / RATE_HZ


def test_white_noise_is_flat_and_its_integral_is_its_variance() -> None:
    noise = np.random.default_rng(0).standard_normal((40000, 3)) * [1.0, 2.0, 0.5]
    spectrum = error_spectrum(noise, RATE_HZ)
    assert spectrum.band_rms(0.0, 51.0) == pytest.approx([1.0, 2.0, 0.5], rel=0.02)
    # One-sided: the variance spreads over half the rate.
    assert spectrum.density[1:-1].mean(axis=0) == pytest.approx(np.array([1.0, 4.0, 0.25]) / 50.0, rel=0.02)


def test_a_constant_error_is_seen_at_the_lowest_frequencies_with_its_own_size() -> None:
    spectrum = error_spectrum(np.tile([0.02, 0.0, -0.03], (len(T), 1)), RATE_HZ)
    assert spectrum.band_rms(0.0, 1.0) == pytest.approx([0.02, 0.0, 0.03], rel=1e-9)
    assert spectrum.band_rms(2.0, 51.0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_a_line_is_where_it_is_and_carries_its_rms() -> None:
    wave = 0.004 * np.sin(2 * np.pi * 5.0 * T)
    spectrum = error_spectrum(np.column_stack([wave, 0 * wave, wave]), RATE_HZ)
    assert spectrum.frequency_hz[np.argmax(spectrum.density[:, 0])] == pytest.approx(5.0, abs=0.4)
    assert spectrum.band_rms(4.0, 6.0)[[0, 2]] == pytest.approx(0.004 / np.sqrt(2), rel=0.01)
    assert spectrum.amplitude_density**2 == pytest.approx(spectrum.density)


def test_a_short_record_is_one_window_and_a_broken_one_is_refused() -> None:
    assert error_spectrum(np.zeros((20, 3)), RATE_HZ).resolution_hz == pytest.approx(5.0)
    for broken in (np.zeros((7, 3)), np.full((20, 3), np.nan)):
        with pytest.raises(InvalidInput) as refusal:
            error_spectrum(broken, RATE_HZ)
        assert refusal.value.code == "spectrum-needs-samples"


def test_where_two_spectra_cross() -> None:
    rng = np.random.default_rng(1)
    flat = error_spectrum(rng.standard_normal((40000, 3)), RATE_HZ)
    steep = error_spectrum(4.0 * np.diff(rng.standard_normal((40001, 3)), axis=0), RATE_HZ)
    # 4 |1 - exp(-iw)| = 1 at w = 2 asin(1/8): 4.0 Hz.
    assert crossing_hz(steep, flat, 1) == pytest.approx(4.0, abs=0.8)
    louder = error_spectrum(100.0 * rng.standard_normal((40000, 3)), RATE_HZ)
    assert np.isnan(crossing_hz(flat, louder, 0))
    assert crossing_hz(louder, flat, 0) == 0.0
