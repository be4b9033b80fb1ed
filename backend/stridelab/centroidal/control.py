"""The control u of (4.8) as data: what acts on the body in a phase, and the cone that constrains it.

The contact wrench is a linear image of variables in standard cones, phase by phase and group by group,

    (F, T) = sum over groups of G u,      u >= 0            rays of pyramids             (``lorentz`` = 0)
                                      or  u = (tau, eta) one after the other, |tau| <= eta,  tau of ``lorentz`` entries

so that one transcription serves u_f (4.4) and u_c (4.5) alike; only G and the cones differ.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Rotation


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """An effector's contact in a phase: its points ``(k, 3)`` and frame in world axes, relative to a given origin.

    ``kind`` is ``surface`` for soles and ``point`` for hands; ``force_weight`` weighs ``|f / (m g)|^2`` of its points
    per second.
    """

    effector: str
    kind: Literal["surface", "point"]
    points_m: Points
    rotation: Rotation
    friction: float
    force_weight: float


@dataclass(frozen=True, eq=False)
class Generators:
    """A group of ``m`` variables u: ``wrench`` is G, in units of m |g| and m |g| times a metre about the origin.

    ``lorentz``: 0, or the entries of tau in each block ``(tau, eta)``. ``regulariser`` Q puts ``v^T Q v / 2`` per
    second into the cost for each consecutive block v of ``len(Q)`` variables; zeros: none. ``rest`` is the u that
    carries a share of the weight, used as the solver's initial guess; ``normal @ v`` is a point's normal force.
    """

    wrench: Float[np.ndarray, "6 m"]
    lorentz: int
    regulariser: Float[np.ndarray, "j j"]
    rest: Float[np.ndarray, "m"]
    normal: Float[np.ndarray, "j"] | None


Values = Mapping[str, Float[np.ndarray, "n m"]]
"""Variables of the groups of a phase in its ``n`` intervals."""
Forces = Mapping[str, Float[np.ndarray, "n points 3"]]
"""World-frame forces on the points of every effector that touches, in the same intervals and in units of m |g|."""


class Control(ABC):
    """A parametrisation of u; equal and hashable by its settings.

    ``shifts_with_its_contacts``: whether a contact that moves without turning keeps its cones and its forces;
    ``has_point_forces``: whether u contains point forces, which can then be bounded.
    """

    shifts_with_its_contacts: ClassVar[bool]
    has_point_forces: ClassVar[bool]

    @abstractmethod
    def generators(self, patches: tuple[ContactPatch, ...]) -> Mapping[str, Generators]:
        """The groups of a phase by name."""

    def gauge(self, patches: tuple[ContactPatch, ...], wrenches: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
        """Gauge of wrenches ``(F, T)`` in the cone of the control: up to 1 they are inside.

        Zero where the control can express every wrench of the contacts.
        """
        return np.zeros(len(wrenches))

    @abstractmethod
    def point_forces(self, patches: tuple[ContactPatch, ...], values: Values) -> Forces:
        """World-frame point forces from the variables of the groups of a phase."""
