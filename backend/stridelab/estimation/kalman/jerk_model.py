"""Model of the Kalman filter of section 2.5.3: CoM driven by white jerk, measured by three inputs with white noise.

    x_{k+1} = A_d x_k + B_d w_k,   x = (c, c', c''),   w ~ (0, sigma_jerk^2)                    (2.28)
    y_k     = C_d x_k + mu_k,      y = (geometry, acceleration from the force, axis point)      (2.30)

          | 1  dt  dt^2/2 |         | dt^3/6 |         | 1  0  0 |
    A_d = | 0   1  dt     |   B_d = | dt^2/2 |   C_d = | 0  0  1 |                              (2.29), (2.31)
          | 0   0  1      |         | dt     |         | 1  0  0 |

per axis: the exact discretisation of ``x' = A x + B u`` (2.15), (2.16) over dt with a constant jerk u. The axes share
no noise, so they are three separate filters. The thesis prints A_d without its diagonal and y without the acceleration
(docs/theory/misprints.md).

A row of C_d is used where it is measured: the acceleration where all contact force is measured, the axis point where
the force is large enough for an axis (not in flight). A record is a sequence of *stretches* with constant rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import GRAVITY_M_S2, Points, Vector3
from stridelab.dynamics.wrench import AXIS_THRESHOLD_N
from stridelab.errors import Fault, InvalidInput
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.error_priors import ErrorPriors, SdPerAxis
from stridelab.estimation.kalman.riccati import Square, SteadyModel

Measured = Bool[np.ndarray, "n 3"]
"""Whether each of the three inputs is measured, per sample."""

LENGTH_RANGE_M, FORCE_RANGE_N, SIGMA_JERK_RANGE_M_S3 = (1e-4, 1.0), (0.1, 1000.0), (0.01, 1000.0)
"""Valid standard deviations: beyond them, double precision does not solve the Riccati equation to 0.1 mm."""

C = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""(2.31) for one axis."""
C.flags.writeable = False


@dataclass(frozen=True, kw_only=True)
class InputNoise:
    """Standard deviation per axis of the three inputs, modelled as white: the diagonal of R.

    The defaults are the noise of section 2.5.1 propagated to the inputs for a humanoid of 90 kg: 0.05 pi in every
    joint, 10 N, and 10 Nm at a plate 0.83 m below the CoM.
    """

    geometry_m: SdPerAxis = (0.0137, 0.0126, 0.0053)
    force_n: SdPerAxis = (10.0, 10.0, 10.0)
    axis_m: SdPerAxis = (0.0147, 0.0147, 0.0053)

    def __post_init__(self) -> None:
        require_sd("noise.geometry_m", self.geometry_m, LENGTH_RANGE_M)
        require_sd("noise.force_n", self.force_n, FORCE_RANGE_N)
        require_sd("noise.axis_m", self.axis_m, LENGTH_RANGE_M)

    @classmethod
    def from_priors(
        cls, table_sd_m: SdPerAxis, priors: ErrorPriors, velocity_m_s: Points, mass_kg: float
    ) -> "InputNoise":
        """Noise with the variances of all errors in ``priors``, coloured or constant, treated as white.

        Along the force the axis point repeats the geometry, so each of the two gets half of its information.
        """
        g = np.hypot(table_sd_m, priors.marker_m) * [1.0, 1.0, np.sqrt(2)]
        ahead = walk_frame(velocity_m_s)[0]
        walking, lateral = priors.momentum_rate_nm_kg
        # a moment about one horizontal axis moves the axis point along the other
        moment = np.array([ahead * lateral, [-ahead[1] * walking, ahead[0] * walking, 0.0]])
        axis = np.sqrt((moment**2).sum(axis=0) + (priors.moment_nm / mass_kg) ** 2) / GRAVITY_M_S2
        force = np.hypot(priors.force_n, mass_kg * np.asarray(priors.acceleration_m_s2))
        axis[2] = g[2]
        return cls(
            geometry_m=_sd_triple(np.clip(g, *LENGTH_RANGE_M)),
            force_n=_sd_triple(np.clip(force, *FORCE_RANGE_N)),
            axis_m=_sd_triple(np.clip(axis, *LENGTH_RANGE_M)),
        )

    def variance(self, mass_kg: float) -> Float[np.ndarray, "axes inputs"]:
        """R: one row per axis, one column per input."""
        acceleration = np.asarray(self.force_n) / mass_kg
        return np.column_stack([self.geometry_m, acceleration, self.axis_m]) ** 2


