"""The measure ``conditioned``: uniform configurations, given that the robot stands.

Of the uniform measure most postures are folded: the densest place of TALOS' CoM lies 0.13 m above the sole. Here the
same measure is conditioned on an event ``E`` that concerns the legs only (``Stance``): the base is upright over every
sole, and the soles lie to each other as in a step. The law is exactly p(q | E, no self-collision), in three stages of
rejection, each of which throws away only what cannot be in ``E``:

    each leg by itself, until the base is upright over its sole    (the joints are independent)
    all legs together, until ``E`` holds
    the other joints, until nothing collides; else the legs are drawn anew too
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Mask, Points
from stridelab.errors import Fault, NotEstimable
from stridelab.reachability.leg_chain import LegChain, Rotations
from stridelab.robots.collision import SelfCollision
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot

BATCH: Final = 20_000
"""Leg postures drawn at once."""
BATCHES_PATIENCE: Final = 200
"""Batches without any stance before the robot is said to have none."""
PATIENCE: Final = 10_000
"""Stances tried in a row before the robot is said to have none that is free."""


@dataclass(frozen=True)
class Stance:
    """The event ``E``. Every condition holds seen from each sole, so that no foot is preferred.

    ``upright_deg`` bounds the angle between the base's z axis and the normal of each sole, and between the normals;
    ``turned_deg`` the heading of one sole in another; ``ahead_m``, ``above_m`` and ``aside_m`` (least, most; on the
    side on which the reference posture has it) where the other sole is.
    """

    upright_deg: float = 20.0
    turned_deg: float = 35.0
    ahead_m: float = 0.7
    above_m: float = 0.25
    aside_m: tuple[float, float] = (0.12, 0.5)

    def upright(self, R_base_sole: Rotations) -> Mask:
        """Whether the base stands upright over one sole."""
        return np.asarray(R_base_sole[:, 2, 2] >= np.cos(np.radians(self.upright_deg)))

    def stepped(self, p: Points, R: Rotations, side: float) -> Mask:
        """Whether a sole placed at ``(p, R)`` in another one is where a step may put it; ``side`` is +1 to the left."""
        heading = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        least, most = self.aside_m
        return np.asarray(
            (R[:, 2, 2] >= np.cos(np.radians(self.upright_deg)))
            & (np.abs(heading) <= np.radians(self.turned_deg))
            & (np.abs(p[:, 0]) <= self.ahead_m)
            & (np.abs(p[:, 2]) <= self.above_m)
            & (side * p[:, 1] >= least)
            & (side * p[:, 1] <= most)
        )


class StandingConfigurations(Iterator[Float[np.ndarray, "nq"]]):
    """An endless stream of configurations of a standing robot; ``tried`` counts stances, also those that collide.

    The base stays where it is in the reference posture. Raises ``NotEstimable`` (``measure-unavailable``) for a robot
    without two soles on legs of their own.
    """

    def __init__(self, robot: Robot, rng: np.random.Generator, stance: Stance | None = None) -> None:
        self.tried = 0
        self._robot, self._rng, self._stance = robot, rng, stance or Stance()
        self._legs, self._sides = _legs(robot)
        self._columns = [column for leg in self._legs.values() for column in leg.columns]
        self._collision = SelfCollision.of(robot)
        self._stances = self._drawn()

    def __next__(self) -> Float[np.ndarray, "nq"]:
        """Next configuration. Raises ``NotEstimable`` (``no-free-configuration``)."""
        model = self._robot.model
        q = self._robot.q_reference.copy()
        for _ in range(PATIENCE):
            legs = next(self._stances)
            q[7:] = self._rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
            q[self._columns] = legs
            self.tried += 1
            if not self._collision.found(q):
                return q
        raise NotEstimable(
            "no-free-configuration", f"{self._robot.title} touches itself in {PATIENCE} random stances in a row."
        )

    def _drawn(self) -> Iterator[Float[np.ndarray, "j"]]:
        """Angles of all legs in ``E``."""
        empty = 0
        while empty < BATCHES_PATIENCE:
            legs = {name: self._upright(leg) for name, leg in self._legs.items()}
            n = min(len(angles) for angles, _, _ in legs.values())
            kept = np.ones(n, dtype=bool)
            for (first, second), side in self._sides.items():
                (_, p1, R1), (_, p2, R2) = legs[first], legs[second]
                R1_inv = R1[:n].swapaxes(1, 2)
                p = (R1_inv @ (p2[:n] - p1[:n])[..., None])[..., 0]
                kept &= self._stance.stepped(p, R1_inv @ R2[:n], side)
            yield from np.hstack([angles[:n][kept] for angles, _, _ in legs.values()])
            empty = 0 if kept.any() else empty + 1
        raise NotEstimable("no-free-configuration", f"{self._robot.title} never stands in random configurations.")

    def _upright(self, leg: LegChain) -> tuple[Float[np.ndarray, "n j"], Points, Rotations]:
        angles = leg.draw(BATCH, self._rng)
        p, R = leg.placed(angles)
        kept = self._stance.upright(R)
        return angles[kept], p[kept], R[kept]


def _legs(robot: Robot) -> tuple[Mapping[str, LegChain], Mapping[tuple[str, str], float]]:
    """The chain to every sole, and on which side of the first of two soles the second is."""
    model, frames = with_contact_frames(robot)
    soles = [name for name, effector in robot.effectors.items() if effector.kind == "surface"]
    legs = {name: LegChain.of(model, frames[name]) for name in soles}
    columns = [column for leg in legs.values() for column in leg.columns]
    if len(soles) < 2 or len(set(columns)) < len(columns):
        message = f"{robot.title} has no two soles on legs of their own, so that stances cannot be drawn."
        raise NotEstimable("measure-unavailable", message, [Fault("measure", "needs two legs")])
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    sides = {
        (first, second): float(np.sign(data.oMf[frames[first]].actInv(data.oMf[frames[second]]).translation[1]))
        for first, second in permutations(soles, 2)
    }
    return legs, sides
