"""Which files of a result a scene shows: the centre of mass, and the wheel that rolls along with it."""

from collections.abc import Iterable, Mapping
from typing import Final

from stridelab.schemas.recordings import Recording
from stridelab_web.com_plots import COM_TABLE
from stridelab_web.frames import Frames
from stridelab_web.recording_frames import build_frames
from stridelab_web.tables import read_columns
from stridelab_web.wheel_charts import WHEEL_TABLE

SCENE_TABLES: Final = frozenset({COM_TABLE, WHEEL_TABLE})


def shown_in_scene(present: Iterable[str]) -> list[str]:
    """Those of the files ``present`` that a scene reads, in a fixed order."""
    return sorted(SCENE_TABLES & set(present))


def frames_of(recording: Recording, tracks: bytes, shown: Mapping[str, bytes]) -> Frames:
    """The frames of a recording with the files of a result that ``shown_in_scene`` names."""
    tables = {name: read_columns(content) for name, content in shown.items()}
    return build_frames(recording, read_columns(tracks), tables.get(COM_TABLE), tables.get(WHEEL_TABLE))
