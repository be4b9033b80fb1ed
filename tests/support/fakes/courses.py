"""Courses as the pages see them: whatever the obstacles, the terrain and the stances of the fake scenario."""

from starlette.requests import Request
from starlette.responses import JSONResponse

from stridelab.schemas.plans import PlanContactsInput
from stridelab.schemas.scenarios import Course
from support.fakes.robots import scenario


async def compose(request: Request) -> JSONResponse:
    """``POST /scenarios/compose``."""
    course, walk = Course.model_validate(await request.json()), scenario()
    start, goal = ({"contacts": walk.phases[k].contacts} for k in (0, -1))
    fields = {"robot": course.robot, "terrain": walk.terrain, "start": start, "goal": goal, "name": course.name}
    return JSONResponse(PlanContactsInput.model_validate(fields).model_dump(mode="json"))
