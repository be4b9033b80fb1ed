"""Step adjustment: changes of timing and side steps for errors that the soles cannot correct.

The plan runs on its own clock, ``s' = r``; without disturbances ``r = 1`` and the steps are as planned. If the error e
of the capture point exceeds what the soles can correct (``capturability``),

    on two soles    a plan that can pause waits while the next sole could not support the robot
    on one sole     the other one is put down: at the plan's rate, faster, or back at its lift-off, and farther out

For each rate the capture point is predicted to the touch-down, ``xi(T) = z + (xi - z) exp(w T)`` with the pressure z at
the edge of the sole. Its distance beyond the support of both soles, or, if the plan cannot pause, beyond C, is the side
step; the rate with the smallest step is used.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stridelab.conventions import Vector3
from stridelab.wholebody.replay.capturability import Capturability
from stridelab.wholebody.replay.dcm_feedback import Shift


@dataclass(frozen=True)
class Stepping:
    """Errors below ``least_m`` are ignored; ``share`` of C is used, and steps are ``margin_m`` larger than necessary.

    Steps are limited to ``most_step_m`` and fixed after the share ``fixed_from`` of the swing. Capture point errors
    forwards or backwards are weighted by ``along``. The plan's rate is used if a step of ``small_m`` is sufficient. The
    clock uses one of the rates ``paces``, changes by at most ``slew_per_s``, and can pause where the plan's capture
    point is within ``still_m`` of its CoM; its total delay is limited to ``most_lost_s``, after which it does not slow
    down.
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

    def scaled_by(self, size: float) -> "Stepping":
        """For a robot of ``size`` times the lengths."""
        lengths = ("least_m", "small_m", "margin_m", "most_step_m", "still_m")
        return replace(self, **{name: size * getattr(self, name) for name in lengths})


class ConstantClock:
    """Clock of a replay without a stabiliser, with constant rate."""

    rate = 1.0

    def __init__(self, last: int) -> None:
        self.sample, self._last = 0.0, last

    @property
    def sample_index(self) -> int:
        """Index of the plan's nearest sample."""
        return int(self.sample)

    def advance(self) -> None:
        """Advance by one sample."""
        self.sample = min(self.sample + 1.0, float(self._last))


