"""Schemas of scenarios (a robot, a terrain, a sequence of contact phases) and of courses: obstacles in a row."""

import re
from datetime import datetime
from math import hypot
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema, PydanticCustomError

from stridelab.schemas.base import Contract, FaultItem, Remark
from stridelab.schemas.robots import LinkPose

# The schema bounds are wide; the validation checks the actual limits and names phase and effector.
Metres = Annotated[float, Field(ge=-1e6, le=1e6, description="metres, -100 to 100")]
Position = tuple[Metres, Metres, Metres]
QuaternionPart = Annotated[float, Field(ge=-10.0, le=10.0)]
Quaternion = tuple[QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]
Friction = Annotated[float, Field(ge=-1e6, le=1e6, description="coefficient of friction, above 0 and at most 2")]
UNPRINTABLE: Final = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u200b\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff"
"""Control characters, and characters that reorder or hide text; longer texts may contain tabs and line breaks.

The joiners (U+200C, U+200D) are letters' own in Persian and in Indic scripts.
"""


def _require_pattern(pattern: str, reason: str) -> AfterValidator:
    """Validator of the pattern of a text's schema, with a reason in words in place of the pattern."""

    def require_match(text: str) -> str:
        if re.fullmatch(pattern, text) is None:
            raise PydanticCustomError("text-invalid", "{reason}", {"reason": reason})
        return text

    return AfterValidator(require_match)


_NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9 _.-]*$"
_NAME_REASON: Final = "must begin with a letter from A to Z or a digit, and contain only these, spaces, and _ . -"
_LINE: Final = rf"^[^\t\n{UNPRINTABLE}]*$"
_PROSE: Final = rf"^[^{UNPRINTABLE}]*$"
_REASON: Final = "must not contain control characters, or characters that hide or reorder text"
SurfaceName = Annotated[
    str, Field(min_length=1, max_length=60, json_schema_extra={"pattern": _NAME}), _require_pattern(_NAME, _NAME_REASON)
]
OneLine = Annotated[
    str, Field(min_length=1, max_length=120, json_schema_extra={"pattern": _LINE}), _require_pattern(_LINE, _REASON)
]
Prose = Annotated[str, Field(max_length=2000, json_schema_extra={"pattern": _PROSE}), _require_pattern(_PROSE, _REASON)]
Edge = Annotated[float, Field(gt=0.0, le=1e6, description="metres, at most 100")]


ComHeight = Annotated[float, Field(gt=0.0, le=3.0)]


class BoxSurface(Contract):
    """A box whose upper face is walkable; rotated by either ``yaw_rad`` or ``orientation_wxyz``."""

    name: SurfaceName
    kind: Literal["box"]
    center_m: Position
    size_m: tuple[Edge, Edge, Edge]
    yaw_rad: Annotated[float, Field(ge=-100.0, le=100.0)] | None = None
    orientation_wxyz: Quaternion | None = None
    friction: Friction | None = Field(default=None, description="null takes that of the scenario")


class RailSurface(Contract):
    """A cylindrical bar; the normal of a contact is perpendicular to the bar, in its vertical plane."""

    name: SurfaceName
    kind: Literal["rail"]
    from_m: Position
    to_m: Position
    radius_m: Annotated[float, Field(gt=0.0, le=0.5)]
    friction: Friction | None = Field(default=None, description="null takes that of the scenario")


TerrainSurface = Annotated[BoxSurface | RailSurface, Field(discriminator="kind")]


class ScenarioContact(Contract):
    """An effector on a surface: position and orientation of its contact frame in the world."""

    effector: Annotated[str, Field(min_length=1, max_length=60)]
    position_m: Position
    orientation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


_OMITTED: Final[Any] = None
"""Value of a duration until ``fill_durations`` replaces it."""


class ScenarioPhase(Contract):
    """A time interval with constant contacts.

    A phase of a request may omit ``duration_s``: it then lasts as long as in the plans of the contact planner. Answers
    always have it.
    """

    duration_s: float = Field(default=_OMITTED, ge=-1e4, le=1e4, description="seconds, 0.05 to 60")
    contacts: Annotated[list[ScenarioContact], Field(max_length=16)]

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(handler(core_schema))
        schema["properties"]["duration_s"].pop("default", None)
        return schema


ENDS_S: Final = 2.0
REST_S: Final = 0.4
HAND_MOVE_S: Final = 1.8
FOOT_MOVE_S: Final = 1.4
LEVEL_MOVE_SHARE: Final = 0.7
LEVEL_M: Final = 0.02
LONG_MOVE_M: Final = 0.7
FEET: Final = frozenset({"left_foot", "right_foot"})


