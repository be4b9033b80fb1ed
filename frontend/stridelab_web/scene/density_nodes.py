"""Nodes of the densities of a plan's contacts: one per contact and interval in which the density has a constant pose.

The density of a foot is fixed to its contact. That of a hand may be given in a frame that turns with the soles
(``heading``), so that it has a node per phase.
"""

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.schemas.reachability import EffectorReach, LevelSurface, RobotReachability
from stridelab.schemas.scenarios import Scenario, ScenarioContact
from stridelab_web.scene.contacts import placed_contacts, rotation_matrix

GROUP: Final = "/reach/"
SHOWN_MASS: Final = 0.8
"""Mass of the level set that is shown; with a single one, several contacts are distinguishable."""
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class ReachPlace:
    """A contact over an interval: the node of its density, and the heading of the soles (rad)."""

    name: str
    contact: ScenarioContact
    heading_rad: float
    start_s: float
    end_s: float

    def orientation_wxyz(self, reach: EffectorReach) -> Quaternion:
        """Orientation of the density as a quaternion."""
        if reach.card.frame == "contact":
            return self.contact.orientation_wxyz
        return float(np.cos(self.heading_rad / 2)), 0.0, 0.0, float(np.sin(self.heading_rad / 2))


def reach_places(scenario: Scenario) -> tuple[ReachPlace, ...]:
    """All places in the order of the contacts."""
    ends_s = [0.0, *itertools.accumulate(phase.duration_s for phase in scenario.phases)]
    headings = headings_rad(scenario)
    places = []
    for touch in placed_contacts(scenario):
        phases = range(touch.first_phase, touch.last_phase + 1)
        runs = [(k, k) for k in phases] if "hand" in touch.effector else [(phases[0], phases[-1])]
        places += [
            ReachPlace(f"{GROUP}{touch.number}/{k}", touch.contact, headings[first], ends_s[first], ends_s[last + 1])
            for k, (first, last) in enumerate(runs)
        ]
    return tuple(places)


def repeated_nodes(places: Iterable[ReachPlace]) -> list[tuple[str, str]]:
    """Pairs of node names: a node, and the first node of its effector, which shows the same density."""
    first: dict[str, str] = {}
    named = [(place.name, first.setdefault(place.contact.effector, place.name)) for place in places]
    return [(name, of) for name, of in named if name != of]


def headings_rad(scenario: Scenario) -> list[float]:
    """The mean direction of the soles in each phase, seen from above (rad); 0 without soles.

    A sole in the air counts with its previous contact, or else with its first one, as in the plan.
    """
    phases = [{c.effector: c for c in phase.contacts if "foot" in c.effector} for phase in scenario.phases]
    feet = {name: [phase.get(name) for phase in phases] for phase in phases for name in phase}
    headings: list[float] = []
    for k in range(len(phases)):
        places = [
            next(c for c in (*reversed(contacts[: k + 1]), *contacts[k:]) if c is not None)
            for contacts in feet.values()
        ]
        x, y, _ = (
            np.sum([rotation_matrix(c.orientation_wxyz)[:, 0] for c in places], axis=0) if places else (1.0, 0.0, 0.0)
        )
        headings.append(float(np.arctan2(y, x)))
    return headings


def shown_level_sets(reach: RobotReachability | None) -> Mapping[str, tuple[EffectorReach, LevelSurface]]:
    """The shown level set by effector; empty without densities."""
    learned = reach.effectors if reach is not None else []
    return {
        each.card.effector: (each, level)
        for each in learned
        for level in each.level_sets
        if abs(level.mass - SHOWN_MASS) < 1e-9
    }
