"""Endpoints of terrains: read the surfaces of a file, and compose the task of crossing them. Nothing is stored."""

import re
import shutil
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Annotated, Any, Final, get_args

from fastapi import APIRouter, Body, Request

from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.scenarios import ReadTerrain, TerrainCrossing, UpAxis
from stridelab.service.api.dependencies import AppParts
from stridelab.service.api.openapi import failure_responses, form_body
from stridelab.service.api.recordings.multipart import Limits, ReceivedForm, receive_form
from stridelab.service.api.recordings.parse import TERRAIN_FAILURES, run_reader
from stridelab.service.api.recordings.service import spool_folder
from stridelab.service.api.scenarios.validation import compose_crossing_task
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.kinds.registry import READ_TERRAIN

router = APIRouter(prefix="/terrains", tags=["scenarios"], route_class=StrictRoute)

READING_TIMEOUT_S: Final = 60.0
"""Time limit of reading, as of the command line."""
METRES_PER: Final[Mapping[str, float]] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_VALUES: Final[Mapping[str, tuple[str, ...]]] = {"unit": tuple(METRES_PER), "up": get_args(UpAxis)}
_LENGTHS_M: Final[Mapping[str, tuple[float, float]]] = {"cell_m": (0.001, 1.0), "height_range_m": (0.001, 100.0)}
_ENDING: Final = re.compile(r"\.[a-z0-9]{1,10}")
_NUMBER: Final = re.compile(r"\d{1,6}(\.\d{0,12})?|\.\d{1,12}")
_FORM: Final = form_body(
    {
        "file": {
            "type": "string",
            "format": "binary",
            "description": "the terrain; its format is that of the ending of its name",
        },
        "unit": {"type": "string", "enum": [*METRES_PER], "default": "m", "description": "unit of the file's lengths"},
        "up": {
            "type": "string",
            "enum": [*_VALUES["up"]],
            "description": "axis that points up; if omitted, found where the points are clear, else +z, of GLB +y",
        },
        "cell_m": {"type": "number", "description": "edge of a cell of a PNG, in metres; needed for it"},
        "height_range_m": {
            "type": "number",
            "description": "height from black to white of a PNG, in metres; needed for it",
        },
    },
    "file",
)
_FLOOR: Final[Any] = {
    "kind": "box",
    "name": "floor",
    "center_m": [0.5, 0.0, -0.05],
    "size_m": [2.0, 1.2, 0.1],
}
_CROSSING: Final[Any] = {
    "floor": {
        "summary": "A metre ahead on a level floor",
        "value": {"robot": "talos", "terrain": [_FLOOR], "start_m": [0.0, 0.0], "goal_m": [1.0, 0.0]},
    }
}


@router.post(
    "",
    summary="Read a terrain",
    openapi_extra=_FORM,
    responses=failure_responses(
        s413="The file exceeds the size limit (`upload-too-large`).",
        s422="The file cannot be read (`terrain-mesh-unreadable`), nothing in it can be stood on "
        "(`terrain-without-surfaces`), reading it takes too long or too much memory (`parser-timed-out`, "
        "`parser-out-of-memory`), or a field of the form is not valid (`invalid-request`).",
        s507="No disk space is left (`disk-full`).",
    ),
)
async def read_uploaded_terrain(parts: AppParts, request: Request) -> ReadTerrain:
    """Find the surfaces on which feet can stand in the file of a terrain, and the stairs and rails among them.

    Nothing is stored. Send the surfaces with a start and a goal to `POST /terrains/crossing`.
    """
    settings = parts.settings
    limits = Limits(settings.max_upload_mb * 1_000_000, settings.min_free_disk_mb * 1_000_000)
    folder = spool_folder(parts)
    try:
        form = await receive_form(request, folder / "upload", limits)
        task = _task_of_form(form)
        form.path.rename(folder / task["file"])
        outcome = await run_reader(
            parts,
            READ_TERRAIN,
            task,
            folder,
            TERRAIN_FAILURES,
            form.filename,
            READING_TIMEOUT_S,
            parts.terrain_readers,
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return ReadTerrain.model_validate(outcome.value["summary"])  # the child has read a stranger's bytes


def _task_of_form(form: ReceivedForm) -> dict[str, Any]:
    """The task of the child; an empty field counts as not given.

    Raises ``InvalidInput`` (``invalid-request``) naming every unknown or invalid field.
    """
    fields = {name: text.strip() for name, text in form.fields.items() if text.strip()}
    faults = [Fault(name[:60], "unknown field") for name in form.fields if name not in (*_VALUES, *_LENGTHS_M)]
    faults += [
        Fault(name, f"one of {', '.join(allowed)}")
        for name, allowed in _VALUES.items()
        if name in fields and fields[name] not in allowed
    ]
    lengths_m: dict[str, float] = {}
    for name, (least, most) in _LENGTHS_M.items():
        if name in fields:
            length_m = float(fields[name]) if _NUMBER.fullmatch(fields[name]) else 0.0
            if least <= length_m <= most:
                lengths_m[name] = length_m
            else:
                faults.append(Fault(name, f"a number of metres from {least:g} to {most:g}"))
    if faults:
        names = ", ".join(fault.where for fault in faults)
        raise InvalidInput("invalid-request", f"The form is not valid: see {names}.", faults)
    ending = PurePosixPath(form.filename).suffix.lower()  # the rest of the user's name is never used as a path
    return {
        "file": f"uploaded-terrain{ending if _ENDING.fullmatch(ending) else ''}",
        "filename": form.filename,
        "metres_per_unit": METRES_PER[fields.get("unit", "m")],
        "up": fields.get("up"),
        **lengths_m,
    }


@router.post(
    "/crossing",
    summary="Cross a terrain",
    responses=failure_responses(
        s404="No robot with this name (`robot-not-found`).",
        s422="The request is malformed (`invalid-request`), a surface is not valid (`scenario-invalid`), there is no "
        "surface below a foot at the start or the goal (`terrain-without-foothold`, naming it), they are less than "
        "0.3 m apart (`crossing-too-short`), or the robot lacks a sole (`course-without-feet`).",
    ),
)
async def cross_terrain(
    parts: AppParts, body: Annotated[TerrainCrossing, Body(openapi_examples=_CROSSING)]
) -> PlanContactsInput:
    """Compose the task of crossing a terrain: both feet beside each other at the start and at the goal.

    The response is the body of `POST /jobs/plan-contacts`, which places the feet between them. Nothing is stored.
    """
    return await compose_crossing_task(body, parts.validation_limiter, parts.robots)
