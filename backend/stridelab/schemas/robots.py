"""Schemas of robots."""

from typing import Literal

from stridelab.schemas.base import Contract

Triple = tuple[float, float, float]
Measure = Literal["uniform", "conditioned"]
"""Distribution of sampled postures: uniform within the joint limits, or conditioned on the robot standing."""
Frame = Literal["contact", "heading"]
"""Frame of a density: the effector's contact frame, or its contact point with the heading of the trunk, z up."""
LinkPose = tuple[float, float, float, float, float, float, float]
"""Pose of a link: position px, py, pz in m, and quaternion qw, qx, qy, qz."""


class RobotEffector(Contract):
    """A part of the robot that may be in contact; the pose is that of its contact frame in the link ``frame``."""

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
    """A mixture with another number of components, fitted to the same samples: one point of figure 4.3."""

    components: int
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float


class ProxyCard(Contract):
    """Learned reachability density of one effector under one measure: provenance and quality.

    ``rejected_share`` is the fraction of sampled postures that were rejected. ``sizes`` is the quality over the number
    of components; ``thesis_components`` is the number used in the thesis for this kind of effector.
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

    In the reference posture, the robot faces x and stands on z = 0, with x = y = 0 midway between its soles;
    ``link_poses`` are the poses of ``links`` in this posture. ``measures`` are those with learned densities,
    ``default_measure`` is the one that plans use. ``stale_measures`` have densities that were learned on another
    description of the robot and cannot be used.
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
    """Progress of the display files of a robot: facts, display meshes, and densities.

    ``message`` is the current step or, in the state ``failed``, the reason. A failed preparation is repeated after a
    minute.
    """

    state: Literal["preparing", "ready", "failed"]
    fraction: float
    message: str
