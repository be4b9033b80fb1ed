"""Online complementary filter (section 2.4), for robots and live measurements.

Each filter of (2.24)-(2.27) has a small state. With x = (1 - s^2 H2) g + H2 a, the fusion of geometry and force, and
l = H3 (c_p - g), the offset from the central axis,

    x' = v + k_1 (g - x)      v' = a + k_2 (g - x)      k_1 = 2 / tau_1,  k_2 = 1 / tau_1^2       c  = x + l
    tau_2^2 l'' + 2 tau_2 l' + l = c_p - g                                                        c' = v + l'

v is a velocity without the marker noise that k_1 adds to x'. ``online_recursions`` integrates them by the bilinear
rule, so the positions equal those of the forward pass of ``forward_backward`` to rounding; no constant rate is needed.
``OnlineTrack`` handles the start and missing markers or force; without an axis c_p = g, as in 2.6.2.
"""

import math
from collections.abc import Sequence

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Vector3
from stridelab.dynamics.wrench import AXIS_THRESHOLD_N
from stridelab.errors import InvalidInput
from stridelab.estimation.complementary.online_band import OnlineBand
from stridelab.estimation.complementary.online_recursions import LowPass, OnlineTrack
from stridelab.estimation.differentiation import require_mass
from stridelab.estimation.error_priors import ErrorPriors, SdPerAxis
from stridelab.estimation.online_estimator import OnlineSample, require_together, step_s


class OnlineComplementaryFilter:
    """One causal step per sample; ``velocity_m_s`` at the first sample is estimated from the first two if not given.

    Raises ``InvalidInput`` with ``cutoffs-out-of-range`` unless 0 < low < high, or with ``mass-out-of-range``.
    """

    def __init__(
        self,
        *,
        low_hz: float,
        high_hz: float,
        mass_kg: float,
        table_sd_m: SdPerAxis,
        priors: ErrorPriors,
        velocity_m_s: Vector3 | None = None,
    ) -> None:
        require_mass(mass_kg)
        if not 0 < low_hz < high_hz < math.inf:
            raise InvalidInput(
                "cutoffs-out-of-range", f"Cutoffs of {low_hz:g} and {high_hz:g} Hz: 0 < low < high is needed."
            )
        self._mass_kg, self._low_hz, self._high_hz = mass_kg, low_hz, high_hz
        self._table_sd_m, self._priors = table_sd_m, priors
        self._time_s: float | None = None
        self._reset_state(None if velocity_m_s is None else velocity_m_s.tolist())

    def _reset_state(self, velocity_m_s: Sequence[float] | None = None) -> None:
        self._track = OnlineTrack(self._high_hz, velocity_m_s)
        self._low = LowPass(self._low_hz, 0.0)
        self._band = OnlineBand(self._low_hz, self._mass_kg, self._table_sd_m, self._priors)

    def step(
        self, time_s: float, geometry_m: Vector3 | None, force_n: Vector3 | None, moment_nm: Vector3 | None
    ) -> OnlineSample:
        """CoM at ``time_s``; below 100 N the geometry replaces the axis point (2.6.2).

        Raises ``InvalidInput`` (``not-finite``) and otherwise as ``OnlineEstimator.step``.
        """
        h = step_s(self._time_s, time_s) / 2
        self._time_s = time_s
        require_together(force_n, moment_nm)
        f = None if force_n is None else force_n.tolist()
        nu = None if moment_nm is None else moment_nm.tolist()
        g = None if geometry_m is None else geometry_m.tolist()
        if not math.isfinite(sum(f or ()) + sum(nu or ()) + sum(g or ())):
            raise InvalidInput("not-finite", "A sample contains a number that is not finite; omit missing values.")
        if g is not None and self._track.is_lost:
            self._reset_state()

        m = self._mass_kg
        track = self._track
        seen = track.step(h, None if f is None else (f[0] / m, f[1] / m, f[2] / m - GRAVITY_M_S2), g)
        to_axis = None if f is None or nu is None else _to_axis(seen, f, nu)
        self._low.step(h, *(to_axis or (0.0, 0.0, 0.0)))
        lx, ly, lz = self._low.values
        lvx, lvy, lvz = self._low.rates
        x, y, z = track.axes
        vx, vy = x.v + lvx, y.v + lvy
        self._band.advance(h, to_axis is not None)
        sx, sy, sz = self._band.sd_m(track, h, f is not None, vx, vy)
        flat = np.array((x.x + lx, y.x + ly, z.x + lz, vx, vy, z.v + lvz, sx, sy, sz))
        return OnlineSample(flat[:3], flat[3:6], flat[6:])


def _to_axis(c: Sequence[float], f: Sequence[float], nu: Sequence[float]) -> tuple[float, float, float] | None:
    """``c_p - c`` of (2.12) in scalars, because np.cross costs more than the rest of the step; None without an axis."""
    (c0, c1, c2), (f0, f1, f2), (n0, n1, n2) = c, f, nu
    squared = f0 * f0 + f1 * f1 + f2 * f2
    if squared <= AXIS_THRESHOLD_N**2:
        return None
    along = c0 * f0 + c1 * f1 + c2 * f2
    return (
        (f1 * n2 - f2 * n1 + along * f0) / squared - c0,
        (f2 * n0 - f0 * n2 + along * f1) / squared - c1,
        (f0 * n1 - f1 * n0 + along * f2) / squared - c2,
    )