def fill_durations(phases: list[ScenarioPhase]) -> list[ScenarioPhase]:
    """Give phases without a duration the one of the contact planner.

    The first and the last phase last ``ENDS_S``, others in which no effector moves ``REST_S``. A move of a foot lasts
    ``FOOT_MOVE_S``, ``LEVEL_MOVE_SHARE`` of it on level ground, that of a hand ``HAND_MOVE_S``; moves farther than
    ``LONG_MOVE_M`` last longer in proportion.
    """
    stances = [{contact.effector: contact.position_m for contact in phase.contacts} for phase in phases]
    return [
        phase.model_copy(update={"duration_s": _default_duration_s(stances, k)}) if phase.duration_s is None else phase
        for k, phase in enumerate(phases)
    ]


def _default_duration_s(stances: list[dict[str, Position]], k: int) -> float:
    if k in (0, len(stances) - 1):
        return ENDS_S
    longest_s = REST_S
    for name in (stances[k - 1].keys() | stances[k + 1].keys()) - stances[k].keys():
        before = next((stance[name] for stance in stances[k - 1 :: -1] if name in stance), None)
        after = next((stance[name] for stance in stances[k + 1 :] if name in stance), None)
        move_s, share = FOOT_MOVE_S if name in FEET else HAND_MOVE_S, 1.0
        if before is not None and after is not None:
            if name in FEET and abs(after[2] - before[2]) < LEVEL_M:
                move_s *= LEVEL_MOVE_SHARE
            share = max(1.0, hypot(after[0] - before[0], after[1] - before[1]) / LONG_MOVE_M)
        longest_s = max(longest_s, round(move_s * share, 3))
    return longest_s


class Scenario(Contract):
    """Body of ``POST /scenarios`` and ``PUT /scenarios/{id}``: a contact sequence on a terrain.

    The fields of a stored scenario are ignored, so that what was downloaded can be sent again.
    """

    ignored_fields = frozenset({"id", "created_at", "updated_at", "bundled", "owner"})

    name: OneLine
    description: Prose = ""
    robot: Annotated[str, Field(min_length=1, max_length=60)]
    friction: Friction = 0.3
    start_com_height_m: ComHeight | None = Field(
        default=None,
        description="initial CoM height above the mean of the soles; null takes the usual one of the robot",
    )
    terrain: Annotated[list[TerrainSurface], Field(max_length=200)]
    phases: Annotated[list[ScenarioPhase], Field(max_length=400), AfterValidator(fill_durations)]


class ScenarioSource(Contract):
    """Base of inputs that refer to a stored scenario or contain a complete one."""

    scenario_id: str | None = None
    scenario: Scenario | None = None

    @model_validator(mode="after")
    def _check_source(self) -> "ScenarioSource":
        if (self.scenario_id is None) == (self.scenario is None):
            raise ValueError("give either scenario_id or scenario")
        return self


class StoredScenario(Scenario):
    """A stored scenario; bundled ones are read-only."""

    id: str
    created_at: datetime
    updated_at: datetime | None = None
    bundled: bool = False
    owner: str | None = None

    @property
    def etag(self) -> str:
        """Entity tag for ``If-Match``: ``updated_at`` in its JSON form, including the quotes."""
        return self.model_dump_json(include={"updated_at"}).partition(":")[2].removesuffix("}")


class ContactMargin(Contract):
    """Distances of one contact to its limits; negative values are violations."""

    phase: int
    effector: str
    surface: str | None
    height_m: float | None = Field(description="height of the contact frame above (+) or below (-) the surface")
    edge_m: float | None = Field(description="distance from the contact patch to the edge of its surface, inside > 0")
    reach_m: float | None = Field(description="slack of the reach limits, common to the contacts of the phase")


class PhaseSupport(Contract):
    """Whether the robot can be at rest on the contacts of a phase."""

    phase: int
    margin_m: float | None = Field(
        description="maximum distance of a reachable CoM to the border of the support region; negative: the robot can "
        "only pass the phase dynamically; null without a region or reachability data"
    )
    com_m: Position | None = Field(description="CoM position with this distance")


BodyAnswer = Literal["reachable", "unreachable", "not-asked"]
"""Whether the whole body can reach the stance of a phase; ``not-asked`` if this was not checked."""


class PhaseBody(Contract):
    """Result of the whole-body check for one phase: its stance, and the motion through it."""

    phase: int
    body: BodyAnswer
    reason: str | None = Field(default=None, description="violated constraint, if unreachable")
    limits: list[str] = Field(
        default_factory=list,
        description="effector that misses its contact and joints at their limits, two links in collision, or what "
        "limits the motion through the phase",
    )
    link_poses: list[LinkPose] | None = Field(
        default=None,
        description="for the phase `posture_of`: poses in the world of the `links` of `GET /robots/{name}`, in the "
        "posture that reaches the contacts or comes closest to them",
    )


