"""Random values of the survey's scenarios."""

from dataclasses import dataclass

import numpy as np

from experiments.terrains.bounds import Range
from stridelab.contacts.scenarios.parts import Timing

ENDS_S = 1.5
"""Standing at both ends of every scenario of the survey."""


@dataclass(frozen=True, eq=False)
class Draw:
    """Draws rounded values from a generator."""

    rng: np.random.Generator

    def number(self, bounds: Range, digits: int = 3) -> float:
        """A number within ``bounds``."""
        return round(float(self.rng.uniform(*bounds)), digits)

    def integer(self, low: int, high: int) -> int:
        """An integer from ``low`` to ``high``, both included."""
        return int(self.rng.integers(low, high + 1))

    def coin(self) -> bool:
        """True or false."""
        return bool(self.rng.integers(2))

    def sign(self) -> float:
        """1 or -1."""
        return 1.0 if self.coin() else -1.0

    def foot(self) -> str:
        """The foot that steps first."""
        return "left_foot" if self.coin() else "right_foot"

    def timing(self, move_s: Range, rest_s: Range) -> Timing:
        """Durations of swings and double supports."""
        return Timing(ENDS_S, self.number(move_s, 2), self.number(rest_s, 2))
