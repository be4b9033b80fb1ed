"""Start and goal stances of a planned contact sequence, validated like the phases of any scenario.

The check takes a few milliseconds; it runs before a task is accepted and again in the planner.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.validation.parse import Draft, parse_scenario
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput

ENDS = ("start", "goal")


@dataclass(frozen=True, eq=False)
class TaskEnds:
    """Start and goal by effector, and the ``draft`` that has them as its two phases."""

    start: Mapping[str, Placement]
    goal: Mapping[str, Placement]
    draft: Draft


def task_ends(task: Mapping[str, Any], effectors: Mapping[str, EffectorShape]) -> TaskEnds:
    """The ends of ``{robot, terrain, start, goal, friction?, name?}``, fields as in a scenario and its phases.

    Raises ``InvalidInput`` (``stance-invalid``) for an invalid start or goal, naming the end, the effector and the
    fault; all feet must be in contact in both.
    """
    bare, faults = scenario_without_phases(task), []
    for end in ENDS:
        alone = {**bare, "phases": [_end_phase(task, end)]}
        standing = {str(contact.get("effector")) for contact in task[end]["contacts"]}
        faults += [
            Fault(fault.where.replace("phases[0]", end), fault.message)
            for fault in validate_scenario(alone, effectors).faults
        ]
        for foot in sorted(name for name, shape in effectors.items() if shape.kind == "surface"):
            if foot not in standing:
                faults.append(Fault(f"{end}.contacts", f"{foot} must be in contact"))
    if faults:
        unique = tuple(dict.fromkeys(faults))
        more = f" and {len(unique) - 1} more" if len(unique) > 1 else ""
        message = f"The robot cannot stand like this: {unique[0].where}: {unique[0].message}{more}."
        raise InvalidInput("stance-invalid", message, unique)
    draft = parse_scenario({**bare, "phases": [_end_phase(task, end) for end in ENDS]}, effectors)
    return TaskEnds(draft.phases[0].contacts, draft.phases[1].contacts, draft)


def scenario_without_phases(task: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a scenario other than its phases, taken from a task."""
    return {
        "name": task.get("name") or "Planned contacts",
        "description": "Found by the contact planner.",
        "robot": task["robot"],
        "friction": task.get("friction", 0.3),
        "terrain": task["terrain"],
    }


def _end_phase(task: Mapping[str, Any], end: str) -> dict[str, Any]:
    return {"duration_s": 1.0, "contacts": task[end]["contacts"]}
