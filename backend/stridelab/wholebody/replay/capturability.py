"""Capturability of a motion: the capture point error that its soles can correct, in four directions.

The error e of the capture point diverges from the shift d of the centre of pressure, ``e' = w (e - d)``, and d is
limited by the soles. The largest error that can be corrected from time t on is therefore

    C(t) = w int_t^inf exp(-w (s - t)) d_max(s) ds ,

``d_max(s)`` being the distance from the planned centre of pressure to the edge of the support in that direction, the
convex hull of the soles (Koolen 2012). A sole that lands with offset o from its planned position carries its share of
the weight there and shifts the reference by ``W(t) o``, where

    W(t) = w int exp(-w (s - t)) share(s) ds    over the sole's contact, the present one or the next.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Series
from stridelab.wholebody.control.tasks import Heading
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.dcm_feedback import pendulum_rate

Sizes = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Capturability:
    """Capturability per sample of a motion, in the directions forwards, left, backwards, right.

    ``towards`` are their unit vectors. ``edge_m`` and ``capture_edge_m`` are the coordinates along them, from the world
    origin, of the support's edge as seen from the planned centre of pressure and from the planned capture point.
    ``reach_m`` is C, ``weight`` W of every sole, ``capture_m`` the planned capture point, ``capture_distance_m`` its
    distance from the CoM, ``pressure_m`` the planned centre of pressure, ``rate_per_s`` w. ``touches`` is 1 while a
    sole is in contact.

    Of a motion that is still being computed there are the samples from ``first`` to ``known``. Their ``reach_m`` is a
    lower bound, as no distance is negative, and ``weight`` is zero.
    """

    directions: Float[np.ndarray, "n 4 2"]
    edge_m: Float[np.ndarray, "n 4"]
    capture_edge_m: Float[np.ndarray, "n 4"]
    reach_m: Float[np.ndarray, "n 4"]
    weight: Mapping[str, Series]
    capture_m: Float[np.ndarray, "n 2"]
    capture_distance_m: Series
    pressure_m: Float[np.ndarray, "n 2"]
    rate_per_s: Series
    in_contact: Mapping[str, Int[np.ndarray, "n"]]
    known: int

    @property
    def is_exact(self) -> bool:
        """Whether all samples are known."""
        return self.known == len(self.rate_per_s)

    @staticmethod
    def of_motion(
        motion: WholeBodyMotion, half_size_m: Sizes, inside_m: float, first: int = 0, known: int | None = None
    ) -> "Capturability":
        """From ``half_size_m`` of all soles; the centre of pressure keeps ``inside_m`` from their edges.

        With ``known`` below the number of samples, those from ``first`` to ``known``.
        """
        n, sequence, heading = len(motion.time_s), motion.sequence, Heading.of_sequence(motion.sequence)
        known = n if known is None else known
        first = 0 if known == n else first
        towards, pressure_margin, stand = np.zeros((n, 4, 2)), np.zeros((n, 4)), np.zeros((n, 4))
        c, v = motion.com_reference_m, motion.com_v_reference_m_s
        pressure, capture, w = c[:, :2].copy(), c[:, :2].copy(), np.ones(n)
        share = {name: np.zeros(n) for name in half_size_m}
        touches = {name: np.zeros(n, dtype=int) for name in half_size_m}
        phase = np.full(n, -1)
        phase[first:known] = sequence.phases_at(motion.time_s[first:known] + 1e-9)
        for k in np.unique(phase[first:known]):
            inside = phase == k
            x, y = heading.orientations_at(np.array([k]), sequence.starts_s[[k]])[0][0, :2, :2].T
            towards[inside] = [x, y, -x, -y]
            soles = {name: c for name, c in sequence.phases[k].contacts.items() if name in half_size_m}
            if not soles:
                continue
            loads = {name: _sole_loads(motion, name, contact, inside) for name, contact in soles.items()}
            total = np.maximum(sum(load.sum(axis=1) for load, _ in loads.values()), 1e-9)
            pressure[inside] = sum(load @ points for load, points in loads.values()) / total[:, None]
            for name, (load, _) in loads.items():
                share[name][inside], touches[name][inside] = load.sum(axis=1) / total, 1
            ground_m = float(np.mean([contact.placement.position_m[2] for contact in soles.values()]))
            w[inside] = [pendulum_rate(float(z) - ground_m) for z in c[inside, 2]]
            capture[inside] += v[inside, :2] / w[inside, None]
            corners = np.concatenate([_sole_corners(c, half_size_m[name], inside_m) for name, c in soles.items()])
            hull = ConvexHull(corners).equations
            pressure_margin[inside], stand[inside] = (
                _distance_to_edge(hull, at[inside], towards[inside][0]) for at in (pressure, capture)
            )
        pressure_reach = np.maximum(pressure_margin, 0.0)
        decay = np.exp(-w / motion.rate_hz)
        until = n if known == n else known + 1  # one sample more: the integral begins with what is zero there
        part, reach, weight = slice(first, until), np.zeros((n, 4)), {name: np.zeros(n) for name in share}
        reach[part] = _discounted_integral(pressure_reach[part], decay[part], np.zeros(until - first, dtype=bool))
        for name, load_share in share.items() if known == n else ():
            lifts = np.append((touches[name][:-1] == 1) & (touches[name][1:] == 0), False)
            weight[name] = _discounted_integral(load_share, decay, lifts)
        edge, stand = (
            distance + np.einsum("nij,nj->ni", towards, at)
            for distance, at in ((pressure_margin, pressure), (stand, capture))
        )
        moving = np.linalg.norm(capture - c[:, :2], axis=1)
        return Capturability(towards, edge, stand, reach, weight, capture, moving, pressure, w, touches, known)

    def touch_down(self, sole: str, i: int) -> int:
        """First sample in contact of a sole that swings at ``i``."""
        return i + int(np.argmax(self.in_contact[sole][i:]))

    def lift_off(self, sole: str, i: int) -> int:
        """Last sample in contact before the swing of a sole at ``i``."""
        return i - int(np.argmax(self.in_contact[sole][i::-1]))


def _discounted_integral(values: np.ndarray, decay: Series, ends: np.ndarray) -> np.ndarray:
    """``w int exp(-w (s - t)) values(s) ds`` from every sample on; the integral stops after samples with ``ends``."""
    integral, goes_on = values.copy(), ~ends
    gained = (1.0 - decay).reshape(-1, *[1] * (values.ndim - 1)) * values
    rows = integral.reshape(len(values), -1)
    for column, added in zip(rows.T, gained.reshape(rows.shape).T, strict=True):
        sums = column.tolist()  # a loop over plain numbers, ten times as fast as over arrays
        given = list(zip(decay.tolist(), goes_on.tolist(), added.tolist(), strict=True))
        for i in range(len(sums) - 2, -1, -1):
            factor, continues, gain = given[i]
            sums[i] = factor * sums[i + 1] * continues + gain
        column[:] = sums
    return integral


def _sole_loads(
    motion: WholeBodyMotion, name: str, contact: Contact, inside: np.ndarray
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "k 2"]]:
    """Normal forces and their positions; a unit force at the centre for a sole without forces in the motion."""
    forces = motion.forces_n.get(name)
    if forces is None:
        return np.ones((int(inside.sum()), 1)), contact.placement.position_m[None, :2]
    points = contact.placement.act(motion.points_m[name])[:, :2]
    return np.maximum(forces[inside] @ contact.placement.rotation[:, 2], 0.0), points


def _sole_corners(contact: Contact, half_size_m: tuple[float, float], inside_m: float) -> Float[np.ndarray, "4 2"]:
    """Corners of the rectangle that the centre of pressure may use."""
    x, y = (half - inside_m for half in half_size_m)
    return contact.placement.act(np.array([[x, y, 0.0], [x, -y, 0.0], [-x, y, 0.0], [-x, -y, 0.0]]))[:, :2]


def _distance_to_edge(
    hull: Float[np.ndarray, "h 3"], points_m: Float[np.ndarray, "m 2"], directions: Float[np.ndarray, "4 2"]
) -> Float[np.ndarray, "m 4"]:
    """Distance from points to the edge of a convex polygon, negative outside; ``hull`` is ``n' p + b <= 0``."""
    slack = -(points_m @ hull[:, :2].T + hull[:, 2])
    along = directions @ hull[:, :2].T
    with np.errstate(divide="ignore"):
        per_slack = np.where(along > 1e-9, 1.0 / along, np.inf)
    distance = slack[:, None, :] * per_slack
    return np.asarray(np.where(np.isnan(distance), np.inf, np.where(along > 1e-9, distance, np.inf)).min(axis=2))
