"""Limits of the checks; docs/theory/quality.md derives each and names the recordings.

``passes`` is the largest value of a good recording: if derived from recordings, the 1e-4 quantile of a log-normal
distribution (median and median absolute deviation) over the walks of eight subjects of the shared data, rounded up.
``contradicts`` follows from physics or from the model, never from recordings.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

CIRCLE_95: Final = math.sqrt(-2.0 * math.log(0.05))
"""Radius, in standard deviations per axis, of the circle that contains 95 % of a normal error in the plane."""
BAND_95: Final = 1.96
"""The same for one axis."""


@dataclass(frozen=True)
class Limit:
    """A check passes up to ``passes``; above ``contradicts`` the compared sensors contradict each other."""

    passes: float
    contradicts: float
    unit: str = "1"


LIMITS: Final[Mapping[str, Limit]] = MappingProxyType(
    {
        # 1 is the expectation if all errors are as stated; 2.05 the 1e-4 quantile of chi-squared with 40 degrees of
        # freedom over 40, fewer than in the shortest window.
        "normalised_innovations": Limit(1.0, 2.0),
        # 15 % of the weight is the standard deviation of the vertical force in a walk, 8 % that of the fore-aft force:
        # a difference of that size explains none of the force. The residual includes the error of the mass.
        "force_residual": Limit(0.05, 0.15),
        "acceleration_difference": Limit(0.08, 0.15),
        "mass_from_motion": Limit(0.04, 0.15),
        "mass_from_standing": Limit(0.04, 0.15),
        # ``passes`` is replaced by the 95 % circle, or band, of the geometry's own standard deviation.
        "horizontal_bias": Limit(0.05, 0.05, "m"),
        "vertical_bias": Limit(0.08, 0.08, "m"),
        # Allows for 2 cm of tissue (passes) and 10 cm of unmarked head and hands (contradicts).
        "outside_body": Limit(0.02, 0.10, "m"),
        # The sole extends 6 cm beyond the markers of a foot; 15 cm is more than half a foot.
        "pressure_from_feet": Limit(0.06, 0.15, "m"),
        "pressure_off_plate": Limit(0.1, 0.5),
        "leg_length_change": Limit(0.15, 0.5),
    }
)


def limit_of(name: str, geometry_sd_m: tuple[float, float, float]) -> Limit:
    """Limit of the check ``name`` for a geometric centre of mass with this standard deviation per axis."""
    limit = LIMITS[name]
    if name == "horizontal_bias":
        return replace(limit, passes=min(limit.contradicts, CIRCLE_95 * max(geometry_sd_m[:2])))
    if name == "vertical_bias":
        return replace(limit, passes=min(limit.contradicts, BAND_95 * geometry_sd_m[2]))
    return limit
