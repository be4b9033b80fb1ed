"""Sampling of the measure ``conditioned``: postures of a standing robot, by inverse kinematics of the legs.

Uniform joint angles give mostly folded postures: the mode of TALOS' CoM is 0.13 m above the sole and half a metre
behind it. Here the variables of a planner are uniform: the placement of the second sole, the pose of the base over both
soles and the joints that are not in the legs. The legs follow by inverse kinematics, and a posture is accepted if it is
in the event ``E`` (``Stance``), within the joint limits and free of collision with itself and with a step:

    p_2, p_base, R_base, q_rest ~ U,    q_leg = IK(T_base^-1 T_sole),    accepted if in E and free

The first sole is at the world origin, its normal vertical. The step is a box across the path of a sole that rises ahead
of its toes, like the next stair; it is checked against the links between hip and ankle.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Configurations, Mask, Points, Rotations, Vector3
from stridelab.errors import Fault, NotEstimable
from stridelab.reachability.kinematics.leg_ik import LegChain
from stridelab.reachability.standing_conditions import Stance, axis_rotations
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision


@dataclass(frozen=True, eq=False)
class StepClearance:
    """Clearance check of one leg: its links, the index of the contact frame, and the distance to the step.

    ``depth_m`` is the size of the step along the sole and across it.
    """

    links: Sequence[pin.GeometryObject]
    frame: int
    begins_m: float
    depth_m: float

    @staticmethod
    def for_effector(
        robot: Robot, effector: str, frame: int, joints: Sequence[int], gap_m: float, depth_m: float
    ) -> "StepClearance":
        """Create for the sole ``effector`` on a leg of ``joints``, the last two of which are the ankle."""
        moved = set(joints[:-2])
        half_m = robot.effectors[effector].contact_half_size_m
        return StepClearance(
            [part for part in robot.collision.geometryObjects if part.parentJoint in moved],
            frame,
            gap_m + (half_m[0] if half_m is not None else 0.0),
            depth_m,
        )

    def is_clear(self, data: pin.Data, height_m: float) -> bool:
        """Whether no link collides with a step of ``height_m``; ``data`` must contain joint and frame placements."""
        box = coal.Box(self.depth_m, self.depth_m, height_m)
        middle = np.array([self.begins_m + self.depth_m / 2, 0.0, height_m / 2])
        T_world_box = _to_coal(data.oMf[self.frame] * pin.SE3(np.eye(3), middle))
        request = coal.CollisionRequest()
        return not any(
            coal.collide(
                part.geometry,
                _to_coal(data.oMi[part.parentJoint] * part.placement),
                box,
                T_world_box,
                request,
                coal.CollisionResult(),
            )
            for part in self.links
        )


def _to_coal(T: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(T.rotation, T.translation)


BATCH: Final = 5000
"""Stances per batch."""
MAX_EMPTY_BATCHES: Final = 200
"""Consecutive batches without a stance after which sampling fails."""
MAX_REJECTIONS: Final = 10_000
"""Consecutive colliding stances after which sampling fails."""
LENGTH_DRAWS: Final = 4096
BASE_LOW: Final = (-0.6, -0.5, 0.3)
"""Lower corner of the sampling box of the hips' midpoint over that of the soles, in leg lengths along the heading. No
leg reaches above the box, and few stances lie beyond its sides."""
BASE_HIGH: Final = (0.6, 0.5, 1.0)
STEP_DEPTH: Final = 0.75
"""Size of the step, in leg lengths."""


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg; ``hip_m`` is the origin of its first joint in the base, ``longest_m`` its longest hip to ankle span."""

    chain: LegChain
    hip_m: Vector3
    length_m: float
    longest_m: float
    start_rad: Float[np.ndarray, "j"]
    step: StepClearance

    def relative_extension(self, angles_rad: Float[np.ndarray, "n j"]) -> Float[np.ndarray, "n"]:
        """Distance from the third joint to the last but one, relative to the longest one."""
        return self.chain.span_m(angles_rad, 2, -2) / self.longest_m


