"""The complementary filter sample by sample, as a robot or a live laboratory needs it (section 2.4)."""

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Vector3
from stridelab.dynamics.central_axis import AXIS_THRESHOLD_N
from stridelab.estimation.filters import ComplementaryFilters, DigitalFilter
from stridelab.estimation.passes import FilterState, State


class OnlineComplementaryFilter:
    """One causal step per sample; the same arithmetic as ``passes.forward``, so equal to it to rounding.

    Without a ``start`` the body is taken to have moved uniformly, with ``velocity_m_s``, before the first sample, and
    the geometry to be unbiased.
    """

    def __init__(
        self,
        filters: ComplementaryFilters,
        mass_kg: float,
        start: FilterState | None = None,
        velocity_m_s: Vector3 | None = None,
    ) -> None:
        self._mass_kg = mass_kg
        self._velocity = np.zeros(3) if velocity_m_s is None else velocity_m_s
        self._high_force = _Recursion(filters.h2, None if start is None else start.h2)
        self._high_geometry = _Recursion(filters.s2_h2, None if start is None else start.s2_h2)
        self._low = _Recursion(filters.h3, None if start is None else start.h3)
        self._rested = start is None

    def step(self, geometry_m: Vector3, force_n: Vector3, moment_nm: Vector3) -> Vector3:
        """CoM at this sample from geometry and the total contact wrench about the same origin, in metres.

        Below 100 N the central axis is undefined and the geometry takes its place (2.6.2).
        """
        if self._rested:
            self._high_geometry.remember_line(geometry_m, self._velocity)
            self._rested = False
        acceleration = force_n / self._mass_kg
        acceleration[2] -= GRAVITY_M_S2
        high = self._high_force(acceleration) - self._high_geometry(geometry_m)
        return np.asarray(geometry_m + high + self._low(_to_axis(geometry_m, force_n, moment_nm)))


class _Recursion:
    """Second-order section in transposed direct form II, as ``scipy.signal.lfilter`` computes it."""

    def __init__(self, h: DigitalFilter, state: State | None) -> None:
        (self._b0, self._b1, self._b2), (_, self._a1, self._a2) = h.b.tolist(), h.a.tolist()
        self._rate_hz = h.rate_hz
        self._z0: Vector3 = np.zeros(3) if state is None else state[0].copy()
        self._z1: Vector3 = np.zeros(3) if state is None else state[1].copy()

    def remember_line(self, position_m: Vector3, velocity_m_s: Vector3) -> None:
        """State after an endless straight line that would reach ``position_m`` now, for a filter that stops lines."""
        last = position_m - velocity_m_s / self._rate_hz
        before = last - velocity_m_s / self._rate_hz
        self._z0 = self._b1 * last + self._b2 * before
        self._z1 = self._b2 * last

    def __call__(self, x: Vector3) -> Vector3:
        y: Vector3 = self._z0 + self._b0 * x
        self._z0 = self._z1 + self._b1 * x - self._a1 * y
        self._z1 = self._b2 * x - self._a2 * y
        return y


def _to_axis(c: Vector3, f: Vector3, nu: Vector3) -> Vector3:
    """``c_p - c`` of (2.12), written out: np.cross costs more than the rest of the step."""
    (c0, c1, c2), (f0, f1, f2), (n0, n1, n2) = c.tolist(), f.tolist(), nu.tolist()
    squared = f0 * f0 + f1 * f1 + f2 * f2
    if squared <= AXIS_THRESHOLD_N**2:
        return np.zeros(3)
    along = c0 * f0 + c1 * f1 + c2 * f2
    return np.array(
        [
            (f1 * n2 - f2 * n1 + along * f0) / squared - c0,
            (f2 * n0 - f0 * n2 + along * f1) / squared - c1,
            (f0 * n1 - f1 * n0 + along * f2) / squared - c2,
        ]
    )
