"""Where the densities of a plan's contacts stand: one node per contact, for as long as the density stays in its place.

The density of a foot stays with its touch. That of a hand may live in a frame that turns with the soles
(``heading``), so that it has a node per phase.
"""

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.schemas.reachability import EffectorReach, LevelSurface, RobotReachability
from stridelab.schemas.scenarios import Scenario, ScenarioContact
from stridelab_web.scene.contacts import rotation, touches

GROUP: Final = "/reach/"
SHOWN_MASS: Final = 0.8
"""The level set that is shown: one, so that those of several contacts can be told apart."""
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class ReachPlace:
    """A contact for a while: the node of its density, and the heading of the soles of the phase (rad)."""

    name: str
    contact: ScenarioContact
    heading_rad: float
    start_s: float
    end_s: float

    def wxyz(self, found: EffectorReach) -> Quaternion:
        """How the density is turned."""
        if found.card.frame == "contact":
            return self.contact.orientation_wxyz
        return float(np.cos(self.heading_rad / 2)), 0.0, 0.0, float(np.sin(self.heading_rad / 2))


def reach_places(scenario: Scenario) -> tuple[ReachPlace, ...]:
    """All places in the order of the touches."""
    ends_s = [0.0, *itertools.accumulate(phase.duration_s for phase in scenario.phases)]
    headings = headings_rad(scenario)
    found = []
    for touch in touches(scenario):
        phases = range(touch.first_phase, touch.last_phase + 1)
        runs = [(k, k) for k in phases] if "hand" in touch.effector else [(phases[0], phases[-1])]
        found += [
            ReachPlace(f"{GROUP}{touch.number}/{k}", touch.contact, headings[first], ends_s[first], ends_s[last + 1])
            for k, (first, last) in enumerate(runs)
        ]
    return tuple(found)


def repeats(places: Iterable[ReachPlace]) -> list[tuple[str, str]]:
    """Nodes that show the density of an earlier one elsewhere: their names and those of the first of the effector."""
    first: dict[str, str] = {}
    named = [(place.name, first.setdefault(place.contact.effector, place.name)) for place in places]
    return [(name, of) for name, of in named if name != of]


def headings_rad(scenario: Scenario) -> list[float]:
    """The mean direction of the soles in each phase, seen from above; 0 where there is no sole.

    Of a sole in the air counts the contact that it has left, before its first one that, as in the plan.
    """
    phases = [{c.effector: c for c in phase.contacts if "foot" in c.effector} for phase in scenario.phases]
    feet = {name: [phase.get(name) for phase in phases] for phase in phases for name in phase}
    found: list[float] = []
    for k in range(len(phases)):
        places = [next(c for c in (*reversed(held[: k + 1]), *held[k:]) if c is not None) for held in feet.values()]
        x, y, _ = np.sum([rotation(c.orientation_wxyz)[:, 0] for c in places], axis=0) if places else (1.0, 0.0, 0.0)
        found.append(float(np.arctan2(y, x)))
    return found


def surfaces(reach: RobotReachability | None) -> Mapping[str, tuple[EffectorReach, LevelSurface]]:
    """The shown level set by effector; nothing where nothing was learned."""
    learned = reach.effectors if reach is not None else []
    return {
        each.card.effector: (each, level)
        for each in learned
        for level in each.level_sets
        if abs(level.mass - SHOWN_MASS) < 1e-9
    }
