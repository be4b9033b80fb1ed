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

from stridelab.estimation.quality.measures import MIN_CONTRADICTING_SHARE, contradicting_share

LEG_MASS_SHARE: Final = 0.39
"""Share of both legs in the mass of a body; 0.28 to 0.50 in 87 public body models of whole bodies."""
THIGH_OVER_TRUNK: Final = 0.73
"""Thigh over the trunk from hips to neck; median of 110 recordings of 40 people (docs/theory/quality.md)."""
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
        # The sine of the angle: 3 and 6 degrees. 0.1 of gravity moves a body by half a metre in a second.
        "force_tilt": Limit(0.05, 0.1),
        # 1 is the expectation if all errors are as stated; 2.05 the 1e-4 quantile of chi-squared with 40 degrees of
        # freedom over 40, fewer than in the shortest window.
        "normalised_innovations": Limit(1.0, 2.0),
        # 15 % of the weight is the standard deviation of the vertical force in a walk, 8 % that of the fore-aft force:
        # a difference of that size explains none of the force. The residual includes the error of the mass.
        "force_residual": Limit(0.05, 0.15),
        # In runs and jumps it contradicts from half of the force's own standard deviation on, 28 to 50 % of the weight.
        "acceleration_difference": Limit(0.08, MIN_CONTRADICTING_SHARE),
        # A channel that reads half or twice the force, or the wrong way round, is 1 or more from a gain of 1.
        "channel_gain": Limit(0.25, 0.5),
        # At 1 the motion fits equally well to the channels exchanged; above 1.5 a third less is left unexplained.
        "channel_exchange": Limit(1.1, 1.5),
        "mass_from_motion": Limit(0.04, 0.15),
        "mass_from_standing": Limit(0.04, 0.15),
        # A measured mass that is not known within what two masses may differ by. No uncertainty contradicts.
        "mass_uncertainty": Limit(0.04, 10.0),
        # Nothing carries a body in flight; half of its weight is more than any error of marker or plate explains.
        "flight_acceleration": Limit(0.1, 0.5),
        # ``passes`` is replaced by the 95 % circle, or band, of the geometry's own standard deviation.
        "horizontal_bias": Limit(0.05, 0.05, "m"),
        "vertical_bias": Limit(0.08, 0.08, "m"),
        # At any one time: 15 degrees of lean of a trunk that is not marked, 4 standard deviations of one that is.
        "largest_difference": Limit(0.05, 0.05, "m"),
        # Allows for 2 cm of tissue (passes) and 10 cm of unmarked head and hands (contradicts).
        "outside_body": Limit(0.02, 0.10, "m"),
        # The sole extends 6 cm beyond the markers of a foot; 15 cm is more than half a foot.
        "pressure_from_feet": Limit(0.06, 0.15, "m"),
        "pressure_off_plate": Limit(0.1, 0.5),
        # Times at a limit are not used, so that none contradicts. A channel that was mixed into others after it was
        # clipped cannot be found, which one that is found makes likely.
        "force_clipped": Limit(0.0, 1.0),
        # The hips of a person who sits lie 45 degrees behind the ankles, the neck 25; only a person who lies, crawls or
        # hangs extends farther from the vertical, and may do so. No angle contradicts.
        "body_axis": Limit(60.0, 180.0, "deg"),
        "leg_length_change": Limit(0.15, 0.5),
        # Logarithm of the ratio; a pelvis that is 10 cm too high changes it by 0.43. Above 0.9 the largest ratio of a
        # person and a pelvis that moves the centre of mass by 50 mm (0.57) do not suffice together.
        "body_proportions": Limit(0.3, 0.9),
        # 1 where labels and places named the markers, which are not checked. It does not contradict.
        "proposed_names": Limit(0.0, 1.0),
        # Legs of 54 % of the mass: more than a quarter of a body, 0.4 m higher, is missing, and the centre of mass is
        # 0.1 m too low.
        "model_leg_mass": Limit(0.12, 0.15),
    }
)


def limit_of(
    name: str, geometry_sd_m: tuple[float, float, float], force_share: float = 0.0, unmarked_share: float = 0.0
) -> Limit:
    """Limit of the check ``name`` for a geometric centre of mass with this standard deviation per axis.

    ``force_share`` and ``unmarked_share`` are those of ``acceleration_difference`` on its axis.
    """
    limit = LIMITS[name]
    if name == "acceleration_difference":
        return replace(limit, contradicts=float(contradicting_share(force_share, unmarked_share)))
    if name == "horizontal_bias":
        return replace(limit, passes=min(limit.contradicts, CIRCLE_95 * max(geometry_sd_m[:2])))
    if name == "vertical_bias":
        return replace(limit, passes=min(limit.contradicts, BAND_95 * geometry_sd_m[2]))
    return limit
