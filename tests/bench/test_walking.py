"""Speed of the wheel's fits; run by ``make bench`` (skipped otherwise). A step of half a second at 100 and 200 Hz."""

import numpy as np
import pytest

from stridelab.walking.path_fit import fit_path
from stridelab.walking.step_fit import fit_step
from stridelab.walking.steps import GaitStep
from stridelab.walking.timed_fit import fit_in_time
from support.recordings.analytic_motions import PERIOD_S


def step(rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """A path as people have it: fast at the lowest point, and with a second harmonic that no wheel has."""
    t = np.arange(round(rate_hz * 0.54)) / rate_hz
    w = 2 * np.pi / PERIOD_S
    x = 1.2 * t + 0.008 * np.sin(w * t + 0.9) + 0.001 * np.sin(2 * w * t)
    return t, np.column_stack([x, 0.93 - 0.015 * np.cos(w * t + 0.9) + 0.0015 * np.sin(2 * w * t)])


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
@pytest.mark.parametrize("branch", [1, -1])
def test_path(benchmark, rate_hz, branch):
    """Free angles: below 1 ms per step."""
    t, path = step(rate_hz)
    benchmark(lambda: fit_path(t, path, PERIOD_S, branch))


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
@pytest.mark.parametrize("branch", [1, -1])
def test_clock(benchmark, rate_hz, branch):
    """An even clock: below 5 ms per step."""
    t, path = step(rate_hz)
    benchmark(lambda: fit_in_time(t, path, PERIOD_S, branch))


def test_whole_step(benchmark):
    """Both branches, both ways, and all rivals with held-out blocks."""
    t, path = step(100.0)
    whole = GaitStep(
        side="left",
        lift_off_s=0.0,
        strike_s=0.42,
        next_lift_off_s=0.54,
        period_s=PERIOD_S,
        length_m=0.65,
        speed_m_s=1.2,
        measured=True,
        source="plates",
    )
    benchmark(lambda: fit_step(whole, t, path))
