"""What force and moment can say of the CoM, and what they cannot (section 2.3.1).

The contact wrench does not change when the CoM moves along the contact force (2.18), so that direction is known from
the geometry alone. (2.19) is the observability matrix of (c, c', c'') from the wrench, (2.23) that of (c, c', c'', b)
with the geometry c + b added; both are for u = 0. Written with f = m (c'' - g), g pointing down.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Points, Vector3, g
from stridelab.estimation.estimate import ComEstimate

_STATES = 25
"""States at which the ranks are evaluated, spread over the window."""
_TOLERANCE = 1e-9

Skew = Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class Observability:
    """Smallest ranks over the window, and the unobservable direction.

    ``rank_force`` is that of (2.19) out of 9 (7 when there is a contact force), ``rank_with_geometry`` that of (2.23)
    out of 12 (11). ``unobservable`` is the mean unit vector of the contact force; ``tilt_rad`` the largest angle
    between the force and the vertical, ``turn_rad`` the largest angle between the force and its own mean.
    """

    rank_force: int
    rank_with_geometry: int
    unobservable: tuple[float, float, float]
    tilt_rad: float
    turn_rad: float


def observability(estimate: ComEstimate) -> Observability:
    """Observability along an estimate, whose states (c, c', c'') the matrices are evaluated at."""
    at = np.unique(np.linspace(0, len(estimate.time_s) - 1, _STATES).astype(int))
    states = list(zip(estimate.com_m[at], estimate.velocity_m_s[at], estimate.acceleration_m_s2[at], strict=True))
    f = _unit(estimate.acceleration_m_s2 - g)
    mean = _unit(f.mean(axis=0, keepdims=True))[0]
    return Observability(
        rank_force=min(_rank(force_matrix(*state)) for state in states),
        rank_with_geometry=min(_rank(force_and_geometry_matrix(*state)) for state in states),
        unobservable=(float(mean[0]), float(mean[1]), float(mean[2])),
        tilt_rad=_largest_angle(f, np.array([0.0, 0.0, 1.0])),
        turn_rad=_largest_angle(f, mean),
    )


def force_matrix(c: Vector3, velocity: Vector3, acceleration: Vector3) -> Float[np.ndarray, "15 9"]:
    """(2.19) without its zero row, divided by m; position in units of g times one second squared."""
    O, E = np.zeros((3, 3)), np.eye(3)
    f = skew(acceleration - g) / GRAVITY_M_S2
    rows = [[O, O, E], [-f, O, skew(c)], [O, O, O], [O, -f, skew(velocity)], [O, O, skew(g)]]
    return np.block(rows)


def force_and_geometry_matrix(c: Vector3, velocity: Vector3, acceleration: Vector3) -> Float[np.ndarray, "21 12"]:
    """(2.23), scaled as ``force_matrix``: the geometry measures c + b, and b is constant."""
    O, E = np.zeros((3, 3)), np.eye(3)
    f = skew(acceleration - g) / GRAVITY_M_S2
    rows = [
        [O, O, E, O],
        [-f, O, skew(c), O],
        [E, O, O, E],
        [O, -f, skew(velocity), O],
        [O, E, O, O],
        [O, O, skew(g), O],
        [O, O, E, O],
    ]
    return np.block(rows)


def constant_jerk_matrix(
    c: Vector3, velocity: Vector3, acceleration: Vector3, jerk: Vector3
) -> Float[np.ndarray, "15 9"]:
    """Observability matrix of (c, c', c'') from the wrench when a constant jerk u is known, scaled as ``force_matrix``.

    With ``A = c'' - g`` the moment c x A and its derivatives are ``c x A``, ``c' x A + c x u``,
    ``2 c' x u + c'' x A`` and ``3 c'' x u + u x A``. Rank 8: (c, c') moved by (lambda A, lambda u) stays invisible, so
    2.3.1's remark that some motions make everything observable needs a jerk that changes.
    """
    O, E = np.zeros((3, 3)), np.eye(3)
    f, u = skew(acceleration - g), skew(jerk)
    rows = [[O, O, E], [-f, O, skew(c)], [-u, -f, skew(velocity)], [O, -2 * u, skew(g)], [O, O, -2 * u]]
    return np.block(rows) / GRAVITY_M_S2


def skew(a: Vector3) -> Skew:
    """``[a]x``, with ``[a]x b = a x b``."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _rank(matrix: Float[np.ndarray, "rows columns"]) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=_TOLERANCE))


def _unit(vectors: Points) -> Points:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _largest_angle(directions: Points, axis: Vector3) -> float:
    return float(np.arccos(np.clip(directions @ axis, -1.0, 1.0)).max())
