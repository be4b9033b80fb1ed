"""Robots of the HTTP contract."""

from typing import Literal

from stridelab.schemas.base import Contract

Triple = tuple[float, float, float]
Measure = Literal["uniform", "conditioned"]
"""How postures are drawn: uniform within the joint limits, or so given that the robot stands."""
Frame = Literal["contact", "heading"]
"""Where a density lives: the effector's contact frame, or at its contact point along the heading of the trunk, z up."""
LinkPose = tuple[float, float, float, float, float, float, float]
"""Where a link is: px, py, pz in m, qw, qx, qy, qz."""


class RobotEffector(Contract):
    """A part of the robot that may touch the world; the pose is that of its contact frame in the link ``frame``."""

    name: str
    frame: str
    kind: Literal["surface", "point"]
    position_m: Triple
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


class ProxySize(Contract):
    """A mixture of another size, fitted to the same samples: a point of the curve of figure 4.3."""

    components: int
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float


class ProxyCard(Contract):
    """How the reachability density of one effector was learned under one measure, and how good it is.

    ``rejected_share`` of the postures that were drawn were not kept. ``sizes`` is the curve over the number of
    components; ``thesis_components`` is the size that the thesis chose for such an effector.
    """

    effector: str
    measure: Measure
    frame: Frame
    components: int
    thesis_components: int
    samples: int
    tried: int
    rejected_share: float
    seed: int
    bandwidth_m: float
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float
    mode_m: Triple
    sizes: list[ProxySize]
    learned_on: str
    versions: dict[str, str]


class RobotFacts(Contract):
    """One robot: ``GET /robots/{name}``. ``q_reference``: position, quaternion xyzw, joints, as in pinocchio.

    In the reference posture the robot faces x and stands on z = 0, with x = y = 0 midway between its soles;
    ``link_poses`` says where each of ``links`` is then. ``measures`` are those under which densities were learned,
    ``default_measure`` is the one that plans use. Densities that were learned on another description of the robot
    cannot be used: their measures are ``stale_measures``.
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
    measures: list[Measure]
    stale_measures: list[Measure]
    default_measure: Measure


class RobotSummary(Contract):
    """One line of ``GET /robots``."""

    name: str
    title: str
    licence: str
    available: bool
    reason: str | None = None
    effectors: list[str]


class RobotPreparation(Contract):
    """How far the files are that show a robot: its facts, its display meshes, and its densities.

    ``message`` says what is being done, or, where the state is ``failed``, why the robot cannot be shown. ``failed`` is
    tried again after a minute.
    """

    state: Literal["preparing", "ready", "failed"]
    fraction: float
    message: str
