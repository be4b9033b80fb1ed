"""The friction cone of every touch of a plan: ``|f_t| <= mu f_n`` about the normal of what is touched."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from stridelab.schemas.scenarios import Scenario
from stridelab_web.footholds import side
from stridelab_web.tables import Columns
from stridelab_web.touches import Touch, touches

GROUP: Final = "/cones/"


@dataclass(frozen=True)
class Cone:
    """A touch and the friction coefficient of what it stands on."""

    touch: Touch
    friction: float

    @property
    def name(self) -> str:
        """Its node in a scene."""
        return f"{GROUP}{self.touch.number}"


def cones(scenario: Scenario, centroidal: Columns) -> tuple[Cone, ...]:
    """Cones of the touches whose friction the plan tells; none for plans of versions that did not."""
    phase = centroidal["phase"].astype(int)
    found = []
    for touch in touches(scenario):
        friction = centroidal.get(f"friction_{touch.effector}")
        there = (touch.first_phase <= phase) & (phase <= touch.last_phase)
        if friction is not None and friction[there].max(initial=0.0) > 0.0:
            found.append(Cone(touch, float(friction[there].max())))
    return tuple(found)


def twins(found: Iterable[Cone]) -> list[tuple[str, str]]:
    """Nodes of cones as wide as an earlier one and of its colour: their names and those of the first."""
    first: dict[tuple[float, str], str] = {}
    named = [(cone.name, first.setdefault((cone.friction, side(cone.touch.effector)), cone.name)) for cone in found]
    return [(name, of) for name, of in named if name != of]
