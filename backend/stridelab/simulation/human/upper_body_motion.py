"""Motion of pelvis, trunk, head and arms in walking: harmonics of the stride, scaled by a vigour of 0 to 1.

With ``phi`` the phase of the stride (0 at a left strike, pi at a right strike):

    pelvis yaw   -cos phi    (the hip of the striking leg is ahead)
    pelvis roll   sin phi    (the hip of the swinging leg drops)
    torso yaw    +cos phi    (the shoulders rotate against the pelvis)
    torso pitch  -sin 2 phi' (phi' = 0 in the middle of double support; against the legs' angular momentum)
    arm pitch    +cos phi on the left, -cos phi on the right; the elbow flexes as the arm comes forward

Amplitudes at 1.2 m/s are typical of adults (Perry 1992; Murray 1967 for the arms) and vary by 10 % with the seed.
The head keeps facing forward.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy.random import Generator
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from stridelab.conventions import Points, Series
from stridelab.simulation.human.body_model import AnthropometricBody, Configurations
from stridelab.simulation.human.body_proportions import SIDES, side_prefix, side_sign
from stridelab.simulation.human.gait_plan import GaitPlan
from stridelab.simulation.human.load_transfer import minimum_jerk

_PELVIS_YAW: Final = 0.07
_PELVIS_ROLL: Final = 0.045
_TORSO_YAW: Final = 0.09
_LEAN: Final = 0.09
"""Forward lean of the trunk, which brings the centre of mass over the feet."""
_NOD: Final = 0.04
"""Pitch of the trunk, twice per stride, against the angular momentum of the legs."""
_ARM: Final = 0.40
_ARM_BACK: Final = 0.05
_ELBOW: Final = 0.28
_ELBOW_SWING: Final = 0.18
_ABDUCTION: Final = 0.12
_REFERENCE_M_S: Final = 1.2


Knots = Float[np.ndarray, "knots"]


@dataclass(frozen=True)
class StrideClock:
    """Phase of the stride (``phi``: strikes; ``phi_double``: middles of double support) and vigour over time."""

    phi: Series
    phi_double: Series
    vigour: Series


def stride_clock(plan: GaitPlan, time_s: Series) -> StrideClock:
    """Phases that are multiples of pi at every strike (or middle of double support), linear beyond the ends."""
    landed = [stance for stance in plan.stances if np.isfinite(stance.strike_s)]
    if not landed:
        return StrideClock(np.zeros(len(time_s)), np.zeros(len(time_s)), np.zeros(len(time_s)))
    strikes = np.array([stance.strike_s for stance in landed])
    lifts = np.array([stance.off_s for stance in plan.stances if np.isfinite(stance.off_s)])
    doubles = np.array([(s + lifts[lifts > s].min(initial=s + 0.2 * plan.step_time_s)) / 2 for s in strikes])
    counts = np.pi * (np.arange(len(strikes)) + (0.0 if landed[0].side == "left" else 1.0))
    start_s, end_s = lifts[0] - 0.3 * plan.step_time_s, strikes[-1] + 0.5 * plan.step_time_s
    ramp_s = 1.5 * plan.step_time_s
    vigour = minimum_jerk((time_s - start_s) / ramp_s) * minimum_jerk((end_s - time_s) / ramp_s)
    return StrideClock(_interpolate_phase(strikes, counts, time_s), _interpolate_phase(doubles, counts, time_s), vigour)


def _interpolate_phase(at_s: Knots, phase: Knots, time_s: Series) -> Series:
    """Monotone interpolation, continued with the mean rate over five steps at either end."""
    rate = np.pi * (len(at_s) - 1) / (at_s[-1] - at_s[0])
    steps = np.arange(1, 6)
    at = np.concatenate([at_s[0] - np.pi / rate * steps[::-1], at_s, at_s[-1] + np.pi / rate * steps])
    knots = np.concatenate([phase[0] - np.pi * steps[::-1], phase, phase[-1] + np.pi * steps])
    return np.asarray(PchipInterpolator(at, knots)(np.clip(time_s, at[0], at[-1])))


@dataclass(frozen=True)
class Posture:
    """Configuration without the position of the pelvis and the leg angles; ``pelvis`` is its orientation."""

    q: Configurations
    pelvis: Rotation


def prescribe_posture(body: AnthropometricBody, plan: GaitPlan, clock: StrideClock, rng: Generator) -> Posture:
    """Posture at the instants of the clock."""
    vary = 1.0 + 0.1 * np.clip(rng.standard_normal(5), -2.0, 2.0)
    briskness = (plan.speed_m_s / _REFERENCE_M_S) ** 0.5
    swing = clock.vigour * briskness
    cos, sin = np.cos(clock.phi) * swing, np.sin(clock.phi) * swing
    none = np.zeros(len(cos))
    nod = -_NOD * np.sin(2.0 * clock.phi_double) * swing
    pelvis = _ball_rotation(-vary[0] * _PELVIS_YAW * cos, none, vary[1] * _PELVIS_ROLL * sin)
    torso = _ball_rotation(vary[2] * _TORSO_YAW * cos, none + _LEAN + nod, none)
    head = _ball_rotation(none, none + 0.02, none)
    q = np.tile(body.neutral_pose(), (len(cos), 1))

    def set_rotation(joint: str, rotation: Rotation) -> None:
        first = body.index[joint]
        q[:, first : first + 3] = rotation.as_euler("ZYX")

    set_rotation("pelvis", pelvis)
    set_rotation("lumbar", pelvis.inv() * torso)
    set_rotation("cervical", torso.inv() * head)
    for side in SIDES:
        back = side_sign(side) * vary[3] * cos
        hanging = _ball_rotation(none, none + _ARM_BACK + _ARM * back, none + side_sign(side) * _ABDUCTION)
        set_rotation(f"{side_prefix(side)}shoulder", torso.inv() * hanging)
        q[:, body.index[f"{side_prefix(side)}elbow"]] = -(_ELBOW + 0.1 * swing - vary[4] * _ELBOW_SWING * back)
    return Posture(q, pelvis)


def _ball_rotation(yaw: Series, pitch: Series, roll: Series) -> Rotation:
    angles: Points = np.column_stack([yaw, pitch, roll])
    return Rotation.from_euler("ZYX", angles)
