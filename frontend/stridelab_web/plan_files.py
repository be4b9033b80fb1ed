"""The files of a plan that a scene is made of, and what they hold."""

from collections.abc import Mapping
from typing import Final

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.scenarios import Scenario
from stridelab_web.frames import Frames
from stridelab_web.plan_frames import plan_frames, read_motion
from stridelab_web.tables import read_columns

SCENARIO: Final = "scenario.json"
CENTROIDAL: Final = "centroidal.parquet"
MOTION: Final = ("poses.json", "poses.f32", "forces.f32")
"""Only where the whole body was planned."""


def needed(result: JobResult) -> tuple[str, ...]:
    """Names of the files to read."""
    there = {artifact.name for artifact in result.artifacts}
    return (SCENARIO, CENTROIDAL, *(MOTION if there.issuperset(MOTION) else ()))


def read_plan(files: Mapping[str, bytes]) -> tuple[Scenario, Frames]:
    """The scenario that was planned, and the frames of its plan, from the files that were ``needed``."""
    scenario = Scenario.model_validate_json(files[SCENARIO])
    motion = read_motion(*(files[name] for name in MOTION)) if MOTION[0] in files else None
    return scenario, plan_frames(scenario, read_columns(files[CENTROIDAL]), motion)
