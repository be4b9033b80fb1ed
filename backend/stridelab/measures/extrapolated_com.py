r"""Extrapolated centre of mass and capture point (Hof, Gazendam and Sinke 2005; Pratt et al. 2006).

    x = c + v / omega_0,    omega_0 = sqrt(g / l)

with c and v the horizontal position and velocity of the CoM and l the length of the equivalent pendulum, the mean
height of the CoM above the floor. A linear inverted pendulum comes to rest over a foot that is placed at x, the
*capture point*. With the covariance P of position and velocity of one axis

    var x = P_cc + 2 P_cv / omega_0 + P_vv / omega_0^2 .
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2
from stridelab.measures.walk_motion import UP, WalkMotion

Horizontal = Float[np.ndarray, "n 2"]


@dataclass(frozen=True)
class ExtrapolatedCom:
    """Positions ahead and left, shape (n, 2), with their standard deviation (None if the estimator states none)."""

    position_m: Horizontal
    sd_m: Horizontal | None
    rate_1_s: float


def extrapolated_com(motion: WalkMotion) -> ExtrapolatedCom:
    """The extrapolated CoM at every sample of the estimate."""
    rate = float(np.sqrt(GRAVITY_M_S2 / motion.mean_height_m))
    position = motion.com_m[:, :UP] + motion.velocity_m_s[:, :UP] / rate
    if motion.covariance is None:
        return ExtrapolatedCom(np.asarray(position), None, rate)
    weights = np.array([1.0, 1.0 / rate])
    variance = weights @ motion.covariance[:, :UP] @ weights
    return ExtrapolatedCom(np.asarray(position), np.sqrt(np.maximum(variance, 0.0)), rate)
