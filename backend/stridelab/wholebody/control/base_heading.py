"""Reference orientation of the base: upright, with the heading of the feet.

At the start of every phase the heading is that of its soles (``ContactSequence.headings_rad``); it is interpolated to
that of the next phase by the quintic with zero rates at both ends,
``s(x) = x^3 (10 - 15 x + 6 x^2)``.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Rotation, Vector3


@dataclass(frozen=True, eq=False)
class Heading:
    """Yaw (rad, unwrapped) at every phase boundary ``(n_phases + 1,)``."""

    sequence: ContactSequence
    yaw_rad: Float[np.ndarray, "n"]

    @staticmethod
    def of_sequence(sequence: ContactSequence) -> "Heading":
        """Headings of the phases; the last one holds until the end."""
        return Heading(sequence, np.append(sequence.headings_rad, sequence.headings_rad[-1]))

    def orientation_at(self, phase: int, time_s: float) -> tuple[Rotation, Vector3, Vector3]:
        """Rotation, angular velocity and acceleration in world axes."""
        T = self.sequence.phases[phase].duration_s
        x = min(max((time_s - float(self.sequence.starts_s[phase])) / T, 0.0), 1.0)
        turn = self.yaw_rad[phase + 1] - self.yaw_rad[phase]
        yaw = self.yaw_rad[phase] + turn * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        rate = turn * 30.0 * x**2 * (1.0 - x) ** 2 / T
        rate_rate = turn * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / T**2
        c, s = np.cos(yaw), np.sin(yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return R, np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, rate_rate])
