"""Reachability densities of the HTTP contract, as what can be drawn: samples, level sets and projections."""

from typing import Literal

from stridelab.schemas.base import Contract
from stridelab.schemas.robots import LinkPose, Measure, ProxyCard, Triple

Axis = Literal["x", "y", "z"]


class LevelSurface(Contract):
    """The smallest volume that holds the share ``mass`` of a mixture, and its surface as triangles.

    It may have several pieces; triangles are counterclockwise seen from outside.
    """

    mass: float
    density_per_m3: float
    volume_m3: float
    vertices_m: list[Triple]
    triangles: list[tuple[int, int, int]]


class Projection(Contract):
    """The density projected along one axis (figures 4.2 and 4.4): of the kernels, and of the mixture, per m^2.

    Rows of the maps go along ``up_m``, columns along ``right_m``.
    """

    along: Axis
    right: Axis
    up: Axis
    right_m: list[float]
    up_m: list[float]
    kernel_per_m2: list[list[float]]
    mixture_per_m2: list[list[float]]


class EffectorReach(Contract):
    """Where the CoM can be relative to one effector, in the frame that its card names.

    ``reference_pose`` says where this frame is in the reference posture. ``com_m`` are the first sampled positions.
    """

    card: ProxyCard
    reference_pose: LinkPose
    com_m: list[Triple]
    level_sets: list[LevelSurface]
    projections: list[Projection]


class RobotReachability(Contract):
    """``GET /robots/{name}/reachability``, and ``reachability.json`` of the job that learned densities anew."""

    robot: str
    robot_sha256: str
    measure: Measure
    effectors: list[EffectorReach]
