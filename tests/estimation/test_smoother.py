"""The smoother against motions whose centre of mass is known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import uniform, walk

RATE_HZ = 100.0
WHOLE = Window(0.0, 4.0)


def times(duration_s: float = 4.0) -> np.ndarray:
    return np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ


def rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(error**2, axis=0))


def test_it_offers_what_every_estimator_offers():
    assert isinstance(Smoother(), ComEstimator)
    assert Smoother.name == "smoother"


def test_a_body_that_coasts_is_returned_from_the_first_sample_on():
    motion, t = uniform(), times()
    estimate = Smoother().estimate(motion.geometric(t), motion.wrench_track(t, WHOLE), motion.mass_kg)
    assert np.abs(estimate.com_m - motion.com.at(t)).max() < 1e-9
    assert np.abs(estimate.velocity_m_s - motion.com.at(t, 1)).max() < 1e-8


def test_a_wrong_table_is_corrected_sideways_and_ahead_but_never_in_height():
    motion, t = walk(), times()
    bias = np.array([0.015, -0.012, 0.02])
    exact_plates = Smoother(priors=SmootherPriors(walking_moment_nm=(0.0, 0.0)))
    estimate = exact_plates.estimate(motion.geometric(t, bias), motion.wrench_track(t, WHOLE), motion.mass_kg)
    error = estimate.com_m - motion.com.at(t)
    assert (rms(error)[:2] < 0.0015).all()
    assert rms(error)[2] == pytest.approx(0.02, rel=0.02)  # along the force nothing is learnt
    assert (estimate.sd_m[:, 2] >= 0.02).all()  # and the band says so
    assert (np.abs(error) < 1.96 * estimate.sd_m).all()


@pytest.mark.parametrize("name", ["marker_m", "force_n", "moment_nm", "table_varying_m", "damping"])
@pytest.mark.parametrize("value", [0.0, -0.01])
def test_priors_of_zero_or_less_are_refused_by_name(name: str, value: float):
    with pytest.raises(InvalidInput) as refused:
        SmootherPriors(**{name: value})
    assert refused.value.code == "prior-out-of-range"
    assert name in refused.value.faults[0].where
    assert refused.value.message == f"The stated error of an input must be a positive number: priors.{name}."


def test_a_damping_that_does_not_swing_is_refused():
    with pytest.raises(InvalidInput) as refused:
        SmootherPriors(damping=1.0)
    (fault,) = refused.value.faults
    assert (fault.where, fault.message) == ("priors.damping", "a damping ratio of 1 or more does not oscillate")


def test_a_force_of_a_third_of_a_second_is_refused():
    motion, t = walk(), times()
    with pytest.raises(NotEstimable) as refused:
        Smoother().estimate(motion.geometric(t), motion.wrench_track(t, Window(1.0, 1.3)), motion.mass_kg)
    assert refused.value.code == "window-too-short"


def test_the_band_along_a_walk_is_that_of_a_clock_five_milliseconds_off():
    """The residual of the clocks moves the force's path by the speed times it; here the table says nothing.

    It errs by its stated size: if it did not err at all, the clock would be believed more.
    """
    motion, t = walk(), times()
    geometric = replace(motion.geometric(t, np.array([0.05, 0.05, 0.0])), sd_m=(0.05, 0.05, 0.05))
    exact_plates = Smoother(learn=False, priors=SmootherPriors(walking_moment_nm=(0.0, 0.0)))
    estimate = exact_plates.estimate(geometric, motion.wrench_track(t, WHOLE), motion.mass_kg)
    speed_m_s = float(np.linalg.norm(np.ptp(motion.com.at(t)[:, :2], axis=0))) / t[-1]
    assert float(estimate.sd_m[:, 0].mean()) / speed_m_s == pytest.approx(0.005, rel=0.1)


def test_angular_momentum_is_remembered_from_stride_to_stride():
    """Three seconds beside one second of force: with a damping of 0.3 the error is 0.19 mm ahead and 0.35 sideways."""
    motion, t = walk(), times()
    periodic = Smoother(learn=False, beyond_window=True, priors=SmootherPriors(walking_moment_nm=(0.0, 0.0)))
    estimate = periodic.estimate(motion.geometric(t), motion.wrench_track(t, Window(1.5, 2.5)), motion.mass_kg)
    assert (rms(estimate.com_m - motion.com.at(t))[:2] < [0.00017, 0.00029]).all()


def test_a_short_gap_of_the_force_is_bridged():
    """Withheld for 0.15 s in every half second: between the accelerations on both sides the path hardly changes."""
    motion, t = walk(), times()
    wrench = motion.wrench_track(t, WHOLE)
    withheld = np.arange(len(t)) % 50 < 15
    withheld[:50] = withheld[-50:] = False
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(t), 3))
    geometric = motion.geometric(t, noise)
    whole, gaps = (
        Smoother().estimate(geometric, track, motion.mass_kg).com_m - motion.com.at(t)
        for track in (wrench, replace(wrench, withheld=withheld))
    )
    assert (rms(gaps) < rms(whole) + 0.0004).all()
