"""Trials of motions, and the search of the fastest pace at which one passes.

A trial passes if the motion is planned, its certificate passes and, where the input has one, its replay in physics is
completed. At pace ``p`` every phase lasts its duration in the scenario over ``p``.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from stridelab.contacts.validation.parse import DURATION_S
from stridelab.errors import Fault, InvalidInput, NotEstimable, StridelabError
from stridelab.pipelines.plan_centroidal import Change
from stridelab.pipelines.plan_motion import (
    IGNORED,
    REPLAY,
    MotionResult,
    PlanWatcher,
    plan_motion,
    replay_motion,
    stage_shares,
)
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.schemas.plans import PaceAttempt, PaceSearch, PlanMotionTask, ReplaySummary
from stridelab.schemas.scenarios import Scenario

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

PACE_STEP: Final = 0.05
"""Resolution of the pace."""
SLOWER_PACES: Final = (0.7, 0.5, 0.3)
"""Tried in this order if the given durations do not pass."""
FASTEST_PACE: Final = 3.0
SEARCH_S: Final = 300.0
"""Time after which the search tries no further pace if one has passed; a job ends after ten minutes."""


@dataclass(frozen=True)
class MotionTrial:
    """A motion planned, certified and replayed, as far as it goes; ``reasons`` says why it does not pass."""

    task: PlanMotionTask
    stages: Stages
    result: MotionResult | None = None
    replay: "Replay | None" = None
    replayed: ReplaySummary | None = None
    reasons: tuple[str, ...] = ()

    @property
    def certified(self) -> bool:
        """Whether the certificate passes."""
        return self.result is not None and self.result.certificate is not None and self.result.certificate.passed

    @property
    def completed(self) -> bool:
        """Whether the replay is completed."""
        return self.replayed is not None and self.replayed.completed

    @property
    def passed(self) -> bool:
        """Whether the motion passes certificate and, if the input has one, replay."""
        return self.certified and (self.completed or not self.task.input.replay)

    @property
    def reason(self) -> str:
        """Why the motion does not pass; empty if it does."""
        return "; ".join(self.reasons)


def try_motion(
    task: PlanMotionTask,
    progress: ProgressCallback,
    *,
    change: Change | None = None,
    replay_uncertified: bool = False,
    resumes: bool = True,
    watcher: PlanWatcher = IGNORED,
) -> MotionTrial:
    """Plan and certify a motion and, if it is certified or ``replay_uncertified``, replay it as requested.

    Errors of the stages become the reason of the trial. ``change`` and ``watcher`` are those of ``plan_motion``,
    ``resumes`` is that of ``replay_motion``.
    """
    stages = Stages(progress, stage_shares(task.input))
    try:
        result = plan_motion(task, stages, change, watcher)
    except StridelabError as error:
        return MotionTrial(task, stages, reasons=(error.message,))
    motion, certificate = result.motion, result.certificate
    if result.stopped is not None or motion is None or certificate is None:
        return MotionTrial(task, stages, result, reasons=(str(result.stopped),))
    failed = [check for check in certificate.checks if not check.passed]
    reasons = tuple(f"certificate: {check.name} {check.value:.4g} {check.unit}".rstrip() for check in failed)
    if not task.input.replay or (reasons and not replay_uncertified):
        return MotionTrial(task, stages, result, reasons=reasons)
    try:
        with stages.run_stage(REPLAY, "simulating") as tell:
            replay = replay_motion(task.input, result.robot, motion, tell, watcher, resumes=resumes)
    except InvalidInput as error:
        return MotionTrial(task, stages, result, reasons=(*reasons, error.message))
    replayed = result.summary(replay, stages).replay
    if replayed is None:
        raise AssertionError("a replay has a summary")
    if not replayed.completed:
        reasons += tuple(f"replay: {remark.message}" for remark in replayed.remarks or ())
    return MotionTrial(task, stages, result, replay, replayed, reasons)


def at_pace(scenario: Scenario, pace: float) -> Scenario:
    """The scenario with all durations over ``pace``."""
    phases = [phase.model_copy(update={"duration_s": phase.duration_s / pace}) for phase in scenario.phases]
    return scenario.model_copy(update={"phases": phases})


def bisect_steps(passes: Callable[[int], bool], low: int, high: int) -> int:
    """The largest number from ``low``, which passes, to below ``high``, if all numbers up to it pass and no others."""
    while high - low > 1:
        middle = (low + high) // 2
        if passes(middle):
            low = middle
        else:
            high = middle
    return low


def find_fastest_pace(
    task: PlanMotionTask, progress: ProgressCallback, attempt: Callable[..., MotionTrial] = try_motion
) -> tuple[MotionTrial, PaceSearch]:
    """The trial of the fastest pace that passes, to ``PACE_STEP``, and the search.

    The given durations are tried first, then slower ones until one passes, then the pace is bisected up to
    ``FASTEST_PACE``, within the durations that phases may have. Raises ``NotEstimable`` (``no-pace-passes``), whose
    faults are the attempts.
    """
    durations_s = [phase.duration_s for phase in task.scenario.phases]
    given_s, began = math.fsum(durations_s), time.monotonic()
    slowest = math.ceil(max(durations_s, default=0.0) / DURATION_S[1] / PACE_STEP - 1e-9)
    highest = math.floor(min(FASTEST_PACE, min(durations_s, default=1.0) / DURATION_S[0]) / PACE_STEP + 1e-9)
    attempts: list[PaceAttempt] = []
    best: MotionTrial | None = None
    finished = True

    def passes_at_pace(steps: int) -> bool:
        nonlocal best, finished
        if best is not None and time.monotonic() - began > SEARCH_S:
            finished = False
            return False
        pace = round(steps * PACE_STEP, 4)
        share = len(attempts) / (len(attempts) + 5.0)
        timed = task.model_copy(update={"scenario": at_pace(task.scenario, pace)})
        trial = attempt(timed, lambda _fraction, text: progress(share, f"pace {pace:g}: {text}"))
        completed = trial.completed if task.input.replay and trial.certified else None
        attempts.append(
            PaceAttempt(
                pace=pace,
                duration_s=round(given_s / pace, 3),
                certified=trial.certified,
                completed=completed,
                reason=trial.reason,
            )
        )
        if trial.passed:
            best = trial
        return trial.passed

    first_failed = highest + 1
    for steps in (round(pace / PACE_STEP) for pace in (1.0, *SLOWER_PACES)):
        if not slowest <= steps <= highest:
            continue
        if passes_at_pace(steps):
            bisect_steps(passes_at_pace, steps, first_failed)
            break
        first_failed = steps
    if best is None:
        faults = [Fault(f"pace {one.pace:g}", one.reason) for one in attempts]
        raise NotEstimable("no-pace-passes", f"The motion passes at no pace. The last: {attempts[-1].reason}", faults)
    pace = max(one.pace for one in attempts if not one.reason)
    return best, PaceSearch(pace=pace, given_duration_s=round(given_s, 3), attempts=attempts, finished=finished)
