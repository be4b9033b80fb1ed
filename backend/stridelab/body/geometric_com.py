"""Result of the segment model: the CoM from markers and a segment table (input (i) of section 2.4.1)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stridelab.conventions import Points, Rotation, Series, Vector3
from stridelab.recordings.recording import Remark


@dataclass(frozen=True)
class SegmentTrack:
    """One body segment: its share of the body mass and its own CoM over time."""

    mass_fraction: float
    com_m: Points


@dataclass(frozen=True)
class GeometricCom:
    """CoM of the segment model at the marker instants (NaN where it cannot be formed).

    ``sd_m`` is the prior standard deviation per axis of the whole-body position (table error plus the errors of missing
    or substituted segments). ``joint_centres_m`` is for drawing the skeleton. ``references`` are citation keys.
    ``ground_m_s`` is the velocity of the walking surface: that of the belt on a treadmill, else zero.
    """

    time_s: Series
    com_m: Points
    table: str
    segments: Mapping[str, SegmentTrack]
    joint_centres_m: Mapping[str, Points]
    sd_m: tuple[float, float, float]
    remarks: tuple[Remark, ...] = ()
    references: tuple[str, ...] = ()
    ground_m_s: Vector3 = field(default_factory=lambda: np.zeros(3))

    def rotated_to(self, R: Rotation) -> "GeometricCom":
        """Rotate all positions into the axes given by the rows of ``R``; ``sd_m`` is unchanged."""
        return replace(
            self,
            com_m=self.com_m @ R.T,
            ground_m_s=R @ self.ground_m_s,
            segments={name: replace(s, com_m=s.com_m @ R.T) for name, s in self.segments.items()},
            joint_centres_m={name: track @ R.T for name, track in self.joint_centres_m.items()},
        )
