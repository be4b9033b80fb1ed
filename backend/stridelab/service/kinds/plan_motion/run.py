"""``plan-motion``: plans, certifies and replays a whole-body motion for a scenario (chapter 4).

    Scenario -> MotionResult -> Replay -> artifacts

All stages but the last write what they have computed as parts (``partial_plan``), which a page shows at once. The files
of the motion are written in a second process beside its certificate and its replay. A search of the fastest pace does
neither, as it computes many motions.
"""

import contextlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

from stridelab.machine.parallel import compute_beside
from stridelab.pipelines.motion_trial import find_fastest_pace
from stridelab.pipelines.plan_motion import EXPORT, REPLAY, plan_motion, replay_motion, stage_shares
from stridelab.pipelines.plan_problem import with_planned_durations
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.partial_results import PartialWriter
from stridelab.service.kinds.plan_motion.files import (
    write_json,
    write_mcap,
    write_motion,
    write_motion_film,
    write_plan,
    write_replay,
)
from stridelab.service.kinds.plan_motion.partial_plan import PartialPlanWriter
from stridelab.service.kinds.plan_motion.video import require_film
from stridelab.wholebody.motion import WholeBodyMotion


class _JobWatcher(PartialPlanWriter):
    """Writes the parts, and begins with the files of the motion when it is complete; ``wait_for_files`` ends them."""

    def __init__(self, folder: Path, processes: contextlib.ExitStack) -> None:
        super().__init__(PartialWriter(folder))
        self._folder, self._processes = folder, processes
        self.wait_for_files: Callable[[], tuple[ArtifactFile, ...]] | None = None

    def on_motion(self, robot: Robot, motion: WholeBodyMotion) -> None:
        """Begin to write the files of ``motion``."""
        write = partial(write_motion, self._folder, robot, motion)
        self.wait_for_files = self._processes.enter_context(compute_beside(write))


def run(task: PlanMotionTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Plan the motion of ``task.scenario`` into ``folder``; the summary is a ``PlanMotionSummary``.

    Raises as ``stridelab.pipelines.plan_motion.plan_motion`` does. A whole-body controller that cannot follow the plan
    is the outcome's ``failure`` (``whole-body-failed``), with the plan and the motion until then.
    """
    require_film(task.input.film)
    with contextlib.ExitStack() as processes:
        return _run_beside(task, folder, progress, _JobWatcher(folder, processes))


def _run_beside(task: PlanMotionTask, folder: Path, progress: ProgressCallback, watcher: _JobWatcher) -> Outcome:
    request = task.input
    pace = None
    if request.fastest:
        trial, pace = find_fastest_pace(task, progress)
        task, stages, result, replay = trial.task, trial.stages, trial.result, trial.replay
        if result is None:
            raise AssertionError("a trial that passes has a result")
    else:
        stages = Stages(progress, stage_shares(request))
        result, replay = plan_motion(task, stages, watcher=watcher), None
        if request.replay and result.certificate is not None and result.motion is not None:
            with stages.run_stage(REPLAY, f"0.0 of {result.plan.sequence.duration_s:.1f} s") as tell:
                replay = replay_motion(result, result.motion, tell, watcher)
                watcher.flush_replay()
    motion, certificate, stopped = result.motion, result.certificate, result.stopped
    artifacts: list[ArtifactFile] = []
    with stages.run_stage(EXPORT, "writing the plan") as tell:
        if certificate is not None:
            artifacts.append(write_json(folder, "certificate.json", certificate))
        scenario = with_planned_durations(task.scenario, result.plan.sequence)
        artifacts += [*write_plan(folder, result.plan), write_json(folder, "scenario.json", scenario)]
        if motion is not None:
            tell(0.2, "writing the motion")
            wait = watcher.wait_for_files
            artifacts += write_motion(folder, result.robot, motion) if wait is None else wait()
            if request.film is not None:
                artifacts.append(write_motion_film(folder, result.robot, motion, request.film, tell))
            if replay is not None:
                artifacts += write_replay(folder, result.robot, motion, replay)
            if request.mcap:
                artifacts.append(write_mcap(folder, result.robot, motion, replay))
    summary = result.summary(replay, stages).model_copy(update={"pace": pace}).model_dump(mode="json")
    progress(1.0, "done" if stopped is None else f"stopped at {stopped.time_s:.2f} s")
    return Outcome(summary, result.citation_keys, tuple(artifacts), stopped)
