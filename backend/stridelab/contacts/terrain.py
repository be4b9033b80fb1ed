"""Contact surfaces: boxes, which feet stand on, and rails."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stridelab.conventions import Points, Vector3
from stridelab.dynamics.spatial import Placement


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
    """All surfaces; the floor is a box as well."""

    surfaces: tuple[Surface, ...]

    @staticmethod
    def from_surfaces(surfaces: Sequence[Surface]) -> "Terrain":
        """Create a terrain from any sequence of surfaces."""
        return Terrain(tuple(surfaces))

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The boxes among the surfaces."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, Box))

    @cached_property
    def box_bounds_m(self) -> tuple[Points, Points]:
        """Lower and upper corners ``(n_boxes, 3)`` of the axis-aligned bounding box of every box."""
        center = np.array([box.placement.position_m for box in self.boxes]).reshape(-1, 3)
        half = np.array([np.abs(box.placement.rotation) @ box.size_m / 2 for box in self.boxes]).reshape(-1, 3)
        return center - half, center + half

    @property
    def rails(self) -> tuple[Rail, ...]:
        """The rails among the surfaces."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, Rail))
