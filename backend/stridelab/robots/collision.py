"""Self-collision of a configuration: which shapes of the robot overlap, mostly convex hulls.

The library's search for a separating direction starts where the last one ended. Of 4000 uniform configurations of
TALOS, held against linear programmes, 5 had a pair that it missed (four grazing, one 9 mm deep), and none had one that
does not touch; a verdict at that rate may thus depend on what was asked before. A motion is checked at many instants.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class SelfCollision:
    """The check with its own buffers, for many configurations; one per thread."""

    robot: Robot
    data: pin.Data
    hulls: pin.GeometryData

    @staticmethod
    def of(robot: Robot) -> "SelfCollision":
        """A check for ``robot``."""
        return SelfCollision(robot, robot.model.createData(), robot.collision.createData())

    def found(self, q: Float[np.ndarray, "nq"]) -> bool:
        """Whether any pair collides; stops at the first."""
        return bool(pin.computeCollisions(self.robot.model, self.data, self.robot.collision, self.hulls, q, True))

    def pairs(self, q: Float[np.ndarray, "nq"]) -> tuple[tuple[str, str], ...]:
        """Names of the links of all pairs that collide."""
        pin.computeCollisions(self.robot.model, self.data, self.robot.collision, self.hulls, q, False)
        checked = zip(self.robot.collision.collisionPairs, self.hulls.collisionResults, strict=True)
        return tuple((self._link(p.first), self._link(p.second)) for p, result in checked if result.isCollision())

    def _link(self, part: int) -> str:
        return str(self.robot.model.frames[self.robot.collision.geometryObjects[part].parentFrame].name)
