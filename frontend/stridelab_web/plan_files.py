"""The files of a plan that a scene is made of, and what they hold."""

from collections.abc import Mapping
from typing import Final

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.scenarios import Scenario
from stridelab_web.frames import Frames
from stridelab_web.friction_cones import Cone, cones
from stridelab_web.plan_frames import plan_frames, read_motion
from stridelab_web.tables import read_columns

SCENARIO: Final = "scenario.json"
CENTROIDAL: Final = "centroidal.parquet"
MOTION: Final = ("poses.json", "poses.f32", "forces.f32")
"""Only where the whole body was planned."""
REPLAYED: Final = ("replay_poses.f32", "replay_forces.f32")
"""Only where that motion was replayed in physics."""
FOLLOWED: Final = "motion.parquet"
"""How the motion follows the plan."""


def needed(result: JobResult) -> tuple[str, ...]:
    """Names of the files to read."""
    there = {artifact.name for artifact in result.artifacts}
    if not there.issuperset(MOTION):
        return SCENARIO, CENTROIDAL
    return (SCENARIO, CENTROIDAL, *MOTION, *(name for name in (FOLLOWED, *REPLAYED) if name in there))


def read_plan(files: Mapping[str, bytes]) -> tuple[Scenario, Frames]:
    """The scenario that was planned, and the frames of its plan, from the files that were ``needed``."""
    scenario = Scenario.model_validate_json(files[SCENARIO])
    replayed = [files[name] for name in REPLAYED] if REPLAYED[0] in files else []
    motion = read_motion(*(files[name] for name in MOTION), *replayed) if MOTION[0] in files else None
    followed = read_columns(files[FOLLOWED]) if FOLLOWED in files else None
    return scenario, plan_frames(scenario, read_columns(files[CENTROIDAL]), motion, followed)


def read_cones(files: Mapping[str, bytes]) -> tuple[Cone, ...]:
    """The friction cones of the plan, from the same files."""
    return cones(Scenario.model_validate_json(files[SCENARIO]), read_columns(files[CENTROIDAL]))
