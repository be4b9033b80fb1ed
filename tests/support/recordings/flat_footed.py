"""A walk whose footholds are known: flat feet that rest at given places and swing between them."""

from dataclasses import dataclass, field, replace

import numpy as np

from stridelab.measures.walk_motion import FootMotion, WalkMotion
from stridelab.recordings.recording import Side
from stridelab.walking.gait_events import Contact
from stridelab.walking.steps import GaitStep

FOOT_M = 0.26


@dataclass(frozen=True)
class FlatFootedWalk:
    """``steps`` steps of ``length_m`` and ``width_m`` with toes ``toe_out_rad`` outwards; the left foot first.

    The first contact begins before the recording and the last one ends after it.
    """

    steps: int = 5
    length_m: float = 0.6
    width_m: float = 0.12
    toe_out_rad: float = 0.1
    swing_s: float = 0.4
    both_s: float = 0.1
    height_m: float = 0.9
    rate_hz: float = 100.0
    sides: tuple[Side, Side] = field(default=("left", "right"))

    def place_m(self, k: int) -> np.ndarray:
        """Middle of foothold k: ahead, left."""
        return np.array([k * self.length_m, (0.5 if self.side(k) == "left" else -0.5) * self.width_m])

    def side(self, k: int) -> Side:
        return self.sides[k % 2]

    def yaw_rad(self, k: int) -> float:
        return self.toe_out_rad if self.side(k) == "left" else -self.toe_out_rad

    def strike_s(self, k: int) -> float:
        """Strike of foothold k; the foot of k lifts off ``both_s`` after the strike of k + 1."""
        return k * (self.swing_s + self.both_s)

    @property
    def contacts(self) -> tuple[Contact, ...]:
        last = self.steps
        return tuple(
            Contact(
                self.side(k),
                None if k == 0 else self.strike_s(k),
                None if k >= last else self.strike_s(k + 1) + self.both_s,
            )
            for k in range(last + 1)
        )

    @property
    def gait_steps(self) -> tuple[GaitStep, ...]:
        """Steps to footholds 2 and later, whose lift-offs are in the recording."""
        return tuple(
            GaitStep(
                side=self.side(k),
                lift_off_s=self.strike_s(k - 1) + self.both_s,
                strike_s=self.strike_s(k),
                next_lift_off_s=self.strike_s(k) + self.both_s,
                period_s=self.swing_s + self.both_s,
                length_m=self.length_m,
                speed_m_s=self.length_m / (self.swing_s + self.both_s),
                measured=True,
                source="markers",
            )
            for k in range(2, self.steps + 1)
        )

    @property
    def motion(self) -> WalkMotion:
        end_s = self.strike_s(self.steps) + self.both_s
        time_s = np.arange(0.0, end_s, 1.0 / self.rate_hz)
        speed = self.length_m / (self.swing_s + self.both_s)
        com = np.column_stack([speed * time_s, np.zeros_like(time_s), np.full_like(time_s, self.height_m)])
        return WalkMotion(
            time_s=time_s,
            com_m=com,
            velocity_m_s=np.gradient(com, time_s, axis=0),
            covariance=None,
            varying_sd_m=0.0,
            feet={side: self._foot(side, time_s) for side in self.sides},
            momentum_per_kg=np.full_like(com, np.nan),
            mass_kg=70.0,
            stature_m=1.7,
        )

    def _foot(self, side: Side, time_s: np.ndarray) -> FootMotion:
        own = [k for k in range(self.steps + 1) if self.side(k) == side]
        middle = np.empty((len(time_s), 2))
        for i, t in enumerate(time_s):
            k = max((k for k in own if k == own[0] or self.strike_s(k) <= t), default=own[0])
            lift_off_s = self.strike_s(k + 1) + self.both_s
            middle[i] = self.place_m(k)
            if t > lift_off_s and k + 2 <= self.steps:
                share = (t - lift_off_s) / self.swing_s
                middle[i] += 0.5 * (1.0 - np.cos(np.pi * share)) * (self.place_m(k + 2) - self.place_m(k))
        yaw = self.yaw_rad(own[0])
        along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        places = [(-0.5, 0.12), (-0.5, -0.12), (0.2, 0.18), (0.2, -0.18), (0.5, 0.0)]
        points = np.array([FOOT_M * (a * along + b * across) for a, b in places])
        outline = np.pad(middle[:, None] + points, ((0, 0), (0, 0), (0, 1)))
        return FootMotion(outline[:, :2].mean(axis=1), outline, np.full((len(time_s), 3), np.nan))


def during(motion: WalkMotion, start_s: float, end_s: float) -> WalkMotion:
    """The part of a motion from ``start_s`` to ``end_s``."""
    inside = (motion.time_s >= start_s) & (motion.time_s <= end_s)
    return replace(
        motion,
        time_s=motion.time_s[inside],
        com_m=motion.com_m[inside],
        velocity_m_s=motion.velocity_m_s[inside],
        momentum_per_kg=motion.momentum_per_kg[inside],
        feet={
            side: FootMotion(foot.heel_m[inside], foot.outline_m[inside], foot.force_n[inside])
            for side, foot in motion.feet.items()
        },
    )
