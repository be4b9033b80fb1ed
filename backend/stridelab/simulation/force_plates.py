"""Force plates in the floor, and the wrench of the feet on each of them.

``walkway``: two lanes of plates, left and right of the line of walking, bounded midway between the footprints of a
lane, so that every footprint has its own plate: all contact is measured while the subject is on the plates.
``two_plates``: two plates of 0.51 m x 0.46 m in a row, placed under two footprints in the middle of the recording, as
in most gait laboratories: all contact is measured for about one second.

A plate carries the share of a foot's pressure that lies on it. The pressure is uniform along ``2 h`` around its centre,
so that a footprint across an edge loads both plates and their wrenches add up exactly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from stridelab.conventions import Corners, Points, Series, Vector3
from stridelab.recordings.recording import Side
from stridelab.simulation.human.gait_plan import GaitPlan, Stance
from stridelab.simulation.human.load_sharing import FootWrench

LabName = Literal["walkway", "two_plates"]

LANE_WIDTH_M: Final = 0.60
MAX_PLATES: Final = 24
"""Maximum number of plates of a walkway; a longer walk is measured in its middle."""
PATCH_M: Final = 0.02
"""Half length h of the pressure patch."""
_SMALL_M: Final = (0.508, 0.464)
_END_M: Final = 0.35
"""Walkway before the first and after the last ankle of a lane."""


@dataclass(frozen=True)
class PlateArea:
    """Rectangle on the floor (z = 0): from ``low_m`` to ``high_m``, both (x, y)."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]

    @property
    def corners_m(self) -> Corners:
        """Corners in the order of the plate's quadrants; its own x points along the walkway, its z axis down."""
        (x0, y0), (x1, y1) = self.low_m, self.high_m
        return np.array([[x1, y0, 0.0], [x0, y0, 0.0], [x0, y1, 0.0], [x1, y1, 0.0]])

    @property
    def middle_m(self) -> Vector3:
        """Centre of the rectangle, on the floor."""
        return np.asarray(self.corners_m.mean(axis=0))


def plate_areas(lab: LabName, plan: GaitPlan) -> tuple[PlateArea, ...]:
    """Plates of the laboratory, placed under the footprints within the recording."""
    recorded = [
        s for s in plan.stances if s.off_s > plan.record_from_s and s.strike_s < plan.record_from_s + plan.duration_s
    ]
    if lab == "two_plates":
        return _two_plates(plan, recorded)
    middle = plan.record_from_s + plan.duration_s / 2
    recorded = sorted(recorded, key=lambda s: abs(_mid_time_s(s, plan) - middle))[:MAX_PLATES]
    lanes = [
        _lane_plates(sorted(s.x_m for s in recorded if s.side == side), side, plan.sole_middle_m)
        for side in ("left", "right")
    ]
    return tuple(sorted((area for lane in lanes for area in lane), key=lambda area: (area.low_m[0], area.low_m[1])))


def plate_wrench(area: PlateArea, feet: Mapping[Side, FootWrench]) -> tuple[Points, Points]:
    """Force on the body from this plate and moment at the world origin, at the samples of ``feet``."""
    n = len(next(iter(feet.values())).force_n)
    force, moment = np.zeros((n, 3)), np.zeros((n, 3))
    for foot in feet.values():
        share, centre_m = _patch_on_plate(area, foot.cop_m)
        plate_force = share[:, None] * foot.force_n
        force += plate_force
        moment += np.cross(centre_m, plate_force)
        moment[:, 2] += share * foot.free_moment_nm
    return force, moment


def _patch_on_plate(area: PlateArea, cop_m: Points) -> tuple[Series, Points]:
    """Share of the pressure patch on the plate and the centre of that part."""
    x, y = cop_m[:, 0], cop_m[:, 1]
    start = np.clip(x - PATCH_M, area.low_m[0], area.high_m[0])
    end = np.clip(x + PATCH_M, area.low_m[0], area.high_m[0])
    beside = (y < area.low_m[1]) | (y >= area.high_m[1])
    share = np.where(beside, 0.0, (end - start) / (2 * PATCH_M))
    return share, np.column_stack([(start + end) / 2, y, np.zeros(len(x))])


def _lane_plates(x_m: Sequence[float], side: Side, middle_m: float) -> list[PlateArea]:
    footprints = sorted(set(x_m))
    if not footprints:
        return []
    inner = [(a + b) / 2 + middle_m for a, b in pairwise(footprints)]
    edges = [footprints[0] - _END_M, *inner, footprints[-1] + _END_M + 2 * middle_m]
    y0, y1 = (0.0, LANE_WIDTH_M) if side == "left" else (-LANE_WIDTH_M, 0.0)
    return [PlateArea((a, y0), (b, y1)) for a, b in pairwise(edges)]


def _two_plates(plan: GaitPlan, recorded: Sequence[Stance]) -> tuple[PlateArea, ...]:
    if not plan.walks:
        return _lane_plates([0.0], "right", plan.sole_middle_m)[0], _lane_plates([0.0], "left", plan.sole_middle_m)[0]
    middle = plan.record_from_s + plan.duration_s / 2
    k = min(range(len(recorded) - 1), key=lambda i: abs(recorded[i + 1].strike_s - middle))
    length, width = min(_SMALL_M[0], 0.95 * plan.step_length_m), _SMALL_M[1]
    centres = [stance.x_m + plan.sole_middle_m for stance in recorded[k : k + 2]]
    return tuple(PlateArea((c - length / 2, -width / 2), (c + length / 2, width / 2)) for c in centres)


def _mid_time_s(stance: Stance, plan: GaitPlan) -> float:
    start = max(stance.strike_s, plan.record_from_s)
    return (start + min(stance.off_s, plan.record_from_s + plan.duration_s)) / 2
