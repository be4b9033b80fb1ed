"""``sl.plan_motion`` and ``sl.push_basin``: plans motions of humanoids, and pushes them in physics."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from stridelab.errors import StridelabError
from stridelab.library.job_files import JobFiles, job_folder
from stridelab.library.options import Progress, data_frame, ignore_progress, validate_fields
from stridelab.schemas.plans import PlanMotionInput, PlanMotionSummary, PlanMotionTask
from stridelab.schemas.receding import PushBasinInput, PushBasinSummary, PushBasinTask
from stridelab.schemas.scenarios import Scenario


@dataclass(frozen=True)
class PlannedMotion(JobFiles):
    """A motion of a robot, from ``plan_motion``: the summary of the job and the folder with its files.

    ``failure`` is the reason why the motion is incomplete. ``to_dataframe`` gives the planned centre of mass, momentum
    and forces over time (``centroidal.parquet``).
    """

    table: ClassVar[str] = "centroidal.parquet"

    summary: PlanMotionSummary
    failure: StridelabError | None = None


def plan_motion(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    robot: str | None = None,
    whole_body: bool = True,
    replay: bool | Mapping[str, Any] = False,
    progress: Progress | None = None,
    **options: Any,
) -> PlannedMotion:
    """Plan a multi-contact motion of a humanoid (chapter 4 of the thesis).

    Args:
        scenario: A scenario, its JSON file, or the name of a bundled one such as "long-stride".
        robot: Name of the robot, in place of that of the scenario.
        whole_body: Compute the motion of all joints and its certificate.
        replay: Replay the motion in physics as well, undisturbed or with ``pushes``, ``payload_kg``, ``friction``,
            ``delay_s`` or ``sensors`` (``ReplayOptions``).
        progress: Called with a fraction from 0 to 1 and a message.
        options: Other fields of the job's input, such as ``formulation`` or ``free_durations``.

    Raises:
        InvalidInput: ``scenario-invalid``, ``replay-invalid``; the faults name every field that is wrong.
        NotEstimable: The solver found no motion; the error says at which stage.
    """
    from stridelab.service.kinds.plan_motion import run as job
    from stridelab.service.local_runs import write_result

    given = _scenario_of(scenario)
    if robot is not None:
        given = given.model_copy(update={"robot": robot})
    request = validate_fields(
        PlanMotionInput, {"scenario": given, "whole_body": whole_body, "replay": replay, **options}
    )
    with job_folder() as folder:
        outcome = job.run(PlanMotionTask(scenario=given, input=request), folder, progress or ignore_progress)
        write_result(folder, "plan-motion", request, outcome)
    return PlannedMotion(folder, PlanMotionSummary.model_validate(outcome.summary), outcome.failure)


@dataclass(frozen=True)
class PushedMotion:
    """Pushes of a motion, from ``push_basin``: the summary of the job, and one value per push in every column."""

    summary: PushBasinSummary
    columns: Mapping[str, Any]

    def to_dataframe(self) -> Any:
        """One row per push: time, direction, speed, outcome and its reason (``pushes.csv``).

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither pandas nor polars is installed.
        """
        return data_frame(self.columns)


def push_basin(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    speed_m_s: float,
    n: int = 50,
    seed: int = 0,
    robot: str | None = None,
    progress: Progress | None = None,
) -> PushedMotion:
    """Replay a motion in physics with one push at a time, at random times and in random directions, on all cores.

    Args:
        scenario: A scenario, its JSON file, or the name of a bundled one such as "long-stride".
        speed_m_s: Change of the velocity of the centre of mass by a push.
        n: Number of pushes.
        seed: Determines times and directions; more pushes of a seed begin with the same ones.
        robot: Name of the robot, in place of that of the scenario.
        progress: Called with a fraction from 0 to 1 and a message.

    Raises:
        InvalidInput: ``scenario-invalid``, ``option-invalid``; the faults name every field that is wrong.
        NotEstimable: There is no motion, or the robot falls without a push (``replay-fell``).
    """
    from stridelab.pipelines.replays.push_basin import push_basin as push_motion
    from stridelab.service.kinds.push_basin.run import push_columns

    given = _scenario_of(scenario)
    fields = {"scenario": given, "speed_m_s": speed_m_s, "n": n, "seed": seed, "robot": robot}
    task = PushBasinTask(scenario=given, input=validate_fields(PushBasinInput, fields))
    result = push_motion(task, progress or ignore_progress)
    return PushedMotion(result.summary, push_columns(result.pushes, speed_m_s))


def _scenario_of(scenario: str | Path | Mapping[str, Any] | Scenario) -> Scenario:
    from stridelab.pipelines.scenarios.scenario_files import read_scenario

    return read_scenario(str(scenario)) if isinstance(scenario, str | Path) else validate_fields(Scenario, scenario)
