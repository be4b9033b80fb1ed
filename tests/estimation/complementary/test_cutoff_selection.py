"""Cut-offs that the recording's own spectra choose."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.estimation.complementary.cutoff_selection import cutoffs_from_spectra
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import FilterInputs
from stridelab.reproduction.studies.estimator_study import simulate_trial

RATE_HZ = 200.0
T = np.arange(4000) / RATE_HZ


def inputs(of_g: np.ndarray, of_a: np.ndarray, of_p: np.ndarray) -> FilterInputs:
    """A sway with these errors of the three inputs."""
    w = 2 * np.pi * 0.9
    c = np.sin(w * T)[:, None] * [0.02, 0.03, 0.01]
    return FilterInputs(c + of_g, -(w**2) * c + of_a, c + of_p)


def noise(seed: int, size: float) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal((len(T), 3))


def test_noisy_markers_move_the_force_down_and_a_noisy_force_moves_it_up():
    trusted = cutoffs_from_spectra(inputs(noise(0, 5e-3), noise(1, 1e-3), noise(2, 5e-3)), RATE_HZ)
    doubted = cutoffs_from_spectra(inputs(noise(0, 5e-5), noise(1, 2.0), noise(2, 5e-4)), RATE_HZ)
    assert trusted[1] < 1.5 < 5.0 < doubted[1]


def test_an_axis_that_is_displaced_at_the_step_is_believed_below_it_only():
    displaced = 0.03 * np.sin(2 * np.pi * 1.8 * T)[:, None] * np.ones(3)
    low, _ = cutoffs_from_spectra(inputs(noise(0, 5e-3), noise(1, 0.05), displaced), RATE_HZ)
    assert low <= 0.2


@pytest.mark.parametrize("gait", ["robot", "human"])
def test_on_marker_like_noise_they_beat_the_cut_offs_of_the_thesis_twice(gait):
    def horizontal(filter_: ComplementaryFilter) -> float:
        squares = []
        for seed in range(3):
            trial = simulate_trial(gait, "marker-like", seed)
            estimate = filter_.estimate(trial.geometric, trial.wrench, trial.mass_kg)
            squares.append(
                np.mean(np.sum((estimate.com_m - trial.truth.com_m[: len(estimate.com_m)])[:, :2] ** 2, axis=1))
            )
        return float(np.sqrt(np.mean(squares)))

    spectral = horizontal(ComplementaryFilter(from_spectra=True))
    assert spectral < 0.5 * horizontal(ComplementaryFilter.thesis())
    assert spectral < horizontal(ComplementaryFilter())


def test_the_cut_offs_are_reported_and_none_can_be_chosen_sample_by_sample():
    trial = simulate_trial("robot", "marker-like", 0)
    estimate = ComplementaryFilter(from_spectra=True).estimate(trial.geometric, trial.wrench, trial.mass_kg)
    assert 0 < estimate.diagnostics["low_hz"] < estimate.diagnostics["high_hz"]
    for estimator, code, where in (
        (ComplementaryFilter(from_spectra=True), "cutoffs-not-online", "cutoffs"),
        (replace(ComplementaryFilter(), order=3), "order-out-of-range", "order"),
    ):
        with pytest.raises(InvalidInput) as refused:
            estimator.causal(70.0, (0.01, 0.01, 0.02))
        assert (refused.value.code, refused.value.faults[0].where) == (code, where)
