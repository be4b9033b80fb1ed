"""u_c: the contact wrench itself as control (4.5), in a Lorentz cone in place of the wrench cone of the contacts (4.6).

    (F, T) = M^-1 (tau, eta),   |tau| <= eta

with M of a ``LorentzCone``: the largest one inside the pyramids, or the thesis' cone shrunk by alpha, which may leave
them (docs/theory/wrench-cones.md). Point forces are distributed afterwards: those that give the wrench and minimise

    sum over points of weight |f|^2,     f in pyramids whose edges include those of the linear cone,

which is the cost of u_f, so that hands carry as little as there. If the Lorentz cone lies inside the pyramids, such
forces exist; otherwise the minimum without cones is returned where none do, and verification reports the violation.

Centroidal dynamics as a linear system, by the momentum about a fixed point instead of about the CoM.

With ``K = L_c + m c x c'`` (momentum about a fixed point o; all positions are relative to o) the bilinear (4.2b), and
with it all of (4.2), becomes linear, for point forces (4.4) as well as for their wrench (4.5):

    c'' = F + g,     K' = T + c x g,     F = sum f / m,   T = sum p x f / m

in units of mass. Forces constant over an interval h integrate in closed form, exactly:

    c+ = c + h c' + h^2/2 (F + g)
    c'+ = c' + h (F + g)
    K+ = K + h T + (h c + h^2/2 c' + h^3/6 F) x g                               (g x g = 0)

The bilinear term remains only in the mean rate of L_c over the interval, which enters the cost:

    (L_c+ - L_c) / h = T - (c + h/2 c' + h^2/6 g) x F                           (F x F = 0)

All forces are divided by |g|: F = (0, 0, 1) balances gravity.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, Final, Literal

import daqp
import numpy as np
from jaxtyping import Float

from stridelab.centroidal.control import ContactPatch, Control, Forces, Generators, Values
from stridelab.contacts.wrench_cones.contact_points import PointContacts, wrench_transform
from stridelab.contacts.wrench_cones.thesis_lorentz_cone import outer_cone
from stridelab.contacts.wrench_cones.wrench_cone import N_RAYS, LinearCone, LorentzCone
from stridelab.conventions import GRAVITY_M_S2, Rotation, Vector3
from stridelab.errors import InvalidInput

WRENCH: Final = "wrench"
"""Name of the only group."""
THESIS_RAYS: Final = 4
"""Rays per point of the thesis' cone."""
N_FACES: Final = 3 * N_RAYS
"""Faces of the pyramids for point forces: an odd multiple, so that they contain those of the linear cone."""
ROUNDING_DECIMALS: Final = 12
"""Decimals to which contacts are rounded for the cache of cones."""
PRIMAL_TOLERANCE: Final = 1e-10
WEIGHT_MIN: Final = 1e-6
"""Lower bound of the force weights when a wrench is distributed."""


