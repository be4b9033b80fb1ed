"""External mechanical work of each leg on the centre of mass (Donelan, Kram and Kuo 2002).

    P_leg = F_leg . v,    W+ = integral of max(P, 0) dt,    W- = integral of min(P, 0) dt

over one stance of the leg, per kilogram of body mass; a leg in swing has no external work, so this is its work per
stride. The force of the leg must be measured on its own. The error of the velocity is taken as constant over the
stance, since its largest part comes from the body mass and the offset of the plates:

    (sd W)^2 = sum over the axes of (integral of F dt)^2 var v / m^2    over the samples that count.
"""

import math
from collections.abc import Sequence

import numpy as np

from stridelab.conventions import Points, Series
from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import WalkMotion
from stridelab.walking.gait_events import Contact
from stridelab.walking.steps import GaitStep


def limb_work(motion: WalkMotion, contacts: Sequence[Contact], steps: Sequence[GaitStep]) -> list[Measure]:
    """``limb_work_{left,right}_{positive,negative}`` in J/kg per stance, numbered by the step that ends in its strike.

    Stances that are not whole or whose force is not measured on its own are left out; none without a body mass.
    """
    measures = []
    for contact in contacts:
        if contact.strike_s is None or contact.lift_off_s is None or motion.mass_kg is None:
            continue
        span = motion.samples(contact.strike_s, contact.lift_off_s)
        force = motion.feet[contact.side].force_n[span]
        if not motion.covers(contact.strike_s, contact.lift_off_s) or len(force) < 2 or not np.isfinite(force).all():
            continue
        time_s = motion.time_s[span]
        power = np.einsum("ka,ka->k", force, motion.velocity_m_s[span]) / motion.mass_kg
        number = next((k for k, step in enumerate(steps) if step.strike_s == contact.strike_s), None)
        for sign, name in ((1.0, "positive"), (-1.0, "negative")):
            counted = sign * power > 0.0
            work = float(np.trapezoid(np.where(counted, power, 0.0), time_s))
            sd = _work_sd(motion, span, np.where(counted[:, None], force, 0.0), time_s)
            measures.append(Measure(f"limb_work_{contact.side}_{name}", work, sd, "J/kg", contact.side, number))
    return measures


def _work_sd(motion: WalkMotion, span: slice, force_n: Points, time_s: Series) -> float | None:
    if motion.covariance is None or motion.mass_kg is None:
        return None
    impulse = np.trapezoid(force_n, time_s, axis=0)
    sd_v = np.sqrt(np.maximum(motion.covariance[span, :, 1, 1].mean(axis=0), 0.0))
    return math.sqrt(float(((impulse * sd_v) ** 2).sum())) / motion.mass_kg
