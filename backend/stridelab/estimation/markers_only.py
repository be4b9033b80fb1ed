"""Estimator that returns the geometric CoM without using forces."""

from dataclasses import dataclass, field
from typing import ClassVar

from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.differentiation import BAND_HZ, require_mass, smoothed_derivatives, window_span
from stridelab.estimation.error_band import geometry_sd_m
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.recording import WrenchTrack


@dataclass(frozen=True, kw_only=True)
class GeometryOnly:
    """Input (i) unchanged, with derivatives smoothed to ``band_hz``; ``sd_m`` is its prior.

    The result covers the same window as those of the other estimators, so that they can be compared sample by sample;
    with ``beyond_window`` it covers the whole gap-free geometry around the window.
    """

    name: ClassVar[str] = "geometry"

    band_hz: float = BAND_HZ
    priors: ErrorPriors = field(default_factory=ErrorPriors)
    beyond_window: bool = False

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Geometry at the window's samples; raises as ``window_span`` does."""
        require_mass(mass_kg)
        span = window_span(geometric, wrench)
        g = geometric.com_m[span.around]
        velocity, acceleration = smoothed_derivatives(g, span.rate_hz, self.band_hz)
        within = slice(None) if self.beyond_window else span.within
        return ComEstimate(
            method=self.name,
            time_s=geometric.time_s[span.around][within],
            com_m=g[within],
            velocity_m_s=velocity[within],
            acceleration_m_s2=acceleration[within],
            sd_m=geometry_sd_m(geometric.sd_m, len(g[within]), self.priors),
            window=span.window,
            references=(),
            diagnostics={"band_hz": self.band_hz},
        )
