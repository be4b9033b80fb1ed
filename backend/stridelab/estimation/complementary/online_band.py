"""Standard deviation of the online complementary filter: the input errors of ``error_band``, sample by sample.

Every source goes through the recursion of the estimate, so the band accounts for the start, hidden markers and missing
force. With s the response of H3 to the presence of an axis (0 at the start, 1 once settled):

- table: 1 - s of its offset remains horizontally, all of it along the force, which is assumed vertical here.
- moment and clocks: s times the offset of the axis that they cause, moment / m g and velocity times delay.
- angular momentum: the response of H3 to a line at the step (forward) and the stride frequency (sideways), any phase.
- acceleration: a constant error moves x by 1 / k_2, and by a growing amount without geometry; without force the
  acceleration of the body itself is unknown.
- marker noise: its share k_1 dt per sample, all of it at first.
"""

import cmath
import math
from typing import Final

from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.complementary.online_recursions import LowPass, OnlineTrack
from stridelab.estimation.error_priors import ErrorPriors, SdPerAxis

UNKNOWN_ACCELERATION_M_S2: Final = 2.5
"""Standard deviation of the acceleration of a walking body."""
UNKNOWN_VELOCITY_M_S: Final = 1.0
"""Standard deviation of the velocity after a single sample."""
SLOWEST_M_S: Final = 0.05
"""Speed below which the direction is undefined; forward is then x."""
_UNKNOWN: Final = (UNKNOWN_ACCELERATION_M_S2**2,) * 3


class OnlineBand:
    """State of the band: responses of H3 to errors of size one, constant or at stride and step frequency."""

    def __init__(self, low_hz: float, mass_kg: float, table_sd_m: SdPerAxis, priors: ErrorPriors) -> None:
        self._answers = LowPass(low_hz, 0j)
        self._omega, self._since_s = 1j * math.pi * priors.step_hz, 0.0
        x, y, z = table_sd_m
        self._table = (x * x, y * y, z * z)
        x, y, z = priors.acceleration_m_s2
        self._acceleration = (x * x, y * y, z * z)
        self._moment = (priors.moment_nm / (mass_kg * GRAVITY_M_S2)) ** 2
        walking, lateral = priors.momentum_rate_nm_kg
        self._sideways, self._forward = (walking / GRAVITY_M_S2) ** 2, (lateral / GRAVITY_M_S2) ** 2
        self._clock, self._marker = priors.clock_s**2, priors.marker_m**2

    def advance(self, h: float, has_axis: bool) -> None:
        """Advance by 2h to a sample with or without a central axis."""
        self._since_s += 2.0 * h
        stride = cmath.exp(self._omega * self._since_s) if has_axis else 0j
        self._answers.step(h, 1.0 + 0j if has_axis else 0j, stride, stride * stride)

    def sd_m(self, track: OnlineTrack, h: float, has_force: bool, vx: float, vy: float) -> tuple[float, float, float]:
        """Standard deviation per axis at this sample, whose estimated velocity is ``vx``, ``vy``."""
        k1, k2, blind = track.k1, track.k2, track.blind_s
        lag = (1.0 + blind * k1) / k2 + blind * blind / 2.0
        lag *= lag
        ax, ay, az = self._acceleration if has_force else _UNKNOWN
        noise = self._marker * min(1.0, 2.0 * h * k1 or 1.0)
        if blind and not track.has_velocity:
            noise += (UNKNOWN_VELOCITY_M_S * blind) ** 2
        share, stride, step = self._answers.values
        s = share.real
        left, used = (1.0 - s) * (1.0 - s), s * s
        forward = self._forward * (step.real * step.real + step.imag * step.imag)
        sideways = self._sideways * (stride.real * stride.real + stride.imag * stride.imag)
        xx, yy = vx * vx, vy * vy
        along = xx / (xx + yy) if xx + yy > SLOWEST_M_S * SLOWEST_M_S else 1.0
        turned = along * (forward - sideways)
        clock, both = used * self._clock, noise + used * self._moment
        tx, ty, tz = self._table
        return (
            math.sqrt(left * tx + both + clock * xx + sideways + turned + ax * lag),
            math.sqrt(left * ty + both + clock * yy + forward - turned + ay * lag),
            math.sqrt(tz + noise + az * lag),
        )
