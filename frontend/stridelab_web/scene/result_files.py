"""The files of results that scenes are built from: plans, centres of mass, and rolling wheels."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.recordings import Recording
from stridelab.schemas.scenarios import Scenario
from stridelab_web.pages.results.com_plots import COM_TABLE
from stridelab_web.pages.results.cycloid import WHEEL_TABLE
from stridelab_web.parquet import Columns, read_columns, read_texts
from stridelab_web.scene.frames import Frames
from stridelab_web.scene.plan_frames import Cone, friction_cones, plan_frames, read_motion
from stridelab_web.scene.recording_frames import build_frames
from stridelab_web.scene.second_walk import add_second_walk, align_at_strike, next_recording

SCENARIO: Final = "scenario.json"
CENTROIDAL: Final = "centroidal.parquet"
MOTION: Final = ("poses.json", "poses.f32", "forces.f32")
"""Files of plans of the whole body."""
REPLAYED: Final = ("replay_poses.f32", "replay_forces.f32")
"""Files of plans that were replayed in physics."""
FOLLOWED: Final = "motion.parquet"
"""Table of the whole-body motion that follows the plan."""
PERSON: Final = "person.parquet"
"""Table of the person whose walk the robot imitates, on the clock of the plan."""


def needed_files(result: JobResult) -> tuple[str, ...]:
    """Names of the files that ``read_plan`` needs."""
    present = {artifact.name for artifact in result.artifacts}
    if not present.issuperset(MOTION):
        return SCENARIO, CENTROIDAL
    return (SCENARIO, CENTROIDAL, *MOTION, *(name for name in (FOLLOWED, PERSON, *REPLAYED) if name in present))


def read_plan(files: Mapping[str, bytes]) -> tuple[Scenario, Frames]:
    """The planned scenario and the frames of its plan, from its files."""
    scenario = Scenario.model_validate_json(files[SCENARIO])
    replayed = [files[name] for name in REPLAYED] if REPLAYED[0] in files else []
    motion = read_motion(*(files[name] for name in MOTION), *replayed) if MOTION[0] in files else None
    followed = read_columns(files[FOLLOWED]) if FOLLOWED in files else None
    person = read_columns(files[PERSON]) if PERSON in files else None
    return scenario, plan_frames(scenario, read_columns(files[CENTROIDAL]), motion, followed, person)


def read_cones(files: Mapping[str, bytes]) -> tuple[Cone, ...]:
    """The friction cones of the plan, from the same files."""
    return friction_cones(Scenario.model_validate_json(files[SCENARIO]), read_columns(files[CENTROIDAL]))


STABILITY_TABLE: Final = "stability.parquet"
SCENE_TABLES: Final = frozenset({COM_TABLE, WHEEL_TABLE, STABILITY_TABLE})


def shown_in_scene(present: Iterable[str]) -> list[str]:
    """The files among ``present`` that a scene reads, in a fixed order."""
    return sorted(SCENE_TABLES & set(present))


def frames_of(
    recording: Recording,
    tracks: bytes,
    shown: Mapping[str, bytes],
    second: tuple[Recording, bytes] | None = None,
) -> Frames:
    """The frames of a recording with the files of a result that ``shown_in_scene`` names.

    ``second`` is another recording of the result and its tracks, shown over the first (``second_walk``).
    """
    tables = {name: read_columns(content) for name, content in shown.items()}
    stability = _rows_of(recording, shown, tables)
    frames = build_frames(recording, read_columns(tracks), tables.get(COM_TABLE), tables.get(WHEEL_TABLE), stability)
    if second is None or stability is None:
        return frames
    other, other_tracks = second
    other_stability = _rows_of(other, shown, tables)
    alignment = None if other_stability is None else align_at_strike(stability, other_stability)
    if alignment is None:
        return frames
    return add_second_walk(
        frames, build_frames(other, read_columns(other_tracks), None, None, other_stability), alignment
    )


def second_recording(present: Iterable[str], summary: Mapping[str, Any], recording_id: str) -> str | None:
    """The recording of a result with these files and summary that is shown over ``recording_id``; None without one."""
    if STABILITY_TABLE not in present:
        return None
    return next_recording([trial["recording_id"] for trial in summary.get("trials", ())], recording_id)


def _rows_of(recording: Recording, shown: Mapping[str, bytes], tables: Mapping[str, Columns]) -> Columns | None:
    """The rows of the table of stability that are of a recording; None if there are none."""
    if STABILITY_TABLE not in shown:
        return None
    own = np.array(read_texts(shown[STABILITY_TABLE])["recording_id"]) == recording.id
    return {name: values[own] for name, values in tables[STABILITY_TABLE].items()} if own.any() else None
