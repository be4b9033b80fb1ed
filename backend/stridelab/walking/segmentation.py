"""The thesis' rule for double support (section 3.3.3): from one crossing of the hub's height to the next.

The point on the wheel is below the hub from theta = -pi/2 to +pi/2 around a lowest point. That is half a turn whatever
the double support is, so the rule is shown beside the timing of plates and markers, never instead of it.
"""

import numpy as np

from stridelab.conventions import Series
from stridelab.walking.curtate_cycloid import FullTurn
from stridelab.walking.path_fit import PathFit
from stridelab.walking.timed_fit import TimedFit

QUARTER_TURN = FullTurn / 4


def double_support_of_wheel(fit: PathFit | TimedFit, time_s: Series) -> tuple[float | None, float | None]:
    """Seconds at which the wheel says that double support begins and ends; ``time_s`` are the samples of the fit.

    A crossing that lies outside the samples is None, and so are both where theta does not increase throughout.
    """
    if isinstance(fit, PathFit):
        return valley(time_s, fit.theta_rad)
    return valley(time_s, fit.theta0_rad + fit.omega_rad_s * (time_s - time_s[0]))


def valley(time_s: Series, theta_rad: Series) -> tuple[float | None, float | None]:
    """When theta passes -pi/2 and +pi/2 around the lowest point of which the samples see most.

    Of two that are seen alike the later one: a step ends with its double support.
    """
    if not (np.diff(theta_rad) > 0).all():
        return None, None
    first, last = float(theta_rad[0]), float(theta_rad[-1])
    lowest = FullTurn * np.arange(np.floor(first / FullTurn), np.ceil(last / FullTurn) + 1)
    seen = np.minimum(lowest + QUARTER_TURN, last) - np.maximum(lowest - QUARTER_TURN, first)
    if seen.max() <= 0.0:
        return None, None
    centre = float(lowest[np.flatnonzero(seen >= seen.max() - 1e-9)[-1]])
    return _when(time_s, theta_rad, centre - QUARTER_TURN), _when(time_s, theta_rad, centre + QUARTER_TURN)


def _when(time_s: Series, theta_rad: Series, angle_rad: float) -> float | None:
    if not theta_rad[0] <= angle_rad <= theta_rad[-1]:
        return None
    return float(np.interp(angle_rad, theta_rad, time_s))
