"""Schemas of reachability densities for display: samples, level sets and projections."""

from typing import Literal

from stridelab.schemas.base import Contract
from stridelab.schemas.robots import LinkPose, Measure, ProxyCard, Triple

Axis = Literal["x", "y", "z"]


class LevelSurface(Contract):
    """Smallest volume that contains the fraction ``mass`` of a mixture, and its surface as a triangle mesh.

    It may consist of several parts; triangles are counterclockwise seen from outside.
    """

    mass: float
    density_per_m3: float
    volume_m3: float
    vertices_m: list[Triple]
    triangles: list[tuple[int, int, int]]


class Projection(Contract):
    """Density projected along one axis, in 1/m^2 (figures 4.2 and 4.4): kernel density estimate, and mixture.

    Rows of the maps correspond to ``up_m``, columns to ``right_m``.
    """

    along: Axis
    right: Axis
    up: Axis
    right_m: list[float]
    up_m: list[float]
    kernel_per_m2: list[list[float]]
    mixture_per_m2: list[list[float]]


class EffectorReach(Contract):
    """Reachable CoM positions relative to one effector, in the frame of its card.

    ``reference_pose`` is the pose of this frame in the reference posture. ``com_m`` are the first sampled positions.
    """

    card: ProxyCard
    reference_pose: LinkPose
    com_m: list[Triple]
    level_sets: list[LevelSurface]
    projections: list[Projection]


class RobotReachability(Contract):
    """``GET /robots/{name}/reachability``, and ``reachability.json`` of ``learn-reachability``."""

    robot: str
    robot_sha256: str
    measure: Measure
    effectors: list[EffectorReach]
