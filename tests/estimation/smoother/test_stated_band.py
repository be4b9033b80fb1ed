"""The band of the smoother states sizes of its errors that are not those by which it weighs its inputs."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.people.sensors import draw_recording
from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.smoother import Smoother, SmootherPriors, stated_band
from stridelab.recordings.recording import Window, WrenchTrack
from support.recordings.analytic_motions import Motion, walk

T = np.arange(101) / 100.0
WHOLE = Window(0.0, 1.0)
STEP_S = 0.5
SMOOTHER = Smoother(learn=False, priors=SmootherPriors(step_hz=1.0 / STEP_S, clock_s=0.0))


def wrench_with_drift(motion: Motion, drift_m_s: float) -> WrenchTrack:
    """Moments of plates whose reference wanders ahead by ``drift_m_s``."""
    wrench = motion.wrench_track(T, WHOLE)
    lever_m = drift_m_s * (T - T.mean())
    moment = wrench.moment_nm.copy()
    moment[:, 1] -= lever_m * motion.mass_kg * GRAVITY_M_S2
    return replace(wrench, moment_nm=moment)


def test_moments_that_drift_away_from_the_geometry_widen_the_band_along() -> None:
    motion = walk()
    along, across = np.transpose(
        [
            SMOOTHER.estimate(motion.geometric(T), wrench_with_drift(motion, one), motion.mass_kg).sd_m.mean(axis=0)[:2]
            for one in (0.0, 0.05, 0.1)
        ]
    )
    assert along[0] < along[1] < along[2]
    assert along[2] / along[0] > 1.3 * across[2] / across[0]  # across only the constants are believed less


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_constants_are_as_large_as_geometry_and_moments_are_apart(side: float) -> None:
    """Within the table's error the band is narrower, beyond it wider, and both ways alike."""
    motion = walk()
    geometric, wrench = motion.geometric(T), motion.wrench_track(T, WHOLE)
    apart = np.array([1.0, 1.0, 0.0]) * geometric.sd_m
    near, stated, far = (
        SMOOTHER.estimate(motion.geometric(T, side * times * apart), wrench, motion.mass_kg).sd_m[:, :2].mean()
        for times in (0.0, 1.0, 4.0)
    )
    assert near < stated < far
    assert far < 4.0 * near


def test_a_constant_error_of_a_plate_acts_as_long_as_it_is_loaded() -> None:
    """On a jump's plate with an error of 3 Nm the band is the share of the contacts of what it is in the model."""
    drawn = draw_recording(5, "hop", None, 3.0, 100.0)
    wrench = drawn.wrench_at(0.0)
    on = float(np.mean(wrench.force_n[wrench.complete, 2] > 50.0))
    assert 0.4 < on < 0.7
    geometric = replace(drawn.geometric, sd_m=(0.05, 0.05, 0.02))  # the plate alone says where the body is
    priors = SmootherPriors(plate_moment_nm=3.0, clock_s=0.0)
    estimate = Smoother(learn=False, priors=priors).estimate(geometric, wrench, drawn.mass_kg)
    assert estimate.state_covariance is not None
    weighed_m = np.sqrt(estimate.state_covariance.matrices[:, :2, 0, 0]).mean()
    assert 0.4 < estimate.sd_m[:, :2].mean() / weighed_m < 0.75


def test_the_estimate_and_the_covariance_of_its_weights_do_not_depend_on_the_stated_sizes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    motion = walk()
    inputs = motion.geometric(T), wrench_with_drift(motion, 0.05), motion.mass_kg
    usual = Smoother().estimate(*inputs)
    monkeypatch.setattr(stated_band, "WALKING_SHARE", 1.0)
    monkeypatch.setattr(stated_band, "VARYING_SHARE", 1.0)
    other = Smoother().estimate(*inputs)
    assert np.array_equal(usual.com_m, other.com_m)
    assert usual.state_covariance is not None
    assert other.state_covariance is not None
    assert np.array_equal(usual.state_covariance.matrices, other.state_covariance.matrices)
    assert (usual.sd_m[:, 0] < other.sd_m[:, 0]).all()


def test_a_long_recording_has_the_same_band_from_a_part_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its ratio is that of the whole within 3 %."""
    drawn = draw_recording(78, "walk", None, 9.0, 100.0)
    bands_m = []
    for longest in (900, stated_band.LONGEST):
        monkeypatch.setattr(stated_band, "LONGEST", longest)
        estimate = SMOOTHER.estimate(drawn.geometric, drawn.wrench_at(drawn.true_latency_s), drawn.mass_kg)
        bands_m.append(estimate.sd_m[:, :2].mean(axis=0))
    assert len(estimate.time_s) == 900 > stated_band.LONGEST
    assert np.abs(bands_m[1] / bands_m[0] - 1.0).max() < 0.03
    assert estimate.state_covariance is not None
    assert (bands_m[0] < 0.95 * np.sqrt(estimate.state_covariance.matrices[:, :2, 0, 0]).mean(axis=0)).all()
