"""Prior errors of the inputs of an estimator, as standard deviations given by the user."""

from dataclasses import asdict, dataclass
from typing import Final

import numpy as np

from stridelab.errors import Fault, InvalidInput

NEVER_ZERO: Final = frozenset({"marker_m", "force_n", "step_hz"})
"""Fields that must be positive: every sensor has noise; the other errors may be zero."""

SdPerAxis = tuple[float, float, float]
"""One standard deviation each for x, y and z."""


@dataclass(frozen=True, kw_only=True)
class ErrorPriors:
    """Standard deviations of the input errors; that of the segment table is in ``GeometricCom.sd_m``.

    ``marker_m``: white noise of the CoM from marker noise. ``force_n``: white noise per axis. ``acceleration_m_s2``:
    constant error per axis (0.15 m/s^2 vertically is 1.5 % of body weight). ``moment_nm``: constant error of each
    horizontal moment at the body. ``momentum_rate_nm_kg``: RMS of L' per kilogram of body mass, about the walking axis
    (at ``step_hz`` / 2) and the lateral axis (at ``step_hz``). ``clock_s``: residual latency between force and markers
    after correction. Raises ``InvalidInput`` (``prior-out-of-range``) naming the fields with invalid values.
    """

    marker_m: float = 0.001
    force_n: float = 5.0
    acceleration_m_s2: SdPerAxis = (0.05, 0.05, 0.15)
    moment_nm: float = 2.0
    momentum_rate_nm_kg: tuple[float, float] = (0.12, 0.33)
    step_hz: float = 1.8
    clock_s: float = 0.005

    def __post_init__(self) -> None:
        """Raise unless every value is a valid standard deviation."""
        faults = []
        for name, value in asdict(self).items():
            numbers = np.atleast_1d(np.asarray(value, dtype=float))
            possible = np.isfinite(numbers) & (numbers > 0.0 if name in NEVER_ZERO else numbers >= 0.0)
            if not possible.all():
                faults.append(Fault(f"priors.{name}", f"{value} is not a valid standard deviation"))
        if faults:
            raise InvalidInput(
                "prior-out-of-range",
                "The stated error of an input must be a positive number: " + ", ".join(f.where for f in faults) + ".",
                faults,
            )