@dataclass(frozen=True)
class ContactWrench(Control):
    """The wrench as control, in the largest ``inscribed`` cone or in the ``thesis``' cone shrunk by ``alpha``.

    The cone is that of the ``soles``, which is inside that of ``all`` contacts: the largest cone of a foot and a hand
    has its axis between them and would load the hand beyond what an arm carries. Without a sole, all contacts are used.
    Raises ``InvalidInput`` (``alpha-out-of-range``) unless ``0 < alpha <= 1``.
    """

    cone: Literal["inscribed", "thesis"] = "inscribed"
    contacts: Literal["soles", "all"] = "soles"
    alpha: float = 0.2
    shifts_with_its_contacts: ClassVar[bool] = False
    has_point_forces: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha <= 1.0:
            raise InvalidInput("alpha-out-of-range", f"The shrink factor must be in (0, 1], not {self.alpha}.")

    def generators(self, patches: tuple[ContactPatch, ...]) -> Mapping[str, Generators]:
        """One group; empty in flight. Raises ``NotEstimable`` where the contacts have no such cone."""
        if not patches:
            return {}
        cone = self._lorentz_cone(patches)
        k = cone.dimension
        onto = np.linalg.inv(cone.to_standard)[:, : k + 1]
        upright = np.zeros(k + 1)
        upright[k] = 1.0 / onto[2, k]
        return {WRENCH: Generators(onto, k, np.zeros((k + 1, k + 1)), upright, None)}

    def _lorentz_cone(self, patches: tuple[ContactPatch, ...]) -> LorentzCone:
        """The cone about the origin, from the cached one about the mean of the contacts, which repeats on stairs."""
        soles = tuple(patch for patch in patches if patch.kind == "surface")
        contacts = point_contacts(soles if soles and self.contacts == "soles" else patches)
        middle = contacts.position_m.mean(axis=0)
        own = contacts.in_frame(-middle)
        parts = (own.position_m, own.rotation, own.friction)
        key = [np.round(part, ROUNDING_DECIMALS).tobytes() for part in parts]
        return _cached_lorentz_cone(self.cone, self.alpha, *key).in_frame(wrench_transform(-middle))

    def gauge(self, patches: tuple[ContactPatch, ...], wrenches: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
        """``|tau| / eta``; infinite where ``eta`` is not positive."""
        return self._lorentz_cone(patches).gauge(wrenches) if patches else np.zeros(len(wrenches))

    def point_forces(self, patches: tuple[ContactPatch, ...], values: Values) -> Forces:
        """Minimum-cost point forces for each wrench."""
        if not patches:
            return {}
        sharing, onto = ForceDistribution(patches), self.generators(patches)[WRENCH].wrench
        f = np.array([sharing.minimum_cost_forces(onto @ u) for u in values[WRENCH]])
        parts = np.split(f, np.cumsum([len(patch.points_m) for patch in patches])[:-1], axis=1)
        return {patch.effector: part for patch, part in zip(patches, parts, strict=True)}


@dataclass(frozen=True, eq=False)
class ForceDistribution:
    """Distribution of a wrench over contact points: all solutions are ``f = W^-1/2 (f0 + N z)``, z free."""

    patches: tuple[ContactPatch, ...]

    @cached_property
    def _inverse_sqrt_weights(self) -> Float[np.ndarray, "minimum_cost_forces"]:
        """``W^-1/2``."""
        weights = [max(t.force_weight, WEIGHT_MIN) for t in self.patches]
        sizes = [3 * len(t.points_m) for t in self.patches]
        return np.repeat(np.array(weights) ** -0.5, sizes)

    @cached_property
    def _from_wrench(self) -> Float[np.ndarray, "forces 6"]:
        return np.linalg.pinv(point_contacts(self.patches).grasp_matrix() * self._inverse_sqrt_weights)

    @cached_property
    def _null_space(self) -> Float[np.ndarray, "forces d"]:
        G = point_contacts(self.patches).grasp_matrix() * self._inverse_sqrt_weights
        _, S, Vt = np.linalg.svd(G)
        return np.asarray(Vt[int((1e-9 * S[0] < S).sum()) :].T)

    @cached_property
    def _pyramid_faces(self) -> Float[np.ndarray, "faces forces"]:
        """Face normals of the pyramids in ``W^1/2 f``; the products are non-positive inside."""
        angle = 2.0 * np.pi * np.arange(N_FACES) / N_FACES
        blocks = []
        for patch in self.patches:
            height = np.full(N_FACES, -patch.friction * np.cos(np.pi / N_FACES))
            own = np.stack([np.cos(angle), np.sin(angle), height], axis=1) @ patch.rotation.T
            blocks += [own] * len(patch.points_m)
        rows = np.zeros((N_FACES * len(blocks), 3 * len(blocks)))
        for i, own in enumerate(blocks):
            rows[N_FACES * i : N_FACES * (i + 1), 3 * i : 3 * i + 3] = own
        return np.asarray(rows * self._inverse_sqrt_weights)

    @cached_property
    def _reduced_faces(self) -> Float[np.ndarray, "faces d"]:
        return np.ascontiguousarray(self._pyramid_faces @ self._null_space)

    def minimum_cost_forces(self, wrench: Float[np.ndarray, "6"]) -> Float[np.ndarray, "points 3"]:
        """Minimum-cost forces in the pyramids, or without cones where the pyramids admit none."""
        eased = self._from_wrench @ wrench
        limits, d = -self._pyramid_faces @ eased, self._null_space.shape[1]
        if d and limits.min() < 0.0:
            z, _, flag, _ = daqp.solve(
                np.eye(d),
                np.zeros(d),
                self._reduced_faces,
                limits,
                np.full(len(limits), -1e30),
                np.zeros(len(limits), np.int32),
                primal_tol=PRIMAL_TOLERANCE,
            )
            if flag > 0:
                eased = eased + self._null_space @ z
        return np.asarray((self._inverse_sqrt_weights * eased).reshape(-1, 3))


@lru_cache(maxsize=256)
def _cached_lorentz_cone(
    kind: Literal["inscribed", "thesis"], alpha: float, position_m: bytes, rotation: bytes, friction: bytes
) -> LorentzCone:
    points, axes, mu = (np.frombuffer(part) for part in (position_m, rotation, friction))
    contacts = PointContacts(points.reshape(-1, 3), axes.reshape(-1, 3, 3), mu)
    if kind == "inscribed":
        return LinearCone.from_contacts(contacts).largest_lorentz()
    return outer_cone(contacts.wrench_rays(THESIS_RAYS)).shrink(alpha)


def point_contacts(patches: tuple[ContactPatch, ...]) -> PointContacts:
    """The points of all contacts in the form used by the wrench cones."""
    return PointContacts(
        np.vstack([t.points_m for t in patches]),
        np.array([t.rotation for t in patches for _ in t.points_m]),
        np.array([t.friction for t in patches for _ in t.points_m]),
    )


N_STATE = 9
"""Size of ``x = (c, c', K)``, K in units of m |g|."""
N_WRENCH = 6
"""Size of ``(F, T)``, in units of m |g| and of m |g| times a metre."""

DOWN = np.array([0.0, 0.0, -1.0])


def skew(a: Vector3) -> Rotation:
    """Matrix of ``b -> a x b``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False)
class Step:
    """``x+ = A x + B (F, T) + b`` over one interval."""

    A: Float[np.ndarray, "9 9"]
    B: Float[np.ndarray, "9 6"]
    b: Float[np.ndarray, "9"]


def discrete_step(h: float) -> Step:
    """Exact step over ``h`` seconds with a constant contact wrench."""
    G = GRAVITY_M_S2
    E, cross_g = np.eye(3), -skew(DOWN)  # a x g = -[g]x a
    A, B, b = np.eye(N_STATE), np.zeros((N_STATE, N_WRENCH)), np.zeros(N_STATE)
    A[0:3, 3:6] = h * E
    A[6:9, 0:3], A[6:9, 3:6] = h * cross_g, h**2 / 2 * cross_g
    B[0:3, 0:3], B[3:6, 0:3] = h**2 / 2 * G * E, h * G * E
    B[6:9, 0:3], B[6:9, 3:6] = h**3 / 6 * G * cross_g, h * E
    b[0:3], b[3:6] = h**2 / 2 * G * DOWN, h * G * DOWN
    return Step(A, B, b)
