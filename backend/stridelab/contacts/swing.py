"""Swing curves: trajectories of an effector from one contact to the next (thesis 4.6.1).

Quintic time scalings ``s(u) = u^3 (10 - 15 u + 6 u^2)`` on windows of the swing, so that velocity and acceleration
vanish at both ends. With the lift-off and landing axes ``n_0, n_1``, the heights ``h_0, h_1`` and the windows below

    p(t) = p_0 + n_0 h_0 s_up(t) + (a_1 - a_0) s_move(t) - n_1 h_1 s_down(t),   a_i = p_i + n_i h_i
    R(t) = R_0 exp(s_move(t) log(R_0^T R_1))

A sole rises vertically until its centre is ``rise_m`` above the higher of its two contacts, which clears the obstacles
between them; a hand retreats ``HAND_RETREAT_M`` along the normals of its contacts.

For the clearance, the sole moves along the straight line from one contact to the other while it turns. With the heights
``z_0, z_1`` of its centre at both contacts, the highest top ``h`` of a box below its path and the depth ``d`` of the
lowest point of the turning sole below its centre, the centre rises above ``max(z_0, z_1)`` by

    max(clearance_m, h - max(z_0, z_1) + d + margin_m)

so that at the apex the whole sole clears every box below its path by ``margin_m``, half of ``clearance_m``. Obstacles
more than ``STEP_OVER_M`` above both contacts are not stepped over; the validation of the scenario reports them.

A sole that passes a standing one goes around it: ``n_i h_i`` then also contain the same shift ``side_m`` aside, so that
the outlines of both soles stay ``PASSING_GAP_M`` apart across the path (feet one before the other, as on a beam).
"""

import math
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import FOOT_CLEARANCE_M
from stridelab.contacts.sequence import Contact
from stridelab.contacts.terrain import Terrain, vertical_span_m
from stridelab.conventions import Points, Rotation, Rotations, Series, Vector3
from stridelab.dynamics.spatial import Placement

MARGIN_M: Final = 0.03
"""Clearance between a sole and the highest obstacle below its path."""
STEP_OVER_M: Final = 0.25
"""Height above both contacts up to which an obstacle is stepped over."""
PASSING_GAP_M: Final = 0.045
"""Distance between the rectangles of a swinging and a standing sole across the path; shoes are up to 1 cm wider."""
MAX_SIDE_M: Final = 0.15
MIN_PATH_M: Final = 0.10
"""Shorter swings pass no other sole."""
SHARES: Final = np.linspace(0.0, 1.0, 25)


def required_rise_m(
    start: Placement, end: Placement, sole_m: Points, terrain: Terrain, clearance_m: float = FOOT_CLEARANCE_M
) -> float:
    """Rise of the centre of a sole above the higher of its two contacts.

    ``sole_m`` ``(n, 3)`` are points of the sole in its contact frame, ``clearance_m`` is the rise without obstacles.
    """
    turn = ScipyRotation.from_matrix(start.rotation.T @ end.rotation).as_rotvec()
    rotations = start.rotation @ ScipyRotation.from_rotvec(np.outer(SHARES, turn)).as_matrix()
    offsets = np.einsum("tij,kj->tki", rotations, sole_m)
    travel = np.outer(SHARES, end.position_m - start.position_m)
    points = (offsets + (start.position_m + travel)[:, np.newaxis]).reshape(-1, 3)
    high = max(float(start.position_m[2]), float(end.position_m[2]))
    low_m, high_m = terrain.box_bounds_m
    below = (low_m[:, :2] <= points[:, :2].max(axis=0)) & (high_m[:, :2] >= points[:, :2].min(axis=0))
    near = np.flatnonzero(below.all(axis=1) & (high_m[:, 2] > high) & (low_m[:, 2] <= high + STEP_OVER_M))
    top = max([high, *(_highest_top_m(*vertical_span_m(terrain.boxes[i], points), high) for i in near)])
    depth = max(0.0, -float(offsets[..., 2].min()))
    margin_m = MARGIN_M * (clearance_m / FOOT_CLEARANCE_M)
    return max(clearance_m, top - high + depth + margin_m)


def _highest_top_m(low: np.ndarray, top: np.ndarray, high_m: float) -> float:
    """The highest top of a box up to ``STEP_OVER_M`` above ``high_m``; boxes overhead do not count."""
    below = (top <= high_m + STEP_OVER_M) & (low <= high_m + STEP_OVER_M)
    return float(top[below].max()) if below.any() else -np.inf


