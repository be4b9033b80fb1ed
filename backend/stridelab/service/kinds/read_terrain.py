"""Reads the uploaded file of a terrain, in a killable confined child of ``POST /terrains``."""

from pathlib import Path

from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.scenarios.read_terrain import read_terrain
from stridelab.schemas.base import Contract
from stridelab.schemas.scenarios import UpAxis
from stridelab.service.kinds.base import Outcome


class ReadTerrainTask(Contract):
    """Task of reading: the uploaded file in the folder, its name at the user's, its unit and upward axis.

    ``cell_m`` and ``height_range_m`` are the cells of an image, and its height from black to white.
    """

    file: str
    filename: str
    metres_per_unit: float
    up: UpAxis | None = None
    cell_m: float | None = None
    height_range_m: float | None = None


def run(task: ReadTerrainTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Read the terrain; the summary is a ``ReadTerrain``. Raises as ``read_terrain``, with the user's name of it."""
    progress(0.0, "reading the file")
    try:
        read = read_terrain(folder / task.file, **task.model_dump(exclude={"file", "filename"}))
    except (InvalidInput, UnreadableFile) as error:
        faults = [Fault(fault.where.replace(task.file, task.filename), fault.message) for fault in error.faults]
        raise type(error)(error.code, error.message.replace(task.file, task.filename), faults) from error
    return Outcome(read.model_dump(mode="json", exclude_none=True), (), ())
