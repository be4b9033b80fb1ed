"""Priors of the smoother: sizes of the input errors, as standard deviations."""

from dataclasses import asdict, dataclass

import numpy as np

from stridelab.errors import Fault, InvalidInput

MAY_BE_ZERO = frozenset(
    {"marker_corner_hz", "plate_corner_hz", "plate_force_n", "plate_moment_nm", "clock_s", "mass_share"}
)


@dataclass(frozen=True, kw_only=True)
class SmootherPriors:
    """Standard deviations unless noted otherwise; the table's constant error is in ``GeometricCom.sd_m``.

    Noise of the sensors: ``marker_m`` of the geometric CoM, ``force_n`` and ``moment_nm`` per axis. A ``corner_hz`` of
    0 is white noise; above 0 the noise is high-passed there (first order), which assumes small slow errors.

    Constant errors of the plates, declared by the user: ``plate_force_n`` of the total force, acting at the floor, and
    ``plate_moment_nm`` about the plate. ``mass_share`` is the relative error of the mass, ``clock_s`` the residual
    latency between force and markers.

    ``table_varying_m`` is the posture-dependent part of the table's error, with correlation time ``table_varying_s``.
    ``momentum_m_s`` is the angular momentum about the walking axis and the lateral axis divided by the weight,
    L / (m g); None uses that of an adult of this height. It is modelled as a resonator of damping ratio ``damping`` at
    half the step frequency and at ``step_hz`` (None: estimated from the vertical motion), with overtones whose L is
    ``overtone_share`` of it. ``acceleration_beyond_m_s2`` with correlation time ``acceleration_beyond_s`` is the
    acceleration of the body where no force is measured.
    """

    marker_m: float = 0.001
    marker_corner_hz: float = 0.0
    force_n: float = 5.0
    moment_nm: float = 3.0
    plate_corner_hz: float = 0.0
    plate_force_n: float = 1.0
    plate_moment_nm: float = 1.0
    mass_share: float = 0.01
    clock_s: float = 0.005
    table_varying_m: float = 0.001
    table_varying_s: float = 0.3
    momentum_m_s: tuple[float, float] | None = None
    overtone_share: float = 0.25
    damping: float = 0.08
    step_hz: float | None = None
    acceleration_beyond_m_s2: float = 2.5
    acceleration_beyond_s: float = 0.15

    def __post_init__(self) -> None:
        """Raise ``InvalidInput`` (``prior-out-of-range``) for an invalid standard deviation."""
        faults = []
        for name, value in asdict(self).items():
            numbers = np.atleast_1d(np.asarray([] if value is None else value, dtype=float))
            least = 0.0 if name in MAY_BE_ZERO else np.nextafter(0.0, 1.0)
            if not (np.isfinite(numbers).all() and (numbers >= least).all()):
                faults.append(Fault(f"priors.{name}", f"{value} is not a valid standard deviation"))
        if not self.damping < 1.0:
            faults.append(Fault("priors.damping", "a damping ratio of 1 or more does not oscillate"))
        if faults:
            raise InvalidInput(
                "prior-out-of-range",
                "The stated error of an input must be a positive number: " + ", ".join(f.where for f in faults) + ".",
                faults,
            )
