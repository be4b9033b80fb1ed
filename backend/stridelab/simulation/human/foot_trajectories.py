"""Trajectories of the feet: heel strike, flat sole, heel rise about the ball, swing.

In stance the foot rotates about a fixed point of its sole (heel, then ball), so that it neither slips nor penetrates
the ground. In swing the ankle follows the quintic that matches position, velocity and acceleration at both ends, plus a
hump ``64 h u^3 (1 - u)^3`` just high enough for heel and ball to clear the ground. Toes are not modelled: the sole is
assumed to bend past the ball. All pieces join with continuous acceleration.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from stridelab.conventions import Points, Series
from stridelab.recordings.recording import Side
from stridelab.simulation.human.body_proportions import Proportions, side_sign
from stridelab.simulation.human.gait_plan import GaitPlan, Stance

SWING_LAG: Final = -0.06
SWING_ADVANCE: Final = 0.08
"""Deviation of the swinging foot from the quintic, relative to the stride: slightly behind, and early rather than late,
like a pendulum driven by the hip before toe-off. It keeps the leg's angular momentum at human values."""
TOE_OUT_RAD: Final = 0.12
"""Both feet point outwards by 7 degrees (adults: 5 to 13)."""
CLEARANCE_M: Final = 0.02
"""Minimum height of heel and ball above the ground in the middle of the swing."""

ROCKER_RADIUS: Final = 0.035
"""Radius of the forefoot's arc over stature."""
STRIKE_RATE: Final = 2.3
"""Pitch rate at the strike times the time until flat, over the pitch."""


@dataclass(frozen=True)
class FootPath:
    """Ankle in the world and pitch of the foot (positive: toes down) over time; yaw is constant."""

    side: Side
    ankle_m: Points
    pitch_rad: Series

    @property
    def yaw_rad(self) -> float:
        """Constant turn about the vertical: both feet point outwards."""
        return side_sign(self.side) * TOE_OUT_RAD

    @cached_property
    def foot(self) -> Rotation:
        """The foot in the world, one rotation per instant."""
        return Rotation.from_euler("ZY", np.column_stack([np.full(len(self.pitch_rad), self.yaw_rad), self.pitch_rad]))


def foot_path(plan: GaitPlan, side: Side, p: Proportions, time_s: Series) -> FootPath:
    """Trajectory of one foot at the instants ``time_s`` of the plan."""
    stances = [stance for stance in plan.stances if stance.side == side]
    ankle, pitch = np.empty((len(time_s), 3)), np.empty(len(time_s))
    for stance in stances:
        on = (time_s >= stance.strike_s) & (time_s <= stance.off_s)
        pitch[on] = _stance_pitch(stance, time_s[on])
        ankle[on] = _on_ground(stance, p, pitch[on])
    for before, after in pairwise(stances):
        off = (time_s > before.off_s) & (time_s < after.strike_s)
        ankle[off], pitch[off] = _swing_trajectory(before, after, p, time_s[off])
    return FootPath(side, ankle, pitch)


def _stance_pitch(stance: Stance, t: Series) -> Series:
    """Pitch in stance: the foot flattens after the strike and the heel rises at an increasing rate before toe-off."""
    pitch = np.zeros(len(t))
    if np.isfinite(stance.strike_s):
        left = np.clip((stance.flat_s - t) / (stance.flat_s - stance.strike_s), 0.0, 1.0)
        r = STRIKE_RATE
        pitch += stance.strike_pitch_rad * left**3 * (10 - 4 * r + (7 * r - 15) * left + (6 - 3 * r) * left**2)
    if np.isfinite(stance.off_s):
        since = np.clip((t - stance.heel_off_s) / (stance.off_s - stance.heel_off_s), 0.0, 1.0)
        pitch += stance.off_pitch_rad * since**3 * (1.5 - 0.5 * since)
    return pitch


def _pitch_at_off(stance: Stance) -> tuple[float, float, float]:
    """Pitch, rate and acceleration at toe-off."""
    pitch, span_s = stance.off_pitch_rad, stance.off_s - stance.heel_off_s
    return pitch, 2.5 * pitch / span_s, 3.0 * pitch / span_s**2