class StandingConfigurations(Iterator[Float[np.ndarray, "nq"]]):
    """An endless stream of configurations of a standing robot; ``tried`` counts all stances, including colliding ones.

    Raises ``NotEstimable`` (``measure-unavailable``) for a robot without two soles on legs of their own.
    """

    def __init__(self, robot: Robot, rng: np.random.Generator, stance: Stance | None = None) -> None:
        self.tried = 0
        self._robot, self._rng, self._stance = robot, rng, stance or Stance()
        self._collision = SelfCollision(robot)
        self._model, frames = with_contact_frames(robot)
        self._data = self._model.createData()
        self._legs, self._side = _find_legs(robot, self._model, frames, self._stance)
        self.leg_length_m = float(np.mean([leg.length_m for leg in self._legs]))
        self._waiting: list[Float[np.ndarray, "nq"]] = []

    def __next__(self) -> Float[np.ndarray, "nq"]:
        """Next configuration. Raises ``NotEstimable`` (``no-free-configuration``)."""
        step_m = self._stance.step * self.leg_length_m
        for _ in range(MAX_REJECTIONS):
            q = self._draw_stance()
            height_m = self._rng.uniform(0.0, step_m)
            self.tried += 1
            if self._collision.any_collision(q):
                continue
            pin.framesForwardKinematics(self._model, self._data, q)
            if all(leg.step.is_clear(self._data, height_m) for leg in self._legs):
                return q
        raise NotEstimable(
            "no-free-configuration",
            f"{self._robot.title} collides with itself or a step in {MAX_REJECTIONS} consecutive stances.",
        )

    def _draw_stance(self) -> Float[np.ndarray, "nq"]:
        """Draw a configuration in ``E``, without collision checks."""
        for _ in range(MAX_EMPTY_BATCHES):
            if self._waiting:
                return self._waiting.pop()
            self._waiting = list(self._draw_batch(BATCH))
        raise NotEstimable("no-free-configuration", f"{self._robot.title} has no valid posture in random stances.")

    def _draw_batch(self, n: int) -> Configurations:
        """Draw ``n`` stances and return those in ``E``."""
        model, rng, E, length_m = self._robot.model, self._rng, self._stance, self.leg_length_m
        second, turn = E.draw_soles(n, self._side, rng)
        R_second = axis_rotations(2, turn)
        heading = axis_rotations(2, turn / 2)
        R_trunk = E.draw_trunks(turn / 2, rng)
        R_base = R_trunk @ self._robot.R_root_trunk.T
        hips = length_m * ((heading @ rng.uniform(BASE_LOW, BASE_HIGH, (n, 3))[..., None])[..., 0] + second / 2)
        p_base = hips - R_base @ np.mean([leg.hip_m for leg in self._legs], axis=0)
        q = np.tile(self._robot.q_reference, (n, 1))
        q[:, 7:] = rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:], (n, model.nq - 7))
        q[:, :3], q[:, 3:7] = p_base, ScipyRotation.from_matrix(R_base).as_quat()

        first_in_second = (R_second.swapaxes(1, 2) @ -second[..., None])[..., 0]
        accepted = np.flatnonzero(E.is_upright(R_trunk) & E.within_step(first_in_second, -self._side))
        flat = np.broadcast_to(np.eye(3), (n, 3, 3))
        soles = ((np.zeros((n, 3)), flat), (length_m * second, R_second))
        for leg, (p, R) in zip(self._legs, soles, strict=True):
            angles, reached = self._solve_leg(leg, p[accepted], R[accepted], p_base[accepted], R_base[accepted])
            q[accepted[:, None], leg.chain.indices_in_q] = angles
            accepted = accepted[reached]
        return np.asarray(q[accepted])

    def _solve_leg(
        self, leg: Leg, p: Points, R: Rotations, p_base: Points, R_base: Rotations
    ) -> tuple[Float[np.ndarray, "n j"], Mask]:
        """Angles of one leg on its sole, and whether they are in ``E`` and strictly within the joint limits."""
        R_back = R_base.swapaxes(1, 2)
        p_sole, R_sole = (R_back @ (p - p_base)[..., None])[..., 0], R_back @ R
        angles = np.tile(leg.start_rad, (len(p), 1))
        near = np.flatnonzero(np.linalg.norm(p_sole - leg.hip_m, axis=1) <= leg.length_m)
        angles[near], reached = leg.chain.solve_angles(p_sole[near], R_sole[near], angles[near])
        ok = np.zeros(len(p), dtype=bool)
        ok[near] = reached
        least, most = self._stance.extension
        extension = leg.relative_extension(angles)
        inside = ((angles > leg.chain.lower_rad) & (angles < leg.chain.upper_rad)).all(axis=1)
        return angles, ok & inside & (extension >= least) & (extension <= most)


def _find_legs(
    robot: Robot, model: pin.Model, frames: Mapping[str, int], stance: Stance
) -> tuple[tuple[Leg, Leg], float]:
    """The two legs, and the side of the second sole relative to the first: +1 for left."""
    soles = [name for name, effector in robot.effectors.items() if effector.kind == "surface"]
    chains = {name: LegChain.from_frame(model, frames[name]) for name in soles}
    columns = [column for chain in chains.values() for column in chain.indices_in_q]
    if len(soles) != 2 or len(set(columns)) < len(columns) or min(len(c.joints) for c in chains.values()) < 6:
        message = f"{robot.title} needs two soles on separate legs of at least six joints for this measure."
        raise NotEstimable("measure-unavailable", message, [Fault("measure", "needs two legs")])
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    first, second = (_build_leg(robot, model, frames, name, chains[name], stance) for name in soles)
    second_m = data.oMf[frames[soles[0]]].actInv(data.oMf[frames[soles[1]]].translation)
    return (first, second), float(np.sign(second_m[1]))


def _build_leg(
    robot: Robot, model: pin.Model, frames: Mapping[str, int], name: str, chain: LegChain, stance: Stance
) -> Leg:
    draws = chain.draw_angles(LENGTH_DRAWS, np.random.default_rng(0))
    p, _ = chain.contact_frame_pose(draws)
    hip_m = chain.joints[0].p
    length_m = float(np.linalg.norm(p - hip_m, axis=1).max())
    joints = list(model.supports[model.frames[frames[name]].parentJoint])[2:]
    return Leg(
        chain=chain,
        hip_m=hip_m,
        length_m=length_m,
        longest_m=float(chain.span_m(draws, 2, -2).max()),
        start_rad=robot.q_reference[list(chain.indices_in_q)],
        step=StepClearance.for_effector(
            robot, name, frames[name], joints, stance.toe_gap * length_m, STEP_DEPTH * length_m
        ),
    )