class AdaptiveClock:
    """Adaptive clock: position in the plan (samples), rate, and offset of every sole from its planned position.

    ``margins`` is the capturability of the motion; ``complete`` waits for that of the whole motion, where a decision
    needs it.
    """

    def __init__(
        self,
        stepping: Stepping,
        capturable: Capturability,
        rate_hz: float,
        complete: Callable[[], Capturability] | None = None,
    ) -> None:
        self._settings, self.margins, self._dt_s = stepping, capturable, 1.0 / rate_hz
        self._complete = complete
        self._last = len(capturable.capture_m) - 1
        self._lost_s = 0.0
        self.sample, self.rate = 0.0, 1.0
        self.excess_m = 0.0
        """Largest distance of the capture point beyond what the soles can correct, or, while the plan waits on both,
        beyond their edge."""
        self.off_m: dict[str, Shift] = {name: np.zeros(2) for name in capturable.weight}

    @property
    def sample_index(self) -> int:
        """Index of the plan's nearest sample."""
        return min(int(self.sample + 0.5), self._last)

    @property
    def reference_off_m(self) -> Shift:
        """Shift of the capture point reference by the offsets of the soles."""
        i = self.sample_index
        moved = (self.margins.weight[name][i] * off for name, off in self.off_m.items())
        return np.asarray(sum(moved, start=np.zeros(2)))

    def update_rate(
        self, capture_m: Shift, soles_m: Mapping[str, Vector3], progress: Mapping[str, float], hand_shift_m: float = 0.0
    ) -> None:
        """Update offsets and rate for a capture point, given planned positions and swing progress of the soles.

        ``hand_shift_m`` is the shift of the centre of pressure by the hands; steps are enlarged by it, as a push may
        break the contact of the hands.
        """
        by, i, target_rate = self._settings, self.sample_index, 1.0
        swinging = [name for name, share in progress.items() if share < 1.0]
        for name in swinging:
            if progress[name] < by.fixed_from:
                self.off_m[name] = np.zeros(2)
        reference_off_m = self.reference_off_m
        e = capture_m - self.margins.capture_m[i] - reference_off_m
        error_along = self.margins.directions[i] @ e
        excess = np.where(error_along > by.least_m, error_along - by.share * self.margins.reach_m[i], 0.0)
        if not self.margins.is_exact and self._complete is not None and excess.max() > 0.0:
            self.margins = self._complete()  # the reach was a lower bound
            excess = np.where(error_along > by.least_m, error_along - by.share * self.margins.reach_m[i], 0.0)
        self.excess_m = float(excess.max())
        if self.excess_m > 0.0 and not swinging:
            target_rate = float(not self._can_pause(i))
            if target_rate == 0.0 and not self._delay_exhausted:
                beyond_m = self.margins.directions[i] @ (capture_m - reference_off_m)
                self.excess_m = max(0.0, float((beyond_m - self.margins.capture_edge_m[i]).max()))
        elif excess[1::2].max() > 0.0 and len(swinging) == 1 and len(progress) == 2:
            (name,) = swinging
            (stance,) = (other for other in progress if other != name)
            k = int(np.argmax(excess[1::2])) * 2 + 1
            if float(self.margins.directions[i, k] @ (soles_m[name] - soles_m[stance])[:2]) > 0.0:
                target_rate = self._plan_landing(name, stance, progress[name], capture_m, k, by.margin_m + hand_shift_m)
        if self._delay_exhausted:
            target_rate = max(target_rate, 1.0)
        step = by.slew_per_s * self._dt_s
        self.rate += min(max(target_rate - self.rate, -step), step)

    def advance(self) -> None:
        """Advance by one sample."""
        self._lost_s += max(0.0, 1.0 - self.rate) * self._dt_s
        self.sample = min(max(self.sample + self.rate, 0.0), float(self._last))

    @property
    def _delay_exhausted(self) -> bool:
        return self._lost_s > self._settings.most_lost_s

    def _can_pause(self, i: int) -> bool:
        return float(self.margins.capture_distance_m[i]) < self._settings.still_m

    def _plan_landing(
        self, name: str, stance: str, progress: float, capture_m: Shift, k: int, margin_m: float
    ) -> float:
        """Choose the clock rate until the landing and set the landing offset."""
        by, margins, i = self._settings, self.margins, self.sample_index
        best_cost, best_rate, offset = np.inf, 1.0, 0.0
        for pace in (pace for pace in by.paces if pace > 0.0 or not self._delay_exhausted):
            j = margins.touch_down(name, i) if pace > 0.0 else margins.lift_off(name, i)
            growth = float(np.exp(margins.rate_per_s[i] * abs(j - i) / abs(pace) * self._dt_s))
            aside_m, gain = self._outward_excess_m(capture_m, stance, i, j, k, growth) + margin_m, 1.0
            if not self._can_pause(j):
                gain = max(float(margins.weight[name][j]), 1e-6)
            along_m = max(self._shortfall_m(capture_m, i, j, ahead, growth) for ahead in (0, 2))
            cost = max(aside_m / gain, 0.0) + by.along * along_m
            if cost < best_cost:
                best_cost, best_rate, offset = cost, pace, aside_m / gain if pace > 0.0 else 0.0
            if pace == 1.0 and cost < by.small_m:
                break
        if progress < by.fixed_from:
            self.off_m[name] = float(np.clip(offset, 0.0, by.most_step_m)) * margins.directions[i, k]
        return best_rate

    def _outward_excess_m(self, capture_m: Shift, stance: str, i: int, j: int, k: int, growth: float) -> float:
        """Distance of the capture point beyond its limit in direction k for a touch-down at sample j."""
        margins, direction = self.margins, self.margins.directions[i, k]
        off = float(self.off_m[stance] @ direction)
        z, xi = float(margins.edge_m[i, k]) + off, float(capture_m @ direction)
        return (
            z
            + (xi - z) * growth
            - self._capture_limit_m(j, k)
            - off * (1.0 if self._can_pause(j) else margins.weight[stance][j])
        )

    def _shortfall_m(self, capture_m: Shift, i: int, j: int, k: int, growth: float) -> float:
        """Distance by which the capture point falls short in direction k, with the rearmost centre of pressure."""
        can = self.margins
        z, xi = -float(can.edge_m[i, (k + 2) % 4]), float(capture_m @ can.directions[i, k])
        return max(0.0, -self._capture_limit_m(j, (k + 2) % 4) - (z + (xi - z) * growth))

    def _capture_limit_m(self, j: int, k: int) -> float:
        """Limit of the capture point's coordinate in direction k at sample j."""
        by, can = self._settings, self.margins
        if self._can_pause(j):
            return float(can.capture_edge_m[j, k])
        return float(can.capture_m[j] @ can.directions[j, k]) + by.share * float(can.reach_m[j, k])