def _pitch_at_strike(stance: Stance) -> tuple[float, float, float]:
    """Pitch, rate and acceleration at heel strike."""
    pitch, span_s = stance.strike_pitch_rad, stance.flat_s - stance.strike_s
    return pitch, -STRIKE_RATE * pitch / span_s, 0.0


def _rolling_ankle(p: Proportions, pitch: Series) -> Float[np.ndarray, "n 3 2"]:
    """Ankle (forward displacement, height) of a foot in stance, and its first two derivatives by the pitch.

    Pitched up, the foot rotates about the heel; pitched down, it rolls on an arc of radius rho that begins at the ball:

        x = b + rho theta - b cos theta + (h - rho) sin theta,   z = rho + (h - rho) cos theta + b sin theta
    """
    h = p.ankle_height_m
    b = np.where(pitch < 0.0, -p.heel_m, p.ball_m)
    rho = np.where(pitch < 0.0, 0.0, rocker_m(p))
    cos, sin, zero = np.cos(pitch), np.sin(pitch), np.zeros(len(pitch))
    place = [b + rho * pitch - b * cos + (h - rho) * sin, rho + (h - rho) * cos + b * sin]
    first = [rho + b * sin + (h - rho) * cos, -(h - rho) * sin + b * cos]
    second = [b * cos - (h - rho) * sin + zero, -(h - rho) * cos - b * sin]
    return np.stack([np.column_stack(rows) for rows in (place, first, second)], axis=1)


def rocker_m(p: Proportions) -> float:
    """Radius of the arc on which the forefoot rolls."""
    return ROCKER_RADIUS * p.height_m


def _foot_axes(side: Side) -> Float[np.ndarray, "2 3"]:
    """Forward axis of the foot and up, as rows in the world."""
    yaw = side_sign(side) * TOE_OUT_RAD
    return np.array([[np.cos(yaw), np.sin(yaw), 0.0], [0.0, 0.0, 1.0]])


def _on_ground(stance: Stance, p: Proportions, pitch: Series) -> Points:
    """Ankle of a foot in stance."""
    return np.asarray([stance.x_m, stance.y_m, 0.0] + _rolling_ankle(p, pitch)[:, 0] @ _foot_axes(stance.side))


def _ankle_jet(stance: Stance, p: Proportions, pitch: tuple[float, float, float]) -> Float[np.ndarray, "3 3"]:
    """Ankle, its velocity and its acceleration (rows) on the ground, from the pitch and its two derivatives."""
    theta, rate, acceleration = pitch
    _, first, second = _rolling_ankle(p, np.array([theta]))[0]
    motion = np.array([rate * first, acceleration * first + rate**2 * second]) @ _foot_axes(stance.side)
    return np.vstack([_on_ground(stance, p, np.array([theta])), motion])


def _swing_trajectory(before: Stance, after: Stance, p: Proportions, t: Series) -> tuple[Points, Series]:
    ends = [before.off_s, after.strike_s]
    off, strike = _pitch_at_off(before), _pitch_at_strike(after)
    turning = BPoly.from_derivatives(ends, [off, strike])
    path = BPoly.from_derivatives(ends, [_ankle_jet(before, p, off), _ankle_jet(after, p, strike)])
    u = np.linspace(0.0, 1.0, 101)[1:-1]
    fine = ends[0] + u * (ends[1] - ends[0])
    hump = 64.0 * (u * (1.0 - u)) ** 3
    turn = turning(fine)
    below = [p.ankle_height_m * np.cos(turn) + x * np.sin(turn) for x in (-p.heel_m, p.ball_m)]
    lowest = path(fine)[:, 2] - np.max(below, axis=0)
    height = max(0.0, float(np.max((CLEARANCE_M * hump - lowest) / np.maximum(hump, 0.05))))
    ankle = path(t)
    s = (t - ends[0]) / (ends[1] - ends[0])
    hump = 64.0 * (s * (1.0 - s)) ** 3
    ankle[:, 2] += height * hump
    ankle[:, 0] += (after.x_m - before.x_m) * (SWING_LAG + SWING_ADVANCE * (1.0 - 2.0 * s)) * hump
    return ankle, turning(t)
