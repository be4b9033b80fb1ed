"""From a course to the task of the contact planner: terrain, start and goal."""

from collections.abc import Mapping
from typing import Any, Final

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.scenarios.course import Bar, Course, Element, Flight, Gap, Level, Ramp, Stones
from stridelab.schemas.courses import Course as CourseInput
from stridelab.schemas.plans import PlanContactsInput

ELEMENTS: Final[Mapping[str, type[Any]]] = {
    "level": Level,
    "stairs": Flight,
    "ramp": Ramp,
    "stones": Stones,
    "bar": Bar,
    "gap": Gap,
}
"""Element of a course by the ``kind`` of its schema; the fields have the same names."""


def compose_course(request: CourseInput, effectors: Mapping[str, EffectorShape]) -> PlanContactsInput:
    """Compose the body of ``POST /jobs/plan-contacts``.

    Raises ``InvalidInput`` (``course-too-long``, ``course-without-hand``, ``course-without-feet``).
    """
    elements: list[Element] = [ELEMENTS[e.kind](**e.model_dump(exclude={"kind"})) for e in request.elements]
    sides = tuple(dict.fromkeys(request.handrails))
    task = Course(elements, sides, request.width_m).contact_task(effectors)
    head = {"robot": request.robot, "friction": request.friction, "name": request.name}
    return PlanContactsInput.model_validate({**head, **task})