def passing_shift_m(start: Contact, end: Contact, standing: Contact) -> Vector3:
    """Horizontal shift of a sole that passes a standing one, away from it; zero if its straight path is wide enough."""
    zero = np.zeros(3)
    path, here = end.placement.position_m - start.placement.position_m, standing.placement.position_m
    length = float(np.hypot(path[0], path[1]))
    if length < MIN_PATH_M or start.half_size_m is None or standing.half_size_m is None:
        return zero
    along = np.array([path[0], path[1], 0.0]) / length
    aside = np.array([-along[1], along[0], 0.0])
    from_standing = start.placement.position_m - here
    if not 0.0 < -float(along @ from_standing) < length:
        return zero
    distance_m = float(aside @ from_standing)  # the same all along the path
    width_m = sum(_half_extent_m(contact, aside) for contact in (start, standing))
    missing_m = float(np.clip(width_m + PASSING_GAP_M - abs(distance_m), 0.0, MAX_SIDE_M))
    return np.asarray(math.copysign(missing_m, distance_m) * aside)


def _half_extent_m(contact: Contact, axis: Vector3) -> float:
    """Half extent of a sole's rectangle along a horizontal axis."""
    return float(np.abs(axis @ contact.placement.rotation[:, :2]) @ np.array(contact.half_size_m))


HAND_RETREAT_M: Final = 0.05
"""Distance by which a hand retreats from its surface."""
LEVEL_M: Final = 0.02
"""Change of height, and of rise above ``FOOT_CLEARANCE_M``, below which a step counts as level."""

Window = tuple[float, float]
UP: Final[Window] = (0.0, 0.4)
DOWN: Final[Window] = (0.6, 1.0)
"""A sole that rises by ``FOOT_CLEARANCE_M`` is then 10.8 mm up an eighth of the swing from either end."""
LEAST_UP_END: Final = 0.2


LEAVES_M: Final = 0.0108
"""Height of a sole above its contact an eighth of the swing from either end; the certificate requires 10 mm there."""


@cache
def _up_end(rise_m: float) -> float:
    """End of the window in which a sole that rises less than usual is ``LEAVES_M`` up after an eighth of the swing."""
    ends = np.linspace(UP[1], LEAST_UP_END, 100)
    heights_m = [rise_m * quintic_scaling(0.125, (0.0, end), 1.0)[0] for end in ends.tolist()]
    return next((end for end, up_m in zip(ends.tolist(), heights_m, strict=True) if up_m >= LEAVES_M), LEAST_UP_END)


class Profile(NamedTuple):
    """Shares of the swing during which the effector rises, moves and comes down."""

    up: Window
    move: Window
    down: Window


LEVEL: Final = Profile(UP, (0.04, 0.96), DOWN)
STAIR: Final = Profile(UP, (0.18, 0.80), DOWN)
HAND: Final = Profile((0.0, 0.25), (0.12, 0.88), (0.75, 1.0))
"""A hand that retreats by ``HAND_RETREAT_M`` is then 25 mm away an eighth of the swing from either end: its orientation
is a task of the lowest level, and a gripper that leans by 60 degrees extends 17 mm nearer to its rail than its contact.
"""


@dataclass(frozen=True, eq=False)
class SwingPoint:
    """State of the effector's contact frame at one instant, in world coordinates."""

    placement: Placement
    velocity_m_s: Vector3
    acceleration_m_s2: Vector3
    angular_velocity_rad_s: Vector3
    angular_acceleration_rad_s2: Vector3


def quintic_scaling(time_s: float, window: Window, duration_s: float) -> tuple[float, float, float]:
    """``s`` and its first two time derivatives; ``s`` is 0 before ``window`` (share of ``duration_s``), 1 after."""
    length_s = (window[1] - window[0]) * duration_s
    u = min(max((time_s / duration_s - window[0]) * duration_s / length_s, 0.0), 1.0)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    rate = 30.0 * u * u * (1.0 - u) ** 2 / length_s
    return s, rate, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / length_s**2


