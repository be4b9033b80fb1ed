"""The files of a plan that a scene is made of, and what they hold.

Which files of a result a scene shows: the centre of mass, and the wheel that rolls along with it.
"""

from collections.abc import Iterable, Mapping
from typing import Final

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.recordings import Recording
from stridelab.schemas.scenarios import Scenario
from stridelab_web.pages.results.com_plots import COM_TABLE
from stridelab_web.pages.results.cycloid_charts import WHEEL_TABLE
from stridelab_web.parquet import read_columns
from stridelab_web.scene.frames import Frames
from stridelab_web.scene.plan_frames import Cone, cones, plan_frames, read_motion
from stridelab_web.scene.recording_frames import build_frames

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


SCENE_TABLES: Final = frozenset({COM_TABLE, WHEEL_TABLE})


def shown_in_scene(present: Iterable[str]) -> list[str]:
    """Those of the files ``present`` that a scene reads, in a fixed order."""
    return sorted(SCENE_TABLES & set(present))


def frames_of(recording: Recording, tracks: bytes, shown: Mapping[str, bytes]) -> Frames:
    """The frames of a recording with the files of a result that ``shown_in_scene`` names."""
    tables = {name: read_columns(content) for name, content in shown.items()}
    return build_frames(recording, read_columns(tracks), tables.get(COM_TABLE), tables.get(WHEEL_TABLE))
