"""Schema of a crossing: where a robot starts on a terrain and where it goes."""

from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract
from stridelab.schemas.scenarios import Friction, Metres, OneLine, TerrainSurface

TerrainUnit = Literal["m", "cm", "mm"]
UpAxis = Literal["+z", "+y"]
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
