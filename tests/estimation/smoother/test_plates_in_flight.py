"""In flight plates read zero, whatever their errors under a foot: zero readings must not determine those errors."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.people.sensors import SensorErrors, draw_recording
from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.differentiation import window_span
from stridelab.estimation.smoother import Smoother, SmootherPriors

CLEAN = SensorErrors(
    plate_n=0.0, plate_nm=0.0, drift_n_s=0.0, noise_n=0.0, noise_nm=0.0, late_s=(0.0, 0.0), mass_share=0.0
)
ASIDE_M, TABLE_M = 0.03, 0.008


@pytest.mark.parametrize("seed", [2, 3])
def test_a_declared_error_of_the_moments_leaves_its_share_to_the_geometry(seed: int) -> None:
    """A geometry moved by d moves the estimate by d s^2 / (s^2 + t^2): s the moment error in metres, t the table's."""
    drawn = draw_recording(seed, "run", CLEAN, 3.0, 100.0)
    wrench = drawn.wrench_at(0.0)
    vertical_n = wrench.force_n[window_span(drawn.geometric, wrench).inside, 2]
    assert (vertical_n < 1.0).mean() > 0.1
    geometric = replace(drawn.geometric, sd_m=(TABLE_M, TABLE_M, 0.02))
    moved = replace(geometric, com_m=geometric.com_m + np.array([0.0, ASIDE_M, 0.0]))
    smoother = Smoother(learn=False, priors=SmootherPriors(plate_moment_nm=3.0, clock_s=0.0))
    one, other = (smoother.estimate(part, wrench, drawn.mass_kg).com_m for part in (geometric, moved))
    error_m = 3.0 / (drawn.mass_kg * GRAVITY_M_S2)
    expected = error_m**2 / (error_m**2 + TABLE_M**2)
    assert np.mean((other - one)[:, 1]) / ASIDE_M == pytest.approx(expected, rel=0.35)
