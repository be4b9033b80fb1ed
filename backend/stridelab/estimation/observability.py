"""Observability of the CoM from force and moment (section 2.3.1).

The wrench of a body without a rate of angular momentum, (f, c x f) with f = m (c'' - g) (2.17), does not change when
the CoM moves along the contact force (2.18), so only the geometry determines the position in that direction. (2.19) is
the observability matrix of (c, c', c''), driven by the jerk u (2.15), from the wrench; (2.23) that of (c, c', c'', b)
with the geometry c + b (2.20) added and a constant bias (2.21), (2.22). Both are for u = 0, g points down.

A measured force is never exactly zero. Below a tenth of the body weight it has no usable axis (2.6.2) and is treated as
zero, so that flight is detected: there the wrench determines the acceleration only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import GRAVITY_M_S2, Mask, Points, Vector3, g
from stridelab.estimation.estimator import ComEstimate

FLIGHT_FORCE_SHARE: Final = 0.1
"""Force over body weight below which the body counts as in flight."""
STATES: Final = 9
STATES_WITH_BIAS: Final = 12
_TOLERANCE = 1e-9

Vectors = Float[np.ndarray, "*n 3"]
"""One vector, or one per sample."""
Skew = Float[np.ndarray, "*n 3 3"]
Block = Float[np.ndarray, "... 3 3"]
Ranks = Int[np.ndarray, "n"]


@dataclass(frozen=True)
class ObservabilityTrack:
    """Per sample of an estimate: ranks of (2.19) and (2.23), and the direction that is unobservable from the wrench.

    ``direction`` is NaN in flight, where every direction is unobservable.
    """

    rank_force: Ranks
    rank_with_geometry: Ranks
    direction: Points
    flight: Mask


@dataclass(frozen=True)
class Observability:
    """Smallest ranks over the window, the unobservable direction, and a sentence that explains them.

    ``rank_force`` is that of (2.19) out of 9 (7 with a contact force), ``rank_with_geometry`` that of (2.23) out of 12
    (11). ``unobservable`` is the mean unit vector of the contact force (None without any); ``tilt_rad`` the largest
    angle between the force and the vertical, ``turn_rad`` the largest angle between the force and its mean.
    ``flight_s`` is the time without contact, which the angles exclude.
    """

    rank_force: int
    rank_with_geometry: int
    unobservable: tuple[float, float, float] | None
    tilt_rad: float
    turn_rad: float
    flight_s: float
    sentence: str


def observability_track(estimate: ComEstimate) -> ObservabilityTrack:
    """Ranks at the states (c, c', c'') of every sample of an estimate."""
    c = estimate.com_m - estimate.com_m.mean(axis=0)
    velocity, acceleration = estimate.velocity_m_s, estimate.acceleration_m_s2.copy()
    f = acceleration - g
    size = np.linalg.norm(f, axis=1)
    flight = size < FLIGHT_FORCE_SHARE * GRAVITY_M_S2
    acceleration[flight] = g
    direction = np.where(flight[:, None], np.nan, f / np.maximum(size, 1e-12)[:, None])
    rank_force, rank_with_geometry = (
        np.linalg.matrix_rank(matrix(c, velocity, acceleration), tol=_TOLERANCE)
        for matrix in (force_matrix, force_and_geometry_matrix)
    )
    return ObservabilityTrack(rank_force, rank_with_geometry, direction, flight)


def summarise_observability(estimate: ComEstimate) -> Observability:
    """Summarise the observability along an estimate."""
    track = observability_track(estimate)
    time_s = estimate.time_s
    step_s = float((time_s[-1] - time_s[0]) / max(len(time_s) - 1, 1))
    flight_s = float(track.flight.sum()) * step_s
    ranks = int(track.rank_force.min()), int(track.rank_with_geometry.min())
    if track.flight.all():
        sentence = (
            f"There is no ground contact (free fall): the force shows {ranks[0]} of {STATES} numbers of the motion, "
            "its acceleration; position and velocity come from the markers alone."
        )
        return Observability(*ranks, None, 0.0, 0.0, flight_s, sentence)
    n = track.direction[~track.flight]
    mean = n.mean(axis=0) / np.linalg.norm(n.mean(axis=0))
    tilt_rad, turn_rad = _largest_angle(n, np.array([0.0, 0.0, 1.0])), _largest_angle(n, mean)
    return Observability(
        *ranks,
        unobservable=(float(mean[0]), float(mean[1]), float(mean[2])),
        tilt_rad=tilt_rad,
        turn_rad=turn_rad,
        flight_s=flight_s,
        sentence=_explain_ranks(track, mean, tilt_rad, flight_s),
    )


def _explain_ranks(track: ObservabilityTrack, mean: Vector3, tilt_rad: float, flight_s: float) -> str:
    """Explanation of the ranks and of the unobservable direction for users."""
    grounded = ~track.flight
    rank, with_geometry = int(track.rank_force[grounded].min()), int(track.rank_with_geometry[grounded].min())
    tilt_deg = round(float(np.degrees(tilt_rad)))
    where = "upright" if not tilt_deg else f"up to {tilt_deg} degree{'s'[: tilt_deg - 1]} off the vertical"
    upright = abs(float(mean[2])) > np.cos(np.radians(25.0))
    hidden = "the height" if upright else f"the position along ({mean[0]:.2f}, {mean[1]:.2f}, {mean[2]:.2f})"
    sentence = (
        f"The force shows {rank} of {STATES} numbers of the motion (position, velocity and acceleration along three "
        f"axes), force and markers together {with_geometry} of {STATES_WITH_BIAS} (with the table's offset): {hidden} "
        "comes from the markers and the segment table alone, because moving the body "
        f"along the contact force (here {where}) changes nothing on the plates."
    )
    if flight_s > 0.0:
        sentence += f" For {flight_s:.2f} s there is no ground contact; there the force shows the acceleration only."
    return sentence


def force_matrix(c: Vectors, velocity: Vectors, acceleration: Vectors) -> Float[np.ndarray, "*n 15 9"]:
    """(2.19) without its zero row, divided by m; position in units of g times one second squared."""
    O, E = np.zeros((3, 3)), np.eye(3)
    f = skew(acceleration - g) / GRAVITY_M_S2
    rows = [[O, O, E], [-f, O, skew(c)], [O, O, O], [O, -f, skew(velocity)], [O, O, skew(g)]]
    return _block_matrix(rows)


def force_and_geometry_matrix(c: Vectors, velocity: Vectors, acceleration: Vectors) -> Float[np.ndarray, "*n 21 12"]:
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
    return _block_matrix(rows)


def constant_jerk_matrix(
    c: Vectors, velocity: Vectors, acceleration: Vectors, jerk: Vectors
) -> Float[np.ndarray, "*n 15 9"]:
    """Observability matrix of (c, c', c'') from the wrench for a known constant jerk u, scaled as ``force_matrix``.

    With ``A = c'' - g`` the moment c x A and its derivatives are ``c x A``, ``c' x A + c x u``,
    ``2 c' x u + c'' x A`` and ``3 c'' x u + u x A``. Rank 8: a change of (c, c') by (lambda A, lambda u) is
    unobservable, so full observability for some motions, as stated in 2.3.1, needs a varying jerk.
    """
    O, E = np.zeros((3, 3)), np.eye(3)
    f, u = skew(acceleration - g), skew(jerk)
    rows = [[O, O, E], [-f, O, skew(c)], [-u, -f, skew(velocity)], [O, -2 * u, skew(g)], [O, O, -2 * u]]
    return _block_matrix(rows) / GRAVITY_M_S2


def skew(a: Vectors) -> Skew:
    """``[a]x``, with ``[a]x b = a x b``."""
    x, y, z = np.moveaxis(a, -1, 0)
    o = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ([o, -z, y], [z, o, -x], [-y, x, o])]
    return np.stack(rows, axis=-2)


def _block_matrix(rows: Sequence[Sequence[Block]]) -> Float[np.ndarray, "... rows columns"]:
    """``np.block`` of 3 x 3 blocks, for one sample or many."""
    samples = np.broadcast_shapes(*(block.shape[:-2] for row in rows for block in row))
    whole = [[np.broadcast_to(block, (*samples, 3, 3)) for block in row] for row in rows]
    return np.concatenate([np.concatenate(row, axis=-1) for row in whole], axis=-2)


def _largest_angle(directions: Points, axis: Vector3) -> float:
    return float(np.arccos(np.clip(directions @ axis, -1.0, 1.0)).max())
