"""Interface of all CoM estimators: parameters in the constructor, one method, an immutable result.

An estimator is a frozen dataclass with keyword-only parameters, a class attribute ``name`` and one method::

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Rotation, Series
from stridelab.recordings.recording import Remark, Window, WrenchTrack


@dataclass(frozen=True)
class StateCovariance:
    """Covariance of position and velocity per axis and sample; the axes are the rows of ``frame``, uncorrelated.

    Entries in m^2, m^2/s and m^2/s^2. That of the smoother follows from the sizes by which it weighs its inputs;
    ``ComEstimate.sd_m`` is that of the errors to be expected, mostly smaller.
    """

    frame: Rotation
    matrices: Float[np.ndarray, "n 3 2 2"]


@dataclass(frozen=True)
class ComEstimate:
    """CoM, velocity and acceleration over one window, with a standard deviation per axis of the position.

    ``references`` are citation keys of the methods used; ``diagnostics`` are scalars for display. ``state_covariance``
    is None for the estimators that do not compute the error of the velocity.
    """

    method: str
    time_s: Series
    com_m: Points
    velocity_m_s: Points
    acceleration_m_s2: Points
    sd_m: Points
    window: Window
    references: tuple[str, ...]
    remarks: tuple[Remark, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    state_covariance: StateCovariance | None = None


@runtime_checkable
class ComEstimator(Protocol):
    """Protocol of the offline estimators."""

    name: ClassVar[str]

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Fuse the three inputs of section 2.4.1 over the first (or longest) window.

        Raises ``NotEstimable`` if the window or the geometry does not allow it.
        """
        ...
