"""Smoother as an estimator: coloured errors, masks, declared plate bias (docs/theory/smoother.md)."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, Vector3
from stridelab.dynamics.wrench import com_acceleration
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import require_mass, smoothed_derivatives, window_span
from stridelab.estimation.estimator import ComEstimate, StateCovariance
from stridelab.estimation.evaluation.physics_residuals import segment_momentum_rate
from stridelab.estimation.latency import ClockError, remaining_clock_error
from stridelab.estimation.smoother.kalman_rts import (
    ForwardPass,
    Gains,
    Signals,
    compute_gains,
    filter_forward,
    smooth_backward,
)
from stridelab.estimation.smoother.measurements import (
    Walk,
    in_walking_frame,
    moment_in_metres,
    normalised_innovations,
    plate_bias_remarks,
    plate_bias_statistic,
    read_later,
    require_single_support,
    smoother_signals,
    without_ends,
)
from stridelab.estimation.smoother.noise_levels import (
    SmootherPriors,
    is_airborne,
    is_explained,
    is_walk,
    learn_sizes,
    moves_ahead,
    sizes_of,
    with_segments,
    with_walking_noise,
)
from stridelab.estimation.smoother.online_filter import OnlineSmoother
from stridelab.estimation.smoother.state_space import ACCELERATION, Sizes, state_space
from stridelab.estimation.smoother.stated_band import error_sizes, stated_variance_m2
from stridelab.recordings.recording import WrenchTrack


@dataclass(frozen=True, kw_only=True)
class Smoother:
    """Fixed-interval smoother; ``priors`` are the sizes of the input errors, that of the table is in the geometry.

    ``learn`` estimates the noise levels from the recording (``noise_levels``). In walking it also estimates the latency
    within the prior ``clock_s``, unless the clocks have been compared (``remaining_clock_error``); ``compared_clock``
    then replaces ``clock_s`` by the standard deviation that the comparison states, if that is smaller. In walking and
    running it decides whether the angular momentum of the segments as point masses is used, by the likelihood of the
    recording with and without it; ``segment_momentum`` uses it always. ``beyond_window`` returns the whole gap-free
    stretch of geometry around the window instead of the window alone.
    """

    name: ClassVar[str] = "smoother"

    priors: SmootherPriors = field(default_factory=SmootherPriors)
    learn: bool = True
    segment_momentum: bool = False
    beyond_window: bool = False
    compared_clock: bool = True

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Smooth over all geometry around the longest window; every window in it contributes its force.

        The acceleration is that of the force without its estimated bias; without force, that of the path.

        Raises ``NotEstimable`` or ``InvalidInput`` as ``window_span`` does, and ``NotEstimable`` with
        ``no-single-support`` or, with ``segment_momentum``, ``segments-missing``.
        """
        require_mass(mass_kg)
        span = window_span(geometric, wrench)
        used, rate_hz = span.around, span.rate_hz
        seen = np.isfinite(wrench.force_n[used]).all(axis=1) & wrench.complete[used]
        force_n, moment_nm = wrench.force_n[used], wrench.moment_nm[used]
        walk = in_walking_frame(geometric.com_m[used], force_n, moment_nm, seen, rate_hz, geometric.ground_m_s)
        priors = self.priors
        if self.compared_clock and wrench.clock_sd_s is not None:
            priors = replace(priors, clock_s=min(priors.clock_s, wrench.clock_sd_s))
        sizes = sizes_of(priors, walk, mass_kg, geometric.sd_m)
        require_single_support(walk, span.within, sizes.swing_hz[0])
        clock = ClockError(0.0, priors.clock_s)
        if self.learn and clock.sd_s > 0.0 and is_walk(walk, mass_kg):
            clock = remaining_clock_error(geometric, wrench, span, mass_kg, clock.sd_s)
        if clock.mean_s != 0.0:
            walk = read_later(walk, clock.mean_s)
            sizes = sizes_of(replace(priors, clock_s=clock.sd_s), walk, mass_kg, geometric.sd_m)
        if wrench.withheld is not None:
            walk = replace(walk, seen=seen & ~wrench.withheld[used])
        sizes, data = self._model(sizes, walk, geometric, used, mass_kg)
        space = state_space(sizes, rate_hz)
        gain_sets = compute_gains(space, data)
        forward = filter_forward(space, data, gain_sets)
        mean, covariance = smooth_backward(gain_sets, forward, 2)
        c, v = (mean[:, :, i] @ walk.frame for i in (0, 1))
        measured = (com_acceleration(walk.force_n, mass_kg) - forward.constants[:, ACCELERATION]) @ walk.frame
        acceleration = np.where(walk.seen[:, None], measured, smoothed_derivatives(c, rate_hz)[1])
        height = covariance[:, 2, 0, 0]
        np.maximum(height, geometric.sd_m[2] ** 2, out=height)  # the height is unobservable
        errors = error_sizes(sizes, priors, walk, data, forward, mass_kg)
        sd = np.sqrt(stated_variance_m2(sizes, errors, data, rate_hz, covariance[..., 0, 0]) @ walk.frame**2)
        answer = slice(0, len(c)) if self.beyond_window else span.within
        return ComEstimate(
            method=self.name,
            time_s=geometric.time_s[used][answer],
            com_m=c[answer],
            velocity_m_s=v[answer],
            acceleration_m_s2=acceleration[answer],
            sd_m=sd[answer],
            state_covariance=StateCovariance(walk.frame, covariance[answer]),
            window=span.window,
            references=("carpentier2017thesis", "dejong1991", "schmidt1966"),
            remarks=plate_bias_remarks(space, forward, mass_kg, self.priors.plate_force_n, walk.frame),
            diagnostics={
                **_size_diagnostics(sizes, walk, mass_kg),
                **({"clock_ms": 1e3 * clock.mean_s, "clock_sd_ms": 1e3 * clock.sd_s} if clock.mean_s != 0.0 else {}),
                "normalised_innovations": _run_innovations(sizes, walk, data, mass_kg, gain_sets, forward),
                "plate_bias_statistic": plate_bias_statistic(space, forward),
            },
        )

    def _model(
        self, sizes: Sizes, walk: Walk, geometric: GeometricCom, used: slice, mass_kg: float
    ) -> tuple[Sizes, Signals]:
        """Sizes and data, with the angular momentum of the segments where it is required or more probable.

        Both models with a broad rest are compared. Where the segments explain nothing, because their motion is noise,
        the narrow resonator of a periodic walk remains.
        """
        data = smoother_signals(walk, mass_kg)
        rate_nm = segment_momentum_rate(geometric, mass_kg)
        known = rate_nm is not None and bool(np.isfinite(rate_nm[used]).all())
        if self.segment_momentum and not known:
            raise NotEstimable(
                "segments-missing",
                "The angular momentum of the segments needs all segments at all times, and some are hidden.",
            )
        wanted = self.segment_momentum or (self.learn and moves_ahead(walk))
        if rate_nm is None or not known or not wanted:
            return (learn_sizes(sizes, data, walk.rate_hz) if self.learn else sizes), data
        segments_m = moment_in_metres(rate_nm[used] @ walk.frame.T, mass_kg * GRAVITY_M_S2)
        every, data = data, without_ends(data, walk.rate_hz)
        runs = is_airborne(walk, mass_kg)
        rest, less = with_segments(sizes, data, segments_m, runs=runs)
        if not self.learn:
            return rest, less
        learned = learn_sizes(rest, less, walk.rate_hz)
        if self.segment_momentum or is_explained(rest, learned, less, data, walk.rate_hz, runs=runs):
            return learned, less
        return learn_sizes(sizes, every, walk.rate_hz), every

    def causal(
        self,
        *,
        mass_kg: float,
        table_sd_m: tuple[float, float, float],
        velocity_m_s: Vector3 | None = None,
        ahead: Vector3 | None = None,
    ) -> OnlineSmoother:
        """Online filter of the same model. ``ahead`` is the horizontal direction of the walk, if known.

        Raises ``InvalidInput`` (``mass-out-of-range``).
        """
        require_mass(mass_kg)
        return OnlineSmoother(self.priors, mass_kg, table_sd_m, velocity_m_s, ahead)


def _run_innovations(
    sizes: Sizes, walk: Walk, data: Signals, mass_kg: float, gain_sets: Gains, forward: ForwardPass
) -> float:
    """Normalised innovations; in runs and jumps under the noise of walking, whose larger one would hide a fault."""
    if is_airborne(walk, mass_kg):
        space = state_space(with_walking_noise(sizes), walk.rate_hz)
        gain_sets = compute_gains(space, data)
        forward = filter_forward(space, data, gain_sets)
    return normalised_innovations(gain_sets, forward)


def _size_diagnostics(sizes: Sizes, walk: Walk, mass_kg: float) -> dict[str, float]:
    """Error sizes in use, in the units of the priors, for the diagnostics."""
    weight = mass_kg * GRAVITY_M_S2
    return {
        "marker_mm": float(1e3 * np.mean(sizes.marker_m)),
        "momentum_about_walk_nms": float(weight * sizes.swing_m_s[1]),
        "momentum_about_side_nms": float(weight * sizes.swing_m_s[0]),
        "table_varying_mm": float(1e3 * np.mean(sizes.table_varying_m[:2])),
        "step_hz": float(sizes.swing_hz[0]),
        "speed_m_s": walk.speed_m_s,
    }
