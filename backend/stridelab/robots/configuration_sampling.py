"""Rejection sampling of configurations (section 4.3): uniform within the joint limits, free of self-collision."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.errors import NotEstimable
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision

MAX_REJECTIONS: Final = 10_000
"""Consecutive colliding configurations after which sampling fails."""
BATCH: Final = 256
"""Configurations drawn at once."""


class UniformConfigurations(Iterator[Float[np.ndarray, "nq"]]):
    """An endless stream of configurations; ``tried`` counts all draws, including rejected ones.

    The base keeps its reference pose. The stream depends only on the state of the generator.
    """

    def __init__(self, robot: Robot, rng: np.random.Generator) -> None:
        self.tried = 0
        self._robot = robot
        self._collision = SelfCollision(robot)
        # a plain function: a generator method would keep the collision buffers alive
        self._angles = _draw_angles(robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:], rng)

    def __next__(self) -> Float[np.ndarray, "nq"]:
        """Next collision-free configuration. Raises ``NotEstimable`` (``no-free-configuration``)."""
        q = self._robot.q_reference.copy()
        for _ in range(MAX_REJECTIONS):
            q[7:] = next(self._angles)
            self.tried += 1
            if not self._collision.any_collision(q):
                return q
        raise NotEstimable(
            "no-free-configuration",
            f"{self._robot.title} collides with itself in {MAX_REJECTIONS} random configurations in a row.",
        )


def uniform_configurations(robot: Robot, rng: np.random.Generator) -> UniformConfigurations:
    """Configurations ``(nq,)`` of ``robot``, uniform within its joint limits and free of self-collision."""
    return UniformConfigurations(robot, rng)


def _draw_angles(
    lower: Float[np.ndarray, "nj"], upper: Float[np.ndarray, "nj"], rng: np.random.Generator
) -> Iterator[Float[np.ndarray, "nj"]]:
    """Endless uniform draws of all joint angles within their limits."""
    while True:
        yield from rng.uniform(lower, upper, (BATCH, len(lower)))
