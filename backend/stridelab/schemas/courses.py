"""Schemas of courses: obstacles in a row, from which a terrain and the stances at both ends are composed."""

from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract
from stridelab.schemas.scenarios import Friction, OneLine

Length = Annotated[float, Field(ge=0.05, le=10.0, description="metres")]
Angle = Annotated[float, Field(ge=-0.7, le=0.7, description="radians")]
Count = Annotated[int, Field(ge=1, le=40)]


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


class CourseGap(Contract):
    """No ground."""

    kind: Literal["gap"]
    length_m: Annotated[float, Field(ge=0.01, le=2.0)] = 0.15


CourseElement = Annotated[
    CourseLevel | CourseStairs | CourseRamp | CourseStones | CourseBar | CourseGap, Field(discriminator="kind")
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
