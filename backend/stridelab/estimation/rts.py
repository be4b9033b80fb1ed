"""The smoother of Rauch, Tung and Striebel on the model of section 2.5.3."""

from dataclasses import dataclass, field
from typing import ClassVar

from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.estimate import ComEstimate
from stridelab.estimation.kalman import TUNED_SIGMA_JERK_M_S3, KalmanFilter
from stridelab.estimation.kalman_passes import Axis
from stridelab.recordings.recording import WrenchTrack


@dataclass(frozen=True, kw_only=True)
class RtsSmoother:
    """The state from all measurements, earlier and later, under the model of ``kalman``: no lag is left.

    The default model has the thesis' R and a jerk of the size that walking has.
    """

    name: ClassVar[str] = "rts"

    kalman: KalmanFilter = field(default_factory=lambda: KalmanFilter(sigma_jerk_m_s3=TUNED_SIGMA_JERK_M_S3))

    @classmethod
    def tuned(cls) -> "RtsSmoother":
        """On the tuned Kalman filter, with R from the stated errors."""
        return cls(kalman=KalmanFilter.tuned())

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Smooth over the whole gap-free geometry; the result lies at the window's samples.

        Raises as ``KalmanFilter.estimate`` does.
        """
        record = self.kalman.record(geometric, wrench, mass_kg)
        return record.estimate(Axis.smoothed, self.name, ("carpentier2017thesis", "rauch1965", "lainiotis1976"))
