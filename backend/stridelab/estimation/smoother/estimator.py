"""The smoother as an estimator: coloured errors, masks, declared plate bias (docs/theory/smoother.md)."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points
from stridelab.estimation.derivatives import derivatives
from stridelab.estimation.estimate import ComEstimate
from stridelab.estimation.smoother.model import state_space
from stridelab.estimation.smoother.priors import SmootherPriors
from stridelab.estimation.smoother.recursions import filtered, gains, smoothed
from stridelab.estimation.smoother.signals import Walk, in_walking_frame, signals
from stridelab.estimation.smoother.sizes import sizes_of
from stridelab.estimation.span import require_mass, window_span
from stridelab.recordings.recording import WrenchTrack


@dataclass(frozen=True, kw_only=True)
class Smoother:
    """``priors`` say how large the errors of the inputs are; the table's own is in the geometry.

    ``beyond_window`` answers for the whole gap-free stretch of geometry around the window instead of the window alone.
    """

    name: ClassVar[str] = "smoother"

    priors: SmootherPriors = field(default_factory=SmootherPriors)
    beyond_window: bool = False

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Smooth over all geometry around the longest window; every window in it contributes its force.

        Raises ``NotEstimable`` or ``InvalidInput`` as ``window_span`` does.
        """
        require_mass(mass_kg)
        span = window_span(geometric, wrench)
        used = span.around
        seen = np.isfinite(wrench.force_n[used]).all(axis=1) & wrench.complete[used]
        walk = in_walking_frame(geometric.com_m[used], wrench.force_n[used], wrench.moment_nm[used], seen, span.rate_hz)
        data = signals(walk, mass_kg, np.zeros_like(walk.force_n))
        space = state_space(sizes_of(self.priors, walk, mass_kg, geometric.sd_m), span.rate_hz)
        found = gains(space, data.seen, data.phi)
        forward = filtered(space, data, found)
        mean, variance = smoothed(found, forward, 2)
        c, v = (mean[:, :, i] @ walk.frame for i in (0, 1))
        sd = _world_sd(variance[:, :, 0], walk)
        answer = slice(0, len(c)) if self.beyond_window else span.within
        return ComEstimate(
            method=self.name,
            time_s=geometric.time_s[used][answer],
            com_m=c[answer],
            velocity_m_s=v[answer],
            acceleration_m_s2=derivatives(c, span.rate_hz)[1][answer],
            sd_m=sd[answer],
            window=span.window,
            references=("carpentier2017thesis",),
        )


def _world_sd(variance: Points, walk: Walk) -> Points:
    """Standard deviation per world axis; the walking axes are independent."""
    return np.asarray(np.sqrt(variance @ walk.frame**2))
