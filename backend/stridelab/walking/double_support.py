"""Double support by the rule of the thesis (section 3.3.3): from one crossing of the hub's height to the next.

The point on the wheel is below the hub from theta = -pi/2 to +pi/2 around a lowest point. That is always half a turn,
so the rule is reported in addition to the timing of plates and markers, never instead of it.
"""

import numpy as np

from stridelab.conventions import Series
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD
from stridelab.walking.path_fit import PathFit
from stridelab.walking.timed_fit import TimedFit

QUARTER_TURN = FULL_TURN_RAD / 4


def double_support_of_wheel(
    fit: PathFit | TimedFit, time_s: Series, near_s: float | None = None
) -> tuple[float | None, float | None]:
    """Start and end of double support by the wheel, in seconds; ``time_s`` are the samples of the fit.

    Uses the lowest point of the turn at ``near_s``, by default the last sample, because a step ends with its double
    support. A crossing outside the samples is None; both are None if theta is not increasing.
    """
    near_s = float(time_s[-1]) if near_s is None else near_s
    if isinstance(fit, PathFit):
        return crossings_at_lowest(time_s, fit.theta_rad, near_s)
    return crossings_at_lowest(time_s, fit.theta0_rad + fit.omega_rad_s * (time_s - time_s[0]), near_s)


def crossings_at_lowest(time_s: Series, theta_rad: Series, near_s: float) -> tuple[float | None, float | None]:
    """Times at which theta passes -pi/2 and +pi/2 around the lowest point nearest at ``near_s``."""
    if not (np.diff(theta_rad) > 0).all():
        return None, None
    lowest = FULL_TURN_RAD * float(np.round(np.interp(near_s, time_s, theta_rad) / FULL_TURN_RAD))
    return _time_at_angle(time_s, theta_rad, lowest - QUARTER_TURN), _time_at_angle(
        time_s, theta_rad, lowest + QUARTER_TURN
    )


def _time_at_angle(time_s: Series, theta_rad: Series, angle_rad: float) -> float | None:
    if not theta_rad[0] <= angle_rad <= theta_rad[-1]:
        return None
    return float(np.interp(angle_rad, theta_rad, time_s))
