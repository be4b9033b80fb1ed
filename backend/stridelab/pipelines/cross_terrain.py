"""From a terrain and two places on it to the task of crossing it, which the contact planner takes."""

from collections.abc import Mapping
from typing import Any, Final

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.terrain import Box
from stridelab.contacts.terrain_meshes.crossing import crossing_task
from stridelab.contacts.validation.parse import parse_scenario
from stridelab.errors import InvalidInput
from stridelab.schemas.crossings import TerrainCrossing
from stridelab.schemas.plans import PlanContactsInput

LEAST_UP: Final = 0.5
"""Smallest vertical part of the normal of an upper face on which a foot may be placed: 60 degrees."""


def compose_crossing(request: TerrainCrossing, effectors: Mapping[str, EffectorShape]) -> PlanContactsInput:
    """Compose the body of ``POST /jobs/plan-contacts``; rails and walls stay in the terrain.

    Raises ``InvalidInput``: ``scenario-invalid`` naming surface and field, ``crossing-too-short``,
    ``terrain-without-foothold`` naming the end and the foot, and ``course-without-feet``.
    """
    head = {"robot": request.robot, "friction": request.friction, "name": request.name}
    surfaces = [surface.model_dump(mode="json", exclude_none=True) for surface in request.terrain]
    draft = parse_scenario({**head, "terrain": surfaces, "phases": []}, effectors)
    faults = [fault for fault in draft.faults if fault.where.startswith(("terrain", "friction"))]
    if faults:
        first = faults[0]
        text = f"The terrain cannot be crossed: {first.where}: {first.message}."
        raise InvalidInput("scenario-invalid", text, faults)
    floors = [_plain_box(box) for box in draft.terrain.boxes if box.placement.rotation[2, 2] > LEAST_UP]
    task = crossing_task(floors, request.start_m, request.goal_m, effectors)
    return PlanContactsInput.model_validate({**head, **task, "terrain": surfaces})


def _plain_box(box: Box) -> dict[str, Any]:
    return {
        "kind": "box",
        "name": box.name,
        "center_m": box.placement.position_m.tolist(),
        "size_m": box.size_m.tolist(),
        "orientation_wxyz": box.placement.wxyz.tolist(),
    }
