"""Scenarios of the HTTP contract: a robot, a terrain, and which effectors touch it when."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract, FaultItem, Remark
from stridelab.schemas.robots import LinkPose

# What is only too large, or too small a friction, is left to the judge, who names phase and effector.
Metres = Annotated[float, Field(ge=-1e6, le=1e6, description="metres, -100 to 100")]
Position = tuple[Metres, Metres, Metres]
QuaternionPart = Annotated[float, Field(ge=-10.0, le=10.0)]
Quaternion = tuple[QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]
Friction = Annotated[float, Field(ge=-1e6, le=1e6, description="coefficient of friction, above 0 and at most 2")]
SurfaceName = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]*$")]
UNPRINTABLE = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff"
"""Control characters, and those that turn or hide text; a tab and a new line are for longer texts only."""
OneLine = Annotated[str, Field(min_length=1, max_length=120, pattern=rf"^[^\t\n{UNPRINTABLE}]*$")]
Prose = Annotated[str, Field(max_length=2000, pattern=rf"^[^{UNPRINTABLE}]*$")]
Edge = Annotated[float, Field(gt=0.0, le=1e6, description="metres, at most 100")]


ComHeight = Annotated[float, Field(gt=0.0, le=3.0)]


class BoxSurface(Contract):
    """A box, stood on by its upper face; turned by ``yaw_rad`` or by ``orientation_wxyz``, not by both."""

    name: SurfaceName
    kind: Literal["box"]
    center_m: Position
    size_m: tuple[Edge, Edge, Edge]
    yaw_rad: Annotated[float, Field(ge=-100.0, le=100.0)] | None = None
    orientation_wxyz: Quaternion | None = None
    friction: Friction | None = Field(default=None, description="null takes the scenario's")


class RailSurface(Contract):
    """A round bar; the normal of a contact on it is perpendicular to it, in its vertical plane."""

    name: SurfaceName
    kind: Literal["rail"]
    from_m: Position
    to_m: Position
    radius_m: Annotated[float, Field(gt=0.0, le=0.5)]
    friction: Friction | None = Field(default=None, description="null takes the scenario's")


TerrainSurface = Annotated[BoxSurface | RailSurface, Field(discriminator="kind")]


class ScenarioContact(Contract):
    """An effector on a surface: position and orientation of its contact frame in the world."""

    effector: Annotated[str, Field(min_length=1, max_length=60)]
    position_m: Position
    orientation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


class ScenarioPhase(Contract):
    """An interval in which the contacts do not change."""

    duration_s: Annotated[float, Field(ge=-1e4, le=1e4, description="seconds, 0.05 to 60")]
    contacts: Annotated[list[ScenarioContact], Field(max_length=16)]


class Scenario(Contract):
    """Body of ``POST /scenarios`` and ``PUT /scenarios/{id}``: a contact sequence on a terrain."""

    name: OneLine
    description: Prose = ""
    robot: Annotated[str, Field(min_length=1, max_length=60)]
    friction: Friction = 0.3
    start_com_height_m: ComHeight | None = Field(
        default=None, description="of the CoM above the soles' mean at the start; null takes the robot's usual one"
    )
    terrain: Annotated[list[TerrainSurface], Field(max_length=200)]
    phases: Annotated[list[ScenarioPhase], Field(max_length=400)]


class StoredScenario(Scenario):
    """A scenario as the service keeps it; a bundled one is read-only."""

    id: str
    created_at: datetime
    updated_at: datetime | None = None
    bundled: bool = False
    owner: str | None = None

    @property
    def etag(self) -> str:
        """``updated_at`` as JSON has it, in quotes: what ``If-Match`` names."""
        return self.model_dump_json(include={"updated_at"}).partition(":")[2].removesuffix("}")


class ContactMargin(Contract):
    """How far one contact of one phase is from being refused; positive is good."""

    phase: int
    effector: str
    surface: str | None
    height_m: float | None = Field(description="contact frame above (+) or below (-) the surface")
    edge_m: float | None = Field(description="distance from the contact patch to the edge of its surface, inside > 0")
    reach_m: float | None = Field(description="slack of the reach limits that the contacts of the phase share")


class PhaseSupport(Contract):
    """Whether the contacts of a phase hold the robot still."""

    phase: int
    margin_m: float | None = Field(
        description="how far the CoM, where the robot's reach lets it be, can stay from the border of the support "
        "region; negative: the phase can only be passed in motion; null without a region or a known reach"
    )
    com_m: Position | None = Field(description="the place of the CoM at which it does")


BodyAnswer = Literal["reachable", "unreachable", "not-asked"]
"""Whether the whole body can take the stance of a phase; ``not-asked`` where nobody looked."""


class PhaseBody(Contract):
    """What the inverse kinematics of the whole body says of one phase."""

    phase: int
    body: BodyAnswer
    reason: str | None = Field(default=None, description="what ran out, where it is unreachable")
    limits: list[str] = Field(
        default_factory=list,
        description="the effector that misses its place and joints at an end of their range, "
        "or the two links that touch",
    )
    link_poses: list[LinkPose] | None = Field(
        default=None,
        description="of the phase that `posture_of` names: the posture, or the one that misses the contacts least, as "
        "poses of `GET /robots/{name}`'s `links` in the world",
    )


class ScenarioCheck(Contract):
    """Answer of ``POST /scenarios/check``.

    ``support_region_m`` holds, per phase, the polygon above which the CoM can rest; ``support`` how well it can;
    ``phases`` whether the whole body can take its stance, where the request says ``body_checked``.
    """

    valid: bool
    errors: list[FaultItem]
    warnings: list[Remark]
    margins: list[ContactMargin]
    support_region_m: list[list[tuple[float, float]]]
    support: list[PhaseSupport]
    phases: list[PhaseBody] = Field(default_factory=list)
    duration_s: float
