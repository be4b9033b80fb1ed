"""Contact points and the generators of their contact wrenches: the linear side of (4.6) and (4.7).

A sole has a contact point at each corner, a hand has one. At each the force lies in ``mu f_n >= |f_t|``, approximated
by a pyramid of ``n`` rays,

    f_j = R (r cos a_j, r sin a_j, 1),   a_j = 2 pi (j + 1/2) / n,   r = mu (inside)  or  mu / cos(pi / n) (around)

which is inscribed in the circle or circumscribed; both converge to the circular cone as ``1 - cos(pi / n)``.
A ray is the wrench ``y = (f, p x f)`` about the world origin.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Rotations, Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput

Side = Literal["inside", "around"]
Rays = Float[np.ndarray, "rays 6"]
"""Generators of a cone of wrenches (force, moment)."""
Grasp = Float[np.ndarray, "6 forces"]
CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))


@dataclass(frozen=True, eq=False)
class PointContacts:
    """``n`` contact points: positions, surface frames (z is the outward normal) and friction coefficients.

    Raises ``InvalidInput`` (``contacts-invalid``) without points, for non-finite numbers and for friction that is not
    positive.
    """

    position_m: Points
    rotation: Rotations
    friction: Series

    def __post_init__(self) -> None:
        if not len(self.position_m):
            raise InvalidInput("contacts-invalid", "no contacts: a wrench cone needs at least one")
        if not (np.isfinite(self.position_m).all() and np.isfinite(self.rotation).all()):
            raise InvalidInput("contacts-invalid", "the position or frame of a contact is not finite")
        if not ((self.friction > 0.0) & np.isfinite(self.friction)).all():
            raise InvalidInput("contacts-invalid", "friction must be positive and finite")

    @staticmethod
    def from_placements(contacts: Iterable[tuple[Placement, tuple[float, float] | None, float]]) -> "PointContacts":
        """Create from placements, half edges of soles (None for a hand) and friction coefficients."""
        rows = [
            (placement.act(np.array([[x * size[0], y * size[1], 0.0] for x, y in CORNERS])), placement, friction)
            if size is not None
            else (placement.position_m[np.newaxis], placement, friction)
            for placement, size, friction in contacts
        ]
        return PointContacts(
            np.vstack([np.zeros((0, 3)), *[points for points, _, _ in rows]]),
            np.array([at.rotation for points, at, _ in rows for _ in points]).reshape(-1, 3, 3),
            np.array([float(friction) for points, _, friction in rows for _ in points]),
        )

    def pyramid_edges(self, n_rays: int = 4, side: Side = "inside") -> Float[np.ndarray, "n rays 3"]:
        """Edges of the pyramid of every point, with normal component 1. Raises ``ValueError`` below three rays."""
        if n_rays < 3:
            raise ValueError("a pyramid has at least three edges")
        angle = 2.0 * np.pi * (np.arange(n_rays) + 0.5) / n_rays
        radius = self.friction * (1.0 if side == "inside" else 1.0 / np.cos(np.pi / n_rays))
        circle = np.stack([np.cos(angle), np.sin(angle)])
        tangential = np.einsum("nak,kj,n->nja", self.rotation[:, :, :2], circle, radius)
        return np.asarray(tangential + self.rotation[:, np.newaxis, :, 2])

    def wrench_rays(self, n_rays: int = 4, side: Side = "inside") -> Rays:
        """Generators ``(f, p x f)`` of the linear wrench cone about the world origin."""
        f = self.pyramid_edges(n_rays, side)
        return np.concatenate([f, np.cross(self.position_m[:, np.newaxis], f)], axis=2).reshape(-1, 6)

    def grasp_matrix(self, about_m: Vector3 | None = None) -> Grasp:
        """Grasp matrix: maps all forces ``(3 n,)`` to their wrench about ``about_m`` (default: the world origin)."""
        p = self.position_m if about_m is None else self.position_m - about_m
        moments = np.cross(p[:, np.newaxis], np.eye(3)[np.newaxis]).transpose(2, 0, 1).reshape(3, -1)
        return np.vstack([np.tile(np.eye(3), len(p)), moments])

    def in_frame(self, shift_m: Vector3, scale: float = 1.0) -> "PointContacts":
        """The contacts in another frame and unit of length: ``scale (p + shift)``."""
        return PointContacts(scale * (self.position_m + shift_m), self.rotation, self.friction)


def wrench_transform(shift_m: Vector3, scale: float = 1.0) -> Float[np.ndarray, "6 6"]:
    """Wrench transformation that belongs to ``PointContacts.in_frame``: ``(f, nu) -> (f, scale (nu + shift x f))``."""
    x, y, z = shift_m
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[np.eye(3), np.zeros((3, 3))], [scale * cross, scale * np.eye(3)]])
