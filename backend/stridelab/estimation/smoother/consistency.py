"""Consistency checks of the smoother: single support in the window, and errors in agreement with their priors.

Without a full single support, angular momentum and an error of the segment table cannot be distinguished.

A constant error of the force is observable: integrated twice, it moves the CoM away from the geometry. Its posterior
mean m and variance V satisfy m ~ N(0, P0 - V) if the prior variance P0 is true, so m^2 / (P0 - V) is chi-squared with
one degree of freedom. A constant error of the *moment* is not observable: it has the effect of a table error.
"""

from typing import Final

import numpy as np
from scipy import stats

from stridelab.conventions import Rotation
from stridelab.errors import NotEstimable
from stridelab.estimation.smoother.kalman_rts import ForwardPass, Gains
from stridelab.estimation.smoother.measurements import Walk
from stridelab.estimation.smoother.state_space import ACCELERATION, StateSpace
from stridelab.recordings.recording import Remark

WALKS_M_S: Final = 0.3
SHARE_OF_STEP: Final = 0.65
"""A full single support lasts 0.75 to 0.85 of a step in walking."""
CERTAIN_STEPS: Final = 1.8
"""Duration of a window in steps that always contains a full single support."""
LOADED_N: Final = 50.0


def require_single_support(walk: Walk, within: slice, step_hz: float) -> None:
    """Raise ``NotEstimable`` (``no-single-support``) for a short window without a full single support.

    In single support the centre of pressure stays on one side of the CoM; it changes sides in double support.
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


FALSE_ALARMS: Final = 1e-3
MIN_LEARNT_SHARE: Final = 0.05
"""Minimum share of the prior variance that the data must have removed for a meaningful test."""


def plate_bias_statistic(space: StateSpace, forward: ForwardPass) -> float:
    """Sum of m^2 / (P0 - V) over the two horizontal axes: chi-squared with two degrees of freedom."""
    return float(_bias_statistics(space, forward).sum())


def plate_bias_remarks(
    space: StateSpace, forward: ForwardPass, mass_kg: float, declared_n: float, frame: Rotation
) -> tuple[Remark, ...]:
    """Remark if the estimated bias of the horizontal force is improbable (1 in 1000) under the declared one.

    The bias is given in the axes of the laboratory; the rows of ``frame`` are the walking axes.
    """
    if plate_bias_statistic(space, forward) < stats.chi2.isf(FALSE_ALARMS, 2):
        return ()
    bias_n = mass_kg * forward.constants[:, ACCELERATION] @ frame
    return (
        Remark(
            "undeclared-plate-bias",
            f"Force and markers agree only if the plates are off by {bias_n[0]:+.1f} N along x and {bias_n[1]:+.1f} N "
            f"along y, and {declared_n:g} N is declared: the stated band is too narrow. "
            "Zero the plates, or declare the bias.",
        ),
    )


def normalised_innovations(gain_sets: Gains, forward: ForwardPass) -> float:
    """Mean of e' S^-1 e over its degrees of freedom, without the constants: 1 if all error sizes are true."""
    e = forward.innovations[..., 0] + np.einsum("kamc,ac->kam", forward.innovations[..., 1:4], forward.constants)
    squares = np.einsum("kam,kamn,kan->", e, gain_sets.information[gain_sets.use], e)
    return float(squares / (gain_sets.information[gain_sets.use][:, :, [0, 1], [0, 1]] > 1e-6).sum())


def _bias_statistics(space: StateSpace, forward: ForwardPass) -> np.ndarray:
    prior = space.constant_sd[:2, ACCELERATION] ** 2
    learnt = prior - forward.constants_cov[:2, ACCELERATION, ACCELERATION]
    informative = learnt > MIN_LEARNT_SHARE * prior
    m = forward.constants[:2, ACCELERATION]
    return np.where(informative, m**2 / np.where(informative, learnt, 1.0), 0.0)
