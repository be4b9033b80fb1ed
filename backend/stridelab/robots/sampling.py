"""Configurations for section 4.3: uniform within the joint limits, thrown away where the robot touches itself."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from stridelab.errors import NotEstimable
from stridelab.robots.collision import SelfCollision
from stridelab.robots.robot import Robot

PATIENCE = 10_000
"""Configurations tried in a row before the robot is said to have none that is free."""


class UniformConfigurations(Iterator[Float[np.ndarray, "nq"]]):
    """An endless stream of configurations; ``tried`` counts the drawn ones, also those that were thrown away.

    The base stays where it is in the reference posture. The stream is a function of the generator's state only.
    """

    def __init__(self, robot: Robot, rng: np.random.Generator) -> None:
        self.tried = 0
        self._robot, self._rng = robot, rng
        self._collision = SelfCollision.of(robot)

    def __next__(self) -> Float[np.ndarray, "nq"]:
        """Next free configuration. Raises ``NotEstimable`` (``no-free-configuration``)."""
        model = self._robot.model
        q = self._robot.q_reference.copy()
        for _ in range(PATIENCE):
            q[7:] = self._rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
            self.tried += 1
            if not self._collision.found(q):
                return q
        raise NotEstimable(
            "no-free-configuration", f"{self._robot.title} touches itself in {PATIENCE} random configurations in a row."
        )


def uniform_configurations(robot: Robot, rng: np.random.Generator) -> UniformConfigurations:
    """Configurations ``(nq,)`` of ``robot``, uniform within its joint limits and free of self-collision."""
    return UniformConfigurations(robot, rng)
