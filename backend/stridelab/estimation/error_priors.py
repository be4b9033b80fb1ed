"""What can be wrong with the inputs of an estimator, as standard deviations that the user states."""

from dataclasses import dataclass

SdPerAxis = tuple[float, float, float]
"""One standard deviation each for x, y and z."""


@dataclass(frozen=True, kw_only=True)
class ErrorPriors:
    """Standard deviations of what can be wrong with the inputs; the table's own is in ``GeometricCom.sd_m``.

    ``marker_m``: white noise of the CoM from marker noise. ``force_n``: white noise per axis. ``acceleration_m_s2``:
    constant error per axis (0.15 m/s^2 vertically is 1.5 % of body weight). ``moment_nm``: constant error of each
    horizontal moment at the body. ``momentum_rate_nm_kg``: RMS of L' per kilogram of body mass, about the walking axis
    (at ``step_hz`` / 2) and the lateral axis (at ``step_hz``). ``clock_s``: rest of the latency between force and
    markers after whatever was applied.
    """

    marker_m: float = 0.001
    force_n: float = 5.0
    acceleration_m_s2: SdPerAxis = (0.05, 0.05, 0.15)
    moment_nm: float = 2.0
    momentum_rate_nm_kg: tuple[float, float] = (0.12, 0.33)
    step_hz: float = 1.8
    clock_s: float = 0.005
