"""Walking at a commanded velocity on level ground: steps chosen anew at every choice, without a plan.

With the pressure p in the standing sole, the capture point xi moves within T to ``p + (xi - p) exp(w T)``. In a
periodic walk it has the offset b from the landing sole. With displacements d_A, d_B of the next two steps, the growth
G = exp(w T_s) of the swing, and g = exp(w T_d), ``k = (g - 1) / (w T_d)`` of the time on both soles, during which the
pressure moves from one sole to the other,

    s = k (E d_A + d_B) / (E^2 - 1) ,    b = s G - d_A ,    E = G g ,

where s is the capture point relative to the standing sole at the lift-off (Englsberger 2015, Khadiv 2020). For a
measured capture point the pressure first brings ``xi(T)`` to ``u + b`` as far as the sole allows; then place u and time
T of the landing are moved. Where this does not suffice, and without a command, the robot recovers (``recovery``).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.recovery.balance_rows import LevelHeading
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.recovery.recovery import Recovery, RecoveryRun
from stridelab.wholebody.recovery.side_steps import WayCorrection, side_steps_m
from stridelab.wholebody.recovery.step_choice import CORNERS, Shift, Step, nearest_in_hull
from stridelab.wholebody.recovery.swing_aim import AimedSwing
from stridelab.wholebody.replay.sensors import SensedState

TALOS_COM_HEIGHT_M: Final = 0.876
_SLOW: Final = 0.02
"""Commands below this (m/s, rad/s) count as none."""
_LEVEL_M: Final = 0.01
"""Difference of heights from which ground is not level."""
_LEAST_S: Final = 0.1
"""Least time over which an error of the capture point is corrected."""


class WalkCommand(NamedTuple):
    """Velocity of the robot in its own heading: ahead and to the left (m/s), and of its heading (rad/s)."""

    ahead_m_s: float = 0.0
    left_m_s: float = 0.0
    turn_rad_s: float = 0.0

    @property
    def is_rest(self) -> bool:
        """Whether the robot is to stand."""
        return max(abs(value) for value in self) < _SLOW


@dataclass(frozen=True)
class Walking:
    """Settings for the height of TALOS' CoM; times scale with its square root, velocities as well.

    A swing takes ``swing_s``, the time on both soles ``both_s``, the shift before the first step ``shift_s``. The
    command is followed with ``slew`` (m/s2, rad/s2), within ``limits``. Places cost ``place``, the capture point at the
    landing ``capture``, and times ``time`` times their squared deviation. Soles stay ``apart_m`` from each other, their
    centres at ``narrowest`` of their usual distance or more (shoes may be wider than soles), and
    land at most ``longest`` of the leg's length ahead and ``widest`` of it aside. The walk is given up for a recovery
    where the capture point at the landing would be off by more than ``lost_m``. It stops where the ground does not go
    on level for two steps. ``way_correction`` are the arguments of ``side_steps.WayCorrection``.
    """

    swing_s: float = 0.42
    both_s: float = 0.1
    shift_s: float = 0.7
    slew: tuple[float, float, float] = (0.4, 0.3, 0.8)
    limits: WalkCommand = field(default_factory=lambda: WalkCommand(0.4, 0.2, 0.5))
    capture: float = 20.0
    place: float = 1.0
    time: float = 0.3
    times: tuple[float, ...] = (0.7, 0.8, 0.9, 1.0, 1.1)
    apart_m: float = 0.02
    longest: float = 0.7
    widest: float = 0.6
    narrowest: float = 0.5
    lost_m: float = 0.12
    way_correction: tuple[float, tuple[float, float], float] = (0.2, (0.8, 1.7), 0.04)


class Foothold(NamedTuple):
    """A place where a sole is to land."""

    effector: str
    position_m: Float[np.ndarray, "3"]
    yaw_rad: float


class WalkRun(RecoveryRun):
    """State of a walk, which begins on the soles of ``planned`` at ``measured``; ``command`` may change at any time."""

    def __init__(
        self,
        settings: Recovery,
        robot: Robot,
        legs: LegGeometry,
        sequence: ContactSequence,
        planned: Mapping[str, Contact],
        measured: SensedState,
        dt_s: float,
        walking: Walking | None = None,
    ) -> None:
        self._walking = Walking() if walking is None else walking
        scale = math.sqrt(legs.com_height_m / TALOS_COM_HEIGHT_M)
        self._swing_s, self._both_s = scale * self._walking.swing_s, scale * self._walking.both_s
        self._shift_s = scale * self._walking.shift_s
        self.command, self._velocity = WalkCommand(), WalkCommand()
        self._is_walking, self._rest_s, self._of_s, self._next = False, 0.0, 1.0, ""
        self._from_m = np.zeros(2)
        self._landed, self._sole_from_rad, self._is_blocked = 0, 0.0, False
        self._aside_m, self._way = 0.0, WayCorrection(*self._walking.way_correction)
        super().__init__(settings, robot, legs, sequence, planned, measured, dt_s)

    @property
    def is_walking(self) -> bool:
        """Whether the robot walks, rather than stands or recovers."""
        return self._is_walking

    @property
    def is_as_commanded(self) -> bool:
        """Whether the robot walks or stands, rather than steps to stay upright."""
        return self._is_walking or self._swing is None

    @property
    def velocity(self) -> WalkCommand:
        """The commanded velocity as it is followed, with limited changes."""
        return self._velocity

    def _stand(self, capture_m: Shift, w: float, measured: SensedState) -> Shift:
        """Centre of pressure on two soles, which moves to the next standing one; lifts the other one in time."""
        self._follow_command()
        self._sole = self._base
        if self._is_walking and self.steps != self._landed:
            self._landed = self.steps
            left_m, right_m = map(self._place, self._legs.side)
            self._way.add_landing(self._aside_m, 0.5 * (left_m + right_m), self._base.axes[:, 1])
            self._begin_shift(self._other(self._next), self._both_s)
            if self._velocity.is_rest and self._has_parallel_soles():
                self._is_walking = False
        if not self._is_walking:
            pressure_m = super()._stand(capture_m, w, measured)
            if self._swing is None and not self.command.is_rest and self._can_begin(capture_m):
                self._landed, side = self.steps, self.command.left_m_s or self.command.turn_rad_s
                self._begin_shift(
                    next(n for n, s in self._legs.side.items() if s * side > 0.0 or not side), self._shift_s
                )
                self._is_walking = not self._is_blocked
                self._way.begin_walk()
            return pressure_m
        self._rest_s -= self._dt_s
        stance_m = self._place(self._other(self._next))
        if self._rest_s <= 0.5 * self._dt_s:
            return self._begin_swing(stance_m, capture_m, w, measured)
        r = max(self._rest_s, _LEAST_S)
        growth = math.exp(w * r)
        start_m = (self._from_m - stance_m) * min(r / self._of_s, 1.0)
        end_m = (capture_m - stance_m) * growth - start_m * _ramp_share(w, r, growth)
        off_m = (end_m - self._periodic(w)[0]) / (growth - 1.0)
        share = max(self._rest_s, 0.0) / self._of_s
        return self._within_soles(stance_m + share * (self._from_m - stance_m) + off_m)

    def _aim_swing(self, swing: AimedSwing, capture_m: Shift, w: float) -> Shift:
        if not self._is_walking:
            return super()._aim_swing(swing, capture_m, w)
        self._follow_command()
        name, (stance,) = self._in_air, self._contacts.values()
        at = stance.placement
        elapsed_s, step = self._time_s - self._lifted_s, self._step
        if step is not None:
            step = self._step = replace(step, in_s=step.in_s - self._dt_s)
        axes, half = at.rotation[:2, :2], self._legs.half_m - self._by.margin_m
        if step is None or (self._samples % self._by.choose_every == 0 and step.in_s > self._by.fixed_s):
            chosen = self._choose_landing(name, at.position_m, capture_m, w, elapsed_s, axes)
            if chosen is None:
                self._is_walking, self._step = False, None
                self.left_plan_s, self.steps_before = self._time_s, self.steps
                return super()._aim_swing(swing, capture_m, w)
            self._take_step(chosen)
            step = chosen
        self._samples += 1
        frame = self._body.frame_state(name)
        swing.follow(frame.position_m, frame.velocity[:3])
        self._turn_sole(elapsed_s, step.in_s)
        target_m = step.place_m + self._periodic(w)[1]
        pressure = _pressure_towards(
            capture_m, target_m, at.position_m[:2], math.exp(w * max(step.in_s, 0.03)), axes, half
        )
        swing.advance(step.place_m, step.height_m, step.in_s, self._dt_s)
        return pressure

    def predict_footholds(self, steps: int) -> tuple[Foothold, ...]:
        """The next places of the soles: the chosen one, then those of the commanded walk."""
        if not self._is_walking:
            aim = self.next_foothold_m
            return () if aim is None else (Foothold(self._in_air, aim, self._sole.yaw_rad),)
        name, yaw = self._next, self._base.yaw_rad
        place_m, height_m = (
            self._place(self._other(name)),
            float(self._body.frame_state(self._other(name)).position_m[2]),
        )
        footholds: list[Foothold] = []
        for k in range(steps):
            here = place_m + LevelHeading(yaw).axes @ self._displacement(name)
            if k == 0 and self._step is not None:
                here = self._step.place_m
            footholds.append(Foothold(name, np.array([*here, height_m]), yaw + 0.5 * self._turn_of_step()))
            place_m, name, yaw = here, self._other(name), yaw + self._turn_of_step()
        return tuple(footholds)

    def predict_pressures(self, footholds: Sequence[Foothold]) -> list[tuple[float, Shift]]:
        """Middles of the soles that stand next, each until a time from now (s)."""
        until_s = self._step.in_s if self._step is not None else max(self._rest_s, 0.0) + self._swing_s
        pressures = [(until_s, self._place(self._other(self._next)))]
        for foothold in footholds:
            until_s += self._both_s + self._swing_s
            pressures.append((until_s, foothold.position_m[:2]))
        return pressures

    def _choose_landing(
        self, name: str, stance_m: np.ndarray, capture_m: Shift, w: float, elapsed_s: float, axes: np.ndarray
    ) -> Step | None:
        """Place and time of the landing; None where no step brings the capture point near its place in the walk."""
        by, b = self._walking, self._periodic(w)[1]
        half = self._legs.half_m - self._by.margin_m
        nominal_m = stance_m[:2] + self._base.axes @ self._displacement(name)
        clear = elapsed_s > 0.3 * self._swing_s
        best: tuple[float, Step | None] = (math.inf, None)
        for factor in by.times if clear else (1.0,):
            T = factor * self._swing_s - elapsed_s
            if T < 0.05 or (self._step is not None and self._step.in_s + 0.1 < T):
                continue
            growth = math.exp(w * T)
            p = _pressure_towards(capture_m, nominal_m + b, stance_m[:2], growth, axes, half)
            reached_m = p + (capture_m - p) * growth
            u = (by.capture * (reached_m - b) + by.place * nominal_m) / (by.capture + by.place)
            u = self._within_reach(u, stance_m[:2], self._legs.side[name])
            off_m = float(np.linalg.norm(reached_m - u - b))
            cost = (
                by.capture * off_m**2 + by.place * float(((u - nominal_m) ** 2).sum()) + by.time * (factor - 1.0) ** 2
            )
            if cost < best[0] and off_m < by.lost_m:
                best = (cost, Step(u, float(stance_m[2]), T, cost))
        return best[1]

    def _within_reach(self, place_m: Shift, stance_m: Shift, side: float) -> Shift:
        """The nearest place that the leg reaches without coming near to the standing sole."""
        x, y = self._base.axes.T @ (place_m - stance_m)
        far, ahead = self._walking.widest * self._legs.leg_m, self._walking.longest * self._legs.leg_m
        y = side * min(max(side * y, self._nearest_m), far)
        return np.asarray(stance_m + self._base.axes @ np.array([min(max(x, -0.8 * ahead), ahead), y]))

    @property
    def _nearest_m(self) -> float:
        """Least distance of the middles of both soles from each other, sideways."""
        by, half_m = self._walking, float(self._legs.half_m[1])
        return max(2.0 * half_m + by.apart_m, by.narrowest * self._legs.spacing_m)

    def _displacement(self, name: str) -> Shift:
        """From the standing sole to the landing one in a walk at the present velocity, in the axes of the heading.

        Sideways as ``side_steps`` divides the way.
        """
        step_s, side, v = self._swing_s + self._both_s, self._legs.side[name], self._velocity
        way_m, widest_m = 2.0 * step_s * self._way.factor * abs(v.left_m_s), self._walking.widest * self._legs.leg_m
        leading_m, trailing_m = side_steps_m(way_m, self._legs.spacing_m, self._nearest_m, widest_m)
        aside_m = leading_m if side * v.left_m_s > 0.0 else trailing_m
        return np.array([step_s * v.ahead_m_s, side * aside_m])

    def _turn_of_step(self) -> float:
        return (self._swing_s + self._both_s) * self._velocity.turn_rad_s

    def _periodic(self, w: float) -> tuple[Shift, Shift]:
        """``periodic_offsets_m`` of the next two steps."""
        other = self._other(self._next)
        first = self._base.axes @ self._displacement(self._next)
        second = LevelHeading(self._base.yaw_rad + self._turn_of_step()).axes @ self._displacement(other)
        return periodic_offsets_m(first, second, w, self._swing_s, self._both_s)

    def _begin_shift(self, name: str, duration_s: float) -> None:
        """Move the pressure to the sole that is not ``name``, which is lifted next."""
        self._next, self._rest_s, self._of_s = name, duration_s, duration_s
        middle_m = 0.5 * (self._place(name) + self._place(self._other(name)))
        self._from_m = middle_m if duration_s == self._shift_s else self._place(name)
        self._is_blocked = not self._goes_on()

    def _begin_swing(self, stance_m: Shift, capture_m: Shift, w: float, measured: SensedState) -> Shift:
        self._lift_off(self._next, measured)
        self._sole_from_rad = _yaw_of(measured.contacts[self._next].rotation)
        self._state_rows()
        return stance_m

    def _turn_sole(self, elapsed_s: float, in_s: float) -> None:
        """Turn the swinging sole to the heading that the body has in the middle of the next step."""
        goal = self._base.yaw_rad + self._velocity.turn_rad_s * in_s + 0.5 * self._turn_of_step()
        x = min(elapsed_s / max(elapsed_s + in_s - 0.05, 0.05), 1.0)
        share, rate = x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / max(elapsed_s + in_s, 0.05)
        turn = math.remainder(goal - self._sole_from_rad, math.tau)
        self._sole = LevelHeading(self._sole_from_rad + share * turn, rate * turn)

    def _follow_command(self) -> None:
        """Approach the command, and turn the heading while walking."""
        goal = self.command if self._is_walking and not self._is_blocked else WalkCommand()
        changes = zip(self._velocity, goal, self._walking.limits, self._walking.slew, strict=True)
        self._velocity = WalkCommand(
            *(
                v + min(max(min(max(to, -most), most) - v, -a * self._dt_s), a * self._dt_s)
                for v, to, most, a in changes
            )
        )
        self._aside_m += self._velocity.left_m_s * self._dt_s
        rate = self._velocity.turn_rad_s if self._is_walking else 0.0
        self._base = LevelHeading(self._base.yaw_rad + rate * self._dt_s, rate)
        self._axes = self._base.axes

    def _can_begin(self, capture_m: Shift) -> bool:
        """Whether the robot stands quietly enough for a first step, on ground that goes on."""
        places = [self._place(name) for name in self._legs.side]
        middle_m = 0.5 * (places[0] + places[1])
        return float(np.linalg.norm(capture_m - middle_m)) < 0.25 * self._legs.spacing_m + 0.02

    def _goes_on(self) -> bool:
        """Whether the ground goes on level where two steps with the command would lead."""
        standing, swinging = self._contacts[self._other(self._next)].placement, self._next
        way = 2.0 * (self._swing_s + self._both_s) * np.array([self.command.ahead_m_s, self.command.left_m_s])
        aside_m = np.array([0.0, self._legs.side[swinging] * self._legs.spacing_m])
        corners = CORNERS * (self._legs.half_m + self._walking.apart_m) @ self._base.axes.T
        for place_m in (standing.position_m[:2] + self._base.axes @ (way + extra) for extra in (np.zeros(2), aside_m)):
            height_m = self._footholds.sole_heights_m(place_m, corners)
            if not abs(float(height_m) - float(standing.position_m[2])) < _LEVEL_M:
                return False
        return True

    def _has_parallel_soles(self) -> bool:
        left, right = (self._contacts[name].placement for name in self._legs.side)
        along_m = self._base.axes[:, 0] @ (left.position_m - right.position_m)[:2]
        turned_rad = math.remainder(_yaw_of(left.rotation) - _yaw_of(right.rotation), math.tau)
        return bool(abs(along_m) < 0.05 and abs(turned_rad) < 0.1)

    def _within_soles(self, pressure_m: Shift) -> Shift:
        origin, other = (contact.placement.position_m[:2] for contact in self._contacts.values())
        point, end = self._axes.T @ (pressure_m - origin), self._axes.T @ (other - origin)
        nearest, _ = nearest_in_hull(point, end, self._legs.half_m - self._by.margin_m)
        return np.asarray(origin + self._axes @ nearest)

    def _place(self, name: str) -> Shift:
        contact = self._contacts.get(name)
        position_m = self._body.frame_state(name).position_m if contact is None else contact.placement.position_m
        return np.asarray(position_m[:2])

    def _other(self, name: str) -> str:
        return next(other for other in self._legs.side if other != name)


def periodic_offsets_m(
    first_m: Shift, second_m: Shift, rate_per_s: float, swing_s: float, both_s: float
) -> tuple[Shift, Shift]:
    """Capture point of a walk with two alternating displacements of the soles.

    The first offset is that from the standing sole at the lift-off before the step of ``first_m``, the second one that
    from the landing sole at its end, both of shape (2,), metres.
    """
    G, g = math.exp(rate_per_s * swing_s), math.exp(rate_per_s * both_s)
    E, k = G * g, (g - 1.0) / (rate_per_s * both_s)
    start_m = k * (E * first_m + second_m) / (E * E - 1.0)
    return start_m, start_m * G - first_m


def _pressure_towards(
    capture_m: Shift, target_m: Shift, stance_m: Shift, growth: float, axes: np.ndarray, half_m: Shift
) -> Shift:
    """Centre of pressure in the standing sole that brings the capture point to the target, or nearest to it."""
    pressure_m = (capture_m * growth - target_m) / (growth - 1.0)
    return np.asarray(stance_m + axes @ np.clip(axes.T @ (pressure_m - stance_m), -half_m, half_m))


def _ramp_share(w: float, T: float, growth: float) -> float:
    """Effect on the capture point after T of a pressure that moves from 1 to 0 within T."""
    return growth - 1.0 - (growth - 1.0 - w * T) / (w * T)


def _yaw_of(R: np.ndarray) -> float:
    return math.atan2(R[1, 0], R[0, 0])
