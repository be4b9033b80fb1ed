"""Boundary conditions (4.20d), (4.20e) and additional path bounds.

Rest at the end is too strict for a horizon that ends in the middle of a walk. Viability (4.9f) only requires that the
robot *could* still stop: ``capturable`` lets the CoM end anywhere with any horizontal velocity for which the capture
point of the linear inverted pendulum,

    xi = c + c' / omega,    omega^2 = g / (height of the goal above the soles),

lies in the hull of the last phase's contact points, at the goal's height, without vertical velocity or momentum.

``moving`` prescribes a velocity and a momentum at the goal in place of rest, for a motion that goes on, such as one
step of a recorded walk.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from stridelab.conventions import GRAVITY_M_S2, Points, Vector3
from stridelab.errors import Fault, InvalidInput

Terminal = Literal["rest", "capturable", "moving"]


def _zero_vector() -> Vector3:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Start:
    """Velocity of the CoM and angular momentum about it at the start, or at a moving end; zero (rest) by default.

    Raises ``InvalidInput`` (``start-not-finite``).
    """

    com_v_m_s: Vector3 = field(default_factory=_zero_vector)
    l_nms: Vector3 = field(default_factory=_zero_vector)

    def __post_init__(self) -> None:
        if not np.isfinite([self.com_v_m_s, self.l_nms]).all():
            raise InvalidInput("start-not-finite", "Velocity and angular momentum at the start must be numbers.")


AT_REST: Final = Start()


@dataclass(frozen=True, eq=False)
class PathBounds:
    """Path bounds. ``com_height_m``: CoM height above the mean of the current or latest sole positions.

    ``normal_force_max_n``: by effector name, the largest normal force on each of its points. ``com_between_m``:
    lowest and highest CoM (z) in the world's frame, per interval of the problem's grid, infinite for none. Raises
    ``InvalidInput`` (``bounds-out-of-range``), naming the bounds that are empty or not positive.
    """

    com_height_m: tuple[float, float] | None = None
    normal_force_max_n: Mapping[str, float] = field(default_factory=dict)
    com_between_m: Float[np.ndarray, "intervals 2"] | None = None

    def __post_init__(self) -> None:
        faults = [
            Fault(f"normal_force_max_n.{name}", f"must be positive, not {value}")
            for name, value in self.normal_force_max_n.items()
            if not value > 0.0
        ]
        if self.com_height_m is not None and not 0.0 < self.com_height_m[0] < self.com_height_m[1]:
            faults.append(Fault("com_height_m", f"must be a range of positive heights, not {self.com_height_m}"))
        if self.com_between_m is not None and not (self.com_between_m[:, 0] < self.com_between_m[:, 1]).all():
            faults.append(Fault("com_between_m", "must be ranges of heights"))
        if faults:
            named = ", ".join(fault.where for fault in faults)
            raise InvalidInput("bounds-out-of-range", f"These bounds cannot be met: {named}.", faults)


UNBOUNDED: Final = PathBounds()


@dataclass(frozen=True, eq=False)
class CaptureRegion:
    """Admissible capture points in the horizontal plane: ``normals xi <= offsets`` with ``xi = c + c' / omega``."""

    normals: Float[np.ndarray, "h 2"]
    offsets: Float[np.ndarray, "h"]
    omega_1_s: float

    def excess_m(self, com_m: Vector3, com_v_m_s: Vector3) -> float:
        """Distance (m) of the capture point outside the region; 0 inside."""
        xi = com_m[:2] + com_v_m_s[:2] / self.omega_1_s
        return float(max(0.0, (self.normals @ xi - self.offsets).max()))


def capture_region(contact_points_m: Sequence[Points], goal_m: Vector3) -> CaptureRegion:
    """Capture region from the points of all contacts of the last phase and a CoM goal, in the same frame.

    Raises ``InvalidInput`` (``no-support-to-capture``) where the points have no area below the goal.
    """
    points_m = np.vstack([np.zeros((0, 3)), *contact_points_m])
    flat = points_m[:, :2] - points_m[:1, :2]
    if len(points_m) < 3 or np.linalg.matrix_rank(flat, tol=1e-6) < 2:
        raise InvalidInput("no-support-to-capture", "The last phase has no support area in which to come to a stop.")
    height_m = float(goal_m[2] - np.mean([points[:, 2].mean() for points in contact_points_m]))
    if height_m <= 0.0:
        raise InvalidInput("no-support-to-capture", "The goal of the centre of mass is not above the last contacts.")
    equations = np.unique(ConvexHull(points_m[:, :2]).equations.round(9), axis=0)
    return CaptureRegion(equations[:, :2], -equations[:, 2], float(np.sqrt(GRAVITY_M_S2 / height_m)))
