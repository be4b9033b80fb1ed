"""Gait plan of the robot: stances and transfer of the load between the feet.

A walk consists of rest, equal steps, a closing step and rest. A step of duration T begins with double support, in which
the load moves from the middle of one sole to that of the other (minimum jerk), and ends with the swing of the other
foot; the soles stay flat. Step length, step time and step width vary from step to step with the seed.

The plan uses the types of ``simulation.human``, so that plates, events and the load sharing are the same as for the
simulated subject.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from numpy.random import Generator

from stridelab.conventions import Series
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Side
from stridelab.simulation.human.body_proportions import SIDES, side_sign
from stridelab.simulation.human.gait_plan import MIN_SPEED_M_S, GaitPlan, Stance, centred_draws, standing_plan
from stridelab.simulation.human.load_transfer import LoadPlan, minimum_jerk, sway

SHIFT_S: Final = 0.4
"""Time before the first step at which the load starts to shift, and settling time after the last."""
LEAD_S: Final = 1.0
"""Simulated time before and after the recording, in which sway fades in from and out to exact rest."""
MAX_SPEED_M_S: Final = 0.9
COM_HEIGHT_M: Final = 0.83
BOB_M: Final = 0.012
_WALK_RATIO_MS: Final = 0.21
"""Step length over step rate: 0.20 m s at the robot's cadence, 0.22 m s at the human one."""
_LEAST_REST_S: Final = 0.5
_LENGTH_SD: Final = 0.02
_TIME_SD: Final = 0.02
_WIDTH_SD_M: Final = 0.004


@dataclass(frozen=True)
class ArmSwing:
    """Amplitudes of the yaw of the shoulders, of the elbows and of the yaw of the torso."""

    arm_rad: float = 0.35
    elbow_rad: float = 0.15
    yaw_rad: float = 0.06


@dataclass(frozen=True, kw_only=True)
class RobotGait:
    """Parameters of a walk; ``double_support`` is its share of a step, ``bob_m`` the amplitude of the CoM's height."""

    step_length_m: float
    step_time_s: float
    n_steps: int
    rest_s: float
    double_support: float = 0.25
    width_m: float = 0.17
    com_height_m: float = COM_HEIGHT_M
    bob_m: float = BOB_M
    arms: ArmSwing = ArmSwing()

    @property
    def duration_s(self) -> float:
        """Total duration: rest, steps, the closing step and rest."""
        steps = self.n_steps + 1 if self.n_steps > 0 else 0
        return 2 * self.rest_s + steps * self.step_time_s


GaitName = Literal["robot", "human", "running"]
"""Motions of the study; running is in ``runner``."""

WALKS: Final[Mapping[str, RobotGait]] = {
    "robot": RobotGait(step_length_m=0.25, step_time_s=0.8, n_steps=8, rest_s=1.0),
    "human": RobotGait(
        step_length_m=0.40, step_time_s=0.55, n_steps=12, rest_s=0.8, bob_m=0.015, arms=ArmSwing(arm_rad=0.45)
    ),
}
"""The two walks of section 2.5: at a robot's and at a human cadence."""


@dataclass(frozen=True)
class WalkerSize:
    """Size of a robot over that of TALOS, and the distance of its soles; lengths scale with it, times with its root."""

    title: str = "TALOS"
    scale: float = 1.0
    width_m: float = 0.17

    @property
    def max_speed_m_s(self) -> float:
        """Fastest walk, of the same Froude number for all robots."""
        return MAX_SPEED_M_S * math.sqrt(self.scale)


TALOS_SIZE: Final = WalkerSize()


def gait_for(speed_m_s: float, duration_s: float, size: WalkerSize = TALOS_SIZE) -> RobotGait:
    """A walk from rest to rest of ``duration_s`` with full steps at ``speed_m_s``; below 0.1 m/s, standing.

    As in humans, the ratio of step length to step rate is constant, here that of the walks of section 2.5. Raises
    ``InvalidInput`` (``walker-out-of-range``) for a speed that is out of range or a duration that is too short.
    """
    if not 0.0 <= speed_m_s <= size.max_speed_m_s:
        message = f"{size.title} walks at 0 to {size.max_speed_m_s:.2g} m/s, not at {speed_m_s:g} m/s."
        raise InvalidInput("walker-out-of-range", message, [Fault("speed_m_s", message)])
    body = RobotGait(
        step_length_m=0.0,
        step_time_s=1.0,
        n_steps=0,
        rest_s=duration_s / 2,
        width_m=size.width_m,
        com_height_m=COM_HEIGHT_M * size.scale,
        bob_m=BOB_M * size.scale,
    )
    if speed_m_s < MIN_SPEED_M_S:
        return body
    length_m = math.sqrt(_WALK_RATIO_MS * size.scale**1.5 * speed_m_s)
    step_s = length_m / speed_m_s
    n_steps = int((duration_s - 2 * _LEAST_REST_S) / step_s) - 1
    if n_steps < 2:
        message = f"At {speed_m_s:g} m/s, two steps from rest to rest take {2 * _LEAST_REST_S + 3 * step_s:.1f} s."
        raise InvalidInput("walker-out-of-range", message, [Fault("duration_s", message)])
    rest_s = (duration_s - (n_steps + 1) * step_s) / 2
    return replace(body, step_length_m=length_m, step_time_s=step_s, n_steps=n_steps, rest_s=rest_s)


