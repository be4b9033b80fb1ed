"""u_f: the forces of the contact points as control (4.4), in pyramids or in the circular cones themselves.

With f = S u at every point p of a contact, R its axes,

    pyramids          S = R V(mu)                u = lambda >= 0
    circular cones    S = R diag(mu, mu, 1)      u = (f_t / mu, f_n),  |f_t| / mu <= f_n

and the wrench of the contact is the sum of (S u, p x S u).

The pyramids approximate the friction cone ``mu f_z >= |f_xy|`` from inside by rays on its surface:

    f = V lambda,   lambda >= 0,   V = [ mu cos a_j, mu sin a_j, 1 ],   a_j = 2 pi (j + 1/2) / n

spans the largest n-sided pyramid in the cone, for even n with faces along the contact's axes. Every such force
satisfies the exact cone; in the solver the cone becomes a set of bounds, without any inequality row. The pyramid
covers the share (n / 2 pi) sin(2 pi / n) of the circle: 0.64 for four rays, 0.90 for eight, 0.95 for twelve.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.contact_wrench import skew
from stridelab.centroidal.control import ContactPatch, Control, Forces, Generators, Values
from stridelab.errors import InvalidInput

N_RAYS_MIN: Final = 8


class _PointForces(Control):
    """Point forces ``f = S u``; subclasses define ``S`` and its cone."""

    shifts_with_its_contacts: ClassVar[bool] = True
    has_point_forces: ClassVar[bool] = True
    lorentz: ClassVar[int]

    @abstractmethod
    def S(self, patch: ContactPatch) -> Float[np.ndarray, "3 j"]:
        """The force of one point per unit of its variables."""

    @abstractmethod
    def unit_normal_variables(self) -> Float[np.ndarray, "j"]:
        """Variables of a unit force along the normal."""

    def generators(self, patches: tuple[ContactPatch, ...]) -> Mapping[str, Generators]:
        """One group per effector in contact, with the variables of its points concatenated."""
        n_points = sum(len(patch.points_m) for patch in patches)
        groups: dict[str, Generators] = {}
        for patch in patches:
            S, k = self.S(patch), len(patch.points_m)
            groups[patch.effector] = Generators(
                wrench=np.hstack([np.vstack([S, skew(p) @ S]) for p in patch.points_m]),
                lorentz=self.lorentz,
                regulariser=2.0 * patch.force_weight * S.T @ S,
                rest=np.tile(self.unit_normal_variables(), k) / n_points,
                normal=patch.rotation[:, 2] @ S,
            )
        return groups

    def point_forces(self, patches: tuple[ContactPatch, ...], values: Values) -> Forces:
        """``f = S u``."""
        forces: dict[str, Float[np.ndarray, "n points 3"]] = {}
        for patch in patches:
            u = values[patch.effector]
            forces[patch.effector] = u.reshape(len(u), len(patch.points_m), -1) @ self.S(patch).T
        return forces


@dataclass(frozen=True)
class Pyramids(_PointForces):
    """Forces in pyramids of ``n_rays`` inscribed rays, bounds only.

    Raises ``InvalidInput`` (``rays-too-few``) below eight, which cover 0.90 of the circle.
    """

    n_rays: int = N_RAYS_MIN
    lorentz: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if self.n_rays < N_RAYS_MIN:
            raise InvalidInput("rays-too-few", f"A pyramid needs at least {N_RAYS_MIN} rays, not {self.n_rays}.")

    def S(self, patch: ContactPatch) -> Float[np.ndarray, "3 j"]:
        """The rays in the world, each with a normal component of 1."""
        return np.asarray(patch.rotation @ pyramid_rays(patch.friction, self.n_rays))

    def unit_normal_variables(self) -> Float[np.ndarray, "j"]:
        """Equal share of every ray."""
        return np.full(self.n_rays, 1.0 / self.n_rays)


@dataclass(frozen=True)
class CircularCones(_PointForces):
    """Forces in the exact circular cones: three variables and one row per point."""

    lorentz: ClassVar[int] = 2

    def S(self, patch: ContactPatch) -> Float[np.ndarray, "3 j"]:
        """Contact axes in the world, tangential ones scaled by friction, so that the cone is |u_xy| <= u_z."""
        return np.asarray(patch.rotation * np.array([patch.friction, patch.friction, 1.0]))

    def unit_normal_variables(self) -> Float[np.ndarray, "j"]:
        """The normal component only."""
        return np.array([0.0, 0.0, 1.0])


PYRAMIDS: Final = Pyramids()
"""The default control."""


def pyramid_rays(friction: float, n: int) -> Float[np.ndarray, "3 n"]:
    """``V`` in the contact frame, one ray per column, normal component 1."""
    a = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    return np.stack([friction * np.cos(a), friction * np.sin(a), np.ones(n)])
