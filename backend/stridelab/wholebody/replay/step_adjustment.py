"""What is left when the soles cannot undo a push: a step to the side, sooner, back, or not yet.

The plan runs on its own clock, ``s' = r``; an undisturbed robot keeps ``r = 1`` and its places. With the capture
point's error e beyond what the soles can undo (``capturable``),

    on two soles    a plan that may stand still waits there, as long as the sole to come could not hold the robot
    on one sole     the other one is put down: at the plan's pace, faster, or back where it was, and farther out

For each pace the capture point is predicted to the touch-down, ``xi(T) = z + (xi - z) exp(w T)`` with the pressure z at
the edge of the sole. What it is then beyond the support of both soles, or, where the plan cannot stand still, beyond C,
is the step to the side; of the paces that one is taken that needs the smallest.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stridelab.conventions import Vector3
from stridelab.wholebody.replay.capturability import Capturable
from stridelab.wholebody.replay.dcm_feedback import Shift


@dataclass(frozen=True)
class Stepping:
    """An error below ``least_m`` is none; ``share`` of C is relied on, and steps are ``margin_m`` larger than needed.

    None is larger than ``most_step_m``, and none changes from ``fixed_from`` of the swing on. A capture point that
    would be too far ahead or behind counts ``along`` times. The plan's own pace is kept where a step of ``small_m``
    is enough. The clock takes one of ``paces``, changes by ``slew_per_s`` and stands still where the plan's capture
    point is no farther from its CoM than ``still_m``; all in all it loses ``most_lost_s`` at most, and may only hurry
    from then on.
    """

    least_m: float = 0.02
    share: float = 0.8
    small_m: float = 0.01
    margin_m: float = 0.03
    most_step_m: float = 0.15
    along: float = 2.0
    fixed_from: float = 0.9
    paces: tuple[float, ...] = (1.0, 1.5, 2.0, 2.5, -2.5)
    slew_per_s: float = 40.0
    still_m: float = 0.06
    most_lost_s: float = 5.0


class Steady:
    """The clock of a replay without a stabiliser."""

    rate = 1.0

    def __init__(self, last: int) -> None:
        self.sample, self._last = 0.0, last

    @property
    def nearest(self) -> int:
        """Index of the plan's sample."""
        return int(self.sample)

    def tick(self) -> None:
        """One sample later."""
        self.sample = min(self.sample + 1.0, float(self._last))


