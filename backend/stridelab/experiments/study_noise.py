"""Noise of the simulation study (section 2.5.1) and its presets.

Configuration, force and moment noise is Gaussian, either white or high-passed (Butterworth). The thesis
does not say about which point its 10 Nm are meant. Here plates measure: noise and bias of force and moment are those of
a plate, given at the middle of the loaded sole (between the soles while the load passes), and carried to the origin

    nu += n_moment + p x n_force .

The error of the body model is drawn once per seed: every link's mass and lever are wrong by ``mass_model`` (one sigma).
A plate's bias is a constant, drawn once per seed and axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from stridelab.errors import Fault, InvalidInput


@dataclass(frozen=True, kw_only=True)
class NoisePreset:
    """Standard deviations; 0 switches a part off. ``high_pass_hz`` 0 is white noise; ``latency_s`` > 0 a late force.

    ``plate_bias_n`` and ``plate_bias_nm`` are the standard deviations of the bias per axis. Raises ``InvalidInput``
    (``noise-out-of-range``) for a number that is negative (but a latency) or not finite.
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
                message = f"{field.name} must not be negative, nor {value:g}."
                raise InvalidInput("noise-out-of-range", message, [Fault(field.name, message)])


PRESETS: Final[Mapping[str, NoisePreset]] = {
    "thesis": NoisePreset(
        configuration_rad=0.05 * np.pi, force_n=10.0, moment_nm=10.0, high_pass_hz=5.0, mass_model=0.2
    ),
    "white": NoisePreset(configuration_rad=0.05 * np.pi, force_n=10.0, moment_nm=10.0, mass_model=0.2),
    "marker-like": NoisePreset(configuration_rad=0.01, force_n=5.0, moment_nm=5.0, mass_model=0.2),
    "none": NoisePreset(),
}
"""``thesis``: section 2.5.1. ``white``: its levels, white. ``marker-like``: what markers and plates do (white)."""
