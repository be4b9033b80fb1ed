"""Where a planned contact sequence begins and ends: two stances, judged like the phases of any scenario.

Some milliseconds of numpy: asked before a task is accepted, and by the planner itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.validation.parse import Draft, read
from stridelab.contacts.validation.validate import check
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput

ENDS = ("start", "goal")


@dataclass(frozen=True, eq=False)
class TaskEnds:
    """Both stances, by effector, and the ``draft`` whose two phases they are."""

    start: Mapping[str, Placement]
    goal: Mapping[str, Placement]
    draft: Draft


def task_ends(task: Mapping[str, Any], effectors: Mapping[str, EffectorShape]) -> TaskEnds:
    """The ends of ``{robot, terrain, start, goal, friction?, name?}``, fields as in a scenario and its phases.

    Raises ``InvalidInput`` (``stance-invalid``) where start or goal cannot be, naming the end, the effector and what
    is wrong: both are judged, and all feet must stand in both.
    """
    bare, faults = surroundings(task), []
    for end in ENDS:
        alone = {**bare, "phases": [_phase(task, end)]}
        standing = {str(contact.get("effector")) for contact in task[end]["contacts"]}
        faults += [
            Fault(fault.where.replace("phases[0]", end), fault.message) for fault in check(alone, effectors).faults
        ]
        for foot in sorted(name for name, shape in effectors.items() if shape.kind == "surface"):
            if foot not in standing:
                faults.append(Fault(f"{end}.contacts", f"{foot} must stand there"))
    if faults:
        unique = tuple(dict.fromkeys(faults))
        more = f" and {len(unique) - 1} more" if len(unique) > 1 else ""
        message = f"The robot cannot stand like this: {unique[0].where}: {unique[0].message}{more}."
        raise InvalidInput("stance-invalid", message, unique)
    draft = read({**bare, "phases": [_phase(task, end) for end in ENDS]}, effectors)
    return TaskEnds(draft.phases[0].contacts, draft.phases[1].contacts, draft)


def surroundings(task: Mapping[str, Any]) -> dict[str, Any]:
    """What a task and its scenario share."""
    return {
        "name": task.get("name") or "Planned contacts",
        "description": "Found by the contact planner.",
        "robot": task["robot"],
        "friction": task.get("friction", 0.3),
        "terrain": task["terrain"],
    }


def _phase(task: Mapping[str, Any], end: str) -> dict[str, Any]:
    return {"duration_s": 1.0, "contacts": task[end]["contacts"]}