class ScenarioCheck(Contract):
    """Response of ``POST /scenarios/check``.

    Per phase, ``support_region_m`` is the polygon above which the CoM can be at rest, ``support`` the margin within it,
    and ``phases`` whether the whole body can reach the stance, if the request sets ``body_checked``.
    """

    valid: bool
    errors: list[FaultItem]
    warnings: list[Remark]
    margins: list[ContactMargin]
    support_region_m: list[list[tuple[float, float]]]
    support: list[PhaseSupport]
    phases: list[PhaseBody] = Field(default_factory=list)
    duration_s: float


Length = Annotated[float, Field(ge=0.05, le=10.0, description="metres")]
Angle = Annotated[float, Field(ge=-0.7, le=0.7, description="radians")]
Count = Annotated[int, Field(ge=1, le=40)]


SceneName = Literal["flat-walk", "long-stride", "six-stairs", "stairs-down", "stairs-with-rail", "stand-up"]
"""Bundled scenes that can be scaled to any robot; the last two need a right arm."""


class ScaledScene(Contract):
    """Body of ``POST /scenarios/scaled``: a bundled scene for a robot."""

    robot: Annotated[str, Field(min_length=1, max_length=60)]
    scene: SceneName


class CourseLevel(Contract):
    """Level ground; ``width_m`` null is as wide as the course."""

    kind: Literal["level"]
    length_m: Length = 1.0
    width_m: Length | None = None


class CourseStairs(Contract):
    """A flight of stairs, upwards, or downwards for a negative rise."""

    kind: Literal["stairs"]
    number: Count = 4
    rise_m: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.10
    depth_m: Length = 0.30


class CourseRamp(Contract):
    """A slope, upwards, or downwards for a negative angle; ``length_m`` is horizontal."""

    kind: Literal["ramp"]
    length_m: Length = 1.5
    slope_rad: Angle = 0.14


class CourseStones(Contract):
    """Stones for the right and the left foot in turn, with no ground between; their tops lean by ``tilt_rad``."""

    kind: Literal["stones"]
    number: Count = 4
    spacing_m: Length = 0.27
    tilt_rad: Angle = 0.0


class CourseBar(Contract):
    """A bar across level ground, to step over."""

    kind: Literal["bar"]
    height_m: Annotated[float, Field(ge=0.005, le=1.0)] = 0.06
    thickness_m: Annotated[float, Field(ge=0.005, le=1.0)] = 0.05


class CourseBox(Contract):
    """A box as wide as the course, to step on and off; its top is level."""

    kind: Literal["box"]
    height_m: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.10
    length_m: Length = 0.40


class CourseGap(Contract):
    """No ground."""

    kind: Literal["gap"]
    length_m: Annotated[float, Field(ge=0.01, le=2.0)] = 0.15


CourseElement = Annotated[
    CourseLevel | CourseStairs | CourseRamp | CourseStones | CourseBar | CourseBox | CourseGap,
    Field(discriminator="kind"),
]


class Course(Contract):
    """Body of ``POST /scenarios/compose``: a platform, ``elements`` in a row along x, another platform.

    Handrails run along the whole course at the height of the robot's hands.
    """

    name: OneLine = "Course"
    robot: Annotated[str, Field(min_length=1, max_length=60)]
    friction: Friction = 0.5
    width_m: Annotated[float, Field(ge=0.3, le=6.0)] = 1.2
    handrails: Annotated[list[Literal["left", "right"]], Field(max_length=2)] = Field(default_factory=list)
    elements: Annotated[list[CourseElement], Field(min_length=1, max_length=20)]


TerrainUnit = Literal["m", "cm", "mm"]
UpAxis = Literal["+z", "-z", "+y", "-y", "+x", "-x"]
Place = Annotated[tuple[Metres, Metres], Field(description="x and y in metres; the feet stand on the highest surface")]


class TerrainCrossing(Contract):
    """A terrain, as ``POST /terrains`` finds it in a file, and the places where the robot starts and ends.

    The robot faces the goal at both places, with its feet beside each other.
    """

    robot: Annotated[str, Field(min_length=1, max_length=60)]
    terrain: Annotated[list[TerrainSurface], Field(min_length=1, max_length=200)]
    start_m: Place
    goal_m: Place
    friction: Friction = 0.3
    name: OneLine | None = None


class FoundStairs(Contract):
    """A flight of stairs: treads of one rise and run, from the lowest to the highest, and the rails beside them."""

    rise_m: float
    run_m: float
    width_m: float
    start_m: Annotated[list[float], Field(min_length=3, max_length=3, description="middle of the lowest riser's foot")]
    heading_rad: Annotated[float, Field(description="direction of the ascent, about z from x")]
    treads: list[str]
    rails: list[str]


class ReadTerrain(Contract):
    """Surfaces of a terrain as in a scenario, the flights of stairs among them, and remarks on what was left out."""

    terrain: list[TerrainSurface]
    stairs: list[FoundStairs] = Field(default_factory=list)
    remarks: list[str] = Field(default_factory=list)
