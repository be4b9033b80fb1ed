"""Surfaces that can be touched: boxes, stood on by their upper faces, and rails."""

from collections.abc import Sequence
from dataclasses import dataclass

from stridelab.conventions import Vector3
from stridelab.dynamics.placement import Placement


@dataclass(frozen=True, eq=False)
class Box:
    """A box; ``placement`` is that of its centre, ``size_m`` its three edges. ``friction`` None: the scenario's."""

    name: str
    placement: Placement
    size_m: Vector3
    friction: float | None = None


@dataclass(frozen=True, eq=False)
class Rail:
    """A round bar from one end of its axis to the other."""

    name: str
    from_m: Vector3
    to_m: Vector3
    radius_m: float
    friction: float | None = None


Surface = Box | Rail


@dataclass(frozen=True, eq=False)
class Terrain:
    """All surfaces; there is no floor but the boxes."""

    surfaces: tuple[Surface, ...]

    @staticmethod
    def of(surfaces: Sequence[Surface]) -> "Terrain":
        """From any sequence of surfaces."""
        return Terrain(tuple(surfaces))

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The boxes among the surfaces."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, Box))

    @property
    def rails(self) -> tuple[Rail, ...]:
        """The rails among the surfaces."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, Rail))
