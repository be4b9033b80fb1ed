"""Samples the CoM of collision-free configurations in the frames of the effectors (section 4.3.2.2).

    x_a = T_frame_world(q_a) c(q_a)

with configurations ``q_a`` uniform within the joint limits, or conditioned on standing (``standing_sampler``), and
``frame`` the contact frame of the effector or, for a hand of a standing robot, its heading frame (``Frame``).

Each block of ``BLOCK`` configurations has its own child of the seed and its own collision buffers, so that the samples
depend only on the seed, bit for bit, and not on the number of processes.
"""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import combinations, islice
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Points, Progress
from stridelab.errors import Fault, NotFound
from stridelab.machine.parallel import map_in_order, worthwhile_processes
from stridelab.reachability.card import Measure
from stridelab.reachability.learning.standing_sampler import StandingConfigurations
from stridelab.reachability.proxy.effector_proxy import Frame
from stridelab.robots.configuration_sampling import UniformConfigurations, uniform_configurations
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Effector, Robot

BLOCK: Final = 500
"""Configurations of one block."""
BLOCKS_PER_S: Final = 4
"""Approximate number of blocks drawn per second."""


@dataclass(frozen=True, eq=False)
class ComCloud:
    """Sampled CoM positions ``(n, 3)`` by effector, in its ``frame``; row ``a`` of all is one configuration.

    ``pair_distance_max_m`` is the largest distance between the contact points of two effectors over the samples;
    ``tried`` counts the configurations checked for self-collision.
    """

    measure: Measure
    com_m: Mapping[str, Points]
    frames: Mapping[str, Frame]
    pair_distance_max_m: Mapping[tuple[str, str], float]
    tried: int


def sample_com(
    robot: Robot,
    effectors: Sequence[str],
    samples: int,
    seed: int,
    measure: Measure = "uniform",
    progress: Progress | None = None,
    processes: int | None = None,
) -> ComCloud:
    """CoM of ``samples`` configurations in the frames of ``effectors``, drawn by ``processes`` (None: all cores).

    Raises ``NotFound`` (``effector-not-found``), ``NotEstimable`` (``measure-unavailable``,
    ``no-free-configuration``).
    """
    require_effectors(robot, effectors)
    blocks = -(-samples // BLOCK)
    work = partial(_sample_block, robot, tuple(effectors), samples, seed, measure)
    sampled: list[_Block] = []
    with closing(map_in_order(work, blocks, processes or worthwhile_processes(blocks // BLOCKS_PER_S))) as done:
        for block in done:
            sampled.append(block)
            if progress is not None:
                count = min(len(sampled) * BLOCK, samples)
                progress(count / samples, f"{count} of {samples} postures")
    com = np.concatenate([block.com_m for block in sampled], axis=1)
    distance = np.max([block.distance_max_m for block in sampled], axis=0)
    numbered = combinations(enumerate(effectors), 2)
    return ComCloud(
        measure=measure,
        com_m=dict(zip(effectors, com, strict=True)),
        frames={name: frame_of(robot.effectors[name], measure) for name in effectors},
        pair_distance_max_m={(first, second): float(distance[i, j]) for (i, first), (j, second) in numbered},
        tried=sum(block.tried for block in sampled),
    )


def configuration_stream(
    robot: Robot, measure: Measure, rng: np.random.Generator
) -> UniformConfigurations | StandingConfigurations:
    """Endless stream of configurations ``(nq,)`` of a measure; ``tried`` counts the checked ones."""
    return StandingConfigurations(robot, rng) if measure == "conditioned" else uniform_configurations(robot, rng)


def frame_of(effector: Effector, measure: Measure) -> Frame:
    """The frame in which the CoM of an effector is expressed.

    The contact frame, as in the thesis. A hand on a rail can rotate about the bar, so that its gripper does not
    determine the direction of the CoM: the heading frame of the trunk is used for standing robots.
    """
    return "heading" if measure == "conditioned" and effector.kind == "point" else "contact"


def require_effectors(robot: Robot, effectors: Sequence[str]) -> None:
    """Raise ``NotFound`` (``effector-not-found``) naming every effector that ``robot`` lacks."""
    unknown = [(i, name) for i, name in enumerate(effectors) if name not in robot.effectors]
    if unknown:
        names = ", ".join(repr(name) for _, name in unknown)
        raise NotFound(
            "effector-not-found",
            f"{robot.title} has no effector {names}; it has {', '.join(robot.effectors)}.",
            [Fault(f"effectors[{i}]", "unknown") for i, _ in unknown],
        )


@dataclass(frozen=True, eq=False)
class _Block:
    com_m: Float[np.ndarray, "e n 3"]
    distance_max_m: Float[np.ndarray, "e e"]
    tried: int


def _sample_block(
    robot: Robot, effectors: tuple[str, ...], samples: int, seed: int, measure: Measure, block_index: int
) -> _Block:
    """Sample block ``block_index`` of ``samples`` configurations; the last block may be shorter."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(block_index,)))
    stream = configuration_stream(robot, measure, rng)
    model, frames = with_contact_frames(robot)
    data, base = model.createData(), model.getFrameId(robot.base_frame)
    n = min(BLOCK, samples - block_index * BLOCK)
    c, p = np.empty((n, 3)), np.empty((len(effectors), n, 3))
    R, R_heading = np.empty((len(effectors), n, 3, 3)), np.empty((n, 3, 3))
    for a, q in enumerate(islice(stream, n)):
        pin.framesForwardKinematics(model, data, q)
        c[a] = pin.centerOfMass(model, data, q, False)
        R_heading[a] = _heading_frame(data.oMf[base].rotation @ robot.R_base_trunk)
        for i, name in enumerate(effectors):
            T_world_contact = data.oMf[frames[name]]
            R[i, a], p[i, a] = T_world_contact.rotation, T_world_contact.translation
    for i, name in enumerate(effectors):
        if frame_of(robot.effectors[name], measure) == "heading":
            R[i] = R_heading
    com = np.einsum("eaji,eaj->eai", R, c - p)
    return _Block(com, np.linalg.norm(p[:, None] - p[None], axis=-1).max(axis=-1), stream.tried)


def _heading_frame(R_world_trunk: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Axes with z up and x along the horizontal part of the trunk's x axis."""
    x, y = R_world_trunk[:2, 0] / np.hypot(*R_world_trunk[:2, 0])
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
