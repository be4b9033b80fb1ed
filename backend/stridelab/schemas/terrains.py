"""Schemas of a terrain that is read from a file."""

from typing import Annotated

from pydantic import Field

from stridelab.schemas.base import Contract
from stridelab.schemas.scenarios import TerrainSurface


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
