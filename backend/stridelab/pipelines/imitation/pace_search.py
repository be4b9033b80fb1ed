"""Search of the longest steps and the fastest pace at which a robot carries out a recorded walk.

A pace passes if the motion is planned, its certificate passes, and its replay in physics is completed. The longest
steps that pass at ``FIRST_PACE`` are taken (at ``SLOWEST_PACE`` if none do); then the pace is bisected.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stridelab.errors import Fault, NotEstimable, StridelabError
from stridelab.pipelines.imitation.recorded_walk import RecordedWalk
from stridelab.pipelines.imitation.robot_walk import RobotScale, RobotWalk, mean_speed_m_s, scale_walk
from stridelab.pipelines.plan_centroidal import Change
from stridelab.pipelines.plan_motion import REPLAY, MotionResult, plan_motion, replay_motion, stage_shares
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
PACE_STEP: Final = 0.05
"""Resolution of the pace."""


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
    while high - low > 1:
        middle = (low + high) // 2
        trial = attempt(share, middle * PACE_STEP)
        if trial.attempt.passed:
            best, low = trial, middle
        else:
            high = middle
    return best


def try_walk(
    walk: RobotWalk, body: dict[str, Any], pace: float, progress: ProgressCallback, change: Change | None = None
) -> Trial:
    """Plan, check and replay one scenario; a failure at any stage is the reason of the attempt.

    ``change`` is that of ``plan_motion``.
    """
    scenario = Scenario.model_validate(body)
    request = PlanMotionInput(scenario=scenario, replay=True)
    stages = Stages(progress, stage_shares(request))
    lengths_m = [b.position_m[0] - a.position_m[0] for a, b in zip(walk.footholds, walk.footholds[1:], strict=False)]
    fields = {
        "step_share": walk.step_share,
        "pace": round(pace, 4),
        "step_length_m": sum(lengths_m) / len(lengths_m),
        "speed_m_s": mean_speed_m_s(body["phases"]),
    }

    def refused(reason: str, result: MotionResult | None, *, certified: bool = False) -> Trial:
        attempt = ImitationAttempt(**fields, certified=certified, completed=False, reason=reason)
        return Trial(walk, attempt, scenario, result, None, stages)

    try:
        result = plan_motion(PlanMotionTask(scenario=scenario, input=request), stages, change)
    except StridelabError as error:
        return refused(error.message, None)
    if result.stopped is not None or result.certificate is None or result.motion is None:
        return refused(f"the whole body cannot follow the plan: {result.stopped}", result)
    failed = [check for check in result.certificate.checks if not check.passed]
    if failed:
        return refused("certificate: " + ", ".join(f"{c.name} {c.value:.4g} {c.unit}".rstrip() for c in failed), result)
    with stages.run_stage(REPLAY, "simulating") as tell:
        replay = replay_motion(result, result.motion, tell)
    replayed = result.summary(replay, stages).replay
    if replayed is None:
        raise AssertionError("a replay has a summary")
    if not replayed.completed:
        reasons = "; ".join(remark.message for remark in replayed.remarks or ())
        return refused(f"replay: {reasons}", result, certified=True)
    passed = ImitationAttempt(
        **fields, certified=True, completed=True, reason="", com_error_max_m=replayed.com_error_max_m
    )
    return Trial(walk, passed, scenario, result, replay, stages)
