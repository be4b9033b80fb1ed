"""Schemas of robots."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field

from stridelab.schemas.base import Contract, Remark

NAME_PATTERN = r"^[a-z][a-z0-9-]{1,39}$"
"""Names of robots of users."""

RobotState = Literal["bundled", "proposed", "commissioned", "not-walking"]
"""State of a robot: ``commissioned`` once its first walk was certified and completed, ``not-walking`` if it was not."""
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


class WalkerFacts(Contract):
    """Dimensions of a robot on two soles that scale scenes to it, all in metres.

    ``leg_m``: straight leg from hip to sole; ``foot_y_m``: half the distance between the soles in the reference
    posture; ``toe_m`` and ``heel_m``: how far the shoes reach before and behind the middle of their soles.
    ``shoulder_m``: right shoulder in the reference posture; ``arm_m``: straight right arm. Both are null without arms
    of at least four joints, or for facts of an earlier version.
    """

    leg_m: float
    foot_y_m: float
    toe_m: float
    heel_m: float
    shoulder_m: Triple | None = None
    arm_m: float | None = None


class RobotFacts(Contract):
    """One robot: ``GET /robots/{name}``. ``q_reference``: position, quaternion xyzw, joints, as in pinocchio.

    In the reference posture, the robot faces x and stands on z = 0, with x = y = 0 midway between its soles;
    ``link_poses`` are the poses of ``links`` in this posture. ``measures`` are those with learned densities,
    ``default_measure`` is the one that plans use. ``stale_measures`` have densities that were learned on another
    description of the robot and cannot be used. ``own``: uploaded by a user, ``GET /robots/{name}/card`` has its card.
    ``walker``: null for a robot without two soles on legs, or of an earlier version of the service.
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
    own: bool = False
    walker: WalkerFacts | None = None


class RobotSummary(Contract):
    """One line of ``GET /robots``; ``owner`` is the user who uploaded it, null for a bundled one."""

    name: str
    title: str
    licence: str
    available: bool
    reason: str | None = None
    effectors: list[str]
    state: RobotState = "bundled"
    owner: str | None = None


class EarlierCard(Contract):
    """A card of one's own robot before it was changed, and what of it was assumed, by field."""

    version: int
    card: dict[str, Any]
    assumptions: dict[str, str]
    replaced_at: datetime


class OwnRobot(Contract):
    """A robot of a user, after an upload or a change of its card.

    ``card`` has the fields of the card file (docs, *Add a robot*) except ``data``; ``assumed`` lists the fields that
    the description does not state and that were estimated, and ``assumptions`` says how. ``estimates`` are offered for
    fields whose stated values are implausible; the card has the stated ones. ``sha256`` is the hash of the uploaded
    file, ``robot_sha256`` that of the robot. ``version`` counts the cards; ``earlier`` are the last ones before.
    """

    name: str
    state: RobotState
    owner: str | None
    card: dict[str, Any]
    assumed: list[str]
    assumptions: dict[str, str]
    estimates: dict[str, float] = Field(default_factory=dict)
    filename: str
    sha256: str
    robot_sha256: str
    created_at: datetime
    commission: "CommissionRobotSummary | None" = None
    version: int = 1
    earlier: list[EarlierCard] = Field(default_factory=list)


class RobotPackage(Contract):
    """An installed package with descriptions of robots, by their paths below the folder that all of them share."""

    package: str
    version: str
    descriptions: list[str]


class RobotPreparation(Contract):
    """Progress of the display files of a robot: facts, display meshes, and densities.

    ``message`` is the current step or, in the state ``failed``, the reason. A failed preparation is repeated after a
    minute.
    """

    state: Literal["preparing", "ready", "failed"]
    fraction: float
    message: str


class CommissionRobotInput(Contract):
    """Input of ``commission-robot``: a robot of one's own, and the postures from which each density is learned."""

    robot: Annotated[str, Field(pattern=NAME_PATTERN)]
    samples: Annotated[int, Field(ge=500, le=20_000)] = 3_000
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    search_s: Annotated[float, Field(ge=0.0, le=360.0)] = Field(
        default=300.0, description="time for the searches after the level walk; 0 leaves them out"
    )


