"""Online fusion of geometry and acceleration, ``x = (1 - s^2 H2) g + H2 a``, with start-up and missing inputs.

- start: the least-squares line through the samples so far (k_1 = 4 / t, k_2 = 6 / t^2) until these gains fall below
  those of the filter; motions with zero or measured acceleration pass unchanged from the first sample on.
- without force the acceleration is unknown, so the line goes through the last 80 ms only; when the force returns, the
  memory grows again.
- without geometry the force alone is integrated, or the velocity is held; after more than a second, the filter
  restarts.

The scalar recursions use the trapezoidal rule. For ``X' = F(X, u)`` a step of length 2h is ``X_1 = X_0 + h F(X_0, u_0)
+ h F(X_1, u_1)``: an explicit and an implicit half step. On linear systems this is the bilinear rule of
``transfer_functions``, but every step may have its own length and gains. Plain floats are used because arrays of this
size cost more than the arithmetic.
"""

import math
from collections.abc import Sequence
from typing import Final, Generic, TypeVar

import numpy as np

from stridelab.errors import NotEstimable

MEMORY_WITHOUT_FORCE_S: Final = 0.08
"""Memory without force: a walking body deviates from a straight line by 2 mm in this time."""
MAX_BLIND_S: Final = 1.0
"""Longest time without geometry; after it the filter restarts."""
_ZERO: Final = (0.0, 0.0, 0.0)


class OnlineTrack:
    """Position and velocity of the three axes, with the gains ``k1`` and ``k2`` of the last step.

    ``blind_s`` is the time since the last geometry; ``has_velocity`` is False until the second geometry, unless the
    initial velocity is given.
    """

    def __init__(self, high_hz: float, velocity_m_s: Sequence[float] | None) -> None:
        w = 2 * math.pi * high_hz
        self._k1, self._k2 = 2 * w, w * w
        self._stated = velocity_m_s
        self._memory_s = 0.0 if velocity_m_s is None else math.inf
        self._begun = self.has_velocity = False
        self.axes = (Observer(), Observer(), Observer())
        self.k1, self.k2 = 4 / MEMORY_WITHOUT_FORCE_S, 6 / MEMORY_WITHOUT_FORCE_S**2
        self.blind_s = 0.0

    @property
    def is_lost(self) -> bool:
        """Whether the geometry has been missing for longer than ``MAX_BLIND_S``, so that the filter restarts."""
        return self.blind_s > MAX_BLIND_S

    def step(self, h: float, a: Sequence[float] | None, g: Sequence[float] | None) -> Sequence[float]:
        """Advance by 2h; returns the geometry, or x if it is missing.

        Raises ``NotEstimable`` (``geometry-missing``) if the first sample has no geometry.
        """
        x, y, z = self.axes
        ax, ay, az = a or _ZERO
        t = self._memory_s + 2 * h
        if a is None:
            t = min(t, MEMORY_WITHOUT_FORCE_S)
        self._memory_s = t
        if g is None:
            if not self._begun:
                raise NotEstimable("geometry-missing", "The first sample needs the CoM of the segment model.")
            self.blind_s += 2 * h
            x.coast(h, ax)
            y.coast(h, ay)
            z.coast(h, az)
            return x.x, y.x, z.x
        if not self.has_velocity:
            self._learn_velocity(self.blind_s + 2 * h, h, (ax, ay, az), g)
            self.blind_s = 0.0
            return g
        self.blind_s = 0.0
        self.k1, self.k2 = k1, k2 = max(self._k1, 4 / t), max(self._k2, 6 / (t * t))
        gx, gy, gz = g
        x.step(h, ax, gx, k1, k2)
        y.step(h, ay, gy, k1, k2)
        z.step(h, az, gz, k1, k2)
        return g

    def _learn_velocity(self, since_s: float, h: float, a: Sequence[float], g: Sequence[float]) -> None:
        """Initialise the velocity: on the first sample the given one or zero, on the second the finite difference."""
        for axis, (observer, a_i, g_i) in enumerate(zip(self.axes, a, g, strict=True)):
            if self._begun:
                observer.coast(h, a_i)
                observer.begin(g_i, observer.v + (g_i - observer.x) / since_s, a_i)
            else:
                observer.begin(g_i, 0.0 if self._stated is None else self._stated[axis], a_i)
        self.has_velocity = self._begun or self._stated is not None
        self._begun = True


Number = TypeVar("Number", float, complex)


class Observer:
    """Observer of position and velocity: ``x' = v + k_1 (g - x)``, ``v' = a + k_2 (g - x)``."""

    __slots__ = ("_v_rate", "_x_rate", "v", "x")

    def __init__(self) -> None:
        self.x = self.v = self._x_rate = self._v_rate = 0.0

    def begin(self, x: float, v: float, a: float) -> None:
        """Reset the state to position ``x``, velocity ``v`` and acceleration ``a``."""
        self.x, self.v, self._x_rate, self._v_rate = x, v, v, a

    def step(self, h: float, a: float, g: float, k1: float, k2: float) -> None:
        """Advance by 2h to a sample with acceleration and position."""
        v = self.v + h * self._v_rate
        predicted = self.x + h * self._x_rate + h * (v + h * a)
        weight = h * (k1 + h * k2)
        r = (g - predicted) / (1.0 + weight)
        self._v_rate = v_rate = a + k2 * r
        self.v = v = v + h * v_rate
        self.x = predicted + weight * r
        self._x_rate = v + k1 * r

    def coast(self, h: float, a: float) -> None:
        """Advance by 2h to a sample with acceleration only."""
        self.step(h, a, 0.0, 0.0, 0.0)


class LowPass(Generic[Number]):
    """H3 of (2.26), ``tau^2 l'' + 2 tau l' + l = u``, for three signals; starts at zero. ``rates`` are l'.

    The three signals share their coefficients, and one call for all saves overhead.
    """

    __slots__ = ("_accelerations", "_k1", "_k2", "rates", "values")

    def __init__(self, cutoff_hz: float, zero: Number) -> None:
        self._k2 = float((2 * np.pi * cutoff_hz) ** 2)
        self._k1 = float(4 * np.pi * cutoff_hz)
        self.values: tuple[Number, Number, Number] = (zero, zero, zero)
        self.rates: tuple[Number, Number, Number] = (zero, zero, zero)
        self._accelerations: tuple[Number, Number, Number] = (zero, zero, zero)

    def step(self, h: float, ux: Number, uy: Number, uz: Number) -> None:
        """Advance by 2h to a sample with these inputs."""
        k1, k2 = self._k1, self._k2
        weight = 1.0 / (1.0 + h * (k1 + h * k2))
        (x, y, z), (vx, vy, vz), (ax, ay, az) = self.values, self.rates, self._accelerations
        x, y, z = x + h * vx, y + h * vy, z + h * vz
        vx, vy, vz = vx + h * ax, vy + h * ay, vz + h * az
        ax = (k2 * (ux - x - h * vx) - k1 * vx) * weight
        ay = (k2 * (uy - y - h * vy) - k1 * vy) * weight
        az = (k2 * (uz - z - h * vz) - k1 * vz) * weight
        vx, vy, vz = vx + h * ax, vy + h * ay, vz + h * az
        self._accelerations, self.rates = (ax, ay, az), (vx, vy, vz)
        self.values = (x + h * vx, y + h * vy, z + h * vz)
