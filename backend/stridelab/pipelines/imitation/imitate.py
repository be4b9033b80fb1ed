"""A person's recorded walk becomes that of a robot, and both are compared.

Recording -> MeasuredRecording -> RecordedWalk -> RobotWalk -> Scenario -> MotionResult, Replay -> comparison
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.pipelines.gait_measures.recording import MeasuredRecording, measure_recording
from stridelab.pipelines.imitation.comparison import Walker, compare_walks, compared_curves
from stridelab.pipelines.imitation.pace_search import Imitation, Trial, find_pace
from stridelab.pipelines.imitation.person_tracks import person_columns
from stridelab.pipelines.imitation.recorded_walk import RecordedWalk, recorded_walk, rises_of
from stridelab.pipelines.imitation.robot_motion import robot_motion, robot_steps, steady_steps
from stridelab.pipelines.imitation.robot_walk import RobotScale
from stridelab.pipelines.imitation.wheel_trials import judge_wheel
from stridelab.pipelines.plan_motion import MotionResult
from stridelab.pipelines.progress import ProgressCallback
from stridelab.recordings.recording import Remark
from stridelab.robots.loader import load_robot
from stridelab.schemas import base
from stridelab.schemas.imitation.contract import ImitateSummary, ImitateTask, WheelTrial
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.replay import Replay

REFERENCES: Final = ("hof1996", "hof2005")


@dataclass(frozen=True)
class ImitationResult:
    """The measured person, the certified and completed trial, and the curves of both over a step.

    ``person_tracks`` is the table of the person beside the robot (``person_columns``).
    """

    measured: MeasuredRecording
    recorded: RecordedWalk
    best: Trial
    result: MotionResult
    motion: WholeBodyMotion
    replay: Replay
    person: Walker
    robot: Walker
    curves: dict[str, np.ndarray]
    person_tracks: dict[str, np.ndarray]
    summary: ImitateSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the methods used."""
        used = (*REFERENCES, *self.measured.estimate.references, *self.result.citation_keys)
        return tuple(dict.fromkeys(used))


def imitate(task: ImitateTask, folder: Path, progress: ProgressCallback) -> ImitationResult:
    """Let ``task.input.robot`` imitate ``task.recording``, whose file is in ``folder``.

    On stairs, the person's wheel and what depends on the height above a level floor are left out.

    Raises the errors of ``gait-measures`` but ``stairs``, and those of ``recorded_walk``;
    ``NotFound`` (``robot-not-found``, ``reachability-not-learned``), ``InvalidInput`` (``feet-missing``),
    ``NotEstimable`` (``imitation-not-certified``).
    """
    request = task.input
    robot = load_robot(request.robot)
    scale = RobotScale.of_robot(robot)
    progress(0.02, "measuring the walk")
    measured = measure_recording(request.recording_id, task, folder, level=False)
    recorded = recorded_walk(measured)
    name = f"Walk of {measured.filename}"[:80]
    imitation = find_pace(
        recorded,
        scale,
        name,
        lambda share, text: progress(0.08 + 0.72 * share, text),
        step_share=request.step_share,
        pace=request.pace,
    )
    best = imitation.best
    if best.result is None or best.result.motion is None or best.replay is None:
        raise AssertionError("a trial that passes has a motion and a replay")
    progress(0.82, "comparing")
    own = Walker.of_motion(measured.motion, measured.steps, rises_of(recorded.footholds))
    moved = robot_motion(robot, best.replay)
    all_steps = robot_steps(best.result.plan.sequence, best.replay, moved)
    other = Walker.of_motion(moved, steady_steps(all_steps), rises_of(best.walk.footholds))
    trials: tuple[WheelTrial, ...] = ()
    if request.wheel and not own.rises_m:
        trials = judge_wheel(own, best, lambda share, text: progress(0.82 + 0.07 * share, text))
    summary = _summary(task, measured, recorded, scale, imitation, own, other, trials)
    return ImitationResult(
        measured,
        recorded,
        best,
        best.result,
        best.result.motion,
        best.replay,
        own,
        other,
        compared_curves(own, other, best.walk.length_scale),
        person_columns(measured, recorded, best.walk, best.attempt.pace, best.scenario.model_dump()["phases"]),
        summary,
    )


def _summary(
    task: ImitateTask,
    measured: MeasuredRecording,
    recorded: RecordedWalk,
    scale: RobotScale,
    imitation: Imitation,
    person: Walker,
    robot: Walker,
    trials: Sequence[WheelTrial],
) -> ImitateSummary:
    best = imitation.best
    if best.result is None:
        raise AssertionError("a trial that passes has a result")
    plan = best.result.summary(best.replay, best.stages)
    if plan.certificate is None or plan.replay is None:
        raise AssertionError("a trial that passes has a certificate and a replay")
    rows = compare_walks(person, robot, best.walk.length_scale)
    speeds = {row.name: row for row in rows}["walking_speed"]
    remarks = (*measured.prepared.all_remarks, *measured.estimate.remarks, *_remarks(imitation))
    return ImitateSummary(
        scenario=best.scenario,
        certificate=plan.certificate,
        replay=plan.replay,
        comparison=rows,
        robot=task.input.robot,
        filename=measured.filename,
        step_share=best.attempt.step_share,
        pace=best.attempt.pace,
        speed_share=(speeds.robot or 0.0) / (speeds.scaled or np.inf),
        length_scale=best.walk.length_scale,
        time_scale=best.walk.time_scale,
        hip_height_person_m=recorded.hip_height_m,
        hip_height_robot_m=scale.hip_height_m,
        widened_m=best.walk.widened_m,
        recorded_footholds=len(recorded.footholds),
        repeated_footholds=best.walk.repeated,
        attempts=list(imitation.attempts),
        wheel=list(trials),
        plan=plan,
        quality=measured.quality.quality,
        warnings=[base.Remark(code=r.code, message=r.message) for r in dict.fromkeys(remarks)],
    )


def _remarks(imitation: Imitation) -> tuple[Remark, ...]:
    remarks = []
    walk, attempt = imitation.best.walk, imitation.best.attempt
    if any(one.step_share > attempt.step_share for one in imitation.attempts):
        message = f"The steps are {attempt.step_share:.0%} of the person's, scaled: longer ones were not certified."
        remarks.append(Remark("steps-shortened", message))
    if walk.deepened_m > 0.0:
        message = (
            f"Steps from tread to tread are {1e2 * walk.deepened_m:.0f} cm longer than the scaled ones, as the shoes "
            f"need; the stairs rise by {1e2 * walk.rise_m:.1f} cm."
        )
        remarks.append(Remark("treads-deepened", message))
    if walk.repeated:
        message = f"The recording has {len(walk.footholds) - walk.repeated} footholds; its last stride is repeated."
        remarks.append(Remark("stride-repeated", message))
    return tuple(remarks)
