"""A walk in closed form: the CoM, rectangular feet and steps of 0.6 m every 0.5 s, for measures with known values."""

import numpy as np

from stridelab.conventions import Points
from stridelab.measures import FootMotion, WalkMotion
from stridelab.recordings.recording import Side
from stridelab.walking.steps import GaitStep

RATE_HZ = 200.0
STEP_S, STEP_M, SWING_S = 0.5, 0.6, 0.4
HALF_WIDTH_M, HALF_BREADTH_M, FOOT_M = 0.08, 0.04, 0.25
HEIGHT_M, MASS_KG = 0.981, 70.0
SPEED_M_S = STEP_M / STEP_S
STEPS_IN_WALK = 20


def plain_steps(n: int = STEPS_IN_WALK) -> tuple[GaitStep, ...]:
    """Step k of the foot k % 2 (left first) strikes at (k + 1) STEP_S."""
    return tuple(
        GaitStep(
            side=side_of(k),
            lift_off_s=(k + 1) * STEP_S - SWING_S,
            strike_s=(k + 1) * STEP_S,
            next_lift_off_s=(k + 2) * STEP_S - SWING_S,
            period_s=STEP_S,
            length_m=STEP_M,
            speed_m_s=SPEED_M_S,
            measured=True,
            source="plates",
            prior_strike_s=k * STEP_S if k > 0 else None,
        )
        for k in range(n)
    )


def side_of(k: int) -> Side:
    """Foot that swings in step k."""
    return "left" if k % 2 == 0 else "right"


def plain_walk(com_m: Points | None = None, velocity_m_s: Points | None = None, **fields: object) -> WalkMotion:
    """The walk; by default the CoM moves straight ahead at constant speed, midway between the feet."""
    time_s = np.arange(round((STEPS_IN_WALK + 1) * STEP_S * RATE_HZ)) / RATE_HZ
    if com_m is None:
        com_m = np.column_stack([SPEED_M_S * time_s, np.zeros_like(time_s), np.full_like(time_s, HEIGHT_M)])
    if velocity_m_s is None:
        velocity_m_s = np.gradient(com_m, time_s, axis=0, edge_order=2)
    given: dict[str, object] = {
        "covariance": None,
        "varying_sd_m": 0.001,
        "feet": {side: plain_foot(side, time_s) for side in ("left", "right")},
        "momentum_per_kg": np.zeros_like(com_m),
        "mass_kg": MASS_KG,
        "stature_m": 1.8,
    }
    return WalkMotion(time_s=time_s, com_m=com_m, velocity_m_s=velocity_m_s, **(given | fields))  # type: ignore[arg-type]


def plain_foot(side: Side, time_s: np.ndarray) -> FootMotion:
    """Foot k stands from its strike on with the heel at ``(k + 1) STEP_M``; in its swing it moves at constant speed."""
    lane_m = HALF_WIDTH_M if side == "left" else -HALF_WIDTH_M
    own = [k for k in range(-2, STEPS_IN_WALK + 2) if side_of(k) == side]
    knots_s = [t for k in own for t in ((k + 1) * STEP_S - SWING_S, (k + 1) * STEP_S)]
    knots_m = [x for k in own for x in ((k - 1) * STEP_M, (k + 1) * STEP_M)]
    x = np.interp(time_s, knots_s, knots_m)
    heel = np.column_stack([x, np.full_like(x, lane_m), np.zeros_like(x)])
    corners = [(0.0, 1.0), (0.0, -1.0), (0.7, 1.0), (0.7, -1.0), (1.0, 0.0)]
    offsets = np.array([(FOOT_M * ahead, HALF_BREADTH_M * left, 0.0) for ahead, left in corners])
    return FootMotion(heel, heel[:, None] + offsets, np.zeros_like(heel))
