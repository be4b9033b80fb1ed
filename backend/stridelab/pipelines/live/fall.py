"""Explains a fall of a live robot: the limits that ran out before it, and whether it was inevitable."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.robots.robot import Robot
from stridelab.schemas.live.messages import LiveFall
from stridelab.wholebody.recovery.walking import WalkRun
from stridelab.wholebody.replay.disturbances import Push
from stridelab.wholebody.replay.log import TORQUE_RATIO, Replay
from stridelab.wholebody.replay.loss_proof import LossPremises, is_loss_proved
from stridelab.wholebody.replay.stepper import ReplayStepper

RELEVANT_S: Final = 6.0
"""A push that ended longer before a fall is not named as its cause."""
_LEFT_OUT: Final = frozenset({"replay-fell", "replay-left-plan", "replay-torque", "replay-hand-off"})
_UPRIGHT: Final = 0.7


@dataclass(frozen=True)
class Strain:
    """The first joint since the last push whose torque command exceeded its limit, and when (None: no joint)."""

    joint: str = ""
    time_s: float | None = None


def explain_fall(
    robot: Robot,
    stepper: ReplayStepper,
    replay: Replay,
    pushes: Sequence[Push],
    premises: LossPremises | None,
    strain: Strain,
) -> LiveFall:
    """The fall at the end of ``replay``; ``pushes`` are those so far, ``premises`` of a proof of loss, if any hold."""
    fall_s = float(replay.time_s[-1])
    recent = [push for push in pushes if 0.0 <= fall_s - push.time_s < RELEVANT_S]
    proved = None
    if recent and premises is not None and recent[-1].end_s < fall_s:
        proved = is_loss_proved(robot, stepper.motion.sequence, premises, replay, recent[-1].end_s)
    reasons = _balance_reasons(stepper)
    if strain.time_s is not None:
        reasons.append(
            f"Torque: at {strain.time_s:.2f} s {strain.joint} was the first joint asked for more than "
            f"{TORQUE_RATIO:g} times its limit; the rest was cut off."
        )
    reasons += [remark.message for remark in replay.remarks if remark.code not in _LEFT_OUT]
    if proved:
        reasons.append("No motion within the premises of the proof would have come to rest: the push was too large.")
    elif proved is False:
        reasons.append("It is not proved that the push was too large: other steps might have held it.")
    return LiveFall(time_s=fall_s, summary=_summary(robot, fall_s, recent), reasons=reasons, proved_lost=proved)


def _summary(robot: Robot, fall_s: float, recent: Sequence[Push]) -> str:
    if not recent:
        return f"The robot fell at {fall_s:.1f} s."
    size_ns, on = float(np.linalg.norm(recent[-1].impulse_ns)), recent[-1].link or "the trunk"
    before = f", {len(recent)} pushes within {RELEVANT_S:g} s" if len(recent) > 1 else ""
    return (
        f"The robot fell at {fall_s:.1f} s, {fall_s - recent[-1].time_s:.1f} s after a push of {size_ns:.0f} N s "
        f"({size_ns / robot.mass_kg:.2f} m/s) on {on}{before}."
    )


def _balance_reasons(stepper: ReplayStepper) -> list[str]:
    recovering = stepper.recovering
    if recovering is None:
        return ["Steps: the robot did not leave its plan to step, and its centre of mass left it by 25 cm."]
    q, _ = stepper.simulation.coordinates()
    tilt_rad = 2.0 * float(np.arcsin(min(1.0, np.hypot(q[3], q[4]))))
    ended = f"its pelvis was tilted by {np.degrees(tilt_rad):.0f} degrees" if tilt_rad > _UPRIGHT else "it sank down"
    if isinstance(recovering, WalkRun):
        return [f"Steps: after {_count_steps(recovering.steps)} since it was steered, {ended}."]
    return [
        f"Support: at {recovering.left_plan_s:.2f} s the capture point was farther out than the soles can correct.",
        f"Steps: after {_count_steps(recovering.steps - recovering.steps_before)} that were to stop it, {ended}.",
    ]


def _count_steps(number: int) -> str:
    return "1 step" if number == 1 else f"{number} steps"
