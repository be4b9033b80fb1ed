"""Measurement noise (section 2.5.1 of the thesis): noisy plates and markers, and errors of the body model.

``MeasurementNoise`` is the noise of simulated recordings. Force, moment and configuration noise is Gaussian and
coloured: white noise through a high-pass of 5 Hz (second-order Butterworth), scaled to the given standard deviation.
The thesis adds 10 N and 10 Nm to the wrench without stating the reference point; here every plate has its own noise,
with the moment about the middle of its surface, because about the laboratory's origin, metres away, 10 N of force noise
alone produce more than 10 Nm. The configuration noise replaces soft tissue motion; over 34 joints it averages out in
the centre of mass.

``NoisePreset`` is the noise of the simulation study. Configuration, force and moment noise is Gaussian, either white or
high-passed (Butterworth). Noise and bias of force and moment are those of a plate, given at the middle of the loaded
sole (between the soles during load transfer) and transformed to the origin,

    nu += n_moment + p x n_force .

The error of the body model is drawn once per seed: mass and lever of every link have the relative error ``mass_model``
(one sigma). The bias of a plate is constant, drawn once per seed and axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy.random import Generator
from scipy.signal import butter, sosfilt

from stridelab.body.segment_tables import SegmentRow, SegmentTable, parse_table
from stridelab.errors import Fault, InvalidInput

HIGH_PASS_HZ: Final = 5.0
_SETTLING: Final = 400
_MIN_FACTOR: Final = 0.05
"""Minimum factor on the mass of a segment."""

_LIMITS: Final[Mapping[str, tuple[float, float]]] = {
    "force_n": (0.0, 200.0),
    "moment_nm": (0.0, 100.0),
    "configuration_rad": (0.0, 0.3),
    "marker_m": (0.0, 0.05),
    "mass_model": (0.0, 0.5),
    "latency_s": (-0.05, 0.05),
}


@dataclass(frozen=True)
class MeasurementNoise:
    """Standard deviations of the noise; 0 disables a part. ``latency_s`` > 0: the force is recorded late.

    ``mass_model`` is the relative error of each segment's mass and of the position of its centre of mass in the
    *recorded* segment table; the body keeps its true masses. Raises ``InvalidInput`` (``noise-out-of-range``)
    outside the limits of the HTTP contract.
    """

    force_n: float = 2.0
    moment_nm: float = 1.0
    configuration_rad: float = 0.0
    marker_m: float = 0.0005
    mass_model: float = 0.0
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if not low <= value <= high:
                message = f"{name} must lie between {low:g} and {high:g}, not {value:g}."
                raise InvalidInput("noise-out-of-range", message, [Fault(name, message)])


NOISE_FREE: Final = MeasurementNoise(force_n=0.0, moment_nm=0.0, marker_m=0.0)
THESIS: Final = MeasurementNoise(
    force_n=10.0, moment_nm=10.0, configuration_rad=0.05 * np.pi, marker_m=0.0, mass_model=0.2
)
"""The noise of section 2.5.1."""


def coloured_noise(
    rng: Generator,
    n: int,
    channels: int,
    sigma: float,
    rate_hz: float,
    high_pass_hz: float = HIGH_PASS_HZ,
    order: int = 2,
) -> Float[np.ndarray, "n channels"]:
    """Noise above ``high_pass_hz`` (0: white) with exactly the standard deviation ``sigma`` in every channel."""
    noise = rng.standard_normal((n + _SETTLING, channels))
    if high_pass_hz > 0.0:
        noise = sosfilt(butter(order, high_pass_hz, "highpass", fs=rate_hz, output="sos"), noise, axis=0)
    noise = noise[_SETTLING:]
    return np.asarray(sigma * noise / noise.std(axis=0, keepdims=True))


def perturb_table(table: SegmentTable, error: float, rng: Generator) -> SegmentTable:
    """``table`` with relative errors (one sigma ``error``) of masses and centres of mass."""
    rows: dict[str, SegmentRow] = {}
    for name, row in table.segments.items():
        mass = row.mass_fraction * max(1.0 + error * rng.standard_normal(), _MIN_FACTOR)
        x, y, z = (float(k * (1.0 + error * rng.standard_normal())) for k in row.com)
        rows[name] = SegmentRow(float(mass), (x, y, z))
    total = sum(row.mass_fraction for row in rows.values())
    segments = {name: {"mass_fraction": row.mass_fraction / total, "com": row.com} for name, row in rows.items()}
    return parse_table({"name": table.name, "segments": segments, "sd_m": table.sd_m, "references": table.references})


@dataclass(frozen=True, kw_only=True)
class NoisePreset:
    """Standard deviations; 0 disables a part. ``high_pass_hz`` 0 is white noise; ``latency_s`` > 0 a delayed force.

    ``plate_bias_n`` and ``plate_bias_nm`` are the standard deviations of the bias per axis. Raises ``InvalidInput``
    (``noise-out-of-range``) for a negative number (except the latency) or a non-finite one.
    """

    configuration_rad: float = 0.0
    force_n: float = 0.0
    moment_nm: float = 0.0
    high_pass_hz: float = 0.0
    high_pass_order: int = 2
    mass_model: float = 0.0
    plate_bias_n: float = 0.0
    plate_bias_nm: float = 0.0
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not np.isfinite(value) or (value < 0.0 and field.name != "latency_s"):
                message = f"{field.name} must be finite and not negative, not {value:g}."
                raise InvalidInput("noise-out-of-range", message, [Fault(field.name, message)])


PRESETS: Final[Mapping[str, NoisePreset]] = {
    "thesis": NoisePreset(
        configuration_rad=0.05 * np.pi, force_n=10.0, moment_nm=10.0, high_pass_hz=5.0, mass_model=0.2
    ),
    "white": NoisePreset(configuration_rad=0.05 * np.pi, force_n=10.0, moment_nm=10.0, mass_model=0.2),
    "marker-like": NoisePreset(configuration_rad=0.01, force_n=5.0, moment_nm=5.0, mass_model=0.2),
    "none": NoisePreset(),
}
"""``thesis``: section 2.5.1. ``white``: its levels, white. ``marker-like``: typical of markers and plates (white)."""
