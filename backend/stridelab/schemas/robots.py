"""Robots of the HTTP contract."""

from typing import Literal

from stridelab.schemas.base import Contract


class RobotEffector(Contract):
    """A part of the robot that may touch the world; the pose is that of its contact frame in the link ``frame``."""

    name: str
    frame: str
    kind: Literal["surface", "point"]
    position_m: tuple[float, float, float]
    orientation_wxyz: tuple[float, float, float, float]
    contact_half_size_m: tuple[float, float] | None = None


class JointLimits(Contract):
    """Limits of one actuated joint, in the order of the motion's coordinates."""

    joint: str
    group: str
    lower_rad: float
    upper_rad: float
    velocity_rad_s: float
    torque_nm: float


class ProxyCard(Contract):
    """How the reachability density of one effector was learned, and how good it is."""

    effector: str
    components: int
    samples: int
    tried: int
    seed: int
    measure: str
    bandwidth_m: float
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float
    mode_m: tuple[float, float, float]


LinkPose = tuple[float, float, float, float, float, float, float]
"""Where a link is: px, py, pz in m, qw, qx, qy, qz."""


class RobotFacts(Contract):
    """One robot: ``GET /robots/{name}``. ``q_reference``: position, quaternion xyzw, joints, as in pinocchio.

    In the reference posture the robot faces x and stands on z = 0, with x = y = 0 midway between its soles;
    ``link_poses`` says where each of ``links`` is then.
    """

    name: str
    title: str
    mass_kg: float
    licence: str
    sha256: str
    effectors: list[RobotEffector]
    q_reference: list[float]
    com_height_m: float
    limits: list[JointLimits]
    links: list[str]
    link_poses: list[LinkPose]
    proxies: list[ProxyCard]


class RobotSummary(Contract):
    """One line of ``GET /robots``."""

    name: str
    title: str
    licence: str
    available: bool
    reason: str | None = None
    effectors: list[str]
