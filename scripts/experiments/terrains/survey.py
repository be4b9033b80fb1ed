"""The scenarios of a survey, by a seed: robots and classes in turn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from experiments.terrains import level, uneven
from experiments.terrains.bounds import BOUNDS, Bounds
from experiments.terrains.draw import Draw
from experiments.terrains.steps import mirrored
from stridelab.contacts.scenarios.parts import Scenario

CLASSES: Final[Mapping[str, Callable[[Draw, Bounds], Scenario]]] = {
    "arc": level.arc,
    "turn": level.turn,
    "sidestep": level.sidestep,
    "ramp": uneven.ramp,
    "spiral": uneven.spiral,
    "stones": uneven.stones,
    "beam": level.beam,
    "bar": level.bar,
    "stairs": uneven.stairs,
    "alternate": uneven.alternate,
    "rail": uneven.rail,
    "walk": level.walk,
}
"""Builders of scenarios by class."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A random scenario."""

    index: int
    robot: str
    kind: str
    scenario: Scenario


def random_scenarios(number: int, seed: int) -> list[Drawn]:
    """``number`` scenarios; every scenario depends on the seed and its index only, every other one is mirrored."""
    robots, kinds = tuple(BOUNDS), tuple(CLASSES)
    drawn = []
    for index in range(number):
        robot, kind = robots[index % len(robots)], kinds[index // len(robots) % len(kinds)]
        draw = Draw(np.random.default_rng([seed, index]))
        candidate = CLASSES[kind](draw, BOUNDS[robot])
        drawn.append(Drawn(index, robot, kind, mirrored(candidate) if draw.coin() else candidate))
    return drawn
