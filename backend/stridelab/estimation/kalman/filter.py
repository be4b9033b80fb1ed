"""Kalman filter of section 2.5.3, which the thesis compares with its complementary filter, and its RTS smoother."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.complementary.forward_backward import FilterInputs, filter_inputs
from stridelab.estimation.differentiation import require_mass, smoothed_derivatives, window_span
from stridelab.estimation.error_band import FusedStretch
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.kalman.jerk_model import (
    SIGMA_JERK_RANGE_M_S3,
    InputNoise,
    JerkModel,
    measured_inputs,
    require_sd,
    split_stretches,
)
from stridelab.estimation.kalman.passes import Axis, JerkRecord
from stridelab.recordings.recording import WrenchTrack

THESIS_SIGMA_JERK_M_S3 = 1.0
TUNED_SIGMA_JERK_M_S3 = 20.0


@dataclass(frozen=True, kw_only=True)
class KalmanFilter:
    """White jerk of ``sigma_jerk_m_s3`` drives the CoM; geometry, force and axis point measure it (``jerk_model``).

    The defaults are those of the thesis, with (2.29) and (2.30) corrected. ``noise`` is R; None uses the errors of
    ``priors`` and of the segment table as if they were white (``InputNoise.stated``). ``start_sd`` is the initial
    standard deviation of position (m, about the first geometry), velocity (m/s) and acceleration (m/s^2). ``printed``
    uses A_d as printed in (2.29).

    The filter runs over the whole gap-free geometry; the force is used inside the window, the axis point where the axis
    is defined. ``sd_m`` is not the covariance of the filter, which treats all errors as white and is far too narrow
    (its mean is in ``diagnostics``), but follows from the errors of ``priors`` propagated through the filter, and from
    its lag. Walking has an rms jerk of 4 (across) to 24 m/s^3 (up) in an 8 Hz band.

    Raises ``InvalidInput`` naming the field if a standard deviation is not positive (``prior-not-positive``) or
    implausible (``prior-out-of-range``).
    """

    name: ClassVar[str] = "kalman"

    sigma_jerk_m_s3: float = THESIS_SIGMA_JERK_M_S3
    noise: InputNoise | None = field(default_factory=InputNoise)
    start_sd: tuple[float, float, float] = (1.0, 5.0, 10.0)
    printed: bool = False
    priors: ErrorPriors = field(default_factory=ErrorPriors)

    def __post_init__(self) -> None:
        require_sd("sigma_jerk_m_s3", (self.sigma_jerk_m_s3,), SIGMA_JERK_RANGE_M_S3)
        require_sd("start_sd", self.start_sd, (1e-3, 1e3))

    @classmethod
    def as_printed(cls) -> "KalmanFilter":
        """Filter with A_d of (2.29) as printed, for reference: it loses the position at every step."""
        return cls(printed=True)

    @classmethod
    def tuned(cls) -> "KalmanFilter":
        """Filter with the jerk of walking, and R from ``priors``."""
        return cls(sigma_jerk_m_s3=TUNED_SIGMA_JERK_M_S3, noise=None)

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Filter forward; the result lies at the window's samples.

        ``lag_*_s`` in the diagnostics is the delay of the filter at the stride frequency of ``priors``. Raises as
        ``window_span`` does, and ``InvalidInput`` with ``mass-out-of-range``.
        """
        record = self.prepare_record(geometric, wrench, mass_kg)
        estimate = record.estimate_window(
            Axis.filter_states, self.name, ("carpentier2017thesis", "kalman1960", "lainiotis1976")
        )
        stride_hz = self.priors.step_hz / 2
        lags_s = {f"lag_{name}_s": axis.lag_s(stride_hz) for name, axis in zip("xyz", record.axes, strict=True)}
        return replace(estimate, diagnostics={**estimate.diagnostics, **lags_s})

    def prepare_record(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> JerkRecord:
        """Inputs and models of the three axes; raises as ``estimate`` does."""
        require_mass(mass_kg)
        span = window_span(geometric, wrench)
        g, within, inside = geometric.com_m[span.around], span.within, span.inside
        velocity, a = smoothed_derivatives(g, span.rate_hz)
        total = Wrench(wrench.force_n[inside], wrench.moment_nm[inside])
        measured = filter_inputs(g[within], total, mass_kg)
        p = g.copy()
        a[within], p[within] = measured.acceleration_m_s2, measured.axis_point_m
        noise = (
            InputNoise.from_priors(geometric.sd_m, self.priors, velocity, mass_kg) if self.noise is None else self.noise
        )
        model = JerkModel(1 / span.rate_hz, self.sigma_jerk_m_s3, self.printed)
        measured_rows = measured_inputs(len(g), within, total.force_n)
        if wrench.withheld is not None:
            measured_rows[wrench.withheld[span.around], 1:] = False
        rows = tuple(split_stretches(measured_rows))
        start = np.diag(np.square(self.start_sd))
        x, y, z = (Axis(model, tuple(variance), rows, start) for variance in noise.variance(mass_kg).tolist())
        stretch = FusedStretch(total, velocity, within, span.rate_hz, mass_kg)
        return JerkRecord(geometric, span, FilterInputs(g, a, p), stretch, (x, y, z), self.priors)


@dataclass(frozen=True, kw_only=True)
class RtsSmoother:
    """Rauch-Tung-Striebel smoother for the model of ``kalman``: uses all measurements and has no lag.

    The default model has the thesis' R and the jerk of walking.
    """

    name: ClassVar[str] = "rts"

    kalman: KalmanFilter = field(default_factory=lambda: KalmanFilter(sigma_jerk_m_s3=TUNED_SIGMA_JERK_M_S3))

    @classmethod
    def tuned(cls) -> "RtsSmoother":
        """Smoother of the tuned Kalman filter, with R from its priors."""
        return cls(kalman=KalmanFilter.tuned())

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Smooth over the whole gap-free geometry; the result lies at the window's samples.

        Raises as ``KalmanFilter.estimate`` does.
        """
        record = self.kalman.prepare_record(geometric, wrench, mass_kg)
        return record.estimate_window(
            Axis.smooth_states, self.name, ("carpentier2017thesis", "rauch1965", "lainiotis1976")
        )
