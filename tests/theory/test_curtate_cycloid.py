"""What chapter 3 says of its curve and what the curve does; docs/theory/misprints.md."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from stridelab.walking.curtate_cycloid import Wheel
from stridelab.walking.path_fit import fit_path
from support.oracles.estimators import fit_without_offset

R, r, Z0 = 0.10, 0.015, 0.95
STEP_S = 0.54
OMEGA = 2 * np.pi / STEP_S
THETA = np.linspace(0.0, 2 * np.pi, 100_001)
AS_PRINTED = Wheel(R_m=R, r_m=r, z0_m=Z0, x0_m=0.0)
REVERSED = Wheel(R_m=R, r_m=r, z0_m=Z0, x0_m=0.0, branch=-1)


def test_without_an_offset_in_x_the_wheel_takes_its_radius_from_the_place_in_the_laboratory():
    """(3.1), (3.3)."""
    theta = np.linspace(-2.5, 3.5, 60)
    path = Wheel(R_m=R, r_m=r, z0_m=Z0, x0_m=2.3).position_m(theta)
    with_offset = fit_path(theta / OMEGA, path, STEP_S).wheel
    assert_allclose([with_offset.R_m, with_offset.r_m, with_offset.z0_m, with_offset.x0_m], [R, r, Z0, 2.3], rtol=1e-6)
    as_printed = [
        fit_without_offset(
            path, Wheel(R_m=2.3 / (2 * np.pi * turns), r_m=r, z0_m=Z0, x0_m=0.0), theta + 2 * np.pi * turns
        )
        for turns in range(1, 8)
    ]
    best, distance_m = min(as_printed, key=lambda fitted: float(np.sum(fitted[1] ** 2)))
    assert best.R_m == pytest.approx(2.3 / (2 * np.pi * 4), rel=0.01)  # 0.0915: the fourth turn lies at 2.3 m
    assert abs(best.R_m - R) > 0.08 * R
    assert distance_m.mean() < 0.001  # and nothing in the residual warns


def test_the_wheel_is_slowest_at_the_bottom():
    t = THETA / OMEGA
    x, z = AS_PRINTED.position_m(OMEGA * t).T
    speed = np.gradient(x, t)
    mean = R * OMEGA
    assert speed[np.argmin(z)] - mean == pytest.approx(-r * OMEGA, rel=1e-3)  # -0.17 m/s
    assert speed[np.argmax(z)] - mean == pytest.approx(+r * OMEGA, rel=1e-3)


def test_three_parameters_are_3_plus_n_or_6():
    """Rank of the derivative of (x_1, z_1, ..., x_N, z_N): how many numbers the curve can be given freely."""
    n = 20
    theta = np.linspace(0.3, 6.0, n)
    s, c, one, nil = np.sin(theta), np.cos(theta), np.ones(n), np.zeros(n)
    shape = np.column_stack([np.r_[theta, nil], np.r_[-s, -c], np.r_[nil, one]])
    x_rate, z_rate = R - r * c, r * s
    free_angles = np.hstack([shape, np.vstack([np.diag(x_rate), np.diag(z_rate)])])
    assert np.linalg.matrix_rank(free_angles) == 3 + n
    t = theta / OMEGA
    offset = np.r_[one, nil]
    clock = np.column_stack([np.r_[x_rate, z_rate], np.r_[x_rate * t, z_rate * t]])
    assert np.linalg.matrix_rank(np.column_stack([shape, offset, clock])) == 6


def test_the_convex_lower_part_of_3_1_is_the_shorter_one():
    x, z = AS_PRINTED.position_m(THETA).T
    slope = np.gradient(z, x)
    bend = np.gradient(slope, x)
    lengths = np.gradient(x)
    convex = float(lengths[bend > 0].sum())
    assert convex / (2 * np.pi * R) == pytest.approx(0.405, abs=0.002)  # the wheel with R < 0 has 0.595
    assert convex == pytest.approx(2 * (R * np.arccos(r / R) - np.sqrt(r**2 - r**4 / R**2)), rel=1e-3)
    mirrored = REVERSED.position_m(THETA)[:, 0]
    bend = np.gradient(np.gradient(z, mirrored), mirrored)
    assert float(np.gradient(mirrored)[bend > 0].sum()) / (2 * np.pi * R) == pytest.approx(0.595, abs=0.002)


def test_the_crossings_of_z0_enclose_half_a_step_whatever_the_double_support_is():
    z = AS_PRINTED.position_m(THETA)[:, 1]
    below = THETA[z < Z0].size / THETA.size
    assert below == pytest.approx(0.5, abs=1e-4)
    assert (below - 0.21) * 0.54 == pytest.approx(0.157, abs=0.001)  # double support is 21 % of a step of 0.54 s


def test_a_correlation_of_061_among_16_subjects_is_not_below_001():
    def two_sided_p(correlation: float, n: int) -> float:
        return float(2 * stats.t.sf(correlation * np.sqrt((n - 2) / (1 - correlation**2)), n - 2))

    assert two_sided_p(0.67, 16) == pytest.approx(0.0045, abs=1e-4)
    assert two_sided_p(0.61, 16) == pytest.approx(0.0121, abs=1e-4)  # printed: p < 0.01
    assert two_sided_p(0.87, 16) < 0.001


def test_overlapping_steps_of_one_walk_disagree_by_ten_times_the_formal_sd():
    """A smooth path that no cycloid describes: its residuals are systematic, and not white as formal sds take them."""
    step_s, speed = 0.55, 1.2
    w = 2 * np.pi / step_s
    fits = []
    for start in np.arange(0.0, step_s, 0.05):
        t = start + np.arange(0.0, step_s, 0.01)
        x = speed * t + 0.012 * np.sin(w * t + 0.4) + 0.001 * np.sin(2 * w * t + 1.0)
        z = 0.95 + 0.02 * np.sin(w * t + 2.1) + 0.0015 * np.sin(2 * w * t + 2.0)
        fits.append(fit_path(t, np.column_stack([x, z]), step_s))
    radii = np.array([fit.wheel.R_m for fit in fits])
    formal = np.median([fit.sd_m[1] for fit in fits])
    assert max(fit.distance_m.mean() for fit in fits) < 0.002  # each fit looks perfect
    assert np.ptp(radii) > 0.01  # 10 mm of R between steps that share most of their samples
    assert np.ptp(radii) > 10 * formal
