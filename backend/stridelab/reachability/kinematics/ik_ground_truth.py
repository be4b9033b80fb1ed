"""What a robot on fixed contacts can do, by inverse kinematics: the truth that the proxy (4.12) stands for.

The law is that of section 4.3.3.2: uniform over the postures that hold the contacts. The base's pose and the joints
that hold nothing are drawn, limbs in contact follow by inverse kinematics, and a posture counts if it is within the
limits and does not touch itself:

    p_base, R_base, q_rest ~ U,     q_limb = IK(T_base^-1 T_contact),     x = c(q)

A sole is placed in all six coordinates, a hand in three (it turns about the rail). Whether *some* posture has its CoM
at a given place is another question, which draws cannot answer near the boundary: it is searched for (``feasible``),
and so are the ends of the support (``extent``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Mask, Points, Series
from stridelab.dynamics.spatial import Placement
from stridelab.errors import NotEstimable
from stridelab.reachability.kinematics.leg_ik import LegChain
from stridelab.reachability.kinematics.whole_body_ik import BASE, ROLL, YAW, BodyTree, Coordinates, Directions, Target
from stridelab.reachability.standing_conditions import Interval
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision

BATCH: Final = 10_000
BATCHES: Final = 400
"""So many batches are drawn at most before the contacts are said to be out of reach."""
BASE_LOW: Final = (-0.6, -0.5, 0.3)
"""The box of the base over the middle of the soles, in leg lengths."""
BASE_HIGH: Final = (0.6, 0.5, 1.35)
LENGTH_DRAWS: Final = 4096
SPREADS: Final = (0.1, 0.3, 1.0)
"""A search starts from the best so far or from the reference posture, with normal noise of one of these (m, rad)."""
WALK_M: Final = 0.05
"""First step of a walk towards an end of the support; it is halved down to ``END_M`` where no posture is found."""
END_M: Final = 0.004
WALKS: Final = 60
"""Steps of a walk at most."""


@dataclass(frozen=True)
class Range:
    """Intervals (rad) of the trunk's roll, pitch and yaw, the last from the mean heading of the soles.

    ``extension`` bounds the distance from the third joint of a leg to its last but one, over the longest.
    """

    roll_rad: Interval = (-0.5, 0.5)
    pitch_rad: Interval = (-0.6, 1.0)
    yaw_rad: Interval = (-0.7, 0.7)
    extension: Interval = (0.0, 1.0)


ANY: Final = Range()
"""Any posture that the joints allow, of a trunk that neither lies nor looks away."""
_UPRIGHT_RAD: Final = float(np.radians(20.0))
STANDING: Final = Range(*(((-_UPRIGHT_RAD, _UPRIGHT_RAD),) * 3), extension=(0.62, 0.97))
"""Much what the measure ``conditioned`` asks of a posture: the trunk upright, its cone of 20 degrees as a box, and the
knees bent. Its step is left out, and its bounds of the knees are not followed: what judges does not move with what it
judges.
"""


class Contacts(NamedTuple):
    """Many contact sets of the same effectors, and the mean headings of their soles."""

    targets: Mapping[str, Target]
    heading_rad: Series

    @staticmethod
    def of(robot: Robot, sets: Sequence[Mapping[str, Placement]]) -> "Contacts":
        """From the ``T_world_contact`` of every effector of every set."""
        targets = {}
        for name in sets[0]:
            p, R = (np.array([getattr(one[name], part) for one in sets]) for part in ("position_m", "rotation"))
            targets[name] = Target(p, R if robot.effectors[name].kind == "surface" else None)
        ahead = np.sum([target.R[:, :2, 0] for target in targets.values() if target.R is not None], axis=0)
        return Contacts(targets, np.arctan2(ahead[:, 1], ahead[:, 0]))

    def taken(self, of: Int[np.ndarray, "m"]) -> "Contacts":
        """Those with these numbers, repeated where a number is."""
        targets = {name: Target(p[of], None if R is None else R[of]) for name, (p, R) in self.targets.items()}
        return Contacts(targets, self.heading_rad[of])

    @property
    def middle_m(self) -> Points:
        """The middle of the soles."""
        return np.asarray(np.mean([p for p, R in self.targets.values() if R is not None], axis=0))


class StanceTruth:
    """Postures of one robot within a ``Range``. One per process: the collision check keeps buffers."""

    def __init__(self, robot: Robot, within: Range = STANDING) -> None:
        self.robot, self.within = robot, within
        self._collision = SelfCollision.of(robot)
        self._tree = BodyTree.of(robot)
        self._model, frames = with_contact_frames(robot)
        self._chains = {name: LegChain.of(self._model, frames[name]) for name in robot.effectors}
        self._data = self._model.createData()
        self._reference = self._tree.x(robot.q_reference[None])[0]
        lower, upper = self._tree.lower.copy(), self._tree.upper.copy()
        lengths = []
        for name, effector in robot.effectors.items():
            if effector.kind == "surface":
                chain = self._chains[name]
                draws = chain.draw(LENGTH_DRAWS, np.random.default_rng(0))
                lengths.append(np.linalg.norm(chain.placed(draws)[0] - chain.joints[0].p, axis=1).max())
                knee = BASE + chain.columns[3] - 7
                lower[knee], upper[knee] = _bend(chain, within.extension)
        self.leg_length_m = float(np.mean(lengths))
        self._lower, self._upper = lower, upper

    def sample(self, contacts: Mapping[str, Placement], n: int, seed: int) -> Points:
        """CoM ``(n, 3)`` of ``n`` postures that hold ``contacts``; raises as ``postures``, which has them."""
        q = self.postures(contacts, n, seed)
        return np.array([pin.centerOfMass(self._model, self._data, one, False).copy() for one in q])

    def postures(self, contacts: Mapping[str, Placement], n: int, seed: int) -> Float[np.ndarray, "n nq"]:
        """``n`` configurations that hold ``contacts``, uniform as above.

        Raises ``NotEstimable`` (``contacts-out-of-reach``).
        """
        rng = np.random.default_rng(seed)
        one = Contacts.of(self.robot, [contacts])
        found: list[Float[np.ndarray, "nq"]] = []
        for _ in range(BATCHES):
            for q in self._drawn(one.taken(np.zeros(BATCH, dtype=int)), rng):
                if not self._collision.found(q):
                    found.append(q)
                if len(found) == n:
                    return np.array(found)
        raise NotEstimable(
            "contacts-out-of-reach",
            f"{self.robot.title} took {len(found)} of {n} postures on these contacts in {BATCH * BATCHES} draws.",
        )

    def feasible(
        self, contacts: Contacts, com_m: Points, rounds: int, seed: int
    ) -> tuple[Mask, Float[np.ndarray, "rounds"]]:
        """Whether a posture was found for each CoM ``(n, 3)``, and the share that was found after every round.

        A search that finds nothing proves nothing: the shares say how far they still rise.
        """
        rng = np.random.default_rng(seed)
        directions = np.tile(np.eye(3), (len(com_m), 1, 1))
        found, shares = np.zeros(len(com_m), dtype=bool), np.empty(rounds)
        start = self._started(contacts, com_m)
        for k in range(rounds):
            left = np.flatnonzero(~found)
            x = self._shaken(start[left], rng) if k else start[left]
            _, free = self._solved(contacts.taken(left), directions[left], com_m[left], x)
            found[left] = free
            shares[k] = found.mean()
        return found, shares

    def extent(self, contacts: Contacts, walkers: int, seed: int) -> tuple[Points, Points, Mask]:
        """Least and largest coordinates ``(n, 3)`` of the CoM over all postures, and whether there is any posture.

        ``walkers`` walks per direction start from postures found at random and go on as long as one is found that
        has its CoM farther out; the farthest counts. Where there is no posture, the least is above the largest.
        """
        rng = np.random.default_rng(seed)
        n = len(contacts.heading_rad)
        of = np.repeat(np.arange(n), 6 * walkers)
        axis = np.tile(np.repeat(np.arange(6), walkers), n)
        repeated = contacts.taken(of)
        directions = (np.vstack([np.eye(3), -np.eye(3)])[axis])[:, None, :]
        nowhere = np.zeros_like(directions)
        x = self._started(repeated, repeated.middle_m + np.array([0.0, 0.0, 0.8 * self.leg_length_m]))
        alive = np.zeros(len(of), dtype=bool)
        for _ in range(4):
            left = np.flatnonzero(~alive)
            shaken = self._shaken(x[left], rng)
            y, free = self._solved(repeated.taken(left), nowhere[left], np.zeros((len(left), 1)), shaken)
            x[left[free]], alive[left[free]] = y[free], True
        c, _ = self._tree.com(self._tree.forward(x))
        reached = np.where(alive, (directions[:, 0] * c).sum(axis=1), -np.inf)
        step = np.where(alive, WALK_M, 0.0)
        for _ in range(WALKS):
            left = np.flatnonzero(step >= END_M)
            if not len(left):
                break
            goal = reached[left] + step[left]
            y, free = self._solved(repeated.taken(left), directions[left], goal[:, None], x[left])
            x[left[free]], reached[left[free]] = y[free], goal[free]
            step[left[~free]] /= 2
        ends = reached.reshape(n, 6, walkers).max(axis=2)
        return -ends[:, 3:], ends[:, :3], np.isfinite(ends).all(axis=1)

    def _drawn(self, contacts: Contacts, rng: np.random.Generator) -> Float[np.ndarray, "n nq"]:
        """Postures within the limits, whether or not they touch themselves."""
        n, model, within = len(contacts.heading_rad), self._model, self.within
        turns = [rng.uniform(*interval, n) for interval in (within.yaw_rad, within.pitch_rad, within.roll_rad)]
        turns[0] = turns[0] + contacts.heading_rad
        R_root_trunk = ScipyRotation.from_matrix(self.robot.R_root_trunk)
        rotation = ScipyRotation.from_euler("ZYX", np.column_stack(turns)) * R_root_trunk.inv()
        R_back = rotation.as_matrix().swapaxes(1, 2)
        box = self.leg_length_m * rng.uniform(BASE_LOW, BASE_HIGH, (n, 3))
        p_base = contacts.middle_m + ScipyRotation.from_euler("Z", contacts.heading_rad[:, None]).apply(box)
        q = np.hstack(
            [
                p_base,
                rotation.as_quat(),
                rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:], (n, model.nq - 7)),
            ]
        )
        kept = np.arange(n)
        for name, (p, R) in contacts.targets.items():
            chain = self._chains[name]
            columns = list(chain.columns)
            p_limb = (R_back[kept] @ (p[kept] - p_base[kept])[..., None])[..., 0]
            if R is not None:
                near = np.linalg.norm(p_limb - chain.joints[0].p, axis=1) <= self.leg_length_m * 1.05
                kept, p_limb = kept[near], p_limb[near]
                start, R_limb = np.tile(self.robot.q_reference[columns], (len(kept), 1)), R_back[kept] @ R[kept]
            else:
                start, R_limb = q[kept][:, columns], None
            angles, reached = chain.reach(p_limb, R_limb, start)
            x_columns = np.array(columns) - 7 + BASE
            inside = ((angles >= self._lower[x_columns]) & (angles <= self._upper[x_columns])).all(axis=1)
            q[kept[:, None], columns] = angles
            kept = kept[reached & inside]
        return np.asarray(q[kept])

    def _started(self, contacts: Contacts, com_m: Points) -> Coordinates:
        """The reference posture with its CoM where it is to be, turned to the heading."""
        x = np.tile(self._reference, (len(com_m), 1))
        x[:, YAW] += contacts.heading_rad
        c, _ = self._tree.com(self._tree.forward(x))
        x[:, :3] += com_m - c
        return x

    def _shaken(self, x: Coordinates, rng: np.random.Generator) -> Coordinates:
        """With normal noise, of one size per posture."""
        size = rng.choice(SPREADS, (len(x), 1)) * np.where(np.arange(x.shape[1]) < BASE, 0.3, 1.0)
        return np.asarray(x + size * rng.standard_normal(x.shape))

    def _solved(
        self, contacts: Contacts, directions: Directions, com_m: Float[np.ndarray, "n r"], start: Coordinates
    ) -> tuple[Coordinates, Mask]:
        """Postures from ``start`` on, and which of them hold the contacts and do not touch themselves."""
        lower, upper = np.tile(self._lower, (len(start), 1)), np.tile(self._upper, (len(start), 1))
        within = self.within
        for k, interval in zip(range(YAW, ROLL + 1), (within.yaw_rad, within.pitch_rad, within.roll_rad), strict=True):
            lower[:, k], upper[:, k] = interval
        lower[:, YAW] += contacts.heading_rad
        upper[:, YAW] += contacts.heading_rad
        x, solved = self._tree.solve(
            contacts.targets, directions, com_m, start, (lower, upper), np.clip(start, lower, upper)
        )
        q = self._tree.q(x)
        free = np.array([ok and not self._collision.found(one) for ok, one in zip(solved, q, strict=True)], dtype=bool)
        return x, free


def _bend(chain: LegChain, extension: Interval) -> Interval:
    """The angles of a leg's fourth joint between which it is extended so far; the knee of every robot bends one way."""
    knee = np.linspace(chain.lower_rad[3], chain.upper_rad[3], 2001)
    angles = np.zeros((len(knee), len(chain.joints)))
    angles[:, 3] = knee
    span = chain.span_m(angles, 2, -2)
    inside = knee[
        (span >= extension[0] * span.max()) & (span <= extension[1] * span.max()) & (knee >= knee[span.argmax()])
    ]
    return float(inside[0]), float(inside[-1])
