"""Figures 3.4, 3.5 and 3.10 on a simulated person: their numbers against the walk itself."""

import numpy as np
import pytest

from stridelab.reproduction.claims import Claim, Reproduction
from stridelab.reproduction.common.simulated_steps import SPEED_M_S, simulated_steps, true_steps
from stridelab.reproduction.registry import reproduce_item

FIGURES = ("fig-3.4", "fig-3.5", "fig-3.10")


@pytest.fixture(scope="module")
def found() -> dict[str, Reproduction]:
    return {name: reproduce_item(name, 1, lambda _fraction, _message: None) for name in FIGURES}


def claim(result: Reproduction, key: str) -> Claim:
    return next(c for c in result.claims if c.key == key)


def test_the_steps_are_those_of_the_plan():
    steps = simulated_steps()
    assert len(steps.fits) == 7
    assert [fit.step for fit in steps.fits] == list(true_steps(steps.walk))
    assert len({fit.step.side for fit in steps.fits}) == 2
    for fit in steps.fits:
        travelled = np.polyfit(fit.time_s, fit.path_m[:, 0], 1)[0]
        assert travelled == pytest.approx(SPEED_M_S, abs=0.1)
        z = fit.path_m[:, 1]
        assert fit.time_s[np.argmin(z)] == pytest.approx(np.mean(fit.step.double_support_s), abs=0.03)


def test_the_recording_is_segmented_to_milliseconds(found):
    timing = claim(found["fig-3.4"], "timing_error_s")
    assert 0 < timing.ours < 0.012
    assert timing.verdict == "beaten"
    height = found["fig-3.4"].tables["height"]
    assert np.ptp(height["mean_z_m"]) == pytest.approx(0.035, abs=0.005)


def test_a_walker_who_knows_nothing_of_wheels_fits_one_as_people_do(found):
    result = found["fig-3.5"]
    assert claim(result, "mean_distance_m").verdict == "met"
    assert claim(result, "mean_distance_m").ours == pytest.approx(0.0009, abs=2e-4)
    assert claim(result, "largest_error_m").verdict == "not_met"
    assert claim(result, "up_over_ahead").ours > 5
    assert claim(result, "even_clock_m").verdict == "not_met"
    assert claim(result, "even_clock_m").ours == pytest.approx(0.0085, abs=1e-3)
    existing = claim(result, "over_pendulum")
    assert (existing.verdict, existing.comparator) == ("met", "inverted pendulum")
    assert existing.ours == pytest.approx(0.03, abs=0.01)
    step = result.tables["step"]
    steps = simulated_steps()
    wheel = steps.fits[0].path.wheel.position_m(step["theta_rad"])
    measured = np.column_stack([step["x_m"], step["z_m"]])
    assert wheel - measured == pytest.approx(np.column_stack([step["error_x_m"], step["error_z_m"]]))


def test_the_crossings_miss_its_double_support_by_tens_of_milliseconds(found):
    result = found["fig-3.10"]
    assert claim(result, "start_s").ours == pytest.approx(-0.064, abs=0.005)
    assert claim(result, "end_s").ours == pytest.approx(0.061, abs=0.005)
    assert {c.verdict for c in result.claims} == {"not_met"}
    table, steps = result.tables["crossings"], simulated_steps()
    for k, fit in enumerate(steps.fits[:-1]):  # at both crossings the body is as high as the hub, near its mid-height
        start, end = (
            at + table[f"{name}_error_s"][k]
            for at, name in zip(fit.step.double_support_s, ("start", "end"), strict=True)
        )
        height = np.interp([start, end], steps.recorded.truth.time_s, steps.path_m[:, 1])
        assert height == pytest.approx(fit.path.wheel.z0_m, abs=0.004)
    doubles = np.mean([np.diff(fit.step.double_support_s)[0] for fit in steps.fits])
    expected = 1 + (claim(result, "end_s").ours - claim(result, "start_s").ours) / doubles
    assert claim(result, "enclosed_over_double_support").ours == pytest.approx(expected, rel=0.02)
    assert expected > 1.8
