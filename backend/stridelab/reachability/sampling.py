"""The CoM of collision-free configurations, seen from the effectors' contact frames (section 4.3.2.2).

    x_a = T_contact_world(q_a) c(q_a),     T_world_contact = T_world_link T_link_contact

with configurations ``q_a`` uniform within the joint limits, or uniform given that the robot stands (``standing``).
Where the base is in the world does not matter.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
import pinocchio as pin

from stridelab.conventions import Points
from stridelab.errors import Fault, NotFound
from stridelab.reachability.card import Measure
from stridelab.reachability.standing import StandingConfigurations
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.sampling import UniformConfigurations, uniform_configurations

Progress = Callable[[float, str], None]
"""Called with a fraction from 0 to 1 and a short message."""

REPORT_EVERY: Final = 200
"""Samples between two reports of progress."""


@dataclass(frozen=True, eq=False)
class ComCloud:
    """Sampled CoM positions ``(n, 3)`` by effector, in its contact frame; row ``a`` of all is one configuration.

    ``pair_distance_max_m`` is the largest distance between the contact frames of two effectors over the samples;
    ``tried`` counts the configurations checked for self-collision to find them.
    """

    measure: Measure
    com_m: Mapping[str, Points]
    pair_distance_max_m: Mapping[tuple[str, str], float]
    tried: int


def sample_com(
    robot: Robot,
    effectors: Sequence[str],
    samples: int,
    rng: np.random.Generator,
    measure: Measure = "uniform",
    progress: Progress | None = None,
) -> ComCloud:
    """CoM positions of ``samples`` configurations in the contact frames of ``effectors``.

    Raises ``NotFound`` (``effector-not-found``), ``NotEstimable`` (``measure-unavailable``,
    ``no-free-configuration``).
    """
    require_effectors(robot, effectors)
    stream = _configurations(robot, measure, rng)
    model, frames = with_contact_frames(robot)
    data = model.createData()
    com = np.empty((len(effectors), samples, 3))
    origin = np.empty((len(effectors), samples, 3))
    for a in range(samples):
        q = next(stream)
        pin.framesForwardKinematics(model, data, q)
        c = pin.centerOfMass(model, data, q, False)
        for i, name in enumerate(effectors):
            T_world_contact = data.oMf[frames[name]]
            com[i, a] = T_world_contact.actInv(c)
            origin[i, a] = T_world_contact.translation
        if progress is not None and (a + 1) % REPORT_EVERY == 0:
            progress((a + 1) / samples, f"{a + 1} of {samples} postures")
    distances = {
        (first, second): float(np.linalg.norm(origin[i] - origin[j], axis=1).max())
        for (i, first), (j, second) in combinations(enumerate(effectors), 2)
    }
    return ComCloud(measure, dict(zip(effectors, com, strict=True)), distances, stream.tried)


def require_effectors(robot: Robot, effectors: Sequence[str]) -> None:
    """Raise ``NotFound`` (``effector-not-found``) naming every effector that ``robot`` has not."""
    unknown = [(i, name) for i, name in enumerate(effectors) if name not in robot.effectors]
    if unknown:
        names = ", ".join(repr(name) for _, name in unknown)
        raise NotFound(
            "effector-not-found",
            f"{robot.title} has no effector {names}; it has {', '.join(robot.effectors)}.",
            [Fault(f"effectors[{i}]", "unknown") for i, _ in unknown],
        )


def _configurations(
    robot: Robot, measure: Measure, rng: np.random.Generator
) -> UniformConfigurations | StandingConfigurations:
    return StandingConfigurations(robot, rng) if measure == "conditioned" else uniform_configurations(robot, rng)
