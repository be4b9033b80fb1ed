"""Errors of an estimate with a known truth, horizontal and vertical separately.

The position along the force is unobservable (section 2.3.1), so a single 3D error would mainly show the vertical error
of the segment table.
"""

from dataclasses import dataclass

import numpy as np
from scipy import interpolate

from stridelab.conventions import PerAxis, Points, Series
from stridelab.estimation.differentiation import smoothed_derivatives, walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.physics_residuals import WindowPoints, track_at_samples

BAND_95 = 1.96
_SWAY_M_S = 0.01
"""RMS variation of the velocity below which the lag is undefined."""
_LAG_ROUNDS = 4


@dataclass(frozen=True)
class TruthError:
    """Error of one estimate; arrays are along the walk, lateral, vertical.

    ``horizontal_m`` is the RMS of the horizontal distance, ``horizontal_95_m`` its 95th percentile. ``mean_m`` is the
    constant part. ``coverage`` is the share of samples inside the reported 95 % band, ``sd_m`` the RMS of the reported
    standard deviation. ``lag_s`` > 0 means that the estimate is late; NaN along an axis with uniform motion.
    """

    horizontal_m: float
    vertical_m: float
    horizontal_95_m: float
    rms_m: PerAxis
    mean_m: PerAxis
    coverage: PerAxis
    sd_m: PerAxis
    lag_s: PerAxis


def error_m(estimate: ComEstimate, time_s: Series, truth_com_m: Points) -> WindowPoints:
    """Estimate minus truth at the estimate's samples; the truth is given at the instants ``time_s``."""
    return np.asarray(estimate.com_m - track_at_samples(estimate, time_s, truth_com_m))


def truth_error(estimate: ComEstimate, time_s: Series, truth_com_m: Points) -> TruthError:
    """Compare an estimate with the true CoM, given at the instants ``time_s`` that contain the estimate's."""
    true = track_at_samples(estimate, time_s, truth_com_m)
    rate_hz = (len(true) - 1) / (estimate.time_s[-1] - estimate.time_s[0])
    turn = walk_frame(smoothed_derivatives(true, rate_hz)[0])
    error = (estimate.com_m - true) @ turn.T
    # The bands are per world axis; their variances transform with the squares of the direction cosines.
    sd = np.sqrt(estimate.sd_m**2 @ (turn**2).T)
    distance = np.hypot(error[:, 0], error[:, 1])
    return TruthError(
        horizontal_m=float(np.sqrt(np.mean(distance**2))),
        vertical_m=float(np.sqrt(np.mean(error[:, 2] ** 2))),
        horizontal_95_m=float(np.percentile(distance, 95)),
        rms_m=np.sqrt(np.mean(error**2, axis=0)),
        mean_m=error.mean(axis=0),
        coverage=(np.abs(error) <= BAND_95 * sd).mean(axis=0),
        sd_m=np.sqrt(np.mean(sd**2, axis=0)),
        lag_s=np.array([lag_s(estimate.com_m @ axis, true @ axis, rate_hz) for axis in turn]),
    )


def lag_s(estimated: Series, true: Series, rate_hz: float) -> float:
    """Delay tau of a signal for which ``estimated(t) - true(t - tau)`` is closest to a straight line.

    Gauss-Newton on tau; the line absorbs bias and drift. NaN if the truth moves uniformly.
    """
    t = np.arange(len(true)) / rate_hz
    spline = interpolate.CubicSpline(t, true)
    edge = max(2, len(t) // 20)
    tau, interior = 0.0, slice(edge, -edge)
    line = np.column_stack([np.ones(len(t)), t - t.mean()])[interior]

    def residual_of_line(x: Series) -> Series:
        return np.asarray(x - line @ np.linalg.lstsq(line, x, rcond=None)[0])

    for _ in range(_LAG_ROUNDS):
        velocity = residual_of_line(spline(t - tau, 1)[interior])
        if np.sqrt(np.mean(velocity**2)) < _SWAY_M_S:
            return float("nan")
        tau -= float(velocity @ residual_of_line((estimated - spline(t - tau))[interior]) / (velocity @ velocity))
    return tau
