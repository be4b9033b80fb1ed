r"""The curtate cycloid of each step: R, r, z0 and omega of the wheel that rolls along the path (section 3.2.5).

    x = x0 + R theta - r sin(theta),    z = z0 - r cos(theta)

is fitted to the path of the CoM from lift-off to the next lift-off (``walking.path_fit``); omega is the slope of the
line through the angles theta_k. The errors are not the formal ones of a fit, which take residuals for independent.
Those of the path have the standard deviation s of the posture-dependent error of the segment table, a third of it
vertically, or by the markers alone that of their CoM, the same in both directions, and the correlation

    rho(t) = exp(-|t| / 0.3 s)

of the smoother's model. With the normal n_k and the tangent t_k of the curve, the rows a_k = n_k . d(x, z)/dp and the
error e_k of a sample, to first order

    dp = S^-1 sum a_k (n_k . e_k),    dtheta_k = t_k . (e_k - d(x, z)/dp dp) / |t_k|^2,    S = sum a_k a_k^T,

and domega is the slope of dtheta_k. The error of the height, the same throughout a recording, adds to that of z0.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.errors import StridelabError
from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import AHEAD, UP, WalkMotion
from stridelab.walking.curtate_cycloid import parameter_rows
from stridelab.walking.path_fit import PathFit, fit_path
from stridelab.walking.step_fit import LARGEST_R_M, MIN_R_M, MIN_SAMPLES, MIN_TURN_SHARE
from stridelab.walking.steps import GaitStep

CORRELATION_S: Final = 0.3
"""Correlation time of the varying error of the path, that of ``SmootherPriors.table_varying_s``."""
VERTICAL_SHARE: Final = 1 / 3
"""Varying vertical error over the horizontal one, as in the smoother; by the markers alone they are equal."""


def rolling_wheel(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """``cycloid_wheel_radius``, ``_point_radius``, ``_hub_height`` and ``_angular_speed``: R, r, z0 and omega.

    Per step within the estimate, in metres, the height above the floor, and rad/s. Steps whose fit does not converge,
    turns by less than three quarters, or is no curtate cycloid of a walker are left out.
    """
    measures = []
    path = motion.com_m[:, [AHEAD, UP]]
    for number, step in enumerate(steps):
        if not motion.covers(step.lift_off_s, step.next_lift_off_s):
            continue
        span = motion.samples(step.lift_off_s, step.next_lift_off_s)
        if span.stop - span.start < MIN_SAMPLES:
            continue
        time_s = motion.time_s[span]
        try:
            fit = fit_path(time_s, path[span], step.period_s)
        except StridelabError:
            continue
        if _is_plausible(fit):
            measures += _wheel_measures(motion, span, fit, step, number)
    return measures


def _is_plausible(fit: PathFit) -> bool:
    """Whether the fit describes the whole step of a walker: the limits are those that flag a ``StepFit``."""
    wheel, turned = fit.wheel, float(np.ptp(fit.theta_rad)) / (2.0 * math.pi)
    within = MIN_R_M <= wheel.r_m <= LARGEST_R_M and wheel.R_m > 0.0 and wheel.is_curtate
    return fit.converged and within and turned >= MIN_TURN_SHARE


def _wheel_measures(motion: WalkMotion, span: slice, fit: PathFit, step: GaitStep, number: int) -> list[Measure]:
    time_s, wheel = motion.time_s[span], fit.wheel
    omega = float(np.polyfit(time_s - time_s[0], fit.theta_rad, 1)[0])
    sd: list[float | None] = [None] * 4
    if motion.covariance is not None:
        vertical_m = motion.varying_sd_m * (1.0 if motion.by_markers else VERTICAL_SHARE)
        R_sd, r_sd, z0_sd, omega_sd = wheel_sd(time_s, fit, (motion.varying_sd_m, vertical_m))
        sd = [R_sd, r_sd, math.hypot(z0_sd, motion.height_sd_m), omega_sd]
    names = ("wheel_radius", "point_radius", "hub_height", "angular_speed")
    values = (wheel.R_m, wheel.r_m, wheel.z0_m, omega)
    return [
        Measure(f"cycloid_{name}", value, error, unit, step.side, number)
        for name, value, error, unit in zip(names, values, sd, ("m", "m", "m", "rad/s"), strict=True)
    ]


def wheel_sd(time_s: Series, fit: PathFit, path_sd_m: tuple[float, float]) -> tuple[float, float, float, float]:
    """Standard deviations of R, r, z0 (m) and omega (rad/s) for path errors that are correlated in time.

    ``path_sd_m`` are the standard deviations of the path within a step, ahead and up.
    """
    ahead, up = parameter_rows(fit.theta_rad, fit.wheel.branch)
    tangent = fit.wheel.tangent_m(fit.theta_rad)
    length = np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)
    along = tangent / length[:, None]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    rows = normal[:, :1] * ahead + normal[:, 1:] * up
    to_parameters = np.linalg.pinv(rows)
    t = time_s - time_s.mean()
    to_slope = t / (t @ t)
    correlation = np.exp(-np.abs(t[:, None] - t) / CORRELATION_S)
    variances = np.zeros(4)
    for axis, sd_m in enumerate(path_sd_m):
        by_error: Float[np.ndarray, "4 n"] = to_parameters * normal[:, axis]
        model = along[:, :1] * (ahead @ by_error) + along[:, 1:] * (up @ by_error)
        angle = (np.diag(along[:, axis]) - model) / length[:, None]
        effects = np.vstack([by_error[1:], to_slope @ angle])
        variances += sd_m**2 * np.einsum("in,nm,im->i", effects, correlation, effects)
    R_sd, r_sd, z0_sd, omega_sd = (float(value) for value in np.sqrt(variances))
    return R_sd, r_sd, z0_sd, omega_sd
