"""Ground truth for the proxy (4.12): postures of a robot on fixed contacts, by inverse kinematics.

The distribution is that of section 4.3.3.2: uniform over the postures on the contacts. The base pose and the joints of
free limbs are drawn, limbs in contact follow by inverse kinematics, and a posture is accepted if it is within the
joint limits and free of self-collision:

    p_base, R_base, q_rest ~ U,     q_limb = IK(T_base^-1 T_contact),     x = c(q)

A sole constrains all six coordinates, a hand three (it can rotate about the rail). Near the boundary of the support,
sampling cannot decide whether *some* posture has its CoM at a given position; ``search_feasible`` searches for one, and
``com_bounds`` searches for the bounds of the support.
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
MAX_BATCHES: Final = 400
"""Maximum number of batches before the contacts count as out of reach."""
BASE_LOW: Final = (-0.6, -0.5, 0.3)
"""Lower corner of the sampling box of the base relative to the mean of the soles, in leg lengths."""
BASE_HIGH: Final = (0.6, 0.5, 1.35)
LENGTH_DRAWS: Final = 4096
NOISE_SD: Final = (0.1, 0.3, 1.0)
"""Standard deviations (m, rad) of the noise that is added to the starting postures of a search."""
FIRST_STEP_M: Final = 0.05
"""First step of a walk towards the boundary of the support; halved to ``LAST_STEP_M`` while infeasible."""
LAST_STEP_M: Final = 0.004
MAX_WALK_STEPS: Final = 60
"""Maximum number of steps of a walk."""


@dataclass(frozen=True)
class PostureRange:
    """Intervals (rad) of the trunk's roll, pitch and yaw, the latter relative to the mean heading of the soles.

    ``extension`` bounds the distance from the third joint of a leg to its last but one, relative to the longest.
    """

    roll_rad: Interval = (-0.5, 0.5)
    pitch_rad: Interval = (-0.6, 1.0)
    yaw_rad: Interval = (-0.7, 0.7)
    extension: Interval = (0.0, 1.0)


ANY_POSTURE: Final = PostureRange()
"""All postures within the joint limits with a roughly upright trunk that faces forward."""
FREE_TRUNK: Final = PostureRange((-1.8, 1.8), (-np.pi / 2, np.pi / 2), (-2.2, 2.2))
"""Postures within the joint limits with a free trunk, as for densities of uniform joints: beyond these angles the legs
of the robots do not reach the ground."""
_UPRIGHT_RAD: Final = float(np.radians(20.0))
STANDING_POSTURE: Final = PostureRange(*(((-_UPRIGHT_RAD, _UPRIGHT_RAD),) * 3), extension=(0.62, 0.97))
"""Approximates the conditions of the measure ``conditioned``: upright trunk (its cone of 20 degrees as a box) and bent
knees. The step is ignored and the knee bounds are fixed, so that the ground truth does not change with the measure.
"""


class ContactBatch(NamedTuple):
    """A batch of contact sets of the same effectors, and the mean headings of their soles."""

    targets: Mapping[str, Target]
    heading_rad: Series

    @staticmethod
    def from_placements(robot: Robot, sets: Sequence[Mapping[str, Placement]]) -> "ContactBatch":
        """Create from the ``T_world_contact`` of every effector of every set."""
        targets = {}
        for name in sets[0]:
            p, R = (np.array([getattr(one[name], part) for one in sets]) for part in ("position_m", "rotation"))
            targets[name] = Target(p, R if robot.effectors[name].kind == "surface" else None)
        ahead = np.sum([target.R[:, :2, 0] for target in targets.values() if target.R is not None], axis=0)
        return ContactBatch(targets, np.arctan2(ahead[:, 1], ahead[:, 0]))

    def select(self, indices: Int[np.ndarray, "m"]) -> "ContactBatch":
        """Select sets by index; indices may repeat."""
        targets = {name: Target(p[indices], None if R is None else R[indices]) for name, (p, R) in self.targets.items()}
        return ContactBatch(targets, self.heading_rad[indices])

    @property
    def middle_m(self) -> Points:
        """Mean position of the soles ``(n, 3)``."""
        return np.asarray(np.mean([p for p, R in self.targets.values() if R is not None], axis=0))


class StanceTruth:
    """Postures of one robot within a ``PostureRange``; use one per process."""

    def __init__(self, robot: Robot, within: PostureRange = STANDING_POSTURE) -> None:
        self.robot, self.within = robot, within
        self._collision = SelfCollision(robot)
        self._tree = BodyTree.from_robot(robot)
        self._model, frames = with_contact_frames(robot)
        self._chains = {name: LegChain.from_frame(self._model, frames[name]) for name in robot.effectors}
        self._data = self._model.createData()
        self._reference = self._tree.to_coordinates(robot.q_reference[None])[0]
        lower, upper = self._tree.lower.copy(), self._tree.upper.copy()
        lengths = []
        for name, effector in robot.effectors.items():
            if effector.kind == "surface":
                chain = self._chains[name]
                draws = chain.draw_angles(LENGTH_DRAWS, np.random.default_rng(0))
                lengths.append(np.linalg.norm(chain.contact_frame_pose(draws)[0] - chain.joints[0].p, axis=1).max())
                knee = BASE + chain.indices_in_q[3] - 7
                lower[knee], upper[knee] = _knee_interval(chain, within.extension)
        self.leg_length_m = float(np.mean(lengths))
        self._lower, self._upper = lower, upper

    def sample_com(self, contacts: Mapping[str, Placement], n: int, seed: int) -> Points:
        """CoM ``(n, 3)`` of ``n`` postures on ``contacts``. Raises as ``sample_postures``."""
        q = self.sample_postures(contacts, n, seed)
        return np.array([pin.centerOfMass(self._model, self._data, one, False).copy() for one in q])

    def sample_postures(self, contacts: Mapping[str, Placement], n: int, seed: int) -> Float[np.ndarray, "n nq"]:
        """``n`` configurations on ``contacts`` from the distribution above.

        Raises ``NotEstimable`` (``contacts-out-of-reach``).
        """
        rng = np.random.default_rng(seed)
        one = ContactBatch.from_placements(self.robot, [contacts])
        accepted: list[Float[np.ndarray, "nq"]] = []
        for _ in range(MAX_BATCHES):
            for q in self._draw_postures(one.select(np.zeros(BATCH, dtype=int)), rng):
                if not self._collision.any_collision(q):
                    accepted.append(q)
                if len(accepted) == n:
                    return np.array(accepted)
        raise NotEstimable(
            "contacts-out-of-reach",
            f"{self.robot.title} has {len(accepted)} of {n} required postures on these contacts after "
            f"{BATCH * MAX_BATCHES} draws.",
        )

    def search_feasible(
        self, contacts: ContactBatch, com_m: Points, rounds: int, seed: int
    ) -> tuple[Mask, Float[np.ndarray, "rounds"]]:
        """Search a posture for each CoM ``(n, 3)``; return which have one, and the share that has after every round.

        A failed search does not prove infeasibility; the shares show how far the search has converged.
        """
        rng = np.random.default_rng(seed)
        directions = np.tile(np.eye(3), (len(com_m), 1, 1))
        is_feasible, shares = np.zeros(len(com_m), dtype=bool), np.empty(rounds)
        start = self._initial_postures(contacts, com_m)
        for k in range(rounds):
            remaining = np.flatnonzero(~is_feasible)
            x = self._add_noise(start[remaining], rng) if k else start[remaining]
            _, free = self._solve_postures(contacts.select(remaining), directions[remaining], com_m[remaining], x)
            is_feasible[remaining] = free
            shares[k] = is_feasible.mean()
        return is_feasible, shares

    def com_bounds(self, contacts: ContactBatch, walkers: int, seed: int) -> tuple[Points, Points, Mask]:
        """Lower and upper bounds ``(n, 3)`` of the CoM over all postures, and whether any posture exists.

        ``walkers`` walks per direction start from random postures and continue while a posture with its CoM farther
        out is feasible; the farthest one counts. Without any posture, the lower bound is above the upper one.
        """
        rng = np.random.default_rng(seed)
        n = len(contacts.heading_rad)
        of = np.repeat(np.arange(n), 6 * walkers)
        axis = np.tile(np.repeat(np.arange(6), walkers), n)
        repeated = contacts.select(of)
        directions = (np.vstack([np.eye(3), -np.eye(3)])[axis])[:, None, :]
        nowhere = np.zeros_like(directions)
        x = self._initial_postures(repeated, repeated.middle_m + np.array([0.0, 0.0, 0.8 * self.leg_length_m]))
        alive = np.zeros(len(of), dtype=bool)
        for _ in range(4):
            remaining = np.flatnonzero(~alive)
            shaken = self._add_noise(x[remaining], rng)
            y, free = self._solve_postures(
                repeated.select(remaining), nowhere[remaining], np.zeros((len(remaining), 1)), shaken
            )
            x[remaining[free]], alive[remaining[free]] = y[free], True
        c, _ = self._tree.com_and_jacobian(self._tree.forward_kinematics(x))
        reached = np.where(alive, (directions[:, 0] * c).sum(axis=1), -np.inf)
        step = np.where(alive, FIRST_STEP_M, 0.0)
        for _ in range(MAX_WALK_STEPS):
            remaining = np.flatnonzero(step >= LAST_STEP_M)
            if not len(remaining):
                break
            goal = reached[remaining] + step[remaining]
            y, free = self._solve_postures(
                repeated.select(remaining), directions[remaining], goal[:, None], x[remaining]
            )
            x[remaining[free]], reached[remaining[free]] = y[free], goal[free]
            step[remaining[~free]] /= 2
        ends = reached.reshape(n, 6, walkers).max(axis=2)
        return -ends[:, 3:], ends[:, :3], np.isfinite(ends).all(axis=1)

    def _draw_postures(self, contacts: ContactBatch, rng: np.random.Generator) -> Float[np.ndarray, "n nq"]:
        """Draw postures within the limits, without checking self-collision."""
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
        accepted = np.arange(n)
        for name, (p, R) in contacts.targets.items():
            chain = self._chains[name]
            columns = list(chain.indices_in_q)
            p_limb = (R_back[accepted] @ (p[accepted] - p_base[accepted])[..., None])[..., 0]
            if R is not None:
                near = np.linalg.norm(p_limb - chain.joints[0].p, axis=1) <= self.leg_length_m * 1.05
                accepted, p_limb = accepted[near], p_limb[near]
                start, R_limb = (
                    np.tile(self.robot.q_reference[columns], (len(accepted), 1)),
                    R_back[accepted] @ R[accepted],
                )
            else:
                start, R_limb = q[accepted][:, columns], None
            angles, reached = chain.solve_angles(p_limb, R_limb, start)
            x_columns = np.array(columns) - 7 + BASE
            inside = ((angles >= self._lower[x_columns]) & (angles <= self._upper[x_columns])).all(axis=1)
            q[accepted[:, None], columns] = angles
            accepted = accepted[reached & inside]
        return np.asarray(q[accepted])

    def _initial_postures(self, contacts: ContactBatch, com_m: Points) -> Coordinates:
        """The reference posture moved to the given CoM and turned to the heading."""
        x = np.tile(self._reference, (len(com_m), 1))
        x[:, YAW] += contacts.heading_rad
        c, _ = self._tree.com_and_jacobian(self._tree.forward_kinematics(x))
        x[:, :3] += com_m - c
        return x

    def _add_noise(self, x: Coordinates, rng: np.random.Generator) -> Coordinates:
        """Add normal noise, with one standard deviation per posture."""
        size = rng.choice(NOISE_SD, (len(x), 1)) * np.where(np.arange(x.shape[1]) < BASE, 0.3, 1.0)
        return np.asarray(x + size * rng.standard_normal(x.shape))

    def _solve_postures(
        self, contacts: ContactBatch, directions: Directions, com_m: Float[np.ndarray, "n r"], start: Coordinates
    ) -> tuple[Coordinates, Mask]:
        """Solve from ``start``; return the postures and which are on the contacts and free of self-collision."""
        lower, upper = np.tile(self._lower, (len(start), 1)), np.tile(self._upper, (len(start), 1))
        within = self.within
        for k, interval in zip(range(YAW, ROLL + 1), (within.yaw_rad, within.pitch_rad, within.roll_rad), strict=True):
            lower[:, k], upper[:, k] = interval
        lower[:, YAW] += contacts.heading_rad
        upper[:, YAW] += contacts.heading_rad
        x, solved = self._tree.solve(
            contacts.targets, directions, com_m, start, (lower, upper), np.clip(start, lower, upper)
        )
        q = self._tree.to_configurations(x)
        free = np.array(
            [ok and not self._collision.any_collision(one) for ok, one in zip(solved, q, strict=True)], dtype=bool
        )
        return x, free


def _knee_interval(chain: LegChain, extension: Interval) -> Interval:
    """Interval of a leg's fourth joint (knee, which bends one way) in which its extension is in ``extension``."""
    knee = np.linspace(chain.lower_rad[3], chain.upper_rad[3], 2001)
    angles = np.zeros((len(knee), len(chain.joints)))
    angles[:, 3] = knee
    span = chain.span_m(angles, 2, -2)
    inside = knee[
        (span >= extension[0] * span.max()) & (span <= extension[1] * span.max()) & (knee >= knee[span.argmax()])
    ]
    return float(inside[0]), float(inside[-1])
