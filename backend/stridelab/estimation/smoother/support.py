"""Whether a window holds a full single support: without one, angular momentum and a wrong table look alike."""

from typing import Final

import numpy as np

from stridelab.errors import NotEstimable
from stridelab.estimation.smoother.signals import Walk

WALKS_M_S: Final = 0.3
SHARE_OF_STEP: Final = 0.65
"""A full single support lasts 0.75 to 0.85 of a step in walking."""
CERTAIN_STEPS: Final = 1.8
"""Any window this long holds one."""
LOADED_N: Final = 50.0


def require_single_support(walk: Walk, within: slice, step_hz: float) -> None:
    """Raise ``NotEstimable`` (``no-single-support``) for a short window in which no foot carries the body alone.

    In single support the centre of pressure stays on one side of the CoM; it crosses over in double support.
    """
    n = within.stop - within.start
    step = walk.rate_hz / step_hz
    if walk.speed_m_s < WALKS_M_S or n >= CERTAIN_STEPS * step:
        return
    f, nu = walk.force_n[within], walk.moment_nm[within]
    loaded = f[:, 2] > LOADED_N
    side = np.sign(nu[loaded, 0] / f[loaded, 2] - walk.geometry_m[within][loaded, 1])
    changes = np.flatnonzero(np.diff(side)) + 1
    longest = np.diff(np.concatenate([[0], changes, [len(side)]])).max()
    if longest < SHARE_OF_STEP * step:
        raise NotEstimable(
            "no-single-support",
            f"The longest time on one foot in the window is {longest / walk.rate_hz:.2f} s of a step of "
            f"{1 / step_hz:.2f} s. At least one full single support is needed.",
        )
