"""How a motion begins and ends (4.20d), (4.20e), and the bounds on the way that are ours.

Rest at the end may be too much to ask of a horizon that ends in the middle of a walk. Viability (4.9f) then asks that
the robot *could* still stop: ``capturable`` lets the CoM end anywhere with any horizontal velocity for which the
capture point of the linear inverted pendulum,

    xi = c + c' / omega,    omega^2 = g / (height of the goal above the soles),

lies in the hull of the last phase's contact points, at the goal's height, without vertical velocity or momentum.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from stridelab.conventions import GRAVITY_M_S2, Points, Vector3
from stridelab.errors import Fault, InvalidInput

Terminal = Literal["rest", "capturable"]


def _still() -> Vector3:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Start:
    """Velocity of the CoM and angular momentum about it at the start: rest, unless a motion goes on.

    Raises ``InvalidInput`` (``start-not-finite``).
    """

    com_v_m_s: Vector3 = field(default_factory=_still)
    l_nms: Vector3 = field(default_factory=_still)

    def __post_init__(self) -> None:
        if not np.isfinite([self.com_v_m_s, self.l_nms]).all():
            raise InvalidInput("start-not-finite", "Velocity and angular momentum at the start must be numbers.")


AT_REST: Final = Start()


@dataclass(frozen=True)
class PathBounds:
    """Bounds on the way. ``com_height_m``: of the CoM above the mean of the soles, each where it is or was last.

    ``normal_force_max_n``: for effectors by name, the largest normal force on each of their points, of an arm that can
    carry so much and no more. Raises ``InvalidInput`` (``bounds-out-of-range``) naming what is empty or not positive.
    """

    com_height_m: tuple[float, float] | None = None
    normal_force_max_n: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        faults = [
            Fault(f"normal_force_max_n.{name}", f"must be positive, not {value}")
            for name, value in self.normal_force_max_n.items()
            if not value > 0.0
        ]
        if self.com_height_m is not None and not 0.0 < self.com_height_m[0] < self.com_height_m[1]:
            faults.append(Fault("com_height_m", f"no height lies between {self.com_height_m}"))
        if faults:
            named = ", ".join(fault.where for fault in faults)
            raise InvalidInput("bounds-out-of-range", f"These bounds leave nothing: {named}.", faults)


UNBOUNDED: Final = PathBounds()


@dataclass(frozen=True, eq=False)
class Capture:
    """``normals xi <= offsets`` with ``xi = c + c' / omega``, seen from above."""

    normals: Float[np.ndarray, "h 2"]
    offsets: Float[np.ndarray, "h"]
    omega_1_s: float

    def excess_m(self, com_m: Vector3, com_v_m_s: Vector3) -> float:
        """How far the capture point is outside; 0 inside."""
        xi = com_m[:2] + com_v_m_s[:2] / self.omega_1_s
        return float(max(0.0, (self.normals @ xi - self.offsets).max()))


def capture(touching: Sequence[Points], goal_m: Vector3) -> Capture:
    """For the points of all contacts of the last phase and a goal of the CoM, in the same frame.

    Raises ``InvalidInput`` (``no-support-to-capture``) where the points have no area below the goal.
    """
    points_m = np.vstack([np.zeros((0, 3)), *touching])
    flat = points_m[:, :2] - points_m[:1, :2]
    if len(points_m) < 3 or np.linalg.matrix_rank(flat, tol=1e-6) < 2:
        raise InvalidInput("no-support-to-capture", "The last phase has no support area in which to come to a stop.")
    height_m = float(goal_m[2] - np.mean([points[:, 2].mean() for points in touching]))
    if height_m <= 0.0:
        raise InvalidInput("no-support-to-capture", "The goal of the centre of mass is not above the last contacts.")
    equations = np.unique(ConvexHull(points_m[:, :2]).equations.round(9), axis=0)
    return Capture(equations[:, :2], -equations[:, 2], float(np.sqrt(GRAVITY_M_S2 / height_m)))
