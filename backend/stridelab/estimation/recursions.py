"""Scalar recursions of the online filters: the trapezoidal rule, whose first half is explicit and second half implicit.

For ``X' = F(X, u)`` a step of length 2h is ``X_1 = X_0 + h F(X_0, u_0) + h F(X_1, u_1)``. On linear systems this is the
bilinear rule of ``filters``, but every step may have its own length and gains. One axis each and plain floats: at this
size an array costs more than its arithmetic.
"""

from typing import Generic, TypeVar

import numpy as np

Number = TypeVar("Number", float, complex)


class Observer:
    """Position and velocity, ``x' = v + k_1 (g - x)``, ``v' = a + k_2 (g - x)``, from acceleration and position."""

    __slots__ = ("_v_rate", "_x_rate", "v", "x")

    def __init__(self) -> None:
        self.x = self.v = self._x_rate = self._v_rate = 0.0

    def begin(self, x: float, v: float, a: float) -> None:
        """Be at ``x`` with velocity ``v``, whatever came before."""
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
    """``tau^2 l'' + 2 tau l' + l = u``, which is H3 of (2.26), of three signals; starts at zero. ``rates`` are l'.

    Three at a time, because they share their coefficients and a call costs as much as the arithmetic.
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
