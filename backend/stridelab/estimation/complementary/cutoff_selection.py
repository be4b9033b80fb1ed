"""Selects cut-off frequencies from the recording's spectra: where each of the inputs errs least (2.5.2, 2.5.3).

The errors of geometry g, doubly integrated force and axis point p are unknown, but their differences are measured. If
the errors are independent, the spectra of the three differences determine all three ("three-cornered hat", Gray & Allan
1974):

    S_g = (S_{g-p} + S_{g-a} - S_{p-a}) / 2,   and cyclically.

The force is compared as a *position*, integrated twice and detrended; as an acceleration, high-frequency noise would
leak into the low lines of 1 / w^4. The cut-offs are those of a grid that minimise the horizontal error of the sum, the
integral of H1^2 S_g + (s^2 H2)^2 S_a + H3^2 S_p.
"""

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import integrate, signal

from stridelab.estimation.complementary.forward_backward import FilterInputs
from stridelab.estimation.complementary.transfer_functions import DigitalFilter, complementary_filters

LOW_HZ: Final = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
HIGH_HZ: Final = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
SEGMENT_S: Final = 2.56

Density = Float[np.ndarray, "lines 2"]


def cutoffs_from_spectra(inputs: FilterInputs, rate_hz: float, order: int = 2) -> tuple[float, float]:
    """f_2 and f_1 in Hz for inputs that are all measured; a cut-off at the edge of the grid is valid."""
    g, a, p = (x[:, :2] for x in (inputs.geometry_m, inputs.acceleration_m_s2, inputs.axis_point_m))
    x = _cumulative_integral(_cumulative_integral(a, rate_hz), rate_hz)
    g_p, g_a, p_a = (_difference_density(d, rate_hz) for d in (g - p, g - x, p - x))
    of_g, of_a, of_p = (np.maximum(s, 0.0) / 2 for s in (g_p + g_a - p_a, g_a + p_a - g_p, g_p + p_a - g_a))
    lines = min(len(g), round(SEGMENT_S * rate_hz))
    f = np.fft.rfftfreq(lines, 1 / rate_hz)[1:]

    def squared_gain(h: DigitalFilter) -> Float[np.ndarray, "lines 1"]:
        """Gain of the mean of a forward and a backward pass, squared."""
        return np.asarray(h.response(f).real[:, None] ** 2)

    def fused_error(cutoffs: tuple[float, float]) -> float:
        h = complementary_filters(*cutoffs, rate_hz, order)
        return float((squared_gain(h.h1) * of_g + squared_gain(h.s2_h2) * of_a + squared_gain(h.h3) * of_p).sum())

    grid = [(low, high) for low in LOW_HZ for high in HIGH_HZ if low < high < rate_hz / 2]
    return min(grid, key=fused_error)


def _cumulative_integral(x: Float[np.ndarray, "n 2"], rate_hz: float) -> Float[np.ndarray, "n 2"]:
    return np.asarray(integrate.cumulative_trapezoid(x, dx=1 / rate_hz, axis=0, initial=0.0))


def _difference_density(difference: Float[np.ndarray, "n 2"], rate_hz: float) -> Density:
    """Welch's spectrum without the line at zero: table errors and the integration leave constants undetermined."""
    n = min(len(difference), round(SEGMENT_S * rate_hz))
    free = signal.detrend(difference, axis=0)
    return np.asarray(signal.welch(free, rate_hz, "hann", nperseg=n, detrend="linear", axis=0)[1][1:])
