"""Search of the longest steps and the fastest pace at which a robot carries out a recorded walk.

A pace passes if the motion is planned, its certificate passes, and its replay in physics is completed. The longest
steps that pass at ``FIRST_PACE`` are taken (at ``SLOWEST_PACE`` if none do); then the pace is bisected.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stridelab.errors import Fault, NotEstimable
from stridelab.pipelines.imitation.recorded_walk import RecordedWalk
from stridelab.pipelines.imitation.robot_walk import RobotScale, RobotWalk, mean_speed_m_s, scale_walk
from stridelab.pipelines.motion_trial import PACE_STEP, bisect_steps, try_motion
from stridelab.pipelines.plan_centroidal import Change
from stridelab.pipelines.plan_motion import MotionResult
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.schemas.imitation.contract import ImitationAttempt
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

STEP_SHARES: Final = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
"""Lengths of the steps that are tried, over those scaled by the legs."""
FIRST_PACE: Final = 0.6
SLOWEST_PACE: Final = 0.4


@dataclass(frozen=True)
class Trial:
    """One plan of the walk, and its replay if it was certified."""

    walk: RobotWalk
    attempt: ImitationAttempt
    scenario: Scenario
    result: MotionResult | None
    replay: "Replay | None"
    stages: Stages


@dataclass(frozen=True)
class Imitation:
    """The trial of the longest steps and the fastest pace that pass, and all attempts in order."""

    best: Trial
    attempts: tuple[ImitationAttempt, ...]


Try = Callable[[float, float], Trial]
"""``try(step_share, pace)``."""


def find_pace(
    recorded: RecordedWalk,
    robot: RobotScale,
    name: str,
    progress: ProgressCallback,
    *,
    step_share: float | None = None,
    pace: float | None = None,
) -> Imitation:
    """Search steps and pace of ``recorded`` on ``robot``, or only what is not given.

    Raises ``NotEstimable`` (``imitation-not-certified``) if no steps pass even at the slowest pace; its faults are the
    attempts.
    """
    done: list[ImitationAttempt] = []

    def attempt(step_share: float, pace: float) -> Trial:
        walk = scale_walk(recorded, robot, step_share=step_share)
        label = f"steps of {step_share:.0%} at {pace:.2f} of the scaled pace"
        share = len(done) / (len(done) + 6.0)
        body = walk.scenario(name, pace)
        trial = try_walk(walk, body, pace, lambda _f, text: progress(share, f"{label}: {text}"))
        done.append(trial.attempt)
        return trial

    shares = STEP_SHARES if step_share is None else (step_share,)
    best = search_longest(attempt, shares, (FIRST_PACE, SLOWEST_PACE) if pace is None else (pace,))
    if best is None:
        faults = [Fault(f"steps {a.step_share:.0%}, pace {a.pace:.2f}", a.reason) for a in done]
        raise NotEstimable(
            "imitation-not-certified",
            f"{robot.robot} cannot imitate this walk: down to {done[-1].step_share:.0%} of the scaled steps and "
            f"{done[-1].pace:.0%} of the scaled pace no motion is certified and completed. The last: {done[-1].reason}",
            faults,
        )
    if pace is None:
        best = search_fastest(attempt, best)
    return Imitation(best, tuple(done))


def search_longest(
    attempt: Try, shares: Sequence[float] = STEP_SHARES, paces: Sequence[float] = (FIRST_PACE, SLOWEST_PACE)
) -> Trial | None:
    """The first of ``shares`` that passes at the first pace, else at the next one; None if none do."""
    for pace in paces:
        for share in shares:
            trial = attempt(share, pace)
            if trial.attempt.passed:
                return trial
    return None


def search_fastest(attempt: Try, slow: Trial) -> Trial:
    """The fastest pace that passes with the steps of ``slow``, by bisection up to 1 or a failed ``FIRST_PACE``."""
    share, low = slow.attempt.step_share, round(slow.attempt.pace / PACE_STEP)
    # one above the largest pace to try: 1.0 itself is tried, FIRST_PACE has failed
    high = round(1.0 / PACE_STEP) + 1 if slow.attempt.pace >= FIRST_PACE else round(FIRST_PACE / PACE_STEP)
    best = slow

    def passes_at_pace(steps: int) -> bool:
        nonlocal best
        trial = attempt(share, steps * PACE_STEP)
        if trial.attempt.passed:
            best = trial
        return trial.attempt.passed

    bisect_steps(passes_at_pace, low, high)
    return best


def try_walk(
    walk: RobotWalk, body: dict[str, Any], pace: float, progress: ProgressCallback, change: Change | None = None
) -> Trial:
    """Plan, check and replay one scenario; a failure at any stage is the reason of the attempt.

    ``change`` is that of ``plan_motion``.
    """
    scenario = Scenario.model_validate(body)
    task = PlanMotionTask(scenario=scenario, input=PlanMotionInput(scenario=scenario, replay=True))
    lengths_m = [b.position_m[0] - a.position_m[0] for a, b in zip(walk.footholds, walk.footholds[1:], strict=False)]
    trial = try_motion(task, progress, change=change)
    attempt = ImitationAttempt(
        step_share=walk.step_share,
        pace=round(pace, 4),
        step_length_m=sum(lengths_m) / len(lengths_m),
        speed_m_s=mean_speed_m_s(body["phases"]),
        certified=trial.certified,
        completed=trial.completed,
        reason=trial.reason,
        com_error_max_m=None if trial.replayed is None or not trial.passed else trial.replayed.com_error_max_m,
    )
    return Trial(walk, attempt, scenario, trial.result, trial.replay if trial.passed else None, trial.stages)