def _sd_triple(sd: Vector3) -> SdPerAxis:
    x, y, z = sd.tolist()
    return (x, y, z)


def require_sd(field: str, values: Sequence[float], allowed: tuple[float, float]) -> None:
    """Raise ``InvalidInput`` naming the field: ``prior-not-positive``, or ``prior-out-of-range`` of ``allowed``."""
    low, high = allowed
    shown = ", ".join(f"{v:g}" for v in values)
    if not all(np.isfinite(v) and v > 0 for v in values):
        message = f"A standard deviation must be a number above zero; {field} is {shown}."
        raise InvalidInput("prior-not-positive", message, [Fault(field, shown)])
    if not all(low <= v <= high for v in values):
        message = f"{field} must lie between {low:g} and {high:g}; it is {shown}."
        raise InvalidInput("prior-out-of-range", message, [Fault(field, shown)])


@dataclass(frozen=True)
class Stretch:
    """Samples ``first`` to ``stop`` (exclusive), at which the rows of C_d in ``rows`` are measured."""

    first: int
    stop: int
    rows: tuple[int, ...]


@dataclass(frozen=True)
class JerkModel:
    """A_d and B_d for one time step; ``printed`` omits the diagonal of A_d, as printed in (2.29)."""

    dt_s: float
    sigma_jerk_m_s3: float
    printed: bool = False

    @property
    def A(self) -> Square:
        """A_d (2.29): position, velocity and acceleration after a step without jerk."""
        dt = self.dt_s
        rise = np.array([[0.0, dt, dt**2 / 2], [0.0, 0.0, dt], [0.0, 0.0, 0.0]])
        return rise if self.printed else np.eye(3) + rise

    @property
    def B(self) -> Float[np.ndarray, "3 1"]:
        """B_d (2.29): effect of a jerk of 1 m/s^3, constant over the step."""
        dt = self.dt_s
        return np.array([[dt**3 / 6], [dt**2 / 2], [dt]])


@lru_cache(maxsize=64)
def forward_model(model: JerkModel, variance: tuple[float, ...], rows: tuple[int, ...]) -> SteadyModel:
    """Model (2.28)-(2.31) with only these rows measured; ``variance`` is the axis' diagonal of R."""
    r = np.array(variance)[list(rows)]
    W = model.B @ model.B.T * model.sigma_jerk_m_s3**2
    return SteadyModel(F=model.A, H=C[list(rows)], W=W, R=np.diag(r))


@lru_cache(maxsize=64)
def backward_model(model: JerkModel, variance: tuple[float, ...], rows: tuple[int, ...]) -> SteadyModel:
    """Dual model, whose predictions are the information from the *later* measurements.

    Their information matrix J about x_k, including measurement k, obeys

        J_k = A' (J_{k+1}^-1 + sigma^2 B B')^-1 A + C' R^-1 C,

    the Riccati recursion of the model with A', B' and C' in place of A, C and B.
    """
    c, r = C[list(rows)], np.array(variance)[list(rows)]
    return SteadyModel(F=model.A.T, H=model.B.T, W=c.T / r @ c, R=np.array([[model.sigma_jerk_m_s3**-2]]))


def measured_inputs(n: int, window: slice, force_n: Float[np.ndarray, "window 3"]) -> Measured:
    """Geometry at all n samples, acceleration in the window, axis point where the force there is above 100 N."""
    measured = np.zeros((n, 3), dtype=np.bool_)
    measured[:, 0] = True
    measured[window, 1] = True
    measured[window, 2] = np.linalg.norm(force_n, axis=1) > AXIS_THRESHOLD_N
    return measured


def split_stretches(measured: Measured) -> list[Stretch]:
    """Split the record where the measured rows change."""
    cuts = 1 + np.flatnonzero((np.diff(measured, axis=0) != 0).any(axis=1))
    edges = [0, *cuts.tolist(), len(measured)]
    return [Stretch(a, b, tuple(np.flatnonzero(measured[a]).tolist())) for a, b in pairwise(edges)]