@dataclass(frozen=True, eq=False)
class SwingCurve:
    """A swing from ``start`` to ``end`` in ``duration_s``; ``starts_s`` is its start time in the sequence.

    ``rise_m`` is the apex of a sole's centre above the higher of its two contacts, ``side_m`` its shift there.
    ``windows`` replace the usual time windows (``swing_windows``).
    """

    start: Placement
    end: Placement
    duration_s: float
    kind: Literal["surface", "point"]
    starts_s: float = 0.0
    rise_m: float = FOOT_CLEARANCE_M
    side_m: Vector3 = field(default_factory=lambda: np.zeros(3))
    windows: Profile | None = None

    @cached_property
    def profile(self) -> Profile:
        """The time windows of this swing: ``windows``, or the usual ones of its kind."""
        if self.windows is not None:
            return self.windows
        if self.kind == "point":
            return HAND
        usual = self._usual_profile
        if self.rise_m >= FOOT_CLEARANCE_M:
            return usual
        end = _up_end(self.rise_m)
        return Profile((0.0, end), usual.move, (1.0 - end, 1.0))

    @property
    def _usual_profile(self) -> Profile:
        """The time windows of a sole that rises by ``FOOT_CLEARANCE_M`` or more."""
        level = abs(self.end.position_m[2] - self.start.position_m[2]) < LEVEL_M and not self.side_m.any()
        return LEVEL if level and self.rise_m < FOOT_CLEARANCE_M + LEVEL_M else STAIR

    @cached_property
    def _lift_vectors(self) -> tuple[Vector3, Vector3]:
        """``n_0 h_0`` and ``n_1 h_1``."""
        if self.kind == "point":
            return HAND_RETREAT_M * self.start.rotation[:, 2], HAND_RETREAT_M * self.end.rotation[:, 2]
        z_start, z_end = self.start.position_m[2], self.end.position_m[2]
        apex = max(z_start, z_end) + self.rise_m
        up = np.array([0.0, 0.0, 1.0])
        return self.side_m + (apex - z_start) * up, self.side_m + (apex - z_end) * up

    @cached_property
    def _travel(self) -> Vector3:
        """``a_1 - a_0``."""
        up, down = self._lift_vectors
        return np.asarray(self.end.position_m + down - self.start.position_m - up)

    @cached_property
    def parts_m(self) -> Float[np.ndarray, "3 3"]:
        """Rise, travel and descent, one per row, which the scalings of the three windows multiply."""
        up, down = self._lift_vectors
        return np.vstack([up, self._travel, -down])

    @cached_property
    def _rotation_vector(self) -> Vector3:
        """``log(R_0^T R_1)``, zero in every bit for equal rotations."""
        if np.array_equal(self.start.rotation, self.end.rotation):
            return np.zeros(3)
        return np.asarray(ScipyRotation.from_matrix(self.start.rotation.T @ self.end.rotation).as_rotvec())

    @cached_property
    def _is_turning(self) -> bool:
        return bool(self._rotation_vector.any())

    @cached_property
    def _rotation_axis(self) -> Vector3:
        """``_rotation_vector`` in world axes."""
        return np.asarray(self.start.rotation @ self._rotation_vector)

    def state_at(self, t_s: float) -> SwingPoint:
        """State ``t_s`` seconds after lift-off; before and after the swing, at rest at its ends."""
        up, move, down = (quintic_scaling(t_s, window, self.duration_s) for window in self.profile)
        p, v, a = np.array((up, move, down)).T @ self.parts_m
        axis = self._rotation_axis
        return SwingPoint(
            placement=Placement(self.start.position_m + p, self._rotation_at(move[0])),
            velocity_m_s=v,
            acceleration_m_s2=a,
            angular_velocity_rad_s=axis * move[1],
            angular_acceleration_rad_s2=axis * move[2],
        )

    def poses_at(self, shares: Series) -> tuple[Points, Rotations]:
        """Positions ``(n, 3)`` and rotations ``(n, 3, 3)`` at ``shares`` of the swing, 0 to 1."""
        scalings = np.array([[quintic_scaling(u, window, 1.0)[0] for window in self.profile] for u in shares.tolist()])
        return self.start.position_m + scalings @ self.parts_m, self.rotations_at(scalings[:, 1])

    def rotations_at(self, moved: Series) -> Rotations:
        """Rotations ``(n, 3, 3)`` where the shares ``moved`` of the travel are done."""
        if not self._is_turning:
            return np.repeat(self.start.rotation[None], len(moved), axis=0)
        turns = ScipyRotation.from_rotvec(np.outer(moved, self._rotation_vector)).as_matrix()
        return np.asarray(self.start.rotation @ turns)

    def _rotation_at(self, share: float) -> Rotation:
        if not self._is_turning:
            return self.start.rotation
        return np.asarray(self.start.rotation @ ScipyRotation.from_rotvec(share * self._rotation_vector).as_matrix())
