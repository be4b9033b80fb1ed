"""The three filters of the complementary filter (2.24)-(2.27), and their discrete versions.

The cut-off frequencies are f_2 of the central axis (low) and f_1 of the force (high), in Hz. With
``tau_i = 1 / (2 pi f_i)``:

    s^2 H2 = (s tau_1)^2 / (1 + s tau_1)^2          high-pass: band of the force                (2.24)
    H2     = tau_1^2 / (1 + s tau_1)^2              applied to the acceleration                 (2.25)
    H3     = 1 / (1 + s tau_2)^2                    low-pass: band of the central axis          (2.26)
    H1     = 1 - s^2 H2 - H3                        band of the geometry                        (2.27)

These have skirts of first order: far outside its band H1 falls with the first power of the frequency. The split of
third order, with ``H3 = (1 + 3 s tau_2) / (1 + s tau_2)^3`` and the same in tau_1, has skirts of second order:

    s^2 H2 = 1 - (1 + 3 s tau_1) / (1 + s tau_1)^3 = (s tau_1)^2 (3 + s tau_1) / (1 + s tau_1)^3 .

All are discretised by the bilinear rule ``s = 2 f_s (1 - z^-1) / (1 + z^-1)``. As a substitution it preserves
identities between the filters: the discrete sum is one at every frequency, and -6 dB stays -6 dB (at the cutoff up to
frequency warping). Figures are in ``docs/theory/complementary-filter.md``.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Complex, Float, Inexact
from scipy import signal

from stridelab.conventions import Series
from stridelab.errors import Fault, InvalidInput

THESIS_LOW_HZ: Final = 0.4
THESIS_HIGH_HZ: Final = 4.0
AUTO_LOW_HZ: Final = 0.2
AUTO_HIGH_HZ: Final = 1.0
"""Default cut-offs for windows of one or two steps (docs/theory/complementary-filter.md)."""


def require_cutoffs(low_hz: float, high_hz: float, rate_hz: float) -> None:
    """Raise ``InvalidInput`` (``cutoffs-out-of-range``) unless 0 < low < high < half the rate."""
    if not 0 < low_hz < high_hz < rate_hz / 2:
        raise InvalidInput(
            "cutoffs-out-of-range",
            f"Cutoffs of {low_hz:g} and {high_hz:g} Hz do not fit a rate of {rate_hz:g} Hz: "
            "0 < low < high < half the rate is needed.",
            [Fault("cutoffs", f"{low_hz:g} and {high_hz:g} Hz")],
        )


ORDERS = (2, 3)

Taps = Float[np.ndarray, "_"]
Response = Complex[np.ndarray, "n"]
Roots = Inexact[np.ndarray, "_"]


@dataclass(frozen=True)
class DigitalFilter:
    """Rational transfer function in z, by its gain, zeros and poles."""

    gain: float
    zeros: Roots
    poles: Roots
    rate_hz: float

    @property
    def b(self) -> Taps:
        """Numerator in powers of 1/z."""
        return np.atleast_1d(self.gain * np.poly(self.zeros)).real

    @property
    def a(self) -> Taps:
        """Denominator in powers of 1/z."""
        return np.atleast_1d(np.poly(self.poles)).real

    def response(self, frequency_hz: Series) -> Response:
        """Complex gain at each frequency, factor by factor: near double poles the expanded form loses digits."""
        z = np.exp(2j * np.pi * frequency_hz / self.rate_hz)[:, None]
        return np.asarray(self.gain * np.prod(z - self.zeros, axis=1) / np.prod(z - self.poles, axis=1))


@dataclass(frozen=True)
class ComplementaryFilters:
    """H1, H2, s^2 H2 and H3 at one rate; ``s2_h2`` is one filter because it acts on positions."""

    h1: DigitalFilter
    h2: DigitalFilter
    s2_h2: DigitalFilter
    h3: DigitalFilter


def complementary_filters(low_hz: float, high_hz: float, rate_hz: float, order: int = 2) -> ComplementaryFilters:
    """Discrete filters (2.24)-(2.27) for the cutoffs f_2 = ``low_hz`` and f_1 = ``high_hz``, of order 2 or 3.

    H1 is built from (2.27) over a common denominator instead of by subtraction:
    ``H1 = s (2 tau_1 tau_2^2 s^2 + (tau_2^2 + 4 tau_1 tau_2 - tau_1^2) s + 2 tau_2) / ((1 + s tau_1)(1 + s tau_2))^2``.
    Raises ``InvalidInput`` (``cutoffs-out-of-range``) unless 0 < low < high < half the rate, and
    ``order-out-of-range``.
    """
    require_cutoffs(low_hz, high_hz, rate_hz)
    if order not in ORDERS:
        message = f"The complementary filter has order 2 (as in the thesis) or 3, not {order}."
        raise InvalidInput("order-out-of-range", message, [Fault("order", message)])
    tau_1, tau_2 = 1 / (2 * np.pi * high_hz), 1 / (2 * np.pi * low_hz)
    return _second_order(tau_1, tau_2, rate_hz) if order == 2 else _third_order(tau_1, tau_2, rate_hz)


def _second_order(tau_1: float, tau_2: float, rate_hz: float) -> ComplementaryFilters:
    p_1, p_2 = -1 / tau_1, -1 / tau_2
    bracket = np.array([2 * tau_1 * tau_2**2, tau_2**2 + 4 * tau_1 * tau_2 - tau_1**2, 2 * tau_2])
    none, twice_1, twice_2 = np.zeros(0), np.array([p_1, p_1]), np.array([p_2, p_2])
    h1_zeros = np.append(np.roots(bracket), 0.0)
    return ComplementaryFilters(
        h1=_bilinear_filter(float(bracket[0]) * (p_1 * p_2) ** 2, h1_zeros, np.append(twice_1, twice_2), rate_hz),
        h2=_bilinear_filter(1.0, none, twice_1, rate_hz),
        s2_h2=_bilinear_filter(1.0, np.zeros(2), twice_1, rate_hz),
        h3=_bilinear_filter(p_2**2, none, twice_2, rate_hz),
    )


def _third_order(tau_1: float, tau_2: float, rate_hz: float) -> ComplementaryFilters:
    """Filters of order 3; the numerator of H1 over the common denominator has no powers of s below the second."""
    bracket = np.array(
        [
            3 * tau_1 * tau_2 * (tau_2**2 - tau_1**2),
            tau_2**3 - tau_1**3 + 9 * tau_1 * tau_2 * (tau_2 - tau_1),
            3 * (tau_2**2 - tau_1**2),
        ]
    )
    thrice_1, thrice_2 = np.full(3, -1 / tau_1), np.full(3, -1 / tau_2)
    h1_zeros = np.append(np.roots(bracket), np.zeros(2))
    corner = np.array([-3 / tau_1])
    return ComplementaryFilters(
        h1=_bilinear_filter(float(bracket[0]) / (tau_1 * tau_2) ** 3, h1_zeros, np.append(thrice_1, thrice_2), rate_hz),
        h2=_bilinear_filter(1.0, corner, thrice_1, rate_hz),
        s2_h2=_bilinear_filter(1.0, np.append(corner, np.zeros(2)), thrice_1, rate_hz),
        h3=_bilinear_filter(3 / tau_2**2, np.array([-1 / (3 * tau_2)]), thrice_2, rate_hz),
    )


def _bilinear_filter(gain: float, zeros: Roots, poles: Roots, rate_hz: float) -> DigitalFilter:
    z, p, k = signal.bilinear_zpk(zeros, poles, gain, rate_hz)
    return DigitalFilter(gain=float(k), zeros=np.asarray(z), poles=np.asarray(p), rate_hz=rate_hz)
