"""What goes wrong silently when errors are modelled and results are judged; docs/theory/pitfalls.md."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.dynamics.wrench import Wrench, central_axis
from stridelab.estimation.evaluation.physics_residuals import force_residual_n
from stridelab.estimation.kalman.filter import RtsSmoother
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import Harmonics, Motion, walk

WALK = walk()
UP = np.array([0.0, 0.0, 1.0])


def naive_and_repaired(seed: int, moment_bias_nm: float = 0.0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Constant table offset from noisy force and moment: its error in mm and the sd that is claimed for it.

    ``nu - g x f = f x b + L'``: least squares for b (prior sd 30 mm) beside an angular momentum of unknown size at the
    stride frequency and its multiples, and on request a moment bias. "naive" has the measured force in the matrix,
    "repaired" the weight, the two horizontal rows, and the noise of g x f in R. Robot cadence, origin 2 m behind.
    """
    body = Motion(
        Harmonics(
            np.array([2.0, 0.0, 0.83]),
            np.array([0.0, 0.0, 0.0]),
            ((1.25, np.array([0.004, 0.0, 0.006]), 0.4), (0.625, np.array([0.0, 0.04, 0.0]), 0.2)),
        ),
        Harmonics(
            np.zeros(3), np.zeros(3), ((1.25, np.array([0.0, 3.0, 0.0]), 0.9), (0.625, np.array([1.5, 0.0, 0.6]), 2.5))
        ),
        mass_kg=90.0,
    )
    random, t = np.random.default_rng(seed), np.arange(0.0, 9.2, 0.005)
    b, noise_n, noise_nm = np.array([0.010, -0.008, 0.020]), 10.0, 10.0
    f = body.force(t) + noise_n * random.standard_normal((len(t), 3))
    nu = body.moment(t) + noise_nm * random.standard_normal((len(t), 3))
    y = nu - np.cross(body.com.at(t) + b, f)
    swings = [wave(2 * np.pi * k * 0.625 * t) for k in range(1, 5) for wave in (np.cos, np.sin)]
    intervals = {}
    for name, in_matrix, rows in (
        ("naive", f, [0, 1, 2]),
        ("repaired", np.tile(90.0 * 9.81 * UP, (len(t), 1)), [0, 1]),
    ):
        E = np.eye(3)[rows]
        H = np.concatenate(
            [np.cross(in_matrix[:, None, :], np.eye(3)).transpose(0, 2, 1)[:, rows]]
            + [s[:, None, None] * E for s in swings]
            + [np.tile(E[:, :2], (len(t), 1, 1))] * (moment_bias_nm > 0),
            axis=2,
        ).reshape(-1, 3 + 24 + 2 * (moment_bias_nm > 0))
        prior = np.concatenate([np.full(3, 0.03), np.full(24, 20.0), np.full(H.shape[1] - 27, moment_bias_nm)])
        R = noise_nm**2 + (0.83 * noise_n) ** 2 * (name == "repaired")
        covariance = np.linalg.inv(H.T @ H / R + np.diag(prior**-2))
        x = covariance @ H.T @ y[:, rows].ravel() / R
        intervals[name] = 1e3 * (x[:3] - b), 1e3 * np.sqrt(np.diag(covariance)[:3])
    return intervals


@pytest.mark.parametrize("seed", range(3))
def test_noise_in_the_measurement_matrix_invents_a_height(seed: int):
    error, sd = naive_and_repaired(seed)["naive"]
    assert error[2] > 500  # mm: the height is drawn towards the origin, because noise shows no lever arm
    assert sd[2] < 15  # and the band says 15 mm
    error, sd = naive_and_repaired(seed)["repaired"]
    assert np.abs(error[:2]).max() < 3
    assert error[2] == pytest.approx(-20.0, abs=0.1)  # the table's error, as it was
    assert sd[2] == pytest.approx(30.0, abs=0.1)  # and the table's prior


@pytest.mark.parametrize("seed", range(3))
def test_a_constant_moment_bias_is_distinguished_only_by_noise(seed: int):
    intervals = naive_and_repaired(seed, moment_bias_nm=5.2)
    error, sd = intervals["naive"]
    assert error[0] > 80  # mm in x, two metres from the origin
    assert sd[0] < 7
    error, sd = intervals["repaired"]
    assert abs(error[0]) < 3
    assert sd[0] == pytest.approx(5.8, abs=0.5)  # bias / m g: what cannot be estimated stays in the band


