"""Interface of all CoM estimators: parameters in the constructor, one method, an immutable result.

An estimator is a frozen dataclass with keyword-only parameters, a class attribute ``name`` and one method::

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, runtime_checkable

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Series
from stridelab.recordings.recording import Remark, Window, WrenchTrack


@dataclass(frozen=True)
class ComEstimate:
    """CoM, velocity and acceleration over one window, with a standard deviation per axis of the position.

    ``references`` are citation keys of the methods used; ``diagnostics`` are scalars for display.
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


@runtime_checkable
class ComEstimator(Protocol):
    """Protocol of the offline estimators."""

    name: ClassVar[str]

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Fuse the three inputs of section 2.4.1 over the first (or longest) window.

        Raises ``NotEstimable`` if the window or the geometry does not allow it.
        """
        ...
