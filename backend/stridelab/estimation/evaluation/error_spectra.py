"""Spectra of errors (section 2.5.2, figure 2.6): accuracy of each signal by frequency.

Welch's estimate of the one-sided power spectral density, Hann windows with half overlap. The windows are not detrended,
so that a constant error appears in the lowest line. The integral over all frequencies is the mean square of the
windowed error, so the square root of the integral over a band is an error in metres.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import signal

from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput

SEGMENT_S = 2.56
"""Length of Welch's windows: lines 0.39 Hz apart, which separates f_2 = 0.4 Hz from a constant."""

Density = Float[np.ndarray, "lines 3"]
Lines = Float[np.ndarray, "lines"]


@dataclass(frozen=True)
class ErrorSpectrum:
    """``density`` is the power spectral density per axis, in the error's unit squared per hertz."""

    frequency_hz: Lines
    density: Density

    @property
    def amplitude_density(self) -> Density:
        """Amplitude density: the error's unit per square root of a hertz."""
        return np.asarray(np.sqrt(self.density))

    def band_rms(self, low_hz: float, high_hz: float) -> Float[np.ndarray, "3"]:
        """RMS of the error between two frequencies (the lower one included), per axis, in the error's unit."""
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz < high_hz)
        return np.asarray(np.sqrt(self.density[inside].sum(axis=0) * self.resolution_hz))

    @property
    def resolution_hz(self) -> float:
        """Distance between two lines."""
        return float(self.frequency_hz[1] - self.frequency_hz[0])


def error_spectrum(error: Points, rate_hz: float, segment_s: float = SEGMENT_S) -> ErrorSpectrum:
    """Welch's spectrum of an error sampled at ``rate_hz``; a record shorter than a window is one window.

    Raises ``InvalidInput`` (``spectrum-needs-samples``) for fewer than 8 samples or values that are not finite.
    """
    if len(error) < 8 or not np.isfinite(error).all():
        message = f"A spectrum needs at least 8 samples without gaps; there are {len(error)}."
        raise InvalidInput("spectrum-needs-samples", message, [Fault("error", message)])
    n = min(len(error), round(segment_s * rate_hz))
    f, density = signal.welch(error, fs=rate_hz, window="hann", nperseg=n, detrend=False, axis=0)
    return ErrorSpectrum(np.asarray(f), np.asarray(density))


def crossing_hz(first: ErrorSpectrum, second: ErrorSpectrum, axis: int) -> float:
    """Lowest frequency at which the error of the first signal exceeds that of the second; NaN if it never does.

    Both spectra must have the same lines.
    """
    worse = np.flatnonzero(first.density[:, axis] > second.density[:, axis])
    return float(first.frequency_hz[worse[0]]) if len(worse) else float("nan")