class LearnedMeasure(Contract):
    """Densities learned under one measure, as in ``learn-reachability``."""

    samples: int
    tried: int
    rejected_share: float
    kl_nats: dict[str, float]


class WalkAttempt(Contract):
    """One level walk: ``reason`` is why it is not certified or not completed, empty if it is both."""

    step_m: float
    step_time_s: float
    certified: bool
    completed: bool
    com_error_max_m: float | None = None
    torque_ratio_max: float | None = None
    reason: str = ""


class FirstWalk(Contract):
    """The level walk of ``commission-robot``: that of the longest step which is certified and completed, or the last.

    ``certified``: the motion passed its certificate; ``completed``: its replay in a physics simulation did, too.
    """

    certified: bool
    completed: bool
    steps: int
    step_m: float
    duration_s: float
    attempts: list[WalkAttempt]


CapabilityName = Literal["turn", "stair", "pace", "push-ahead", "push-back", "push-left", "push-right"]
"""Heading change per step on the spot, height of one stair, speed of the level walk, pushes during it."""
SearchEnd = Literal["fails", "range", "time", "not-tried"]


class CapabilityAttempt(Contract):
    """One value of a search: ``reason`` is why its motion does not pass, empty if it does."""

    value: float
    passed: bool
    reason: str = ""


class Capability(Contract):
    """The largest value of one quantity whose motion is certified and replayed in a physics simulation.

    Found by bisection over multiples of ``resolution``, which assumes that all smaller values pass, too. A push passes
    if the robot does not fall; it acts on the trunk for 0.1 s in the middle of the third step of the level walk.
    ``value`` is 0 if no value passes, and null if none was tried. ``ended_by``: the next value ``fails`` for
    ``reason``; the largest of the ``range`` passes; the ``time`` ended, and larger values may pass; or ``not-tried``,
    for ``reason``.
    """

    name: CapabilityName
    value: float | None
    unit: Literal["rad", "m", "m/s", "N s"]
    resolution: float
    ended_by: SearchEnd
    reason: str = ""
    attempts: list[CapabilityAttempt] = Field(default_factory=list)
    seconds: float = 0.0


class CommissionLimits(Contract):
    """What the first walk needed of the robot, as ratios to its limits: of its joints' speeds and torques."""

    mass_kg: float
    com_height_m: float
    foot_spacing_m: float
    torque_ratio_max: float | None = None


class CommissionRobotSummary(Contract):
    """Summary of ``commission-robot``; ``learned`` is by measure (``uniform``, ``conditioned``)."""

    robot: str
    robot_sha256: str
    learned: dict[str, LearnedMeasure]
    first_walk: FirstWalk
    capabilities: list[Capability] = Field(default_factory=list)
    limits: CommissionLimits
    seconds: dict[str, float]


class CommissionRobotTask(Contract):
    """Task of ``commission-robot``; the robot lies in the job's folder."""

    input: CommissionRobotInput


class LearnReachabilityInput(Contract):
    """Input of ``learn-reachability``; ``effectors`` null learns all effectors of the robot."""

    robot: str
    effectors: Annotated[list[str], Field(min_length=1, max_length=16)] | None = None
    samples: Annotated[int, Field(ge=500, le=200_000)] = 20_000
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    measure: Literal["uniform", "conditioned"] = "uniform"


class LearnedEffector(Contract):
    """Learned density of one effector; ``thesis_components`` is the number of components used in the thesis."""

    frame: Literal["contact", "heading"]
    components: int
    thesis_components: int
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float
    bandwidth_m: float
    mode_m: tuple[float, float, float]


class LearnReachabilitySummary(Contract):
    """Summary of ``learn-reachability``."""

    robot: str
    robot_sha256: str
    samples: int
    tried: int
    rejected_share: float
    learned_on: str
    measure: str
    effectors: dict[str, LearnedEffector]
    warnings: list[Remark]


class LearnReachabilityTask(Contract):
    """Task of ``learn-reachability``."""

    input: LearnReachabilityInput