class Pace:
    """Where the plan is, in samples, how fast it runs, and by how much every sole stands or lands beside its place."""

    def __init__(self, stepping: Stepping, capturable: Capturable, rate_hz: float) -> None:
        self._by, self._can, self._dt_s = stepping, capturable, 1.0 / rate_hz
        self._last = len(capturable.capture_m) - 1
        self._lost_s = 0.0
        self.sample, self.rate = 0.0, 1.0
        self.off_m: dict[str, Shift] = {name: np.zeros(2) for name in capturable.weight}

    @property
    def nearest(self) -> int:
        """Index of the plan's sample."""
        return min(int(self.sample + 0.5), self._last)

    @property
    def reference_off_m(self) -> Shift:
        """By how much the capture point's reference is moved by soles beside their places."""
        i = self.nearest
        moved = (self._can.weight[name][i] * off for name, off in self.off_m.items())
        return np.asarray(sum(moved, start=np.zeros(2)))

    def decide(
        self, capture_m: Shift, places_m: Mapping[str, Vector3], swung: Mapping[str, float], leans_m: float = 0.0
    ) -> None:
        """Offsets and rate for a capture point; of the soles where the plan has them and how far they have swung.

        ``leans_m`` is by how much hands move the centre of pressure: a push may tear them off, so that a step is as
        much larger.
        """
        by, i, wanted = self._by, self.nearest, 1.0
        swinging = [name for name, share in swung.items() if share < 1.0]
        for name in swinging:
            if swung[name] < by.fixed_from:
                self.off_m[name] = np.zeros(2)
        e = capture_m - self._can.capture_m[i] - self.reference_off_m
        aside = self._can.towards[i] @ e
        over = np.where(aside > by.least_m, aside - by.share * self._can.reach_m[i], 0.0)
        if over.max() > 0.0 and not swinging:
            wanted = float(not self._may_stand(i))
        elif over[1::2].max() > 0.0 and len(swinging) == 1 and len(swung) == 2:
            (name,) = swinging
            (stands,) = (other for other in swung if other != name)
            k = int(np.argmax(over[1::2])) * 2 + 1
            if float(self._can.towards[i, k] @ (places_m[name] - places_m[stands])[:2]) > 0.0:
                wanted = self._put_down(name, stands, swung[name], capture_m, k, by.margin_m + leans_m)
        if self._late:
            wanted = max(wanted, 1.0)
        step = by.slew_per_s * self._dt_s
        self.rate += float(np.clip(wanted - self.rate, -step, step))

    def tick(self) -> None:
        """One sample later."""
        self._lost_s += max(0.0, 1.0 - self.rate) * self._dt_s
        self.sample = float(np.clip(self.sample + self.rate, 0.0, self._last))

    @property
    def _late(self) -> bool:
        return self._lost_s > self._by.most_lost_s

    def _may_stand(self, i: int) -> bool:
        return float(self._can.moving_m[i]) < self._by.still_m

    def _put_down(self, name: str, stands: str, swung: float, capture_m: Shift, k: int, margin_m: float) -> float:
        """How fast the clock has to run; the offset of the landing is set."""
        by, can, i = self._by, self._can, self.nearest
        best, chosen, offset = np.inf, 1.0, 0.0
        for pace in (pace for pace in by.paces if pace > 0.0 or not self._late):
            j = can.touch_down(name, i) if pace > 0.0 else can.lift_off(name, i)
            grown = float(np.exp(can.rate_per_s[i] * abs(j - i) / abs(pace) * self._dt_s))
            aside_m, gain = self._beyond(capture_m, stands, i, j, k, grown) + margin_m, 1.0
            if not self._may_stand(j):
                gain = max(float(can.weight[name][j]), 1e-6)
            along_m = max(self._behind(capture_m, i, j, ahead, grown) for ahead in (0, 2))
            cost = max(aside_m / gain, 0.0) + by.along * along_m
            if cost < best:
                best, chosen, offset = cost, pace, aside_m / gain if pace > 0.0 else 0.0
            if pace == 1.0 and cost < by.small_m:
                break
        if swung < by.fixed_from:
            self.off_m[name] = float(np.clip(offset, 0.0, by.most_step_m)) * can.towards[i, k]
        return chosen

    def _beyond(self, capture_m: Shift, stands: str, i: int, j: int, k: int, grown: float) -> float:
        """By how much the capture point is too far in direction k when the sole is put down at sample j."""
        can, towards = self._can, self._can.towards[i, k]
        off = float(self.off_m[stands] @ towards)
        z, xi = float(can.edge_m[i, k]) + off, float(capture_m @ towards)
        return z + (xi - z) * grown - self._limit(j, k) - off * (1.0 if self._may_stand(j) else can.weight[stands][j])

    def _behind(self, capture_m: Shift, i: int, j: int, k: int, grown: float) -> float:
        """By how much it is not far enough in direction k then, with the pressure as far behind as can be."""
        can = self._can
        z, xi = -float(can.edge_m[i, (k + 2) % 4]), float(capture_m @ can.towards[i, k])
        return max(0.0, -self._limit(j, (k + 2) % 4) - (z + (xi - z) * grown))

    def _limit(self, j: int, k: int) -> float:
        """How far in direction k the capture point may be at sample j."""
        by, can = self._by, self._can
        if self._may_stand(j):
            return float(can.stand_m[j, k])
        return float(can.capture_m[j] @ can.towards[j, k]) + by.share * float(can.reach_m[j, k])