def test_a_mean_over_no_whole_step_is_biased_by_the_angular_momentum():
    def worst_m(duration_s: float) -> np.ndarray:
        means = []
        for start in np.arange(0.0, 1.1, 0.1):
            t = start + np.arange(0.0, duration_s, 1e-3)
            axis = central_axis(Wrench(WALK.force(t), WALK.moment(t)))
            means.append((axis.project(WALK.com.at(t)) - WALK.com.at(t)).mean(axis=0))
        return np.asarray(np.ptp(means, axis=0))

    step_s = 1 / 1.8
    assert worst_m(1.0)[0] == pytest.approx(0.0075, abs=0.001)  # along the walk it depends on when the second begins
    assert worst_m(0.7)[0] > 0.012
    assert worst_m(step_s)[0] < 2e-4  # one step: L' about y averages out
    assert worst_m(step_s)[1] > 0.01  # but not L' about x, which has the stride's period
    assert worst_m(2 * step_s).max() < 2e-4  # one stride: both
    momentum = WALK.momentum.at(np.array([0.2, 1.2]))
    t = np.arange(0.2, 1.2, 1e-3)
    rate = WALK.momentum.at(t, 1).mean(axis=0)
    assert_allclose(rate, momentum[1] - momentum[0], atol=0.05)  # (L(T) - L(0)) / T: not zero


def test_a_small_force_residual_is_no_proof():
    """The table errs by 30 mm, the force is 18 ms late, and the fused acceleration agrees with the force."""
    t = np.arange(0.0, 6.0, 0.01)
    g = WALK.geometric(t, bias_m=np.array([-0.03, 0.0, 0.0]))
    late = WALK.wrench_track(t, Window(0.0, 6.0), late_s=0.018)
    fused = RtsSmoother.tuned().estimate(g, late, WALK.mass_kg)
    true = GeometryOnly().estimate(WALK.geometric(t), late, WALK.mass_kg)
    assert force_residual_n(fused, late, WALK.mass_kg).max() < 3
    assert force_residual_n(true, late, WALK.mass_kg).max() > 25  # the true motion has ten times the residual
    assert abs((fused.com_m - WALK.com.at(fused.time_s))[:, 0].mean()) > 0.015


def test_an_rmse_in_3d_hides_the_axes():
    """(x, y, z) in mm from the table of docs/theory/kalman-filter.md, robot cadence."""
    kalman, fused = np.array([8.2, 5.0, 22.5]), np.array([3.2, 2.3, 22.4])
    assert np.linalg.norm(fused) / np.linalg.norm(kalman) == pytest.approx(0.93, abs=0.01)
    assert np.linalg.norm(fused[:2]) / np.linalg.norm(kalman[:2]) == pytest.approx(0.41, abs=0.01)


def test_aic_on_smooth_residuals_needs_the_effective_number_of_samples():
    """A sinusoid of one step, sampled at 200 Hz, with errors in an 8 Hz band: how often two harmonics "win"."""
    t = np.arange(0.0, 0.55, 0.005)
    w = 2 * np.pi / 0.55
    one = np.column_stack([np.ones_like(t), np.cos(w * t), np.sin(w * t)])
    two = np.column_stack([one, np.cos(2 * w * t), np.sin(2 * w * t)])
    true = 0.95 - 0.02 * np.cos(w * t)
    effective = 12.0 * (t[-1] - t[0])

    def chosen(smooth: bool, samples: float) -> float:
        wins = 0
        for seed in range(300):
            noise = np.random.default_rng(seed).standard_normal(len(t) + 400)
            if smooth:
                spectrum = np.fft.rfft(noise)
                spectrum[np.fft.rfftfreq(len(noise), 0.005) > 8.0] = 0
                noise = np.fft.irfft(spectrum, len(noise))
            z = true + 0.001 * noise[200 : 200 + len(t)]
            squares = [np.sum((z - H @ np.linalg.lstsq(H, z, rcond=None)[0]) ** 2) for H in (one, two)]
            wins += samples * np.log(squares[1] / squares[0]) + 2 * 2 < 0
        return wins / 300

    assert chosen(False, len(t)) == pytest.approx(0.157, abs=0.02)  # white: what AIC promises
    assert chosen(True, len(t)) == pytest.approx(0.897, abs=0.02)
    assert chosen(True, effective) == pytest.approx(0.293, abs=0.02)
