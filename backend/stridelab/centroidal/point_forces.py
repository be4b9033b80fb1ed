"""u_f: the forces of the contact points as control (4.4), in pyramids or in the circular cones themselves.

With f = S u at every point p of a contact, R its axes,

    pyramids          S = R V(mu)                u = lambda >= 0
    circular cones    S = R diag(mu, mu, 1)      u = (f_t / mu, f_n),  |f_t| / mu <= f_n

and the wrench of the contact is the sum of (S u, p x S u).

The friction cone ``mu f_z >= |f_xy|`` from inside: forces as sums of rays that lie on it.

    f = V lambda,   lambda >= 0,   V = [ mu cos a_j, mu sin a_j, 1 ],   a_j = 2 pi (j + 1/2) / n

spans the largest n-sided pyramid in the cone, for even n with faces along the contact's axes. Every such force
satisfies the exact cone; in the solver the cone becomes a set of bounds, without a single inequality row. The pyramid
holds the share (n / 2 pi) sin(2 pi / n) of the circle: 0.64 for four rays, 0.90 for eight, 0.95 for twelve.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.control import Control, Forces, Generators, Touch, Values
from stridelab.centroidal.dynamics import skew
from stridelab.errors import InvalidInput

N_RAYS_MIN: Final = 8


class _PointForces(Control):
    """What pyramids and cones have in common: ``S`` decides."""

    shifts_with_its_contacts: ClassVar[bool] = True
    has_point_forces: ClassVar[bool] = True
    lorentz: ClassVar[int]

    @abstractmethod
    def S(self, touch: Touch) -> Float[np.ndarray, "3 j"]:
        """The force of one point per unit of its variables."""

    @abstractmethod
    def upright(self) -> Float[np.ndarray, "j"]:
        """Variables of a unit force along the normal."""

    def generators(self, touches: tuple[Touch, ...]) -> Mapping[str, Generators]:
        """One group per effector that touches, its points one after the other."""
        n_points = sum(len(touch.points_m) for touch in touches)
        found: dict[str, Generators] = {}
        for touch in touches:
            S, k = self.S(touch), len(touch.points_m)
            found[touch.effector] = Generators(
                wrench=np.hstack([np.vstack([S, skew(p) @ S]) for p in touch.points_m]),
                lorentz=self.lorentz,
                regulariser=2.0 * touch.force_weight * S.T @ S,
                rest=np.tile(self.upright(), k) / n_points,
                normal=touch.rotation[:, 2] @ S,
            )
        return found

    def forces(self, touches: tuple[Touch, ...], values: Values) -> Forces:
        """``f = S u``."""
        found: dict[str, Float[np.ndarray, "n points 3"]] = {}
        for touch in touches:
            u = values[touch.effector]
            found[touch.effector] = u.reshape(len(u), len(touch.points_m), -1) @ self.S(touch).T
        return found


@dataclass(frozen=True)
class Pyramids(_PointForces):
    """Forces in pyramids of ``n_rays`` inscribed rays, bounds only.

    Raises ``InvalidInput`` (``rays-too-few``) below eight, which hold 0.90 of the circle.
    """

    n_rays: int = N_RAYS_MIN
    lorentz: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if self.n_rays < N_RAYS_MIN:
            raise InvalidInput("rays-too-few", f"A pyramid needs at least {N_RAYS_MIN} rays, not {self.n_rays}.")

    def S(self, touch: Touch) -> Float[np.ndarray, "3 j"]:
        """The rays in the world, each with a normal component of 1."""
        return np.asarray(touch.rotation @ rays(touch.friction, self.n_rays))

    def upright(self) -> Float[np.ndarray, "j"]:
        """The same of every ray."""
        return np.full(self.n_rays, 1.0 / self.n_rays)


@dataclass(frozen=True)
class CircularCones(_PointForces):
    """Forces in the circular cones themselves: three variables per point, and one row each."""

    lorentz: ClassVar[int] = 2

    def S(self, touch: Touch) -> Float[np.ndarray, "3 j"]:
        """The contact's axes in the world, the tangential ones times the friction: the cone is then |u_xy| <= u_z."""
        return np.asarray(touch.rotation * np.array([touch.friction, touch.friction, 1.0]))

    def upright(self) -> Float[np.ndarray, "j"]:
        """The normal alone."""
        return np.array([0.0, 0.0, 1.0])


PYRAMIDS: Final = Pyramids()
"""The control unless another is chosen."""


def rays(friction: float, n: int) -> Float[np.ndarray, "3 n"]:
    """``V`` in the contact frame, one ray per column, normal component 1."""
    a = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    return np.stack([friction * np.cos(a), friction * np.sin(a), np.ones(n)])
