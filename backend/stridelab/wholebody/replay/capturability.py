"""From where a motion can still be caught: the capture point's error that its soles can undo, in four directions.

The error e of the capture point runs away from the shift d of the centre of pressure, ``e' = w (e - d)``, and d ends
where the soles end. What can be undone from time t on is therefore

    C(t) = w int_t^inf exp(-w (s - t)) d_max(s) ds ,

``d_max(s)`` being the distance from the planned centre of pressure to the edge of the support in that direction, the
convex hull of the soles (Koolen 2012). A sole that lands o beside its place carries its share of the weight there, and
moves the reference by ``W(t) o``, where

    W(t) = w int exp(-w (s - t)) share(s) ds    over the sole's contact, the present one or the next.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Series
from stridelab.wholebody.control.base_heading import Heading
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.dcm_feedback import pendulum_rate

Sizes = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Capturable:
    """Of every sample of a motion; directions in the order forwards, to the left, backwards, to the right.

    ``towards`` are their unit vectors. Along them and from the origin of the world, the support reaches to ``edge_m``
    from the planned centre of pressure on, and to ``stand_m`` from the planned capture point on. ``reach_m`` is C,
    ``weight`` W of every sole, ``capture_m`` the planned capture point, ``moving_m`` its distance from the CoM,
    ``pressure_m`` the planned centre of pressure, ``rate_per_s`` w. ``touches`` says when a sole stands.
    """

    towards: Float[np.ndarray, "n 4 2"]
    edge_m: Float[np.ndarray, "n 4"]
    stand_m: Float[np.ndarray, "n 4"]
    reach_m: Float[np.ndarray, "n 4"]
    weight: Mapping[str, Series]
    capture_m: Float[np.ndarray, "n 2"]
    moving_m: Series
    pressure_m: Float[np.ndarray, "n 2"]
    rate_per_s: Series
    touches: Mapping[str, Int[np.ndarray, "n"]]

    @staticmethod
    def of(motion: WholeBodyMotion, half_size_m: Sizes, inside_m: float) -> "Capturable":
        """``half_size_m`` of all soles; the centre of pressure stays ``inside_m`` within."""
        n, sequence, heading = len(motion.time_s), motion.sequence, Heading.of(motion.sequence)
        towards, room, stand = np.zeros((n, 4, 2)), np.zeros((n, 4)), np.zeros((n, 4))
        c, v = motion.com_reference_m, motion.com_v_reference_m_s
        pressure, capture, w = c[:, :2].copy(), c[:, :2].copy(), np.ones(n)
        share = {name: np.zeros(n) for name in half_size_m}
        touches = {name: np.zeros(n, dtype=int) for name in half_size_m}
        phase = np.array([sequence.phase_at(float(t) + 1e-9) for t in motion.time_s])
        for k in np.unique(phase):
            inside = phase == k
            x, y = heading.at(int(k), float(sequence.starts_s[k]))[0][:2, :2].T
            towards[inside] = [x, y, -x, -y]
            soles = {name: c for name, c in sequence.phases[k].contacts.items() if name in half_size_m}
            if not soles:
                continue
            loads = {name: _loads(motion, name, contact, inside) for name, contact in soles.items()}
            total = np.maximum(sum(load.sum(axis=1) for load, _ in loads.values()), 1e-9)
            pressure[inside] = sum(load @ points for load, points in loads.values()) / total[:, None]
            for name, (load, _) in loads.items():
                share[name][inside], touches[name][inside] = load.sum(axis=1) / total, 1
            ground_m = float(np.mean([contact.placement.position_m[2] for contact in soles.values()]))
            w[inside] = [pendulum_rate(float(z) - ground_m) for z in c[inside, 2]]
            capture[inside] += v[inside, :2] / w[inside, None]
            corners = np.concatenate([_corners(c, half_size_m[name], inside_m) for name, c in soles.items()])
            hull = ConvexHull(corners).equations
            room[inside], stand[inside] = (_room(hull, at[inside], towards[inside][0]) for at in (pressure, capture))
        margin = np.maximum(room, 0.0)
        kept = np.exp(-w / motion.rate_hz)
        reach = _ahead(margin, kept, np.zeros(n, dtype=bool))
        weight = {}
        for name, its in share.items():
            lifts = np.append((touches[name][:-1] == 1) & (touches[name][1:] == 0), False)
            weight[name] = _ahead(its, kept, lifts)
        edge, stand = (far + np.einsum("nij,nj->ni", towards, at) for far, at in ((room, pressure), (stand, capture)))
        moving = np.linalg.norm(capture - c[:, :2], axis=1)
        return Capturable(towards, edge, stand, reach, weight, capture, moving, pressure, w, touches)

    def touch_down(self, sole: str, i: int) -> int:
        """The sample from which a sole that swings at ``i`` stands again."""
        return i + int(np.argmax(self.touches[sole][i:]))

    def lift_off(self, sole: str, i: int) -> int:
        """The last sample at which a sole that swings at ``i`` stood."""
        return i - int(np.argmax(self.touches[sole][i::-1]))


def _ahead(values: np.ndarray, kept: Series, ends: np.ndarray) -> np.ndarray:
    """``w int exp(-w (s - t)) values(s) ds`` from every sample on; after a sample where it ``ends`` nothing counts."""
    found = values.copy()
    for i in range(len(values) - 2, -1, -1):
        found[i] = kept[i] * found[i + 1] * (not ends[i]) + (1.0 - kept[i]) * values[i]
    return found


def _loads(
    motion: WholeBodyMotion, name: str, contact: Contact, inside: np.ndarray
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "k 2"]]:
    """Normal forces and where they act; a sole of which no force is known is pressed in its middle."""
    forces = motion.forces_n.get(name)
    if forces is None:
        return np.ones((int(inside.sum()), 1)), contact.placement.position_m[None, :2]
    points = contact.placement.act(motion.points_m[name])[:, :2]
    return np.maximum(forces[inside] @ contact.placement.rotation[:, 2], 0.0), points


def _corners(contact: Contact, half_size_m: tuple[float, float], inside_m: float) -> Float[np.ndarray, "4 2"]:
    """Of the rectangle in which the centre of pressure may be."""
    x, y = (half - inside_m for half in half_size_m)
    return contact.placement.act(np.array([[x, y, 0.0], [x, -y, 0.0], [-x, y, 0.0], [-x, -y, 0.0]]))[:, :2]


def _room(
    hull: Float[np.ndarray, "h 3"], points_m: Float[np.ndarray, "m 2"], towards: Float[np.ndarray, "4 2"]
) -> Float[np.ndarray, "m 4"]:
    """How far it is from points to the edge of a convex polygon; negative beyond it. ``hull`` is ``n' p + b <= 0``."""
    left = -(points_m @ hull[:, :2].T + hull[:, 2])
    along = towards @ hull[:, :2].T
    with np.errstate(divide="ignore"):
        far = np.where(along > 1e-9, 1.0 / along, np.inf)
    room = left[:, None, :] * far
    return np.asarray(np.where(np.isnan(room), np.inf, np.where(along > 1e-9, room, np.inf)).min(axis=2))
