"""Exchange of potential and kinetic energy of the CoM in a stride (Cavagna, Thys and Zamboni 1976).

    E_f = v_ahead^2 / 2,    E_v = g z + v_z^2 / 2,    E = g z + |v|^2 / 2       per kilogram
    W = sum of the positive increments over the stride
    recovery = 1 - W_ext / (W_f + W_v)

An ideal pendulum has a recovery of 1. The standard deviation is propagated to first order: the vertical position
enters through its variation within the stride, the velocity through its constant error.
"""

import math
from collections.abc import Sequence

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Series
from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import AHEAD, LEFT, UP, WalkMotion
from stridelab.walking.steps import GaitStep


def energy_exchange(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """``energy_recovery`` (a share) and ``external_work`` (J/kg) per stride, from strike to strike of one foot."""
    measures = []
    for number, step in enumerate(steps):
        following = next((s for s in steps[number + 1 :] if s.side == step.side), None)
        if following is None or not motion.covers(step.strike_s, following.strike_s):
            continue
        span = motion.samples(step.strike_s, following.strike_s)
        speed_sd = None
        if motion.covariance is not None:
            speed_sd = math.sqrt(max(float(motion.covariance[span, AHEAD, 1, 1].mean()), 0.0))
        v, z = motion.velocity_m_s[span], motion.com_m[span, UP]
        base_recovery, base_work = _recovery_and_work(v[:, AHEAD], v[:, LEFT], v[:, UP], z)
        recovery_sd = work_sd = None
        if speed_sd is not None:
            faster = _recovery_and_work(v[:, AHEAD] + speed_sd, v[:, LEFT], v[:, UP], z)
            share = 1.0 + math.sqrt(2.0) * motion.varying_sd_m / max(float(np.ptp(z)), motion.varying_sd_m)
            higher = _recovery_and_work(v[:, AHEAD], v[:, LEFT], v[:, UP], z.mean() + share * (z - z.mean()))
            recovery_sd = math.hypot(faster[0] - base_recovery, higher[0] - base_recovery)
            work_sd = math.hypot(faster[1] - base_work, higher[1] - base_work)
        measures.append(Measure("energy_recovery", base_recovery, recovery_sd, "1", step.side, number))
        measures.append(Measure("external_work", base_work, work_sd, "J/kg", step.side, number))
    return [measure for measure in measures if math.isfinite(measure.value)]


def _recovery_and_work(ahead: Series, left: Series, up: Series, z: Series) -> tuple[float, float]:
    forward = 0.5 * ahead**2
    vertical = GRAVITY_M_S2 * z + 0.5 * up**2
    whole = forward + vertical + 0.5 * left**2
    w_f, w_v, w_ext = (float(np.maximum(np.diff(energy), 0.0).sum()) for energy in (forward, vertical, whole))
    return (1.0 - w_ext / (w_f + w_v) if w_f + w_v > 0.0 else math.nan), w_ext
