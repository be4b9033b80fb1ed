"""What no wheel is fitted to: numbers that are none, a clock that stands, and a body that does not get ahead."""

from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.walking.curtate_cycloid import Plane

FEWEST_SAMPLES: Final = 8
"""Twice the parameters of the wheel."""
LEAST_ADVANCE_M: Final = 0.05
"""Who sways on the spot moves less than this, who walks ten times more."""
PERIODS_S: Final = (0.1, 3.0)
"""Of one step."""


def require_path(time_s: Series, path_m: Plane, step_period_s: float) -> None:
    """Whether ``path_m`` can be a step.

    Raises ``InvalidInput``: ``path-not-finite``, ``time-not-increasing``, ``period-out-of-range``; and
    ``NotEstimable``: ``too-few-samples``, or ``no-progress`` (standing, or a treadmill whose belt moves instead of the
    body).
    """
    if len(time_s) < FEWEST_SAMPLES:
        message = f"The step has {len(time_s)} samples; a wheel needs {FEWEST_SAMPLES} at least."
        raise NotEstimable("too-few-samples", message)
    good = np.isfinite(path_m).all(axis=1) & np.isfinite(time_s)
    if not good.all():
        first = int(np.flatnonzero(~good)[0])
        message = f"The centre of mass is not known at {np.count_nonzero(~good)} of {len(good)} samples of the step."
        raise InvalidInput("path-not-finite", message, [Fault(f"path_m[{first}]", "not a finite number")])
    if not (np.diff(time_s) > 0).all():
        first = int(np.flatnonzero(np.diff(time_s) <= 0)[0]) + 1
        message = "The instants of the samples must increase."
        raise InvalidInput("time-not-increasing", message, [Fault(f"time_s[{first}]", "not after the one before")])
    low, high = PERIODS_S
    if not low <= step_period_s <= high:
        message = f"A step cannot take {step_period_s:g} s; it takes {low:g} to {high:g} s."
        raise InvalidInput("period-out-of-range", message, [Fault("period_s", message)])
    advance = float(np.ptp(path_m[:, 0]))
    if advance < LEAST_ADVANCE_M:
        raise NotEstimable(
            "no-progress",
            f"The centre of mass gets ahead by {1e3 * advance:.0f} mm only, so there is no wheel that rolls. "
            "Was somebody standing, or walking on a treadmill?",
        )