def plan_walk(gait: RobotGait, rng: Generator) -> GaitPlan:
    """Stances of a walk along +x from the origin; without steps, of standing there."""
    if gait.n_steps == 0:
        return replace(standing_plan(gait.duration_s, gait.width_m), sole_middle_m=0.0)
    n, T = gait.n_steps, gait.step_time_s
    lengths = np.append(gait.step_length_m * (1.0 + _LENGTH_SD * centred_draws(rng, n)), 0.0)
    durations = T * (1.0 + _TIME_SD * centred_draws(rng, n + 1))
    half_m = gait.width_m / 2 + np.append(_WIDTH_SD_M / 2 * centred_draws(rng, n), 0.0)
    first: Side = SIDES[int(rng.integers(2))]
    other: Side = SIDES[1 - SIDES.index(first)]
    begins = gait.rest_s + np.concatenate([[0.0], np.cumsum(durations)])
    lifts, strikes = begins[:-1] + gait.double_support * durations, begins[1:]
    x_m = np.cumsum(lengths)
    stances = [
        _flat_stance(other, 0.0, gait.width_m / 2, -math.inf, float(lifts[1])),
        _flat_stance(first, 0.0, gait.width_m / 2, -math.inf, float(lifts[0])),
    ]
    for k in range(n + 1):
        off_s = float(lifts[k + 2]) if k + 2 <= n else math.inf
        stances.append(_flat_stance((first, other)[k % 2], float(x_m[k]), float(half_m[k]), float(strikes[k]), off_s))
    return GaitPlan(
        tuple(stances),
        gait.step_length_m,
        T,
        gait.step_length_m / T,
        record_from_s=0.0,
        duration_s=gait.duration_s,
        end_s=gait.duration_s,
        steady_s=(float(strikes[1]), float(strikes[-3])),
        sole_middle_m=0.0,
    )


def plan_load(plan: GaitPlan, time_s: Series, rng: Generator) -> LoadPlan:
    """Load shares, centres of pressure and zero-moment point, with sway while standing."""
    left = np.full(len(time_s), 0.5)
    for start_s, end_s, target in _load_shifts(plan):
        left = left + (target - left) * minimum_jerk((time_s - start_s) / (end_s - start_s))
    share: dict[Side, Series] = {"left": left, "right": 1.0 - left}
    still = minimum_jerk((time_s - time_s[0]) / LEAD_S) * minimum_jerk((time_s[-1] - time_s) / LEAD_S)
    wander = sway(time_s, rng) * still[:, None]
    cop = {side: sole_middles(plan, side, time_s) + wander for side in SIDES}
    zmp = sum((share[side][:, None] * cop[side] for side in SIDES), np.zeros((len(time_s), 2)))
    return LoadPlan(share, cop, zmp)


def sole_middles(plan: GaitPlan, side: Side, time_s: Series) -> Float[np.ndarray, "n 2"]:
    """Middle of one sole; in swing that of the last stance, from mid-swing on that of the next."""
    stances = [stance for stance in plan.stances if stance.side == side]
    changes = [(a.off_s + b.strike_s) / 2 for a, b in pairwise(stances)]
    places = np.array([(stance.x_m, stance.y_m) for stance in stances])
    return np.asarray(places[np.searchsorted(changes, time_s)])


def _load_shifts(plan: GaitPlan) -> list[tuple[float, float, float]]:
    """``(start, end, share of the left foot afterwards)`` of every load transfer."""

    def left_share_on(side: Side) -> float:
        return 1.0 if side == "left" else 0.0

    if not plan.walks:
        return []
    first_off_s = plan.stances[1].off_s
    shifts = [(first_off_s - 2 * SHIFT_S, first_off_s, left_share_on(plan.stances[0].side))]
    for stance in plan.stances[2:]:
        lifts = [s.off_s for s in plan.stances if s.side != stance.side and s.off_s > stance.strike_s]
        if np.isfinite(min(lifts)):
            shifts.append((stance.strike_s, min(lifts), left_share_on(stance.side)))
    end_s = plan.stances[-1].strike_s
    return [*shifts, (end_s, end_s + SHIFT_S, 0.5)]


def _flat_stance(side: Side, x_m: float, half_m: float, strike_s: float, off_s: float) -> Stance:
    """A stance with a flat sole throughout."""
    return Stance(side, x_m, side_sign(side) * half_m, strike_s, strike_s, off_s, off_s)
