"""Bad input of the fits: typed errors, never an exception of a library and never a wheel that is none."""

import numpy as np
import pytest

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.walking.curtate_cycloid import Plane
from stridelab.walking.path_fit import fit_path
from stridelab.walking.timed_fit import fit_in_time
from support.recordings.analytic_motions import PERIOD_S, rolled_wheel

CASE = rolled_wheel()
FITS = [fit_path, fit_in_time]


def with_value(value: float) -> Plane:
    path = CASE.path_m
    path[11, 1] = value
    return path


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_path_with_a_gap_names_its_first_sample(fit, value):
    with pytest.raises(InvalidInput) as caught:
        fit(CASE.time_s, with_value(value), PERIOD_S)
    assert caught.value.code == "path-not-finite"
    assert caught.value.faults[0].where == "path_m[11]"
    assert "1 of 60" in caught.value.message


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("n", [0, 1, 4, 7])
def test_too_few_samples_are_refused(fit, n):
    with pytest.raises(NotEstimable) as caught:
        fit(CASE.time_s[:n], CASE.path_m[:n], PERIOD_S)
    assert caught.value.code == "too-few-samples"


@pytest.mark.parametrize("fit", FITS)
def test_a_clock_that_stands_or_turns_back_is_refused(fit):
    for at in (CASE.time_s * 0.0, CASE.time_s[::-1].copy()):
        with pytest.raises(InvalidInput) as caught:
            fit(at, CASE.path_m, PERIOD_S)
        assert caught.value.code == "time-not-increasing"
        assert caught.value.faults[0].where == "time_s[1]"


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("period_s", [0.0, -0.5, np.nan, np.inf, 10.0])
def test_an_invalid_step_period_is_refused(fit, period_s):
    with pytest.raises(InvalidInput) as caught:
        fit(CASE.time_s, CASE.path_m, period_s)
    assert caught.value.code == "period-out-of-range"


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("sway_m", [0.0, 0.004])
def test_standing_and_bobbing_on_the_spot_are_no_steps(fit, sway_m):
    rng = np.random.default_rng(0)
    for height in (np.full(60, 0.9), 0.9 + 0.02 * np.cos(CASE.theta_rad)):
        path = np.column_stack([sway_m * rng.standard_normal(60), height])
        with pytest.raises(NotEstimable) as caught:
            fit(CASE.time_s, path, PERIOD_S)
        assert caught.value.code == "no-progress"
