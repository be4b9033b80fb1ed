"""``plan-motion``: plans, certifies and replays a whole-body motion for a scenario (chapter 4).

    Scenario -> MotionResult -> Replay -> artifacts

All stages but the last write what they have computed as parts (``partial_plan``), which a page shows at once. The
replay runs in a second process beside the body and its certificate (``replay_beside``), and the files of the motion are
written in another. A search of the fastest pace does none of these, as it computes many motions. A body that stops ends
its replay; a motion whose certificate fails is replayed.
"""

import contextlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.machine.parallel import compute_beside
from stridelab.pipelines.motion_trial import find_fastest_pace
from stridelab.pipelines.plan_motion import EXPORT, REPLAY, plan_motion, replay_motion, stage_shares
from stridelab.pipelines.plan_problem import with_planned_durations
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import CertificateSummary, PlanMotionInput, PlanMotionTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.partial_results import PartialWriter
from stridelab.service.kinds.plan_motion.display_tracks import describe_replay_tracks
from stridelab.service.kinds.plan_motion.files import (
    write_json,
    write_mcap,
    write_motion,
    write_motion_film,
    write_plan,
    write_replay,
)
from stridelab.service.kinds.plan_motion.partial_plan import PartialPlanWriter
from stridelab.service.kinds.plan_motion.replay_beside import BEGINS_AFTER_S, ReplayBeside
from stridelab.service.kinds.plan_motion.video import require_film
from stridelab.wholebody.momentum_consistency import needs_replanning
from stridelab.wholebody.motion import WholeBodyMotion, shared_zeros


class _JobWatcher(PartialPlanWriter):
    """Writes the parts, and begins in other processes with the replay and with the files of the motion.

    A replay begins while the motion is computed, or after it if another pass is likely to replace it. The files begin
    after the certificate where the second core is used by a replay, and otherwise beside it.
    """

    def __init__(self, request: PlanMotionInput, folder: Path, processes: contextlib.ExitStack) -> None:
        super().__init__(PartialWriter(folder))
        self._request, self._folder, self._processes = request, folder, processes
        self._can_replay = bool(request.replay) and ReplayBeside.is_possible()
        self._pass: tuple[Robot, WholeBodyMotion] | None = None
        self._solved = 0
        self._begins_early = False
        self.replay_beside: ReplayBeside | None = None
        self.wait_for_files: Callable[[], tuple[ArtifactFile, ...]] | None = None
        processes.callback(self._end_replay)

    def allocate_zeros(self, shape: tuple[int, ...]) -> np.ndarray:
        """Zeros in memory that a replay can share."""
        return shared_zeros(shape) if self._can_replay else super().allocate_zeros(shape)

    def on_pass(self, robot: Robot, motion: WholeBodyMotion) -> None:
        """End the replay of the pass before."""
        super().on_pass(robot, motion)
        self._end_replay()
        self._pass, self._solved = (robot, motion), 0
        self._begins_early = self._can_replay and not needs_replanning(motion.sequence)

    def on_samples(self, time_s: Series, q: Float[np.ndarray, "k nq"]) -> None:
        """Tell the replay how many samples there are, or begin with it when there are enough."""
        super().on_samples(time_s, q)
        self._solved += len(time_s)
        if self.replay_beside is not None:
            self.replay_beside.send_samples(self._solved)
        elif self._pass is not None and self._begins_early:
            robot, motion = self._pass
            if self._solved >= BEGINS_AFTER_S * motion.rate_hz:
                self._begin_replay(robot, motion, self._solved)

    def on_motion(self, robot: Robot, motion: WholeBodyMotion) -> None:
        """Begin with the replay, unless that of this motion has begun, or with the files."""
        if self._pass is not None and not np.may_share_memory(motion.q, self._pass[1].q):
            self._end_replay()  # the motion of an earlier pass is better than the last one
        if self.replay_beside is None:
            self._begin_replay(robot, motion, len(motion.time_s))
        self._pass = robot, motion
        if self.replay_beside is None:
            self._begin_files(robot, motion)

    def on_certificate(self, certificate: CertificateSummary) -> None:
        """Write whether all checks passed, let the replay write its parts, and begin with the files."""
        super().on_certificate(certificate)
        if self.replay_beside is not None and self._pass is not None:
            self.replay_beside.show_parts(self._writer.next_number)
            self._begin_files(*self._pass)

    def _begin_replay(self, robot: Robot, motion: WholeBodyMotion, arrived: int) -> None:
        if self._can_replay and ReplayBeside.is_possible():
            self.replay_beside = ReplayBeside(self._request, robot, motion, arrived, self._folder)

    def _begin_files(self, robot: Robot, motion: WholeBodyMotion) -> None:
        write = partial(write_motion, self._folder, robot, motion)
        self.wait_for_files = self._processes.enter_context(compute_beside(write))

    def _end_replay(self) -> None:
        if self.replay_beside is not None:
            self.replay_beside.end_process()
        self.replay_beside = None


def run(task: PlanMotionTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Plan the motion of ``task.scenario`` into ``folder``; the summary is a ``PlanMotionSummary``.

    Raises as ``stridelab.pipelines.plan_motion.plan_motion`` does. A whole-body controller that cannot follow the plan
    is the outcome's ``failure`` (``whole-body-failed``), with the plan and the motion until then.
    """
    require_film(task.input.film)
    with contextlib.ExitStack() as processes:
        return _run_beside(task, folder, progress, _JobWatcher(task.input, folder, processes))


def _run_beside(task: PlanMotionTask, folder: Path, progress: ProgressCallback, watcher: _JobWatcher) -> Outcome:
    request = task.input
    pace = None
    replay_files: tuple[ArtifactFile, ...] = ()
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
                if watcher.replay_beside is not None:
                    replay, replay_files = watcher.replay_beside.wait_for_replay(tell)
                else:
                    replay = replay_motion(request, result.robot, result.motion, tell, watcher)
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
            if replay_files:
                describe_replay_tracks(folder)
                artifacts += replay_files
            elif replay is not None:
                artifacts += write_replay(folder, result.robot, motion, replay)
            if request.mcap:
                artifacts.append(write_mcap(folder, result.robot, motion, replay))
    summary = result.summary(replay, stages).model_copy(update={"pace": pace}).model_dump(mode="json")
    progress(1.0, "done" if stopped is None else f"stopped at {stopped.time_s:.2f} s")
    return Outcome(summary, result.citation_keys, tuple(artifacts), stopped)
