"""The replayed walk of a robot as a ``WalkMotion``, so that a person and a robot are measured by the same functions.

The outline of a foot is the rectangle of the sole; strikes and lift-offs are those of the plan, on the clock of the
replay.
"""

from typing import TYPE_CHECKING, Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Points
from stridelab.measures.walk_motion import AHEAD, FootMotion, WalkMotion
from stridelab.recordings.recording import Side
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.walking.event_calibration import EventError
from stridelab.walking.steps import GaitStep

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

RATE_HZ: Final = 100.0
FEET: Final[tuple[tuple[Side, str], ...]] = (("left", "left_foot"), ("right", "right_foot"))
"""Sides and effectors."""
PLANNED: Final = EventError(0.0, 0.0)
"""Error of the events, which are those of the plan."""
FROM_REST, TO_REST = 1, 2
"""Steps at the start and at the end that are not steady: the first one; the last full one and the closing one."""


def robot_motion(robot: Robot, replay: "Replay") -> WalkMotion:
    """CoM and soles of a replay along x, at ``RATE_HZ``."""
    time_s = np.arange(0.0, replay.time_s[-1], 1.0 / RATE_HZ)
    every = np.searchsorted(replay.time_s, time_s).clip(max=len(replay.time_s) - 1)
    com_m = np.column_stack([np.interp(time_s, replay.time_s, track) for track in replay.com_m.T])
    return WalkMotion(
        time_s=time_s,
        com_m=com_m,
        velocity_m_s=np.gradient(com_m, time_s, axis=0),
        covariance=None,
        varying_sd_m=0.0,
        feet=_foot_motions(robot, replay.q[every]),
        momentum_per_kg=np.full_like(com_m, np.nan),
        mass_kg=robot.mass_kg,
        stature_m=None,
    )


def robot_steps(sequence: ContactSequence, replay: "Replay", motion: WalkMotion) -> tuple[GaitStep, ...]:
    """All steps of the plan, in order of time."""
    swings = [(k, side) for k, phase in enumerate(sequence.phases) for side, name in FEET if name not in phase.contacts]
    steps: list[GaitStep] = []
    for index, (k, side) in enumerate(swings):
        other = "right_foot" if side == "left" else "left_foot"
        later = swings[index + 1][0] if index + 1 < len(swings) else len(sequence.phases) - 1
        off_s, strike_s, next_s = (
            _replay_time_s(replay, float(at))
            for at in (sequence.starts_s[k], sequence.ends_s[k], sequence.starts_s[later])
        )
        before = steps[-1].strike_s if steps else None
        landing, standing = (sequence.next_contact(name, k) for name in (f"{side}_foot", other))
        if landing is None or standing is None:
            raise ValueError("a swinging sole lands beside the other one")
        ahead_m = float(landing.placement.position_m[AHEAD] - standing.placement.position_m[AHEAD])
        com = [motion.interpolate_track(motion.com_m, at)[AHEAD] for at in (off_s, next_s)]
        steps.append(
            GaitStep(
                side=side,
                lift_off_s=off_s,
                strike_s=strike_s,
                next_lift_off_s=next_s,
                period_s=next_s - off_s if before is None else strike_s - before,
                length_m=ahead_m,
                speed_m_s=float((com[1] - com[0]) / max(next_s - off_s, 1e-9)),
                measured=True,
                source="plates",
                prior_strike_s=before,
                lift_off_error=PLANNED,
                strike_error=PLANNED,
                next_lift_off_error=PLANNED,
                prior_strike_error=PLANNED,
            )
        )
    return tuple(steps)


def steady_steps(steps: tuple[GaitStep, ...]) -> tuple[GaitStep, ...]:
    """The steps between those that start from rest and that end at rest."""
    return steps[FROM_REST : len(steps) - TO_REST]


def _replay_time_s(replay: "Replay", plan_s: float) -> float:
    return float(np.interp(plan_s, replay.plan_time_s, replay.time_s))


def _foot_motions(robot: Robot, q: Float[np.ndarray, "n nq"]) -> dict[Side, FootMotion]:
    model, frames = with_contact_frames(robot)
    data = model.createData()
    corners = {side: _outline_in_sole(robot.effectors[name].points_m()) for side, name in FEET}
    outlines = {side: np.empty((len(q), 6, 3)) for side, _ in FEET}
    for i, posture in enumerate(q):
        pin.framesForwardKinematics(model, data, posture)
        for side, name in FEET:
            placement = data.oMf[frames[name]]
            outlines[side][i] = corners[side] @ placement.rotation.T + placement.translation
    unknown = np.full((len(q), 3), np.nan)
    return {side: FootMotion(outline[:, 5], outline[:, :5], unknown) for side, outline in outlines.items()}


def _outline_in_sole(corners_m: Points) -> Float[np.ndarray, "6 3"]:
    """Edges of the heel (2) and of the toes (2), middle of the toes, middle of the heel; from the corners of a sole."""
    front_left, back_left, back_right, front_right = corners_m
    toe, heel = 0.5 * (front_left + front_right), 0.5 * (back_left + back_right)
    return np.array([back_left, back_right, front_left, front_right, toe, heel])
