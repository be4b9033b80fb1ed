"""Limits of a proposed card: those of the description, estimates of what it lacks, and torques that cannot be right.

A torque that the description states is never replaced: where it holds no posture on one leg, or not what walking adds,
the field is remarked on with an estimate (``offered_estimates``), which its user may choose.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.robots.card import LimitsCard
from stridelab.robots.proposal.limbs import Limbs
from stridelab.robots.proposal.offered_estimates import offered_estimate
from stridelab.robots.proposal.posture import GRAVITY, single_supports, standing_torques_nm
from stridelab.robots.proposal.soles import Sole

TORQUE_SHARE: Final = {"leg": 0.5, "torso": 0.4, "arm": 0.1}
"""Estimated torque over weight times leg length; the bundled robots have 0.3 to 0.7 in their knees."""
WEAK_LEGS: Final = 0.25
"""Largest torque of the legs over weight times leg length below which the stated limits are remarked on."""
SLOW_LEGS_RAD_S: Final = 1.5
"""Largest speed of the legs below which the stated limits are remarked on; knees turn by about 3 rad/s in a step."""
SPEED_RAD_S: Final = {"leg": 8.0, "torso": 5.0, "arm": 6.0}
MAX_SPEED_RAD_S: Final = 100.0
WALKING: Final = {"knee": 1.5, "leg": 1.1}
"""Torques of walking over the largest of standing on one leg. In the first walks of TALOS, JVRC-1 and G1 (simulated) it
is 1.5, 1.5 and 1.9 in the knee and 0.9, 0.9 and 0.8 in the hip's roll; hips' yaw and ankles depend on the gait."""
WEAK_JOINT: Final = 0.05
"""Torque over weight times leg length below which other joints of a leg with implausible torques are implausible."""


def joint_limits(
    model: pin.Model, groups: Mapping[int, str], mass_kg: float, leg_m: float, assumed: dict[str, str]
) -> LimitsCard:
    """Every moving joint's limits; those that the description lacks are estimated, and listed in ``assumed``."""
    position, velocity, torque = {}, {}, {}
    for joint, group in sorted(groups.items()):
        name, key = str(model.names[joint]), re.escape(model.names[joint])
        iq, iv = model.joints[joint].idx_q, model.joints[joint].idx_v
        position[key] = (float(model.lowerPositionLimit[iq]), float(model.upperPositionLimit[iq]))
        velocity[key], torque[key] = float(model.velocityLimit[iv]), float(model.effortLimit[iv])
        if not 0.0 < velocity[key] < MAX_SPEED_RAD_S:
            velocity[key] = SPEED_RAD_S[group]
            assumed[f"limits.velocity_rad_s.{name}"] = f"{velocity[key]:g} rad/s"
        if not 0.0 < torque[key] < 20.0 * mass_kg * GRAVITY * leg_m:
            torque[key] = float(f"{TORQUE_SHARE[group] * mass_kg * GRAVITY * leg_m:.2g}")
            assumed[f"limits.torque_nm.{name}"] = f"{torque[key]:g} N m"
    legs = [str(model.names[joint]) for joint, group in groups.items() if group == "leg"]
    stated_nm = [torque[re.escape(name)] for name in legs if f"limits.torque_nm.{name}" not in assumed]
    if stated_nm and (share := (strongest_nm := max(stated_nm)) / (mass_kg * GRAVITY * leg_m)) < WEAK_LEGS:
        assumed["limits.torque_nm"] = (
            f"as stated, but the legs have {strongest_nm:g} N m at most, {share:.2f} of weight times leg length, and "
            f"the knees of robots that walk 0.3 to 0.7: correct it if it is a placeholder"
        )
    fastest_rad_s = max(velocity[re.escape(name)] for name in legs)
    if fastest_rad_s < SLOW_LEGS_RAD_S:
        assumed["limits.velocity_rad_s"] = (
            f"as stated, but the legs turn by {fastest_rad_s:g} rad/s at most, and knees in a step by about 3 rad/s: "
            f"correct it if it is a placeholder"
        )
    return LimitsCard(position, velocity, torque)


def remark_on_torques(
    model: pin.Model,
    limbs: Limbs,
    soles: Sequence[Sole],
    q: Float[np.ndarray, "nq"],
    leg_m: float,
    torque_nm: Mapping[str, float],
    assumed: dict[str, str],
) -> None:
    """Remark in ``assumed`` on stated torques of the legs that cannot hold the robot, with an estimate for each.

    ``q`` is the rest posture; ``torque_nm`` are the limits of the card by the pattern of the joint.
    """
    standing_nm = np.zeros(model.nv)
    for stance, R, posture in single_supports(model, limbs, soles, q, leg_m):
        standing_nm = np.maximum(standing_nm, np.abs(standing_torques_nm(model, limbs.legs[stance][-1], R, posture)))
    weight_n = GRAVITY * float(pin.computeTotalMass(model))
    found: dict[str, tuple[float, str]] = {}
    rest: dict[str, float] = {}
    for leg in limbs.legs:
        for place, joint in enumerate(leg):
            name, needed_nm = str(model.names[joint]), float(standing_nm[model.joints[joint].idx_v])
            stated_nm = torque_nm[re.escape(name)]
            if f"limits.torque_nm.{name}" in assumed:
                continue
            factor = WALKING["knee" if 3 <= place < len(leg) - 2 else "leg"]
            if stated_nm < factor * needed_nm:
                what = "standing on one leg takes" if stated_nm < needed_nm else "standing on one leg alone takes"
                found[name] = factor * needed_nm, f"{what} {needed_nm:.3g} N m, and walking about {factor:g} times that"
            else:
                rest[name] = stated_nm
    if found:
        least_nm = WEAK_JOINT * weight_n * leg_m
        for name, stated_nm in rest.items():
            if stated_nm < least_nm:
                found[name] = (
                    least_nm,
                    f"less than {WEAK_JOINT:g} of weight times leg length, in a leg with other implausible torques",
                )
    for name, (least_nm, why) in found.items():
        estimate_nm = float(f"{max(TORQUE_SHARE['leg'] * weight_n * leg_m, least_nm):.2g}")
        stated_nm = torque_nm[re.escape(name)]
        assumed[f"limits.torque_nm.{name}"] = offered_estimate(stated_nm, why, estimate_nm)
