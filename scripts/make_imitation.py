"""Does the rolling wheel of a person help a robot? Plans of imitated walks with the wheel, without, and with controls.

make_imitation.py ROBOT RECORDING ...    one JSON object per recording, to the standard output

For every recording: the imitation without reference (longest steps, fastest pace); at its steps and pace the wheel with
s = +1 and s = -1, and as controls both half a turn late (highest where the person's is lowest); then the fastest pace
of the same steps with each wheel. docs/theory/imitation.md has the results.
"""

import json
import sys
from dataclasses import replace

from stridelab.library.recordings import load_recording, staged_sources
from stridelab.pipelines.gait_measures.recording import measure_recording
from stridelab.pipelines.imitation.comparison import Walker
from stridelab.pipelines.imitation.pace_search import Trial, find_pace, search_fastest, try_walk
from stridelab.pipelines.imitation.recorded_walk import recorded_walk
from stridelab.pipelines.imitation.robot_walk import RobotScale, scale_walk
from stridelab.pipelines.imitation.wheel_reference import BRANCHES, RollingWheel, rolling_wheel
from stridelab.pipelines.imitation.wheel_trials import trial_of
from stridelab.robots.loader import load_robot
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask


def ignore(_fraction: float, _message: str) -> None:
    """No progress."""


def study(path: str, robot_name: str) -> dict[str, object]:
    """All plans of one recording."""
    loaded = load_recording(path, {})
    with staged_sources(loaded) as (folder, source, static):
        task = EstimateComTask(recording=source, static=static, input=EstimateComInput(recording_id="r"))
        measured = measure_recording("r", task, folder)
    recorded, scale = recorded_walk(measured), RobotScale.of_robot(load_robot(robot_name))
    person = Walker.of_motion(measured.motion, measured.steps)
    best = find_pace(recorded, scale, "Walk", ignore).best
    walk, attempt = best.walk, best.attempt
    result: dict[str, object] = {
        "file": loaded.path.name,
        "robot": robot_name,
        "step_share": attempt.step_share,
        "pace": attempt.pace,
        "none": trial_of(best, None).model_dump(),
    }
    for branch in BRANCHES:
        wheel = rolling_wheel(person.fits, branch)
        for name, used in ((f"s{branch:+d}", wheel), (f"s{branch:+d} late", half_a_turn_late(wheel))):
            body = best.scenario.model_dump(mode="json")
            trial = try_walk(walk, body, attempt.pace, ignore, used.change)
            result[name] = trial_of(trial, used).model_dump()

        def attempt_with(share: float, pace: float, wheel: RollingWheel = wheel) -> Trial:
            one = scale_walk(recorded, scale, step_share=share)
            return try_walk(one, one.scenario("Walk", pace), pace, ignore, wheel.change)

        slow = attempt_with(attempt.step_share, 0.6 if attempt.pace >= 0.6 else 0.4)
        result[f"pace s{branch:+d}"] = search_fastest(attempt_with, slow).attempt.pace if slow.attempt.passed else None
    return result


def half_a_turn_late(wheel: RollingWheel) -> RollingWheel:
    """The control: the same amplitude and period, against the phase of the person."""
    return replace(wheel, lowest_share=(wheel.lowest_share + 0.5) % 1.0)


if __name__ == "__main__":
    for recording in sys.argv[2:]:
        sys.stdout.write(json.dumps(study(recording, sys.argv[1])) + "\n")
        sys.stdout.flush()
