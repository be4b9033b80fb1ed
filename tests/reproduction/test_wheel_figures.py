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
        assert fit.step.length_m == pytest.approx(fit.step.period_s * travelled, rel=0.1)
        z = fit.path_m[:, 1]
        assert fit.time_s[np.argmin(z)] == pytest.approx(np.mean(fit.step.double_support_s), abs=0.03)


def test_the_recording_is_segmented_to_milliseconds(found):
    timing = claim(found["fig-3.4"], "timing_error_s")
    assert 0 < timing.ours < 0.012
    assert timing.verdict == "beaten"
    height = found["fig-3.4"].tables["height"]
    assert np.ptp(height["mean_z_m"]) == pytest.approx(0.035, abs=0.005)


def test_a_walker_who_knows_nothing_of_wheels_gives_no_verdict(found):
    """Its height is a cosine by construction: only aims of ours, on the fit itself."""
    for result in found.values():
        assert all(c.aim for c in result.claims)
    result = found["fig-3.5"]
    assert claim(result, "mean_distance_m").ours == pytest.approx(0.0009, abs=2e-4)
    assert claim(result, "free_below_even").ours == pytest.approx(0.0009 / 0.0085, abs=0.03)
    step = result.tables["step"]
    steps = simulated_steps()
    wheel = steps.fits[0].path.wheel.position_m(step["theta_rad"])
    measured = np.column_stack([step["x_m"], step["z_m"]])
    assert wheel - measured == pytest.approx(np.column_stack([step["error_x_m"], step["error_z_m"]]))


def test_at_both_crossings_the_body_is_as_high_as_the_hub(found):
    result = found["fig-3.10"]
    table, steps = result.tables["crossings"], simulated_steps()
    assert table["start_error_s"].mean() == pytest.approx(-0.064, abs=0.005)
    assert table["end_error_s"].mean() == pytest.approx(0.061, abs=0.005)
    off_m = []
    for k, fit in enumerate(steps.fits[:-1]):
        start, end = (
            at + table[f"{name}_error_s"][k]
            for at, name in zip(fit.step.double_support_s, ("start", "end"), strict=True)
        )
        height = np.interp([start, end], steps.recorded.truth.time_s, steps.path_m[:, 1])
        off_m.append(np.abs(height - fit.path.wheel.z0_m).max())
    assert max(off_m) < 0.004
    assert claim(result, "crossing_height_m").ours == pytest.approx(max(off_m), abs=0.002)
    assert claim(result, "double_pair").ours == 1.0


@pytest.mark.parametrize("name", ["fig-3.3", "fig-3.4", "fig-3.5", "fig-3.10", "numbers-3", "fig-4.2", "fig-4.4"])
def test_another_seed_gives_the_same_verdicts(name):
    outcomes = [
        {c.key: c.outcome for c in reproduce_item(name, None, lambda _fraction, _message: None, seed).claims}
        for seed in (0, 1000)
    ]
    assert outcomes[0] == outcomes[1]
